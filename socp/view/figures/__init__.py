"""Figures of a solution: what is drawn, how it is arranged, how it looks."""
