"""What is inside `quick_calls` tells casadi less to try, and changes no result of its."""

import sys
import warnings
from collections.abc import Callable, Iterator

import casadi
import numpy as np
import pytest

from socp.model import quick_calls

x, m = casadi.SX.sym("x", 2), casadi.MX.sym("m", 2)
two, ones = casadi.SX([1, 2]), np.ones(2)
of_x, of_m = casadi.Function("f", [x], [2 * x]), casadi.Function("f", [m], [2 * m])
CALLS = [
    lambda: casadi.DM(two),
    lambda: casadi.DM(casadi.SX(3)),
    lambda: casadi.DM(casadi.MX(3)),
    lambda: casadi.DM([casadi.SX(1), casadi.SX(2)]),
    lambda: casadi.DM(x),
    lambda: casadi.DM(None),
    lambda: casadi.evalf(casadi.MX(casadi.DM([1, 2]))),
    lambda: casadi.MX(x),
    lambda: casadi.SX(m),
    lambda: casadi.vertcat(x, m),
    lambda: casadi.vertcat(x, ones, 1),
    lambda: casadi.vertcat(ones, m),
    lambda: casadi.horzcat([1, 2], x),
    lambda: ones * x,
    lambda: np.eye(2) @ x,
    lambda: casadi.mtimes(np.eye(2), m),
    lambda: np.float64(2) * m,
    lambda: ones <= x,
    lambda: x[np.array([1, 0])],
    lambda: x[casadi.SX(1)],
    lambda: np.sin(x),
    lambda: np.array(x),
    lambda: np.array(two),
    lambda: float(casadi.SX(2)),
    lambda: float(x[0]),
    lambda: of_x(two),
    lambda: of_x(m),
    lambda: of_x([1, 2]),
    lambda: of_m(two),
    lambda: of_m(x),
    lambda: casadi.substitute([x], [x], [casadi.DM([1, 2])])[0],
    lambda: casadi.jacobian(x, m),
    lambda: casadi.if_else(x[0] > 1, 2, x[1]),
]


def told(k: int) -> tuple[str, str]:
    """Return the kind of what a call returns or raises, and its text."""
    try:
        found = CALLS[k]()
    except (NotImplementedError, RuntimeError, TypeError) as error:
        found = error
    return type(found).__name__, str(found)


def hooks() -> Iterator[bool]:
    for kind in (casadi.SX, casadi.MX):
        yield from (hasattr(kind, name) for name in ("__DM__", "__SX__", "__MX__"))


@pytest.mark.parametrize("k", range(len(CALLS)))
def test_results_and_refusals_are_those_of_casadi_outside(k: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        outside = told(k)
        with quick_calls():
            inside = told(k)
    assert inside == outside


@pytest.mark.parametrize("call", [lambda: x + x, lambda: casadi.vertcat(m, m)])
def test_expressions_are_not_tried_as_arrays_inside(call: Callable[[], object]) -> None:
    assert "DM_from_array" in called(call)
    with quick_calls():
        assert "DM_from_array" not in called(call)


def called(call: Callable[[], object]) -> list[str]:
    """Return the names of the Python functions that casadi calls on its way."""
    names = list[str]()
    sys.setprofile(lambda frame, *_: names.append(frame.f_code.co_name))
    try:
        call()
    finally:
        sys.setprofile(None)
    return names


def test_the_classes_are_as_they_were_when_the_last_one_leaves() -> None:
    before = [*hooks()]

    @quick_calls()
    def interrupted() -> None:
        with quick_calls():
            assert [*hooks()] != before
        assert [*hooks()] != before
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [*hooks()] == before


def test_hooks_that_are_there_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def own(_self: object) -> None:
        return None

    monkeypatch.setattr(casadi.SX, "__DM__", own, raising=False)
    with quick_calls():
        assert casadi.SX.__DM__ is own
    assert casadi.SX.__DM__ is own
