"""No kind of minimum is claimed that is none: extremals of one switch whose objective is known in
closed form, and variations of the lengths of certified words.
"""

from importlib import import_module
from math import exp

import numpy as np
import pytest
from saddles import HORIZON, held, saddle, slope
from scipy.optimize import brentq
from socp_plugins.lgr_multiphase import LgrMultiphase
from test_never_wrong import WORDS
from test_perturbed import WORDS as STRONG

from socp import default_guess, run
from socp.model.ladder.second_order import Minimum
from socp.verdict.minimum.descent import corrected
from socp.verdict.minimum.induced import Pair, induced
from socp.verdict.minimum.order import second_order


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


SOON = ("jacobson_1", "fishery_discounted")


@pytest.mark.parametrize(
    ("name", "count"),
    [(name, 30) for name in SOON]
    + [pytest.param(name, 80, marks=pytest.mark.slow) for name in WORDS],
)
def test_no_other_lengths_of_a_word_do_better(name: str, count: int) -> None:
    """Random changes of arc lengths, times and free states of sizes 1e-1 to 1e-4, brought back onto
    the conditions at the ends: none lowers an objective that is said to be a minimum of its word.
    """
    problem = import_module(f"socp_problems.{name}").problem
    solution = run(LgrMultiphase(word=WORDS[name]), problem, default_guess(problem))
    kind = second_order(problem, solution).kind
    assert kind.shown
    # these are asked of all controls, those of other words too, in `test_perturbed`
    assert (kind is Minimum.STRONG) == (name in STRONG)
    pair = induced(problem, solution)
    assert isinstance(pair, Pair)
    fine = pair.fine
    kernel, size = fine.kernel(weak=True), fine.conditions.size
    own = fine.conditions.linearised(fine.at).cost
    rng, changes = np.random.default_rng(3), []
    for _ in range(count if kernel.shape[1] else 0):
        direction = kernel @ rng.normal(size=kernel.shape[1])
        step = 10.0 ** -rng.uniform(1, 4) * direction / np.linalg.norm(direction)
        shortest = fine.at[1 : 1 + len(pair.phased.phases)].min() / size[0]
        at = corrected(pair, fine.at + min(shortest, 1.0) * size * (fine.lift @ step))
        if at is not None:
            changes.append(fine.conditions.linearised(at).cost - own)
    noise = 1e-12 * max(abs(own), 1.0)
    assert all(change > -noise for change in changes)
    assert len(changes) > 0.5 * count or not kernel.shape[1]
    assert sum(change > noise for change in changes) > 0.3 * len(changes) or not changes
