"""The guess of a problem: what its file says, straight lines and the middle of the box
elsewhere.
"""

import itertools
from collections.abc import Iterator
from typing import Any

import casadi
import numpy as np

from socp.laws import guessed_ends, horizon
from socp.model import (
    Arc,
    Mode,
    Origin,
    Problem,
    Solution,
    Stop,
    Word,
    final_time,
    initial_time,
    numbers,
    scales,
    time,
)
from socp.verdict import misfit

_NODES = 101  # a guess that varies in time is sampled as finely as a plot would be


def default_guess(problem: Problem) -> Solution:
    """Return a straight-line guess with one arc: from start to end, controls as near to zero as
    their box allows.

    What the problem's own `guess` says takes precedence. A free final time is estimated from how
    fast the box of controls can move the states over the distance they have to go; where the ends
    ask for none, over that to the bounds of the states. Its arc has 101 nodes: t (101,), x (nx,
    101), u (nu, 101), in the problem's units.
    """
    first = _within(problem.guess.get(initial_time), problem.initial_time_box, 0.0)
    x0, xf = guessed_ends(problem)
    length = horizon(problem)
    last = _within(problem.guess.get(final_time), problem.final_time_box, first + length)
    if last <= first:
        last = first + length
    t = np.linspace(first, last, _NODES)
    share = np.linspace(0.0, 1.0, _NODES)
    x = x0[:, None] + (xf - x0)[:, None] * share
    u = np.repeat(np.clip(0.0, *problem.box)[:, None], _NODES, axis=1)
    p = {
        name: _within(None, tuple(box), 0.0)
        for name, box in zip(problem.parameter_names, problem.parameter_box.T, strict=True)
    }
    for symbol, value in problem.guess.items():
        if symbol.name() in problem.state_names and symbol in problem.dynamics:
            x[problem.state_names.index(symbol.name())] = _row(value, t, share)
        elif symbol.name() in problem.control_names:
            u[problem.control_names.index(symbol.name())] = _row(value, t, share)
        elif symbol.name() in p:
            p[symbol.name()] = float(_row(value, t, share)[0])
    return guess_of(problem, t, x, u, p)


def guess_of(
    problem: Problem, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: dict[str, float] | None = None
) -> Solution:
    """Return values at times t (n,), x (nx, n) and u (nu, n) as a piecewise linear guess of one
    arc.
    """
    return _guess(
        (_piecewise_linear(t, x, u, np.full_like(x, np.nan)),),
        problem=problem.name,
        state_names=problem.state_names,
        control_names=problem.control_names,
        parameters=p or {},
    )


def _piecewise_linear(t: np.ndarray, x: np.ndarray, u: np.ndarray, costate: np.ndarray) -> Arc:
    """Return an arc of free controls through values at times t (n,)."""
    mesh, modes = np.arange(t.size), (Mode("free"),) * u.shape[0]
    return Arc(t=t, x=x, u=u, costate=costate, mesh=mesh, side="both", modes=modes)


def _guess(arcs: tuple[Arc, ...], **of_problem: Any) -> Solution:
    """Return arcs as a solution that nobody solved for."""
    return Solution(
        origin=Origin(method="guess"),
        arcs=arcs,
        objective=float("nan"),
        stop=Stop.FAILED,
        message="a guess",
        **of_problem,
    )


def scattered_guesses(problem: Problem, guess: Solution, seed: int = 0) -> Iterator[Solution]:
    """Yield guesses without end, spread over what the problem's bounds and magnitudes allow, in
    opposite pairs.

    Every state leaves the given guess for a plateau up to its own magnitude away, every control is
    constant in its box, the horizon is up to twice or half as long; the second of a pair moves
    everything the other way.
    """
    random = np.random.default_rng(seed)
    t, x, sizes = guess.t, guess.rows("x"), scales(problem, guess)[:, None]
    share = (t - t[0]) / (t[-1] - t[0])
    plateau = (
        np.sin(np.pi * share) ** 0.25
    )  # near 1, but 0 at the ends: it leaves the given states there
    low, high = problem.box
    free = (
        problem.initial_time_box[0] < problem.initial_time_box[1]
        or np.ptp(problem.final_time_box) > 0
    )
    while True:
        row = random.uniform(-1.0, 1.0, x.shape[0] + low.size + 1)
        for side in (row, -row):
            states, controls = side[: x.shape[0], None], side[x.shape[0] : -1]
            moved = np.clip(x + sizes * states * plateau, *problem.state_box[:, :, None])
            u = np.repeat((low + (high - low) * (controls + 1.0) / 2.0)[:, None], t.size, axis=1)
            longer = 2.0 ** side[-1] if free else 1.0
            yield guess_of(problem, t[0] + (t - t[0]) * longer, moved, u, dict(guess.parameters))


def split(guess: Solution, lengths: list[float]) -> Solution:
    """Return a guess cut into arcs of the given relative or absolute lengths, rescaled to the
    guess's own horizon.
    """
    share = np.cumsum([0.0, *lengths]) / sum(lengths)
    corners = guess.initial_time + share * (guess.final_time - guess.initial_time)
    arcs = []
    for a, b in itertools.pairwise(corners):
        t = np.linspace(a, b, _NODES)
        arcs.append(_piecewise_linear(t, guess.at(t), guess.at(t, "u"), guess.at(t, "costate")))
    of_problem = ("problem", "state_names", "control_names", "parameters")
    return _guess(tuple(arcs), **{name: getattr(guess, name) for name in of_problem})


def guess_along(problem: Problem, solution: Solution, word: Word) -> Solution:
    """Return a solution as a guess with the arcs of a word, cut where its controls fit the word
    best.

    The cuts minimise the summed misfit of a uniform grid of intervals to the modes they fall into,
    by dynamic programming.
    """
    t = np.linspace(solution.initial_time, solution.final_time, 2 * _NODES + 1)[1::2]
    cost = np.array(
        [
            sum(misfit(problem, solution, i, mode, t) for i, mode in enumerate(arc))
            for arc in word.arcs
        ]
    )
    total = np.cumsum(cost, axis=1)
    best, cuts = total[0], []
    for row in total[1:]:  # best[n]: least misfit of the first n + 1 intervals to the arcs so far
        ahead = np.append(0.0, (best - row)[:-1])
        ahead[0] = np.inf  # every arc keeps one interval at least
        least = np.minimum.accumulate(ahead)
        cuts.append(np.maximum.accumulate(np.where(ahead == least, np.arange(t.size), 0)))
        best = least + row
    ends = [t.size - 1]
    for choice in reversed(cuts):
        ends.append(int(choice[ends[-1]]) - 1)
    return split(solution, np.diff([-1, *reversed(ends)]).clip(1).astype(float).tolist())


def _within(value: Any, box: tuple[float, float], otherwise: float) -> float:
    return float(np.clip(otherwise if value is None else float(value), *box))


def _row(value: Any, t: np.ndarray, share: np.ndarray) -> np.ndarray:
    if isinstance(value, (tuple, list, np.ndarray)):
        return float(value[0]) + (float(value[1]) - float(value[0])) * share
    return numbers(casadi.Function("guess", [time], [casadi.SX(value)]), t)[0].ravel()
