"""No kind of minimum is claimed that is none: extremals of one switch whose objective is known in
closed form, and variations of the lengths of certified words.
"""

from math import exp

import numpy as np
import pytest
from saddles import HORIZON, held, saddle, slope
from scipy.optimize import brentq
from test_never_wrong import WORDS, right
from test_perturbed import WORDS as STRONG

from socp.model.ladder.second_order import Minimum
from socp.registry import Registry
from socp.verdict.accuracy import word_problem
from socp.verdict.minimum.induced import CLEAR, Induced, Pair, induced
from socp.verdict.minimum.order import second_order
from socp.verdict.newton import settled


def objective(s: float, k: float, a: float) -> float:
    """Return -y(3) - k/2 x(3)^2 of the word `+ -` with its switch at s and x' = u + a x, a != 0.

    x = (e^(a t) - 1)/a to the switch, then 1/a + (x(s) - 1/a) e^(a (t - s)).
    """
    r, at = HORIZON - s, (exp(a * s) - 1) / a
    x = 1 / a + (at - 1 / a) * exp(a * r)
    y = ((exp(a * s) - 1) / a - s) / a + r / a + (at - 1 / a) * (exp(a * r) - 1) / a
    return -y - k / 2 * x**2


def stationary(k: float, a: float) -> list[float]:
    """Return all switches at which the objective is stationary, well inside the horizon."""
    looks = np.linspace(0.1, HORIZON - 0.1, 400)
    values = [slope(float(s), k, a) for s in looks]
    ends = np.flatnonzero(np.sign(values[:-1]) != np.sign(values[1:]))
    return [brentq(slope, looks[i], looks[i + 1], args=(k, a), xtol=1e-14) for i in ends]


def test_the_closed_forms_are_one_another_s_derivatives() -> None:
    for k, a, s in ((2.0, 0.3, 1.1), (-1.5, -0.4, 2.0), (0.7, 0.9, 0.5)):
        difference = (objective(s + 1e-5, k, a) - objective(s - 1e-5, k, a)) / 2e-5
        assert slope(s, k, a) == pytest.approx(difference, rel=1e-8)


FEW, MORE = 4, 36  # problems drawn, of the fast and of the slow tests


@pytest.mark.parametrize(
    "seed", [*range(FEW), *(pytest.param(n, marks=pytest.mark.slow) for n in range(FEW, MORE))]
)
def test_a_maximum_is_never_called_a_minimum(seed: int) -> None:
    """Weights from -6 to 6 and drifts from -0.6 to 0.6: what is claimed of every stationary switch
    is what the closed form says beside it.
    """
    rng = np.random.default_rng(seed)
    k, a = rng.uniform(-6, 6), rng.uniform(-0.6, 0.6)
    for switch in stationary(k, a):
        here = objective(switch, k, a)
        beside = [objective(switch + d, k, a) - here for d in (-1e-3, 1e-3)]
        if not min(abs(each) for each in beside) > 1e-9:
            continue
        problem = saddle(k, a)
        solution = held(problem, "u: + -", [switch, HORIZON - switch])
        assert solution.objective == pytest.approx(here, rel=1e-9, abs=1e-9)
        if not solution.extremal:  # the switching function has another sign, or zero, somewhere
            continue
        found = second_order(problem, solution)
        if min(beside) > 0:
            assert found.kind is Minimum.STRONG, (k, a, switch)
        else:
            assert found.kind is Minimum.NONE, (k, a, switch)
            assert found.descent is not None
            moved = objective(switch + found.descent.times[1], k, a) - here
            assert found.descent.found == pytest.approx(moved, rel=1e-4)


def test_extremals_of_both_kinds_are_among_them() -> None:
    kinds = set()
    for seed in range(FEW + 4):
        rng = np.random.default_rng(seed)
        k, a = rng.uniform(-6, 6), rng.uniform(-0.6, 0.6)
        for switch in stationary(k, a):
            kinds.add(objective(switch + 1e-3, k, a) > objective(switch, k, a))
    assert kinds == {True, False}


def test_every_registered_problem_is_among_the_words() -> None:
    """But for the one that chatters, which has no word."""
    assert set(WORDS) == set(Registry.load().entries) - {"fuller"}


def values(found: Induced, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return equations (m, k) and Lagrangian (k,) of a word at many variables w (n, k)."""
    shooting, count = found.conditions.shooting, w.shape[1]
    joined, cost = (each.full() for each in shooting.joined[0].map(count)(w)[:2])
    equations, objective = np.zeros((shooting.signs.size, count)), cost[0]
    equations[shooting.others] = joined - shooting.levels[:, None]
    first = 1 + len(shooting.pairs)
    p = w[first : first + shooting.phased.of.p.numel()]
    for k, (block, motion) in enumerate(zip(shooting.blocks, shooting.motions, strict=True)):
        z = w[block.variables]  # (intervals + 1, nz, k)
        shares = block.shares[:, None]
        t, h = w[: 1 + k].sum(axis=0) + w[1 + k] * shares[:-1], w[1 + k] * np.diff(shares, axis=0)
        given = [z[:-1].swapaxes(0, 1).reshape(z.shape[1], -1), t.ravel(), h.ravel()]
        ended = motion.moved(*given, np.tile(p, len(h)), shooting.steps[k])[-1]
        ends = ended[:-2].reshape(z.shape[1], len(h), count).swapaxes(0, 1)
        equations[block.equations] = ends - z[1:]
        objective = objective + ended[-2].reshape(len(h), count).sum(axis=0)
    return equations, objective + found.held @ equations


def brought_back(found: Induced, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return variables w (n, k) moved onto the conditions, by Newton with the slopes of the
    extremal, and the objective (k,), nan where that does not end.
    """
    size, lengths = found.conditions.size, slice(1, 1 + len(found.conditions.shooting.pairs))
    back = np.linalg.pinv(found.slopes * size)
    w, objective, going = w.copy(), np.full(w.shape[1], np.nan), np.arange(w.shape[1])
    for _ in range(30):
        equations, objective[going] = values(found, w[:, going])
        step = back @ equations
        w[:, going] -= size[:, None] * step
        far = np.abs(step).max(axis=0)
        lost = ~(np.isfinite(far) & (far < 1.0) & (w[lengths, going] > 0.0).all(axis=0))
        objective[going[lost]] = np.nan
        going = going[~lost & ~(far < 1e-9)]  # the Lagrangian knows the objective to its square
        if not going.size:
            break
    objective[going] = np.nan
    return w, objective


SOON = ("jacobson_1", "fishery_discounted")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in SOON else pytest.mark.slow) for name in WORDS]
)
def test_no_other_lengths_of_a_word_do_better(name: str) -> None:
    """200 random changes of arc lengths, times, parameters and free states of sizes 1e-1 to 1e-4,
    brought back onto the conditions at the ends: none lowers an objective that is said to be a
    minimum of its word.
    """
    problem, _, solution = right(name)
    kind = second_order(problem, solution).kind
    assert kind.shown
    # these are asked of all controls, those of other words too, in `test_perturbed`
    assert (kind is Minimum.STRONG) == (name in STRONG)
    pair = induced(problem, solution)
    assert isinstance(pair, Pair)
    found, rng, count = pair.fine, np.random.default_rng(3), 200
    kernel, size = found.kernel(weak=True), found.conditions.size
    if not kernel.shape[1]:
        return  # the conditions leave nothing to change
    directions = kernel @ rng.normal(size=(kernel.shape[1], count))
    steps = 10.0 ** -rng.uniform(1, 4, count) * directions / np.linalg.norm(directions, axis=0)
    shortest = found.at[1 : 1 + len(pair.phased.phases)].min() / size[0]
    moved = min(shortest, 1.0) * size[:, None] * (found.lift @ steps)
    own = values(found, found.at[:, None])[1][0]
    w, objective = brought_back(found, found.at[:, None] + moved)
    met = np.isfinite(objective)
    changes, noise = objective[met] - own, 1e-12 * max(abs(own), 1.0)
    assert met.mean() > (0.25 if name == "lotka_fishing" else 0.9)  # its motion is unstable
    assert np.abs(values(found, w[:, met])[0]).max() < 1e-8 * size.max()
    assert (changes > -noise).all()
    assert (changes > noise).mean() > 0.3


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in SOON else pytest.mark.slow) for name in WORDS]
)
def test_twice_the_steps_move_no_curvature_further_than_its_error(name: str) -> None:
    """What half of the steps leave bounds what these do without the factor `CLEAR` on it."""
    problem, _, solution = right(name)
    pair, known = induced(problem, solution), word_problem(problem, solution, 10)
    assert isinstance(pair, Pair)
    assert known is not None
    finer = known.conditions(2.0)
    there = settled(finer)
    assert there is not None
    values = Induced.of(finer, there.at, there.held).spectrum(weak=False)[0]
    found = pair.curvature(weak=False)
    assert found.free == values.size
    if values.size:
        assert abs(values[0] - found.least) <= found.error / CLEAR
