"""A problem along a solution: what is built once and goes with it, and values there."""

import copy
import gc
import pickle
import weakref
from dataclasses import replace

import casadi
import numpy as np
import pytest

from socp import Problem, controls, default_guess, final_time, initial, parameters, states
from socp.errors import MethodError
from socp.model import cached, evaluate, evaluation, once

calls: list[tuple[str, int]] = []


def posed() -> Problem:
    x, y = states("x y")
    u, k = controls("u"), parameters("k")
    return Problem(
        name="evaluated",
        dynamics={x: y + k, y: u},
        bounds={u: (-1, 1), k: (0, 2), y: (None, 3)},
        minimise=final_time + x * initial(y) + k**2,
        running=u * x,
        start={x: 0, y: (0, 1)},
        target={"meet": x * y - k == 2},
        path={"low": x * k - 5 <= 0},
    )


@once
def twice(problem: Problem, number: int) -> list[int]:
    calls.append((problem.name, number))
    if number < 0:
        raise MethodError("negative")
    return [2 * number]


def test_a_function_is_worked_out_once_for_each_owner_and_argument() -> None:
    calls.clear()
    one, other = posed(), posed()
    assert twice(one, 3) is twice(one, 3)
    assert twice(one, 4) == [8]
    assert twice(other, 3) is not twice(one, 3)
    assert len(calls) == 3
    assert cached(one, twice) == {(3,): [6], (4,): [8]}


@once
def slope(problem: Problem, expression: casadi.SX) -> casadi.SX:
    calls.append((problem.name, 0))
    return casadi.jacobian(expression, problem.x)


def test_expressions_are_told_by_their_nodes_not_by_what_they_read() -> None:
    calls.clear()
    problem, again = posed(), casadi.SX.sym("x")
    x = problem.x[0]
    assert slope(problem, x) is slope(problem, problem.x[0])
    assert slope(problem, x)[0].is_one()
    assert not slope(problem, again).nnz()
    for k in range(50):  # what is known is kept alive: none takes its place in memory
        assert float(slope(problem, (k + 2) * x)[0]) == k + 2
    assert len(calls) == 52


def test_an_error_is_not_kept() -> None:
    calls.clear()
    problem = posed()
    for _ in range(2):
        with pytest.raises(MethodError):
            twice(problem, -1)
    assert len(calls) == 2
    assert not cached(problem, twice)


def test_neither_a_copy_nor_a_pickle_takes_along_what_was_built() -> None:
    problem = posed()
    evaluation.mayer_function(problem)
    twice(problem, 3)
    assert not cached(copy.copy(problem), twice)
    assert not cached(pickle.loads(pickle.dumps(problem)), twice)  # noqa: S301 - our own


def test_what_was_built_goes_with_its_owner() -> None:
    problem = posed()
    built = evaluation.rate_function(problem)
    gone = weakref.ref(problem)
    assert built is evaluation.rate_function(problem)
    del problem
    gc.collect()
    assert gone() is None


def test_functions_of_the_ends_are_those_of_the_problem() -> None:
    problem, x1, x0 = posed(), np.array([2.0, 3.0]), np.array([0.0, 0.5])
    at = [x1, x0, np.array([1.5]), 0.0, 4.0]
    assert float(evaluation.mayer_function(problem)(*at)) == 4.0 + 2.0 * 0.5 + 1.5**2
    slopes = [each.full().ravel().tolist() for each in evaluation.mayer_slopes(problem)(*at)]
    assert slopes == [[0.5, 0.0], [0.0, 2.0], [3.0], [0.0], [1.0]]
    (meet,) = problem.conditions
    assert float(evaluation.condition_function(problem, meet)(*at)) == 2.0 * 3.0 - 1.5 - 2.0
    slopes = [
        each.full().ravel().tolist() for each in evaluation.condition_slopes(problem, meet)(*at)
    ]
    assert slopes == [[3.0, 2.0], [0.0, 0.0], [-1.0], [0.0], [0.0]]


def test_values_along_a_solution() -> None:
    problem = posed()
    guess = default_guess(problem)
    x, t, p = guess.rows("x"), guess.t, evaluation.parameters_of(problem, guess)
    values = {c.name: evaluation.constraint_function(problem, c) for c in problem.constraints}
    assert list(values) == ["y.upper", "low"]
    np.testing.assert_allclose(evaluate(values["low"], x, t, p)[0], [x[0] * p[0] - 5.0])
    np.testing.assert_allclose(evaluate(values["y.upper"], x, t, p)[0], [x[1] - 3.0])
    (rate,) = evaluate(evaluation.rate_function(problem), x, guess.rows("u"), t, p)
    np.testing.assert_allclose(rate, [x[1] + p[0], guess.rows("u")[0]])
    (running,) = evaluate(evaluation.running_function(problem), x, guess.rows("u"), t, p)
    np.testing.assert_allclose(running, [guess.rows("u")[0] * x[0]])
    assert np.array_equal(evaluation.running_costs(problem, x, guess.rows("u"), t, p), running[0])
    ends = evaluation.end_values(problem, guess)
    assert ends[0].tolist() == x[:, -1].tolist()
    assert ends[1].tolist() == x[:, 0].tolist()
    assert ends[3:] == [guess.initial_time, guess.final_time]


@pytest.mark.parametrize("cost", [None, 3.0])
def test_a_running_cost_that_is_a_number_is_that_number(cost: float | None) -> None:
    problem = replace(posed(), running=cost)
    guess = default_guess(problem)
    x, u, p = guess.rows("x"), guess.rows("u"), evaluation.parameters_of(problem, guess)
    found = evaluation.running_costs(problem, x, u, guess.t, p)
    (asked,) = evaluate(evaluation.running_function(problem), x, u, guess.t, p)
    assert np.array_equal(found, asked[0])


@pytest.mark.parametrize("n", [0, 1, 5])
def test_a_matrix_stands_point_by_point_and_no_points_give_none(n: int) -> None:
    t, p = casadi.SX.sym("t"), casadi.SX.sym("p", 2)
    function = casadi.Function("f", [t, p], [casadi.horzcat(t * p, p), t])
    at = np.arange(1.0, n + 1.0)
    if n:
        first, second = evaluate(function, at, np.array([3.0, 5.0]))
        assert first.reshape(2, n, 2)[:, -1].tolist() == [[3.0 * n, 3.0], [5.0 * n, 5.0]]
        assert second.tolist() == [at.tolist()]
    else:
        assert [each.shape for each in evaluate(function, at, np.ones(2))] == [(2, 0), (1, 0)]
