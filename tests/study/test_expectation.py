"""What a census lets expect of extremals that it did not meet."""

from dataclasses import replace
from math import comb

import pytest
from records import revised
from socp_problems.double_integrator_time import problem

from socp import default_guess
from socp.model.result.findings import Condition, Finding, Verdict
from socp.study.clusters import Census, Outcome
from socp.study.expectation import Unseen, unseen


def census(counts: list[int], nowhere: int = 0) -> Census:
    """Return a census whose starts ended in extremals so many times each."""
    verdict = Verdict(miss=0.0, findings=(Finding(kind=Condition.SIGN, residual=0.0),))
    one = revised(default_guess(problem), verdict=verdict)
    ended = [
        replace(one, objective=1.0 + k) for k, count in enumerate(counts) for _ in range(count)
    ]
    outcomes = [Outcome(k, "", each) for k, each in enumerate(ended)]
    outcomes += [Outcome(len(ended) + k, "", None, "led nowhere") for k in range(nowhere)]
    return Census(len(outcomes), tuple(outcomes))


def told(*given: object) -> Unseen:
    found = unseen(census(*given))  # type: ignore[arg-type]
    assert found is not None
    return found


@pytest.mark.parametrize(("starts", "species"), [(40, 2), (12, 3), (16, 4), (30, 1)])
def test_the_formulas_are_those_of_bayes(starts: int, species: int) -> None:
    """With k species and all shares equally likely, n draws meet w of them with probability C(k, w)
    C(n - 1, w - 1) / C(n + k - 1, n): every k is taken for as likely beforehand.
    """
    chances = [
        comb(k, species) / comb(starts + k - 1, starts) for k in range(species, species + 3000)
    ]
    whole = sum(chances)
    expected = sum(k * chance for k, chance in enumerate(chances)) / whole
    found = told([starts - species + 1, *[1] * (species - 1)])
    assert (found.starts, found.species, found.nowhere) == (starts, species, 0)
    assert found.expected == pytest.approx(expected, rel=1e-6)
    assert found.complete == pytest.approx(chances[0] / whole, rel=1e-6)
    # with k species each draw is of an unseen one with (k - w) / (n + k) on average
    share = sum(k * chance / (starts + species + k) for k, chance in enumerate(chances)) / whole
    assert found.share == pytest.approx(share, rel=1e-6)


def test_starts_that_end_in_none_are_one_species_more() -> None:
    found = told([20, 7], 13)
    assert (found.starts, found.species, found.nowhere) == (40, 3, 13)
    assert found.expected == pytest.approx(3 * 4 / 35)


def test_what_is_met_often_is_hardly_missed() -> None:
    """(1 - s)^n = 5 % at s = 7.2 % for 40 starts."""
    found = told([40])
    assert (1 - found.missed) ** 40 == pytest.approx(0.05)
    assert found.missed == pytest.approx(0.072, abs=5e-4)


def test_too_few_starts_say_nothing() -> None:
    found = told([1, 1, 1])
    assert found.expected is None
    assert found.share is None
    assert found.complete == 0.0
    assert unseen(census([])) is None
