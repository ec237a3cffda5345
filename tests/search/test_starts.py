"""From how many starts the result of a search is the best, and what else it met."""

import pytest
from records import revised

from socp import default_guess
from socp.methods import Scouted
from socp.model import Met
from socp.registry import Registry
from socp.search import Search, with_starts


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
