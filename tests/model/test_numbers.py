"""A casadi function at many points, on shared memory, is what casadi itself makes of it."""

import casadi
import numpy as np
import pytest

from socp.model import numbers, repeated

X, U, P = casadi.SX.sym("x", 3), casadi.SX.sym("u"), casadi.SX.sym("p", 0)
VALUE = casadi.vertcat(X[0] * casadi.sin(X[1]), U * X[2], X[1])
FUNCTION = casadi.Function("f", [X, U, P], [VALUE, casadi.jacobian(VALUE, X), casadi.SX(0, 1)])
NONE = np.zeros(0)


@pytest.mark.parametrize("count", [1, 2, 7, 48, 49, 101, 703])
def test_points_stand_side_by_side(count: int) -> None:
    random = np.random.default_rng(count)
    x, u = random.standard_normal((3, count)), random.standard_normal((1, count))
    wanted = FUNCTION.map(count)(x, u, np.zeros((0, count)))
    for mine, theirs in zip(numbers(FUNCTION, x, u[0], NONE), wanted, strict=True):
        assert np.array_equal(mine, theirs.full())


def test_what_is_given_once_holds_everywhere() -> None:
    x = np.arange(6.0).reshape(3, 2)
    once, twice = numbers(FUNCTION, x, 2.0, NONE), numbers(FUNCTION, x, np.full(2, 2.0), NONE)
    assert all(np.array_equal(a, b) for a, b in zip(once, twice, strict=True))


def test_results_are_not_written_over_by_the_next_call() -> None:
    first = numbers(FUNCTION, np.ones(3), 1.0, NONE)
    kept = [each.copy() for each in first]
    numbers(FUNCTION, np.zeros(3), 5.0, NONE)
    assert all(np.array_equal(a, b) for a, b in zip(first, kept, strict=True))


def test_no_points_give_no_columns() -> None:
    found = numbers(FUNCTION, np.empty((3, 0)), np.empty((1, 0)), NONE)
    assert [each.shape for each in found] == [(3, 0), (3, 0), (0, 0)]


def test_entries_that_casadi_leaves_out_are_zero() -> None:
    sparse = casadi.Function("d", [casadi.SX.sym("d", casadi.Sparsity.diag(2))], [casadi.SX(2, 2)])
    assert np.array_equal(numbers(sparse, np.eye(2))[0], np.zeros((2, 2)))
    square = casadi.SX.sym("m", casadi.Sparsity.diag(2))
    trace = casadi.Function("t", [square], [casadi.sum1(casadi.sum2(square))])
    assert numbers(trace, np.array([[1.0, 50.0], [60.0, 2.0]]))[0].item() == 3.0


@pytest.mark.parametrize("size", [2, 4, 7])
def test_other_sizes_are_refused(size: int) -> None:
    with pytest.raises(ValueError, match="given"):
        numbers(FUNCTION, np.ones(size), 1.0, NONE)


def test_points_have_to_be_as_many_everywhere() -> None:
    with pytest.raises(ValueError, match="given"):
        numbers(FUNCTION, np.ones((3, 4)), np.ones(2), NONE)


def test_what_a_function_gives_is_what_it_is_given_next() -> None:
    """X -> A x + b, over and over, is A^k x + (A^(k-1) + ... + 1) b."""
    x, b, p = casadi.SX.sym("x", 2), casadi.SX.sym("b"), casadi.SX.sym("p", 0)
    A = np.array([[0.5, 1.0], [0.0, 0.25]])
    after = casadi.mtimes(casadi.DM(A), x) + b
    function = casadi.Function("f", [x, b, p], [after, casadi.sum1(x)])
    first, shift = np.array([[1.0, 2.0], [-3.0, 4.0], [0.5, 0.0]]), np.arange(3.0)
    for _ in range(2):  # on new memory, and on the same once more
        ends, sums = repeated(function, [first], [shift[:, None], np.zeros(0)], 4)
        assert (ends.shape, sums.shape) == ((4, 3, 2), (4, 3, 1))
        powers = [np.linalg.matrix_power(A, k) for k in range(5)]
        for k in range(4):
            wanted = first @ powers[k + 1].T + shift[:, None] * sum(powers[: k + 1]).sum(axis=1)
            assert ends[k] == pytest.approx(wanted, rel=1e-14)
            before = first if k == 0 else ends[k - 1]
            assert sums[k, :, 0] == pytest.approx(before.sum(axis=1), rel=1e-14)


def test_every_call_may_be_given_its_own() -> None:
    x, b = casadi.SX.sym("x"), casadi.SX.sym("b")
    function = casadi.Function("f", [x, b], [x + b])
    given = np.arange(6.0).reshape(3, 2, 1)
    (found,) = repeated(function, [np.zeros((2, 1))], [given], 3)
    assert np.array_equal(found, np.cumsum(given, axis=0))
