"""Values along a solution for whoever looks at it: states, controls, costates, switching functions,
Hamiltonian.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, final

import numpy as np

from socp.model import TINY, Arc, lagrange

if TYPE_CHECKING:
    from socp.model import Problem, Solution

_FINEST, _LEAST = (
    200,
    40,
)  # points an interval at most, steps an arc at least: enough to look smooth


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Traces:
    """Values at times t (n,) along a solution, in the problem's units; a time at which something
    jumps stands twice.

    arc (n,): index of the arc; x (nx, n), u (nu, n), costate (nx, n); switching (nu, n): sigma =
    dH/du; hamiltonian (n,); by name of the state constraint: `constraints` c <= 0 (n,) and the
    densities `multipliers` (n,). What is not known is nan: costates that the method does not give,
    and whatever follows from them.
    """

    t: np.ndarray
    arc: np.ndarray
    x: np.ndarray
    u: np.ndarray
    costate: np.ndarray
    switching: np.ndarray
    hamiltonian: np.ndarray
    constraints: Mapping[str, np.ndarray] = field(default_factory=dict)
    multipliers: Mapping[str, np.ndarray] = field(default_factory=dict)


def traces(problem: "Problem | None", solution: "Solution") -> Traces:
    """Return the values at the nodes of a solution, `solution.t`; without a problem what only it
    can tell is nan.
    """
    arcs, names = solution.arcs, _constrained(problem)
    own = [
        {name: arc.multipliers.get(name, np.full(arc.t.size, np.nan)) for name in names}
        for arc in arcs
    ]
    multipliers = {name: np.concatenate([each[name] for each in own]) for name in names}
    arc = np.repeat(np.arange(len(arcs)), [each.t.size for each in arcs])
    x, u, costate = (solution.rows(which) for which in ("x", "u", "costate"))
    return _completed(
        problem,
        solution,
        {"t": solution.t, "arc": arc, "x": x, "u": u, "costate": costate},
        multipliers,
    )


def sampled(problem: "Problem | None", solution: "Solution", points: int = 1000) -> Traces:
    """Return the values of the polynomials of a solution at about `points` times, the ends of all
    intervals twice.

    So a control that jumps where two intervals meet has both of its values there. Short arcs have
    `_LEAST` steps too.
    """
    step = (solution.final_time - solution.initial_time) / points
    parts = [_sampled(arc, min(step, float(np.ptp(arc.t)) / _LEAST)) for arc in solution.arcs]
    found = {
        name: np.concatenate([part[name] for part in parts], axis=-1)
        for name in ("t", "x", "u", "costate")
    }
    found["arc"] = np.repeat(np.arange(len(parts)), [part["t"].size for part in parts])
    pairs = list(zip(solution.arcs, parts, strict=True))
    multipliers = {
        name: np.concatenate(
            [_density(arc, name, part["t"], part["middle"]) for arc, part in pairs]
        )
        for name in _constrained(problem)
    }
    return _completed(problem, solution, found, multipliers)


def _constrained(problem: "Problem | None") -> list[str]:
    return [] if problem is None else [each.name for each in problem.constraints]


def _sampled(arc: Arc, step: float) -> dict[str, np.ndarray]:
    """Return t (n,), x, u and costate (rows, n) of an arc at steps of about `step`, both ends of
    every interval.
    """
    ends = arc.t[arc.mesh]
    counts = [
        int(np.clip(np.ceil(length / max(step, TINY)) + 1, 2, _FINEST)) for length in np.diff(ends)
    ]
    t = np.concatenate(
        [np.linspace(a, b, n) for a, b, n in zip(ends[:-1], ends[1:], counts, strict=True)]
    )
    middle = np.repeat(0.5 * (ends[:-1] + ends[1:]), counts)  # an interval's own side of its ends
    return {
        "t": t,
        "middle": middle,
        **{which: arc.at(t, which, middle) for which in ("x", "u", "costate")},
    }


def _density(arc: Arc, name: str, t: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Return the density of a multiplier at times t (n,): on every interval through the nodes that
    have one.
    """
    values = arc.multipliers.get(name, np.full(arc.t.size, np.nan))
    out, k = np.full(t.size, np.nan), np.searchsorted(arc.t[arc.mesh], middle, side="right") - 1
    for interval in range(len(arc.mesh) - 1):
        nodes, here = arc.nodes(interval), k == interval
        known = np.isfinite(values[nodes])
        if known.any() and here.any():
            out[here] = lagrange(arc.t[nodes][known], values[None, nodes][:, known], t[here])[0]
    return out


def _completed(
    problem: "Problem | None",
    solution: "Solution",
    found: dict[str, Any],
    multipliers: Mapping[str, np.ndarray],
) -> Traces:
    """Work out what follows from states, controls and costates."""
    if problem is None:
        unknown = np.full(found["t"].size, np.nan)
        return Traces(**found, switching=np.full(found["u"].shape, np.nan), hamiltonian=unknown)
    import casadi

    from socp.model import column, evaluate, parameters_of, time

    constraints = column(each.expression for each in problem.constraints)
    symbols = [problem.x, problem.u, problem.costate, time, problem.p]
    results = [
        casadi.densify(each) for each in (problem.switching, problem.hamiltonian, constraints)
    ]
    given = found["x"], found["u"], found["costate"], found["t"], parameters_of(problem, solution)
    switching, hamiltonian, c = evaluate(casadi.Function("along", symbols, results), *given)
    named = {each.name: c[k] for k, each in enumerate(problem.constraints)}
    return Traces(
        **found,
        switching=switching,
        hamiltonian=hamiltonian[0],
        constraints=named,
        multipliers=multipliers,
    )
