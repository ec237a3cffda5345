"""Starts spread over guesses, words and meshes: start number k is the same however many there
are.
"""

from dataclasses import dataclass
from itertools import islice
from typing import final

import numpy as np

from socp.methods import default_guess, guess_of, scattered_guesses
from socp.model import Problem, Solution, rate_function, scales
from socp.transcription import Mesh, euler, radau_iia, uniform

RECIPE = 1  # of the starts below: kept starts of another recipe are worth nothing
_STEPS = 200  # of the integration of a guess, which needs no digits
_ARCS = 5  # of a guessed word, at most
_INSIDE = 0.4  # share of its arcs on which a control is neither at its lower nor at its upper bound
_FAR = 3.0  # times their own magnitude: no guess leads the states any further


@final
@dataclass(frozen=True, eq=False)
class Start:
    """Where a solve begins: its number, its guess, its first mesh, and both in words."""

    number: int
    guess: Solution
    mesh: Mesh
    about: str


def start(problem: Problem, number: int) -> Start:
    """Return a start: number 0 is the default guess, odd ones move along random words, the others
    are scattered.
    """
    guess, about = default_guess(problem), "default guess"
    if number % 2:
        guess, about = motion(problem, guess, number), "random word"
    elif number:
        pair, side = divmod(number // 2 - 1, 2)
        guess, about = (
            next(islice(scattered_guesses(problem, guess, pair), side, None)),
            "scattered guess",
        )
    if number // 2 % 2:
        mesh, name = uniform(euler(), 150), "implicit Euler, 150 steps"
    else:
        mesh, name = uniform(radau_iia(2), 50), "Radau IIA, 50 intervals"
    return Start(number, guess, mesh, f"{about}; {name}")


def motion(problem: Problem, guess: Solution, seed: int) -> Solution:
    """Return the motion from where a guess starts, its controls held at random levels on the arcs
    of a random word.

    The states are kept within their bounds and a few times their magnitudes; a free horizon is up
    to twice or half as long as the guess's.
    """
    random = np.random.default_rng([seed, RECIPE])
    first, last = guess.initial_time, guess.final_time
    fixed = (
        problem.initial_time_box[0] == problem.initial_time_box[1]
        and np.ptp(problem.final_time_box) == 0
    )
    longer = 1.0 if fixed else 2.0 ** random.uniform(-1.0, 1.0)
    t = np.linspace(first, first + (last - first) * longer, _STEPS + 1)
    count = int(random.integers(1, _ARCS + 1))
    ends = np.sort(random.uniform(0.0, _STEPS, count - 1))
    u = _levels(problem, random, count)[:, np.searchsorted(ends, np.arange(_STEPS + 1))]
    return guess_of(problem, t, _integrated(problem, guess, t, u), u, dict(guess.parameters))


def _levels(problem: Problem, random: np.random.Generator, count: int) -> np.ndarray:
    """Return what the controls are held at on every arc (nu, count): a bound, or anywhere inside
    the box.
    """
    low = np.where(
        np.isfinite(problem.box[0]), problem.box[0], np.minimum(problem.box[1], 0.0) - 1.0
    )
    high = np.where(np.isfinite(problem.box[1]), problem.box[1], np.maximum(low, 0.0) + 1.0)
    low = np.where(np.isfinite(low), low, high - 2.0)
    shape = (low.size, count)
    share = np.where(
        random.random(shape) < _INSIDE, random.random(shape), random.integers(0, 2, shape)
    )
    levels: np.ndarray = low[:, None] + (high - low)[:, None] * share
    return levels


def _integrated(problem: Problem, guess: Solution, t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the states (nx, n) at times t (n,) under controls u (nu, n), by the midpoint rule,
    kept within bounds.
    """
    p = [guess.parameters.get(name, 0.0) for name in problem.parameter_names]
    rate = rate_function(problem)
    far = _FAR * scales(problem, guess)
    low, high = np.maximum(problem.state_box[0], -far), np.minimum(problem.state_box[1], far)
    x = np.empty((problem.x.numel(), t.size))
    x[:, 0] = np.clip(guess.rows("x")[:, 0], low, high)
    for k, h in enumerate(np.diff(t)):
        half = x[:, k] + h / 2.0 * rate(x[:, k], u[:, k], t[k], p).full()[:, 0]
        step = h * rate(np.clip(half, low, high), u[:, k], t[k] + h / 2.0, p).full()[:, 0]
        x[:, k + 1] = np.clip(np.where(np.isfinite(step), x[:, k] + step, x[:, k]), low, high)
    return x
