"""A solution laid out for judging, with its switching functions and Hamiltonian affine in the unknown multipliers."""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from socp.adjoint import Costates, Samples, Unknowns
from socp.ends import Ends
from socp.problem import Problem
from socp.simulate import scales
from socp.solution import Solution


@final
@dataclass(frozen=True, eq=False)
class Along:
    """A solution laid out for judging: nodes, unknown multipliers, costates as functions of them, end slopes."""

    problem: Problem
    solution: Solution
    samples: Samples
    unknowns: Unknowns
    costates: Costates
    ends: Ends

    @property
    def horizon(self) -> float:
        """Length of the horizon."""
        return self.solution.final_time - self.solution.initial_time

    @cached_property
    def scale(self) -> np.ndarray:
        """Magnitude of every state (nx,)."""
        return scales(self.problem, self.solution)

    @cached_property
    def sigma(self) -> tuple[np.ndarray, np.ndarray]:
        """Switching functions as offset (nu, n) and matrix (nu, n, nz)."""
        v = self.samples.values
        offset = v["L1"] + np.einsum("njk,nj->kn", v["G"], self.costates.offset)
        return offset, np.einsum("njk,njz->knz", v["G"], self.costates.maps)

    @cached_property
    def hamiltonian(self) -> tuple[np.ndarray, np.ndarray]:
        """Hamiltonian as offset (n,) and matrix (n, nz)."""
        v = self.samples.values
        return v["L"] + np.einsum("jn,nj->n", v["f"], self.costates.offset), np.einsum(
            "jn,njz->nz", v["f"], self.costates.maps
        )
