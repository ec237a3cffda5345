"""Motions as guesses: where a problem's controls, held constant, take it from its start."""

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np

from socp.methods.guess import guess_of
from socp.model import Problem, Solution, numbers, parameters_of, rate_function, shown_sizes
from socp.process import seconds_left
from socp.transcription import state_magnitudes

# Of the box: the ends of what a control can do and between; growth and decay balance anywhere
_LEVELS = (0.0, 0.25, 0.5, 0.75, 1.0)
_CORNERS = 2  # controls up to which every corner of the box is driven; of more, two of them
# Horizons tried, over the estimate, where the final time is free: it is of the right order, but
# swings and turns take several times as long as a straight way
_HORIZONS = (1.0, 2.0, 4.0, 8.0, 0.5, 0.25, 0.125)
_STEPS = 2000  # of the integrator: a motion that takes more is cut, a guess needs no more
_RTOL = 1e-6  # a guess needs no digits
# Times the magnitudes of states that ends or bounds show: what goes further has escaped, and holds
# there. Of others nothing is known: a product that begins with nothing may have no rate there
_AWAY = 1e3
_NODES = 201  # samples of a motion; growth over many e-foldings happens at the end


def motions(problem: Problem, guess: Solution, *, own: bool = False) -> Iterator[Solution]:
    """Yield the motions from the start of a guess with constant controls, for one horizon after the
    other; own: for that of the guess alone.

    They satisfy the dynamics, unlike straight lines, which stiff or growing motion is far from.
    Those that keep to the states' box go first; others are held in it, and stay where they escape.
    """
    for factor in horizons(problem)[: 1 if own else None]:
        length = factor * (guess.final_time - guess.initial_time)
        last = float(np.clip(guess.initial_time + length, *problem.final_time_box))
        if last > guess.initial_time:
            made = [_driven(problem, guess, level, last) for level in _levels(problem)]
            yield from (each for _, each in sorted(made, key=lambda pair: pair[0]))


def other_horizons(problem: Problem, guess: Solution) -> Iterator[Solution]:
    """Yield a guess over other horizons, from 1/8 to 8 times its own, where the final time is
    free.
    """
    t, t0 = guess.t, guess.initial_time
    for factor in horizons(problem)[1:]:
        times = t0 + factor * (t - t0)
        if problem.final_time_box[0] <= times[-1] <= problem.final_time_box[1]:
            x, u = guess.rows("x"), guess.rows("u")
            yield guess_of(problem, times, x, u, dict(guess.parameters))


def horizons(problem: Problem) -> tuple[float, ...]:
    """Return the horizons to try over the one that is guessed, that one first; alone where it is
    fixed.
    """
    low, high = problem.final_time_box
    return _HORIZONS if low < high else _HORIZONS[:1]


def _levels(problem: Problem) -> Iterator[np.ndarray]:
    low, high = problem.box
    shares = [np.full(low.size, each) for each in _LEVELS]
    if 1 < low.size <= _CORNERS:
        corners = map(np.array, product((0.0, 1.0), repeat=low.size))
        shares += [each for each in corners if np.ptp(each) > 0.0]
    yield from (low + share * (high - low) for share in shares)


def _driven(
    problem: Problem, guess: Solution, u: np.ndarray, last: float
) -> tuple[float, Solution]:
    """Return a motion held in the states' box, and how far it leaves that, relative to the states'
    magnitudes.
    """
    p = parameters_of(problem, guess)
    rate = rate_function(problem)
    sizes, x0 = state_magnitudes(problem, guess), guess.rows("x")[:, 0]
    limits = np.where(shown_sizes(problem, x0[:, None]) > 0.0, _AWAY * sizes, np.inf)

    def moved(t: float, x: np.ndarray) -> np.ndarray:
        return numbers(rate, x, u, t, p)[0].ravel()

    t = np.linspace(guess.initial_time, last, _NODES)
    with np.errstate(all="ignore"):  # towards a pole
        x = _integrated(moved, t, x0, sizes, limits)
    inside = np.clip(x, *problem.state_box[:, :, None])
    beyond = float((np.abs(x - inside) / sizes[:, None]).max())
    return beyond, guess_of(
        problem, t, inside, np.repeat(u[:, None], _NODES, axis=1), dict(guess.parameters)
    )


def _integrated(
    moved: Callable[[float, np.ndarray], np.ndarray],
    t: np.ndarray,
    x0: np.ndarray,
    sizes: np.ndarray,
    limits: np.ndarray,
) -> np.ndarray:
    """Return the states (nx, n) of a motion at times (n,); where it leaves its limits (nx,), is
    cut, or the time allowed ends it, it stays.
    """
    x = np.repeat(x0[:, None], t.size, axis=1)
    if not np.isfinite(moved(t[0], x0)).all():
        return x
    from scipy.integrate import BDF  # where a problem asks for it

    steps = BDF(moved, t[0], x0, t[-1], rtol=_RTOL, atol=_RTOL * _RTOL * sizes)
    for _ in range(_STEPS):
        try:
            steps.step()
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):
            break
        if seconds_left() <= 0.0:
            break
        if steps.status == "failed" or not (np.abs(steps.y) <= limits).all():
            break
        new = (t > steps.t_old) & (t <= steps.t)
        x[:, new] = steps.dense_output()(t[new])
        x[:, t > steps.t] = steps.y[:, None]
        if steps.status == "finished":
            break
    return x
