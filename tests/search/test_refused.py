"""Programmes that cannot be set up: a search says why."""

from dataclasses import dataclass
from typing import Any, final

import casadi
import pytest
from carts import cart

from socp.errors import SolveError
from socp.model import Problem, controls, states
from socp.search.conclusion import explanation
from socp.search.effort import Ration, Search

x = states("x")
u = controls("u")


@final
@dataclass
class Refusing:
    """A backend that sets up nothing but as many programmes at first."""

    left: int = 0

    def limited(self, _iterations: int) -> "Refusing":
        return self

    def __call__(self, *_given: Any) -> Any:
        self.left -= 1
        if self.left >= 0:
            return Done()
        raise SolveError("no programme: out of bounds.")


@final
@dataclass
class Done:
    """As much of a point as a ration looks at."""

    iterations: int = 1


@final
@dataclass
class Size:
    """As much of a programme as a ration looks at."""

    count: int = 10


def refused(left: int = 0) -> Search:
    search = Search(backend=Ration(backend=Refusing(left)))  # type: ignore[arg-type]
    for _ in range(left):
        search.backend(Size(), None)  # type: ignore[arg-type]
    with pytest.raises(SolveError):
        search.backend(Size(), None)  # type: ignore[arg-type]
    search.begin(Ration(), 10, 100)  # another round, which the time allowed may end at once
    return search


@pytest.mark.parametrize(("left", "of"), [(0, 1), (3, 4)])
def test_why_programmes_are_refused_is_told_and_how_many(left: int, of: int) -> None:
    told = explanation(cart(), refused(left))
    assert f"of {of} programmes along words 1 could not be solved at all" in told
    assert told.endswith(": no programme: out of bounds")


def test_nothing_is_told_where_none_is_refused() -> None:
    assert "programmes along words" not in explanation(cart(), Search())


def test_a_table_is_named_where_there_is_one() -> None:
    table = casadi.interpolant("t", "bspline", [[0.0, 1, 2, 3]], [0.0, 1, 0, 1])
    own = Problem(
        name="own", running=x**2, dynamics={x: table(x) + u}, bounds={u: (-1, 1)}, final_time=1
    )
    assert "if slopes of a table are lacking" in explanation(own, refused())
