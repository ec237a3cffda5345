"""From how many starts the result of a search is the best, and what else it met."""

from dataclasses import replace

import pytest
from records import revised

from socp import Watch, default_guess, silent
from socp.methods import Scouted, scouted, scouts
from socp.model import APPROXIMATE, Condition, Finding, Met, Mode, Stop, Verdict
from socp.registry import Registry
from socp.search import Candidate, Search, arc_insertions, with_starts
from socp.solvers import NLP, NLPPoint, default_backend


def test_extremals_of_other_objectives_are_told_once() -> None:
    one = default_guess(Registry.load().problem("double_integrator_time"))
    best, same, other, worse = (
        revised(one, objective=value, structure={"u": ((word, 0.0, 1.0),)})
        for value, word in ((1.0, "-"), (1.0 + 1e-9, "+"), (2.0, "+"), (3.0, "s"))
    )
    search = Search(extremals=[worse, other, best, other, same])
    assert with_starts(best, search).starts is None  # it made none
    search.scouted = Scouted(((best, 5), (worse, 2)), 9)
    found = with_starts(best, search).starts
    assert found is not None
    assert found.tried == 9
    assert found.coarse == (Met(objective=1.0, starts=5), Met(objective=3.0, starts=2))
    assert found.extremals == (
        Met(objective=2.0, word="u: +"),
        Met(objective=3.0, word="u: s"),
    )


@pytest.mark.slow
def test_the_default_method_counts_its_starts() -> None:
    registry = Registry.load()
    problem = registry.problem("jacobson_1")
    found = registry.method("auto")(starts=5).solve(problem, default_guess(problem)).starts
    assert found is not None
    assert 1 <= sum(each.starts for each in found.coarse) <= found.tried <= 5
    assert found.extremals == ()
    none = registry.method("auto")(starts=0).solve(problem, default_guess(problem))
    assert none.starts is None


class Counted:
    """A backend that leads nowhere, and how often it was asked."""

    name = "counted"

    def __init__(self) -> None:
        self.asked = 0

    def within(self, _: float) -> "Counted":
        return self

    def limited(self, *_: int) -> "Counted":
        return self

    def __call__(self, _: NLP, guess: NLPPoint, *__: Watch) -> NLPPoint:
        self.asked += 1
        return replace(guess, stop=Stop.INFEASIBLE)


def test_after_three_starts_that_lead_nowhere_the_others_wait() -> None:
    problem = Registry.load().problem("rayleigh_time")
    guess, backend = default_guess(problem), Counted()
    first = scouted(problem, guess, 5, silent, backend)
    # each in its own units as well, and seven horizons that are held
    assert (first.met, first.tried, backend.asked) == ((), 3, 6 + 7)
    rest = scouted(problem, guess, 5, silent, backend, first)
    assert (rest.met, rest.tried, backend.asked) == ((), 5, 10 + 7)
    assert scouts(problem, guess, 5, silent, backend) == []
    assert backend.asked == 2 * (10 + 7)


def test_starts_go_on_from_what_is_known() -> None:
    problem = Registry.load().problem("jacobson_1")
    guess, backend = default_guess(problem), default_backend()
    first = scouted(problem, guess, 1, silent, backend)
    assert [count for _, count in first.met] == [1]
    assert [n for _, n in scouted(problem, guess, 2, silent, backend, first).met] == [2]


@pytest.mark.parametrize(
    ("names", "residual", "miss", "told"),
    [
        (("u",), 1e-4, 1e-9, True),
        ((), 1e-4, 1e-9, False),
        (("u",), 10 * APPROXIMATE, 1e-9, False),
        (("u",), 1e-4, 1.0, False),
    ],
)
def test_a_search_chatters_where_its_best_word_is_nearly_an_extremal(
    names: tuple[str, ...], residual: float, miss: float, told: bool
) -> None:
    one = default_guess(Registry.load().problem("fuller"))
    finding = Finding(kind=Condition.SIGN, residual=residual)
    verdict = Verdict(miss=miss, findings=(finding,), chattering=names)
    assert not Search().chatters
    assert Search(best=one.with_judgement(verdict=verdict)).chatters is told


def test_arcs_are_put_at_the_ends_and_next_to_some_alone() -> None:
    low, up, singular = ((Mode.parse(each),) for each in "-+s")
    one = default_guess(Registry.load().problem("fuller"))
    now = Candidate((low, up, singular), (0.0, 1.0, 2.0, 3.0), one)
    every = {each.arcs for each in arc_insertions(now, [low, up, singular])}
    near = {each.arcs for each in arc_insertions(now, [low, up, singular], {singular})}
    assert near == {
        (up, low, up, singular),
        (singular, low, up, singular),
        (low, up, low, singular),
        (low, up, singular, low),
        (low, up, singular, up),
    }
    assert near < every
