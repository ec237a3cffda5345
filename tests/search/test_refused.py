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
    """A backend that sets up nothing."""

    def limited(self, _iterations: int) -> "Refusing":
        return self

    def __call__(self, *_given: Any) -> Any:
        raise SolveError("no programme: out of bounds.")


@final
@dataclass
class Size:
    """As much of a programme as a ration looks at."""

    count: int = 10


def refused() -> Search:
    search = Search(backend=Ration(backend=Refusing()))  # type: ignore[arg-type]
    with pytest.raises(SolveError):
        search.backend(Size(), None)  # type: ignore[arg-type]
    search.begin(Ration(), 10, 100)  # another round, which the time allowed may end at once
    return search


def test_why_programmes_are_refused_is_told() -> None:
    told = explanation(cart(), refused())
    assert told.endswith("; no programme: out of bounds")


def test_a_table_is_named_where_there_is_one() -> None:
    table = casadi.interpolant("t", "bspline", [[0.0, 1, 2, 3]], [0.0, 1, 0, 1])
    own = Problem(
        name="own", running=x**2, dynamics={x: table(x) + u}, bounds={u: (-1, 1)}, final_time=1
    )
    assert "a table of the formula may lack slopes" in explanation(own, refused())
