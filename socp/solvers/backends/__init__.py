"""Solvers of nonlinear programmes, one a file, and the table of their names."""
