"""Both ends of a problem as far as they can be guessed, and how long the way between them takes."""

from typing import Any, NamedTuple

import casadi
import numpy as np

from socp.model import (
    Problem,
    column,
    final_time,
    initial_time,
    mayer_function,
    numbers,
    of_motion,
    once,
    rate_function,
    repeated,
    running_costs,
    shown_sizes,
    time,
)


@once
def guessed_ends(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Return guessed states at both ends: the given value, that of the other end, or the nearest to
    zero in the box.
    """
    box = problem.state_box
    found = []
    for own, other in ((problem.start_box, problem.end_box), (problem.end_box, problem.start_box)):
        middle = np.where(
            np.isfinite(other).all(axis=0),
            np.nan_to_num(other, posinf=0.0, neginf=0.0).mean(axis=0),
            0.0,
        )
        found.append(np.clip(np.clip(middle, *own), *box))
    ends = found[0], _reach(problem, *found)
    for each in ends:
        each.setflags(write=False)  # shared by all who ask
    return ends


def travel_time(problem: Problem, x0: np.ndarray, xf: np.ndarray, t0: float) -> float:
    """Estimate the time from x0 (nx,) to xf (nx,): |x'| T + |x''| T^2 / 2 = |xf - x0| for the
    slowest state.

    Rates and their derivatives are taken over samples of the line between the ends, of bounded
    states within their bounds and of the box of controls. Returns 1 where nothing moves.
    """
    rate = problem.rate
    second = casadi.jtimes(rate, problem.x, rate) + casadi.jacobian(rate, time)
    function = casadi.Function("rates", [problem.x, problem.u, time, problem.p], [rate, second])
    random = np.random.default_rng(0)
    count = 200  # enough to meet the order of magnitude; the guess needs no more
    share = random.random(count)
    x = x0[:, None] + (xf - x0)[:, None] * share
    bounded = np.isfinite(problem.state_box).all(axis=0)
    low, high = problem.state_box[:, bounded]
    x[bounded] = low[:, None] + (high - low)[:, None] * random.random((int(bounded.sum()), count))
    u = problem.box[
        random.integers(0, 2, (problem.box.shape[1], count)),
        np.arange(problem.box.shape[1])[:, None],
    ]
    p = np.clip(np.zeros(problem.p.numel()), *problem.parameter_box)
    first, curve = (np.nanmax(np.abs(each), axis=1) for each in numbers(function, x, u, t0, p))
    distance = np.abs(xf - x0)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = 2.0 * distance / (first + np.sqrt(first**2 + 2.0 * curve * distance))
    needed = needed[np.isfinite(needed) & (needed > 0)]
    # a state that these samples hardly move (one that a heading across the line would move) says
    # nothing
    return float(needed[needed <= 1e3 * needed.min()].max()) if needed.size else 1.0


def _reach(problem: Problem, x0: np.ndarray, xf: np.ndarray) -> np.ndarray:
    """Move a guessed end state (nx,) within its box until it meets the target conditions, by
    Gauss-Newton.

    States of like sizes are taken to be of one unit, others are measured by their sizes there.
    """
    if not problem.conditions:
        return xf
    values = column(
        c.expression if c.equation else casadi.fmax(c.expression, 0) for c in problem.conditions
    )
    start = [problem.x0, problem.p, initial_time, final_time]
    function = casadi.Function(
        "target", [problem.x, *start], [values, casadi.jacobian(values, problem.x)]
    )
    shown = shown_sizes(problem, np.column_stack([x0, xf]))
    size, free = np.where(shown > 0, shown, 1.0), problem.end_box[0] < problem.end_box[1]
    parts = enumerate(casadi.vertsplit(problem.x))
    touched = [k for k, each in parts if casadi.depends_on(values, each)]
    apart = size[touched].max(initial=0.0) > size[touched].min(initial=np.inf) / _SMALL
    for _ in range(
        30
    ):  # Newton from afar halves a quadratic's distance at every step: 30 cover nine digits
        value, slope = numbers(function, xf, x0, np.zeros(problem.p.numel()), 0.0, 1.0)
        if not np.isfinite(value).all() or not np.isfinite(slope).all():
            break
        movable = free * (np.maximum(np.abs(xf), _SMALL * size) if apart else 1.0)
        step = movable * np.linalg.lstsq(slope * movable, value[:, 0], rcond=1e-15)[0]
        before, xf = xf, np.clip(xf - step, *problem.end_box)
        if np.array_equal(before, xf):
            break
    return xf


# Of the size that its start, end and bounds show: a state near zero may move by as much at once
_SMALL = 1e-2
_STEPS = 16  # of the simulations that spread the points over what the controls can reach
_DRAWS = 4  # constant controls in one simulation
# Of the way: where half the step changes a simulation by more, it is not resolved: stiff, or
# escaping
_ROUGH = 0.2
_ESCAPED = (
    30.0  # times the size that ends, bounds and rates show: beyond it a state is not the problem's
)
_SHORTER = 0.25  # what the time of a simulation that is rough or escapes is multiplied with
_TRIALS = 14  # times that a simulation is shortened: to some 1e-8 of the horizon
# Of the typical way, by which points are moved off the motions: these may have an invariant; of a
# state's size, how far around its start is
_STRAY = 0.1
# Of the size that ends, bounds and rates show: a state that stays below it is taken for as large as
# these, it is rounding
_NONE = 1e-9

Generator = np.random.Generator


class _Runs(NamedTuple):
    """Simulations to come: starts (nx, n), first time, parameters (np, n), bang controls of every
    quarter (nu, n).
    """

    x0: np.ndarray
    t0: float
    p: np.ndarray
    bangs: list[np.ndarray]


def reachable_points(problem: Problem, count: int) -> np.ndarray:
    """Return points (nv, count): t, x, p, costate and controls, the states within their bounds and
    not on them.

    A motion that leaves the sizes that the problem shows, by escaping in finite time or by a step
    too long for a stiff one, is followed for a shorter time.
    """
    random = np.random.default_rng(0)
    x0, p = _starts(problem, count, random), draw(problem.parameter_box, count, random)
    t0 = problem.initial_time_box[0] if np.isfinite(problem.initial_time_box[0]) else 0.0
    whole = horizon(problem)
    runs = _Runs(x0, t0, p, [_bangs(problem, count, random) for _ in range(_DRAWS)])
    known = _sizes(problem, runs, whole)
    x, lengths = _tame(problem, runs, known, whole * random.uniform(0.05, 1.0, count))
    moved = np.median(np.abs(x - x0), axis=1, keepdims=True)
    moved = np.where(moved > 0, moved, np.abs(x - x0).mean(axis=1, keepdims=True))
    x = _inside(problem, x + _STRAY * moved * random.standard_normal(x.shape))
    size = np.sqrt(np.mean(x**2, axis=1, keepdims=True))
    known = np.where(known > 0, known, 1.0)
    size = np.where(size > _NONE * known, size, known)
    t = t0 + lengths
    costate = random.standard_normal(x.shape) * _worth(problem, runs, x, t, whole) / size
    return np.vstack([t[None, :], x, p, costate, _bangs(problem, count, random)])


@once
def horizon(problem: Problem) -> float:
    """Return the fixed or guessed horizon, else an estimate of the time that the way takes, within
    its interval.

    The way is that to the ends; where these ask for none, that to the bounds of the states.
    """
    low, high = problem.final_time_box
    first = problem.initial_time_box[0] if np.isfinite(problem.initial_time_box[0]) else 0.0
    guess: Any = problem.guess.get(final_time)
    if low == high:
        return low - first
    if guess is not None:
        return max(float(guess) - first, 1e-9)
    x0, xf = guessed_ends(problem)
    if np.array_equal(x0, xf):
        sides = np.where(np.isfinite(problem.state_box), problem.state_box, x0)
        xf = np.where(np.abs(sides[1] - x0) >= np.abs(sides[0] - x0), sides[1], sides[0])
    return float(np.clip(travel_time(problem, x0, xf, first), *_lengths(low - first, high - first)))


def draw(box: np.ndarray, count: int, random: Generator) -> np.ndarray:
    """Draw values (n, count) from intervals (2, n); an open end is put one size of the other one
    away.
    """
    low, high = box
    reach = (
        np.nan_to_num(
            np.where(np.isfinite(low), np.abs(low), 0.0)
            + np.where(np.isfinite(high), np.abs(high), 0.0)
        )
        + 1.0
    )
    first = np.where(np.isfinite(low), low, np.where(np.isfinite(high), high, 0.0) - reach)
    last = np.where(np.isfinite(high), high, np.where(np.isfinite(low), low, 0.0) + reach)
    values: np.ndarray = first[:, None] + (last - first)[:, None] * random.random((low.size, count))
    return values


def _lengths(low: float, high: float) -> tuple[float, float]:
    """Return the interval of horizons; one that starts at nothing, or never ends, leaves the
    estimate as it is.
    """
    return (
        max(low, 0.0) if np.isfinite(low) else 0.0,
        high if np.isfinite(high) and high > 0 else np.inf,
    )


def _tame(
    problem: Problem, runs: _Runs, known: np.ndarray, lengths: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return states (nx, n) and times (n,) of motions that are resolved and do not escape sizes
    (nx, 1) that are known: others are shortened.
    """
    x, followed, wild = runs.x0.copy(), np.zeros_like(lengths), np.ones(lengths.size, dtype=bool)
    for _ in range(_TRIALS):
        coarse, fine = (_simulated(problem, runs, lengths, steps) for steps in (_STEPS, 2 * _STEPS))
        with np.errstate(all="ignore"):
            moved, gap = np.abs(fine - runs.x0), np.abs(fine - coarse)
            moved[~np.isfinite(moved)] = np.inf
            typical = np.median(moved, axis=1, keepdims=True)
            limit = _ESCAPED * np.where(known > 0, known, typical)
            tame = (np.isfinite(fine) & (moved <= limit) & (gap <= _ROUGH * (moved + typical))).all(
                axis=0
            )
        taken = wild & tame
        x[:, taken], followed[taken] = fine[:, taken], lengths[taken]
        wild &= ~tame
        if not wild.any():
            break
        lengths = np.where(wild, _SHORTER * lengths, lengths)
    return x, followed


def _sizes(problem: Problem, runs: _Runs, whole: float) -> np.ndarray:
    """Return how large every state (nx, 1) is by its ends and bounds, and by its rate at the start
    over the horizon, 0 where neither shows it.

    A rate is none where it is rounding against what it is around the start: the cosine of a heading
    straight across is 6e-17.
    """

    def rate(x: np.ndarray) -> np.ndarray:
        found = np.abs(numbers(rate_function(problem), x, runs.bangs[0], runs.t0, runs.p)[0])
        most: np.ndarray = np.where(np.isfinite(found), found, 0.0).max(axis=1)
        return most

    shown, here = shown_sizes(problem, runs.x0), rate(runs.x0)
    span = np.maximum(shown, here * whole)[:, None]
    around = np.maximum(rate(runs.x0 + _STRAY * span), rate(runs.x0 - _STRAY * span))
    here = np.where(here > _NONE * around, here, 0.0)
    result: np.ndarray = np.maximum(shown, here * whole)[:, None]
    return result


def _simulated(problem: Problem, runs: _Runs, lengths: np.ndarray, steps: int) -> np.ndarray:
    """Integrate the bang controls for times `lengths` (n,) by Runge-Kutta, states (nx, n) kept
    within their bounds.
    """
    h = (lengths / steps)[:, None]
    u = np.repeat([bangs.T for bangs in runs.bangs], steps // _DRAWS, axis=0)
    t = runs.t0 + h * np.arange(steps)[:, None, None]
    with np.errstate(all="ignore"):
        (found,) = repeated(_step(problem), [runs.x0.T], [u, t, h, runs.p.T], steps)
    last: np.ndarray = found[-1].T
    return last


@of_motion
@once
def _step(problem: Problem) -> casadi.Function:
    """Return a step of Runge and Kutta's method of order 4, and back into the bounds of states, as
    a function of x, u, t, h, p.
    """
    x, u, p, h = problem.x, problem.u, problem.p, casadi.SX.sym("h")
    flow = rate_function(problem)
    a = flow(x, u, time, p)
    b = flow(x + h / 2 * a, u, time + h / 2, p)
    c = flow(x + h / 2 * b, u, time + h / 2, p)
    d = flow(x + h * c, u, time + h, p)
    after = casadi.densify(x + h / 6 * (a + 2 * b + 2 * c + d))
    for k, (low, high) in enumerate(problem.state_box.T):  # what is no number stays none
        if np.isfinite(low):
            after[k] = casadi.if_else(after[k] < low, low, after[k])
        if np.isfinite(high):
            after[k] = casadi.if_else(after[k] > high, high, after[k])
    return casadi.Function("step", [x, u, time, h, p], [after])


def _inside(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Mirror states (nx, n) at their bounds: on a bound much vanishes that does not elsewhere."""
    low, high = (side[:, None] for side in problem.state_box)
    with np.errstate(invalid="ignore"):
        x = np.where(x < low, 2 * low - x, x)
        x = np.where(x > high, 2 * high - x, x)
    inside: np.ndarray = np.clip(x, low, high)
    return inside


def _starts(problem: Problem, count: int, random: Generator) -> np.ndarray:
    known = draw(problem.start_box, count, random)
    other = draw(problem.end_box, count, random)
    open_ = ~np.isfinite(problem.start_box).all(axis=0)
    low, high = problem.state_box
    starts: np.ndarray = np.clip(
        np.where(open_[:, None], other, known), low[:, None], high[:, None]
    )
    return starts


def _bangs(problem: Problem, count: int, random: Generator) -> np.ndarray:
    side = random.integers(0, 2, (problem.box.shape[1], count))
    sides: np.ndarray = np.where(side == 1, problem.box[1][:, None], problem.box[0][:, None])
    return sides


def _worth(problem: Problem, runs: _Runs, x: np.ndarray, t: np.ndarray, whole: float) -> float:
    """Return the typical objective of bangs over points (nx, n) at times (n,): costates are
    measured by it.

    Where there is none, the horizon.
    """
    running = running_costs(problem, x, runs.bangs[-1], t, runs.p)
    (mayer,) = numbers(mayer_function(problem), x, runs.x0, runs.p, runs.t0, t)
    return (_typical(running) * whole + _typical(mayer)) or whole


def _typical(values: np.ndarray) -> float:
    found = np.abs(values[np.isfinite(values)])
    return (float(np.median(found)) or float(found.mean())) if found.size else 0.0
