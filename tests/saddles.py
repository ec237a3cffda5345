"""Words with a switch whose objective is known in closed form: minima and maxima of the principle's
own conditions.
"""

from dataclasses import replace
from math import exp

from socp import (
    Ipopt,
    Problem,
    Solution,
    Word,
    controls,
    default_guess,
    initial,
    judge,
    solve_collocated,
    states,
    uniform,
)
from socp.methods.guess import split
from socp.methods.solving import Follower
from socp.transcription import follow
from socp.transcription.schemes import lgr

HORIZON = 3.0


def saddle(k: float, a: float = 0.0, tilt: float = 0.0) -> Problem:
    """Minimise -y(3) - k/2 x(3)^2 + tilt x(3) with y' = x, x' = u + a x from rest."""
    y, x = states("y x")
    u = controls("u")
    return Problem(
        name="saddle",
        minimise=-y - k / 2 * x**2 + tilt * x,
        dynamics={y: x, x: u + a * x},
        bounds={u: (-1, 1)},
        start={y: 0, x: 0},
        final_time=HORIZON,
    )


def slope(s: float, k: float, a: float) -> float:
    """Return dJ/ds of the word `+ -` with its switch at s, for a != 0.

    x(3) = (2 e^(a r) - e^(3 a) - 1) / -a with r = 3 - s, and dx/ds = 2 e^(a (t - s)) after the
    switch, so that dy(3)/ds = 2 (e^(a r) - 1) / a.
    """
    r = HORIZON - s
    x = (exp(a * HORIZON) - 2 * exp(a * r) + 1) / a
    return -2 * (exp(a * r) - 1) / a - k * x * 2 * exp(a * r)


def held(problem: Problem, text: str, lengths: list[float]) -> Solution:
    """Return a word with all arcs but the last held at given lengths, judged."""
    word = Word.parse(text, problem.control_names)
    phased = follow(problem, word)
    phases = tuple(
        replace(phase, length=(length, length))
        for phase, length in zip(phased.phases, lengths, strict=False)
    )
    phased = replace(phased, phases=(*phases[:-1], phased.phases[-1]))
    guess = split(default_guess(problem), lengths)
    meshes = [uniform(lgr(10), 2)] * len(lengths)
    return judge(problem, solve_collocated(phased, meshes, Ipopt({"tol": 1e-11}), guess))


def along(
    problem: Problem, text: str, lengths: list[float], guess: Solution | None = None
) -> Solution:
    """Return a word solved from given lengths, judged."""
    word = Word.parse(text, problem.control_names)
    return judge(
        problem, Follower()(problem, word, guess or split(default_guess(problem), lengths))
    )


def thrown() -> Problem:
    """Minimise (c + 1)^2 + x^2/10 - 33/10 x + v^2/2 at the end with x' = v, v' = u from x = 0, the
    initial speed c free.

    Along `+ -` with its switch at s, v(3) = c + 2 s - 3, x(3) = 3 c + 6 s - s^2 - 9/2: stationary
    at s = 2, c = 1 with v = 2, x = 13/2, and J_ss = 44/5, J_sc = 16/5, J_cc = 24/5.
    """
    x, v = states("x v")
    u = controls("u")
    return Problem(
        name="thrown",
        minimise=(initial(v) + 1) ** 2 + 0.1 * x**2 - 3.3 * x + 0.5 * v**2,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1)},
        start={x: 0},
        final_time=HORIZON,
        guess={v: 1},
    )
