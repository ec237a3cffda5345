"""Knots: the times at which a problem itself changes its course, on grids and along words."""

import casadi
import numpy as np
import pytest
from casadi import fabs, fmax, fmin, pw_const, pw_lin, sin

from socp import Problem, controls, states, time
from socp.transcription import cut_at_knots, euler, follow, knot_times, knotted, lgr, uniform
from socp.transcription.kinks import crossing, decided

x = states("x")
u = controls("u")


def priced(price: casadi.SX, **more: object) -> Problem:
    return Problem(
        name="priced",
        running=price * u,
        dynamics={x: u - 1},
        bounds={u: (0, 3)},
        start={x: 0},
        **{"final_time": 4, **more},
    )


def test_the_knots_of_a_table_are_its_own() -> None:
    assert knot_times(priced(pw_const(time, [1, 2.5], [3, 1, 2]))) == pytest.approx((1, 2.5))
    assert knot_times(priced(pw_lin(time, [0, 1, 3, 4], [1, 2, 0, 5]))) == pytest.approx((1, 3))


def test_a_knot_is_where_a_branch_of_time_turns() -> None:
    assert knot_times(priced(fmax(sin(time), 0))) == pytest.approx((np.pi,))
    assert knot_times(priced(fabs(time - 1) + fmin(time, 3))) == pytest.approx((1, 3))


@pytest.mark.parametrize(
    "problem",
    [
        priced(1 + time**2),
        priced(fmax(x, 1)),
        priced(fmax(x - time, 0)),
        priced(pw_const(time, [1], [1, 2]), final_time=(1, 9)),
    ],
    ids=["smooth", "of a state", "of both", "free horizon"],
)
def test_what_is_no_knot(problem: Problem) -> None:
    assert knot_times(problem) == ()


def test_grids_have_a_node_at_every_knot() -> None:
    problem = priced(pw_const(time, [1, 2.5], [3, 1, 2]))
    ends = 4 * np.cumsum([share for share, _ in knotted(problem, euler(), 10)])
    assert ends[-1] == pytest.approx(4)
    assert {1.0, 2.5} <= {round(float(t), 12) for t in ends}
    assert len(ends) in range(9, 13)


def test_a_grid_too_coarse_for_its_knots_stays_uniform() -> None:
    problem = priced(pw_const(time, list(np.linspace(0.1, 3.9, 60)), list(range(61))))
    assert knotted(problem, euler(), 10) == uniform(euler(), 10)


@pytest.mark.parametrize("at", [0.5, 1.7, 3.2])
@pytest.mark.parametrize(
    "expression",
    [
        pw_const(time, [1, 2.5], [3, 1, 2]),
        pw_lin(time, [0, 1, 3, 4], [1, 2, 0, 5]),
        fabs(time - 2) * x + fmax(sin(3 * time), 0),
        fmin(time, 2) - casadi.sign(time - 1),
    ],
    ids=["steps", "lines", "state", "minimum"],
)
def test_between_knots_branches_are_decided(expression: casadi.SX, at: float) -> None:
    given = casadi.vertcat(time, x)
    one, other = (casadi.Function("f", [given], [e]) for e in (expression, decided(expression, at)))
    assert float(one([at, 0.3])) == pytest.approx(float(other([at, 0.3])), abs=1e-14)
    slopes = casadi.Function("s", [given], [casadi.hessian(decided(expression, at), given)[0]])
    assert np.isfinite(slopes([at, 0.3]).full()).all()


def test_a_branch_of_a_state_is_left_open() -> None:
    assert casadi.depends_on(decided(fmax(x, time), 1.0), x)


def test_pieces_begin_at_their_knots_and_a_switch_on_one_stays() -> None:
    from socp import Word, default_guess
    from socp.methods import split

    problem = priced(pw_const(time, [1, 2.5], [3, 1, 2]))
    word = Word.parse("+ -", problem.control_names)
    guess = split(default_guess(problem), [2.5, 1.5])
    parts, start, pieces = cut_at_knots(follow(problem, word), guess, lambda *_: uniform(lgr(4), 1))
    assert pieces == [2, 1]
    assert [float(arc.t[0]) for arc in start.arcs] == pytest.approx([0, 1, 2.5])
    ties = [
        [float(casadi.evalf(casadi.substitute(e, time, 0))) for e in p.entry] for p in parts.phases
    ]
    assert ties == [[], [-1], [-2.5]]


@pytest.mark.parametrize(("first", "last"), [(0.0, 3.0), (-100.0, 2.0), (1.7, 1.8)])
def test_a_change_of_sign_is_found_to_rounding(first: float, last: float) -> None:
    found = crossing(lambda t: t**3 - 2.0 * t**2 + t - 1.0, first, last)
    assert found == pytest.approx(1.7548776662466927, abs=2e-14)


def test_a_zero_that_is_looked_at_is_returned() -> None:
    assert crossing(lambda t: t - 0.5, 0.0, 1.0) == 0.5
