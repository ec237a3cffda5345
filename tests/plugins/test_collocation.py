"""The collocated methods are one table: what stands in a row is what users, imports and pickles
find.
"""

import dataclasses
import pickle
import re
from collections.abc import Callable

import pytest
from socp_plugins import collocation
from socp_plugins.collocation import TABLE, EulerIpopt, HermiteSimpson, Lgr, Row, Trapezoidal

from socp.errors import MethodError
from socp.methods import Method, check_options, default_guess, options
from socp.registry import Registry
from socp.transcription import radau_iia


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_a_row_is_a_frozen_method_that_can_be_imported_and_pickled(
    row: Row, registry: Registry
) -> None:
    method = registry.methods[row.name]
    assert method is getattr(collocation, row.kind)
    assert row.kind in dir(collocation)
    assert method.__module__ == "socp_plugins.collocation"
    assert (method.__doc__, method.source) == (row.about, row.source)
    assert [each.name for each in options(method)] == [*row.sizes, "backend"]
    changed = method(**{size: default + 1 for size, default in row.sizes.items()})
    again = pickle.loads(pickle.dumps(changed))  # noqa: S301 - our own
    assert (type(again), again) == (method, changed)
    with pytest.raises(dataclasses.FrozenInstanceError):
        changed.name = "other"


@pytest.mark.parametrize("kind", [EulerIpopt, Trapezoidal, HermiteSimpson, Lgr])
def test_sizes_have_limits(kind: Callable[..., Method]) -> None:
    first = options(kind)[0].name  # type: ignore[arg-type]
    with pytest.raises(MethodError, match=f"{first}=0, but it must be at least 1"):
        check_options(kind(**{first: 0}))


def test_points_are_at_most_a_hundred() -> None:
    with pytest.raises(MethodError, match="points=101, but it must be at most 100"):
        check_options(Lgr(points=101))


def test_another_scheme_is_another_row(registry: Registry) -> None:
    row = Row("Mine", "mine", radau_iia, {"intervals": 30, "points": 3}, "A row.", "no paper")
    problem = registry.problem("jacobson_1")
    found = collocation._method(row)().solve(problem, default_guess(problem))
    assert found.stop.ok
    assert found.t.size == 30 * 3 + 1
    assert found.objective == pytest.approx(problem.reference.objective, rel=1e-3)


def test_other_names_are_no_methods() -> None:
    with pytest.raises(AttributeError, match=re.escape("has no attribute 'Euler'")):
        collocation.Euler  # noqa: B018 - asking for it is the test
