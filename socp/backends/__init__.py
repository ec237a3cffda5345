"""Solvers behind one protocol: `socp.nlp.Backend`."""

from socp.backends.ipopt import Ipopt

__all__ = ["Ipopt"]
