"""Solvers of nonlinear programmes that the searches and methods may be given, and their table."""
