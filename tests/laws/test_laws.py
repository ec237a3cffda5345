"""Derived laws: brackets against integrated extremals, known orders and laws, and degenerate cases
by their names.
"""

import importlib
import subprocess
import sys
from functools import cache
from typing import Any

import casadi
import numpy as np
import pytest
from casadi import cos, exp, sin, tanh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from socp import laws
from socp.errors import MethodError, ProblemError
from socp.laws import book as lawbook
from socp.laws import probes as sampled
from socp.laws.algebra import cramer, determinant, primitive, ratio
from socp.laws.brackets import extended_costate, flow, hamiltonian_value, switching_row
from socp.laws.given import check_laws
from socp.laws.principle import ArcPrinciple
from socp.laws.probes import spread
from socp.laws.setting import homogeneous
from socp.laws.simplify import simplified
from socp.model.problem import Problem
from socp.model.symbols import Expr, controls, final_time, initial_time, parameters, states, time
from socp.model.word import Mode, Word
from socp.view.statement import formula

x, y, z, v, w = states("x y z v w")
u, u1, u2 = controls("u u1 u2")


@cache
def public(name: str) -> Problem:
    found: Problem = importlib.import_module(f"socp_problems.{name}").problem
    return found


def problem(**given: Any) -> Problem:
    fields = {
        "name": "toy",
        "bounds": {u: (-1, 1)},
        "final_time": 5.0,
        "start": dict.fromkeys(given["dynamics"], 1.0),
    }
    return Problem(**{**fields, **given})


def modes(text: str) -> tuple[Mode, ...]:
    return tuple(Mode.parse(token) for token in text.split())


def same(own: Problem, a: Expr, b: Expr, points: np.ndarray | None = None) -> bool:
    """Compare two expressions at points, but for those (a tenth at most) where a formula is 0/0 or
    nearly so.
    """
    at = sampled.admissible(own) if points is None else points
    left, right = sampled.evaluator(own, casadi.SX(a), casadi.SX(b))(at)
    alike = np.isclose(left, right, rtol=1e-9, atol=1e-9).all(axis=(1, 2))
    return bool(at.shape[1] and alike.mean() > 0.9)


# -- the calculus


@pytest.mark.parametrize(
    "name", ["auv", "goddard", "fishery_discounted", "lotka_fishing", "robot_arm"]
)
def test_derivatives_of_switching_functions_are_their_slopes_along_the_hamiltonian_flow(
    name: str,
) -> None:
    """sigma, sigma', sigma'' along an integrated (x, lambda) under constant controls, against
    central differences.
    """
    own = public(name)
    motion = flow(own, own.u)
    row, rows = switching_row(own, 0), []
    for _ in range(3):
        rows.append(row)
        row = motion.of_row(row)
    z = extended_costate(own)
    symbols = [time, own.x, own.costate, own.u]
    rate = casadi.Function(
        "f", symbols, [casadi.vertcat(motion.rate, casadi.mtimes(motion.matrix, z)[:-1])]
    )
    values = casadi.Function("s", symbols, [casadi.mtimes(casadi.vertcat(*rows, row), z)])
    point = sampled.admissible(own)[:, 3]
    nx = own.x.numel()
    t0, x0, costate, control = (
        point[0],
        point[1 : 1 + nx],
        point[1 + nx : 1 + 2 * nx],
        point[1 + 2 * nx :],
    )
    scale = 1e-3 * abs(t0)
    run = solve_ivp(
        lambda t, q: rate(t, q[:nx], q[nx:], control).full().ravel(),
        (t0, t0 + 2 * scale),
        np.r_[x0, costate],
        method="DOP853",
        rtol=1e-13,
        atol=1e-13,
        dense_output=True,
    )
    h, middle = 1e-1 * scale, t0 + scale
    stencil = [-2, -1, 0, 1, 2]
    along = np.hstack(
        [
            values(
                middle + k * h, run.sol(middle + k * h)[:nx], run.sol(middle + k * h)[nx:], control
            ).full()
            for k in stencil
        ]
    )
    slopes = along @ np.array([1, -8, 0, 8, -1]) / (12 * h)
    size = np.abs(along[1:, 2]) + np.abs(along[:-1, 2]) / scale
    assert (np.abs(slopes[:-1] - along[1:, 2]) <= 1e-6 * size).all()


def test_explicit_time_and_running_cost_enter_the_brackets() -> None:
    own = problem(running=(x - sin(time)) ** 2 * exp(-time), dynamics={x: u - x})
    found = laws.derive(own, ("u",))
    assert found.orders == {"u": 1}
    assert same(own, x, sin(time), found.points)  # what is tracked exactly
    assert same(own, found.feedback, sin(time) + cos(time), found.points)
    assert same(own, found.legendre_clebsch, 2 * exp(-time), found.points)


def test_hamiltonian_is_known_just_where_time_is_free_and_nothing_else_depends_on_it() -> None:
    motion = {"dynamics": {x: u}, "start": {x: 1}, "end": {x: 0}}
    assert hamiltonian_value(problem(minimise=final_time, **motion, final_time=(0, None))) == -1
    assert (
        hamiltonian_value(problem(minimise=3 * final_time + x, **motion, final_time=(0, None)))
        == -3
    )
    assert hamiltonian_value(problem(running=x**2, **motion, final_time=(0, None))) == 0
    assert hamiltonian_value(problem(running=x**2, **motion)) is None
    assert (
        hamiltonian_value(problem(minimise=final_time**2, **motion, final_time=(0, None))) is None
    )
    assert hamiltonian_value(problem(running=x**2 * time, **motion, final_time=(0, None))) is None
    assert hamiltonian_value(problem(minimise=final_time, **motion, final_time=(0, 9))) is None, (
        "the interval may bind"
    )
    late = problem(minimise=-2 * initial_time, **motion, initial_time=(None, None), final_time=5)
    assert hamiltonian_value(late) == -2
    assert (
        hamiltonian_value(
            problem(
                minimise=final_time,
                **motion,
                target={"later": x <= final_time},
                final_time=(0, None),
            )
        )
        is None
    )


# -- known laws


KNOWN = {  # problem -> control, order, law in closed form, on the surface where the arc lies
    "jacobson_1": ("u", 1, lambda own: own.x[0]),
    "vdp_regulator": ("u", 1, lambda own: 2 * own.x[0] - own.x[1] * (1 - own.x[0] ** 2)),
    "dubins_csc": ("u", 1, lambda _: casadi.SX(0)),
    "fuller": ("u", 2, lambda _: casadi.SX(0)),
    "auv": ("r", 1, lambda own: -0.8 * cos(own.x[2]) ** 2 * (1 - tanh(own.x[1]) ** 2)),
    "auv_reverse": ("r", 1, lambda own: -0.8 * cos(own.x[2]) ** 2 * (1 - tanh(own.x[1]) ** 2)),
    "goddard": ("u", 1, None),
    "goddard_fixed_time": ("u", 1, None),
    "goddard_vlimit": ("u", 1, None),
    "catalyst_mixing": ("u", 1, None),
    "lotka_fishing": ("w", 1, None),
    "fishery_discounted": ("E", 1, None),
}


@pytest.mark.parametrize("name", KNOWN)
def test_public_problems_have_the_stated_orders_and_state_feedback(name: str) -> None:
    own, (control, order, law) = public(name), KNOWN[name]
    found = laws.derive(own, (control,))
    assert found.orders == {control: order}
    assert found.feedback is not None
    assert not found.hamiltonian, "the conditions alone fix the costate's direction"
    i = own.control_names.index(control)
    assert same(own, found.feedback[i], found.control[i], found.points)
    if law is not None:
        assert same(own, found.feedback[i], law(own), found.points)


def test_fishery_holds_the_golden_rule_stock() -> None:
    """Clark's golden rule for the Schaefer fishery: a closed form for the stock; the effort keeps
    it.
    """
    own = public("fishery_discounted")
    r, K, q, price, cost, discount = 0.71, 8.0, 0.6, 1.0, 0.8, 0.12
    b = cost / (price * q * K)
    stock = (
        K / 4 * (b + 1 - discount / r + np.sqrt((b + 1 - discount / r) ** 2 + 8 * b * discount / r))
    )
    found = laws.derive(own, ("E",))
    surface, law = casadi.Function("s", [own.x, time], [found.surface, found.feedback])(stock, 3.0)
    assert abs(float(surface)) < 1e-12
    assert float(law) == pytest.approx(r * (1 - stock / K) / q, rel=1e-12)


def test_catalyst_law_is_constant_along_its_surface() -> None:
    """Jackson: the singular control of catalyst mixing is the constant 0.227142..."""
    own = public("catalyst_mixing")
    found = laws.derive(own, ("u",))
    points = sampled.onto(own, found.surface, sampled.admissible(own))
    values = sampled.evaluator(own, found.feedback)(points)[0].ravel()
    assert np.ptp(values) < 1e-9
    assert f"{values[0]:.8f}".startswith("0.227142")


def test_free_time_goddard_lies_on_a_surface_and_fixed_time_does_not() -> None:
    assert laws.derive(public("goddard"), ("u",)).surface.numel() == 1
    assert laws.derive(public("goddard_fixed_time"), ("u",)).surface.numel() == 0


@pytest.mark.parametrize(
    ("name", "singular", "boundary"),
    [
        ("goddard_fixed_time", ("u",), {}),
        ("goddard_vlimit", (), {"u": "v.upper"}),
        ("auv", ("r",), {"f": "u.upper"}),
        ("lotka_fishing", ("w",), {}),
        ("catalyst_mixing", ("u",), {}),
        ("jacobson_1", ("u",), {}),
    ],
)
def test_conditions_stay_zero_along_an_extremal_with_the_derived_control(
    name: str, singular: tuple[str, ...], boundary: dict[str, str]
) -> None:
    own = public(name)
    assert drift(own, laws.derive(own, singular, boundary)) < 1e-9


def drift(own: Problem, found: ArcPrinciple) -> float:
    """Integrate x and lambda from a point of the arc under its control; return the worst condition,
    relative.
    """
    nx = own.x.numel()
    symbols = [time, own.x, own.p, own.costate, own.u]
    bang = casadi.substitute(found.control, own.u, own.u)
    rates = casadi.vertcat(casadi.substitute(own.rate, own.u, bang), found.costate_rate)
    vanish = casadi.vertcat(found.conditions, found.entry)
    terms = casadi.mtimes(
        casadi.fabs(casadi.jacobian(vanish, casadi.vertcat(own.x, own.costate))),
        casadi.fabs(casadi.vertcat(own.x, own.costate)),
    )
    rate, check = (
        casadi.Function("f", symbols, [rates]),
        casadi.Function("c", symbols, [vanish, terms]),
    )
    k = next(
        k
        for k in range(found.points.shape[1])
        if np.isfinite(rate(*parts(own, found.points[:, k])).full()).all()
    )
    t0, x0, p, costate, control = parts(own, found.points[:, k])
    long = 1e-2 * abs(t0) + 1e-3
    run = solve_ivp(
        lambda t, q: rate(t, q[:nx], p, q[nx:], control).full().ravel(),
        (t0, t0 + long),
        np.r_[x0, costate],
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
    )
    assert run.success
    values, sizes = check(t0 + long, run.y[:nx, -1], p, run.y[nx:, -1], control)
    assert np.abs(run.y[:, -1] - run.y[:, 0]).max() > 0, "nothing moves: the test shows nothing"
    return float(np.max(np.abs(values.full()) / (sizes.full() + 1.0)))


def parts(own: Problem, point: np.ndarray) -> tuple[Any, ...]:
    nx, npar = own.x.numel(), own.p.numel()
    t, *rest = np.split(point, [1, 1 + nx, 1 + nx + npar, 1 + 2 * nx + npar])
    return float(t[0]), *rest


# -- where the costate stays


CUSP = {
    "running": x**2 / 2,
    "dynamics": {x: y + z**2, y: z, z: u},
}  # sigma = lz, sigma' = -(2 z lx + ly): lx stays open


def test_law_with_the_costate_where_the_conditions_leave_it_open() -> None:
    own = problem(**CUSP)
    found = laws.derive(own, ("u",))
    assert found.feedback is None
    lx = own.costate[0]
    assert same(
        own, found.control, (lx + 2 * z * -x * -1) / (2 * lx), found.points
    )  # sigma'' = -2 u lx + 2 z x + lx
    assert same(own, found.legendre_clebsch, 2 * lx)
    assert drift(own, found) < 1e-9
    law = laws.arc_law(own, modes("s"))
    assert law.costate
    assert len(law.costate_entry) == 2
    assert same(own, law.costate_rate, casadi.vertcat(-x, -lx, -2 * z * lx - own.costate[1]))
    assert law.entry == ()


def test_known_hamiltonian_closes_what_the_conditions_leave_open() -> None:
    own = problem(**CUSP, end={x: 0}, final_time=(0, None))
    found = laws.derive(own, ("u",))
    assert found.hamiltonian
    assert same(own, found.feedback, found.control, found.points)
    assert not laws.arc_law(own, modes("s")).costate


def test_costate_has_the_price_of_a_cost_that_is_written_as_a_state() -> None:
    rates = {x: y + z**2, y: z, z: u, w: x**2 / 2}
    own = problem(minimise=2 * w + 3, dynamics=rates)
    assert homogeneous(own)
    law = laws.arc_law(own, modes("s"))
    assert law.costate
    assert same(own, law.costate_entry[-1], own.costate[3] - 2)
    found = np.array([[4.0], [3.0], [2.0], [1.0]])
    assert (laws.at_length(own, found) == found).all()
    assert not homogeneous(problem(**CUSP))


@pytest.mark.parametrize(
    "more",
    [
        {"dynamics": {x: y + z**2, y: z, z: u, w: x**2 / 2 - w / 10}},  # it enters its own rate
        {"end": {w: (None, 5)}},  # its end may bind
        {"bounds": {u: (-1, 1), w: (None, 5)}},  # so may a limit along the way
        {"target": {"sum": w + x <= 5}},
        {"minimise": w**2},  # its slope is not known beforehand
    ],
)
def test_costate_is_of_length_one_where_no_price_is_known(more: dict[str, Any]) -> None:
    own = problem(**{"minimise": w, "dynamics": {x: y + z**2, y: z, z: u, w: x**2 / 2}, **more})
    assert homogeneous(own)
    sizes = spread(own)[5:9]
    squares = casadi.sumsqr(own.costate / sizes)
    assert same(own, laws.arc_law(own, modes("s")).costate_entry[-1], squares - 1)
    found = laws.at_length(own, 7.0 * np.outer(sizes, [1.0, 2.0]))
    assert np.allclose(found, np.outer(sizes, [0.5, 1.0]))


# -- several controls


def test_two_singular_controls_at_once() -> None:
    own = problem(
        running=x**2 + y**2 + x, dynamics={x: y + u1, y: -x + u2}, bounds={u1: (-1, 1), u2: (-1, 1)}
    )
    found = laws.derive(own, ("u1", "u2"))
    # lx = ly = 0, so x = -1/2 and y = 0 for all time: u1 = -y, u2 = x
    assert found.orders == {"u1": 1, "u2": 1}
    assert same(own, found.feedback, casadi.vertcat(-y, x), found.points)
    assert same(own, found.legendre_clebsch, 2 * casadi.SX.eye(2), found.points)
    assert np.allclose(found.points[1:3], [[-0.5], [0.0]])


def test_singular_controls_of_different_orders() -> None:
    own = problem(
        running=x**2 + z**2, dynamics={x: u1, y: u2, z: y}, bounds={u1: (-1, 1), u2: (-1, 1)}
    )
    assert laws.derive(own, ("u1", "u2")).orders == {"u1": 1, "u2": 2}


def test_goh_condition_is_required_where_the_fields_do_not_commute() -> None:
    own = problem(
        running=x**2 + y**2 + z**2,
        dynamics={x: u1, y: u2, z: x * u2},
        bounds={u1: (-1, 1), u2: (-1, 1)},
    )
    found = laws.derive(own, ("u1", "u2"))
    # [g1, g2] = d/dz: lz = 0 by Goh, so z = 0 for all time as well
    assert np.allclose(sampled.evaluator(own, own.costate[2])(found.points)[0], 0)
    assert np.allclose(
        sampled.evaluator(own, casadi.vertcat(x, y, z))(found.points)[0], 0, atol=1e-9
    )
    assert same(own, found.feedback, casadi.SX.zeros(2, 1), found.points)


def test_partly_singular_law_depends_on_the_other_control() -> None:
    own = problem(
        running=x**2 + y**2 + z**2,
        dynamics={x: u1, y: u2, z: x * u2},
        bounds={u1: (-1, 1), u2: (-2, 3)},
    )
    up, down = (laws.arc_law(own, modes(f"s {sign}")).control for sign in "+-")
    assert same(own, up, casadi.vertcat(3 * z, 3))  # sigma1'' = 2 (u2 z - u1)
    assert same(own, down, casadi.vertcat(-2 * z, -2))


def test_singular_control_on_a_constraint_that_both_controls_act_on() -> None:
    own = problem(
        running=x**2 + 2 * y**2,
        dynamics={x: u1, y: u2},
        bounds={u1: (-1, 1), u2: (-1, 1)},
        path={"wall": x + y >= 1},
    )
    found = laws.derive(own, ("u1",), {"u2": "wall"})
    # the point of the wall with the least cost, 2 x = 4 y = mu on x + y = 1, and nothing moves
    assert np.allclose(found.points[1:3], [[2 / 3], [1 / 3]])
    assert same(own, found.multipliers["wall"], casadi.SX(4 / 3), found.points)
    assert same(own, found.feedback, casadi.SX.zeros(2, 1), found.points)
    assert laws.extremal_arc(own, modes("- b[wall]")).feedback[1].is_constant()
    assert same(own, laws.arc_law(own, modes("- b[wall]")).control, casadi.SX([-1, 1]))


# -- state constraints


def test_order_entry_and_control_of_a_constraint_on_the_position() -> None:
    own = problem(
        running=(x - 2) ** 2,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1), x: (None, 1)},
        start={x: 0, v: 0},
    )
    found = laws.derive(own, (), {"u": "x.upper"})
    assert found.orders == {"x.upper": 2}
    assert same(own, found.entry, casadi.vertcat(x - 1, v))
    assert same(own, found.feedback, 0)
    assert same(own, found.multipliers["x.upper"], 2, found.points)  # -2 (x - 2) on x = 1
    law = laws.arc_law(own, modes("b"))
    assert law.kept == {"x.upper"}
    assert len(law.entry) == 2


def test_constraint_with_explicit_time() -> None:
    own = problem(
        running=x, dynamics={x: v, v: u - v}, path={"line": v <= 1 + time / 10}, start={x: 0, v: 0}
    )
    found = laws.derive(own, (), {"u": "line"})
    assert found.orders == {"line": 1}
    assert same(own, found.feedback, v + 0.1)


def test_auv_on_its_speed_limit() -> None:
    own = public("auv")
    assert same(own, laws.arc_law(own, modes("s b[u.upper]")).control[1], 4)
    assert same(own, laws.arc_law(own, modes("+ b[u.lower]")).control, casadi.SX([np.pi, 0]))
    found = laws.derive(own, (), {"f": "u.upper"})
    assert found.orders == {"u.upper": 1}
    # lambda_u = 0, so mu = -(lambda_x cos(phi) + lambda_y sin(phi)): -dH/du
    lx, ly, phi = own.costate[0], own.costate[1], own.x[2]
    assert same(own, found.multipliers["u.upper"], -(lx * cos(phi) + ly * sin(phi)), found.points)


def test_neighbouring_arcs_tell_which_constraint_a_boundary_arc_follows() -> None:
    own = public("auv")
    names = own.control_names
    assert (
        str(laws.name_constraints(own, Word.parse("r: + s +; f: + b -", names)))
        == "r: + s +; f: + b[u.upper] -"
    )
    assert (
        str(laws.name_constraints(own, Word.parse("r: + s +; f: - b +", names)))
        == "r: + s +; f: - b[u.lower] +"
    )
    assert (
        str(laws.name_constraints(own, Word.parse("r: + s; f: + b", names)))
        == "r: + s; f: + b[u.upper]"
    )
    assert (
        str(laws.name_constraints(own, Word.parse("r: + s s; f: b b -", names)))
        == "r: + s s; f: b[u.upper] b[u.upper] -"
    )
    with pytest.raises(
        MethodError, match=r"control 'f': which state constraint .* b\[u.lower\] or b\[u.upper\]"
    ):
        laws.name_constraints(own, Word.parse("r: + s +; f: + b +", names))
    with pytest.raises(MethodError, match="no state constraint depends on it"):
        laws.name_constraints(own, Word.parse("r: b; f: +", names))
    with pytest.raises(
        MethodError, match=r"no state constraint 'speed' .* it has u\.lower, u\.upper"
    ):
        laws.arc_law(own, modes("+ b[speed]"))


def test_second_order_constraint_is_entered_by_braking() -> None:
    own = problem(
        running=(x - 2) ** 2,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1), x: (-1, 1)},
        start={x: 0, v: 0},
    )
    assert str(laws.name_constraints(own, Word.parse("+ - b -", ("u",)))) == "u: + - b[x.upper] -"
    assert str(laws.name_constraints(own, Word.parse("- + b +", ("u",)))) == "u: - + b[x.lower] +"


# -- degenerate cases have names


TWO = {u1: (-1, 1), u2: (-1, 1)}
QUICK = {"minimise": final_time, "end": {x: 0, v: 0}, "final_time": (0, None)}
DEGENERATE = [
    (problem(minimise=y, dynamics={x: u, y: -y}), "s", "infinite order"),
    (problem(running=x**2, dynamics={x: u1 + u2}, bounds=TWO), "s s", "infinite order"),
    (problem(**QUICK, dynamics={x: v, v: u}), "s", r"no such arc was found.*sigma_u\^\(1\) = 0"),
    (
        problem(running=x, dynamics={x: v, v: u, y: y}, bounds={u: (-1, 1), y: (None, 2)}),
        "b[y.upper]",
        "no control appears .*'y.upper'",
    ),
    (
        problem(running=x, dynamics={x: u1, y: u2}, bounds={**TWO, y: (None, 2)}),
        "b[y.upper] +",
        "'u1' does not act on 'y.upper' .*, u2 does",
    ),
    (
        problem(running=x**2, dynamics={x: u - 3}),
        "s",
        r"its law u = 3 lies outside the bounds \(-1, 1\)",
    ),
    (
        problem(running=x, dynamics={x: u1 + u2}, bounds={**TWO, x: (None, 2)}),
        "b[x.upper] b[x.upper]",
        "do not determine these controls one by one",
    ),
    (
        problem(running=x**2 + y**2 + z**2, dynamics={x: u1, y: u2, z: x * u2}, bounds=TWO),
        "s *",
        "rate of change of a free control",
    ),
]


@pytest.mark.parametrize(("own", "arc", "text"), DEGENERATE)
def test_degenerate_arcs_are_refused_by_name(own: Problem, arc: str, text: str) -> None:
    with pytest.raises(MethodError, match=text) as refused:
        laws.arc_law(own, modes(arc))
    assert "problem 'toy'" in str(refused.value)


def test_free_control_may_enter_a_law() -> None:
    own = problem(running=(x - y) ** 2, dynamics={x: u1, y: u2}, bounds=TWO)
    assert same(own, laws.arc_law(own, modes("s *")).control, casadi.vertcat(u2, u2))


# -- laws of the user


def with_laws(**given: Any) -> Problem:
    return problem(
        running=(x**2 + v**2) / 2, dynamics={x: v, v: u}, bounds={u: (-1, 1), v: (None, 2)}, **given
    )


def test_right_laws_of_the_user_pass_and_are_used() -> None:
    own = with_laws(singular={u: x + 0}, boundary={u: {"v.upper": casadi.SX(0)}})
    check_laws(own)
    assert casadi.is_equal(laws.arc_law(own, modes("s")).control, own.singular[u])
    check_laws(with_laws(boundary={u: 0}))


def test_wrong_laws_of_the_user_are_refused_with_the_difference() -> None:
    with pytest.raises(
        ProblemError,
        match=r"singular law given for 'u' is wrong: u = \(2\.?\*x\), but .* gives u = x; at x = "
        r".* they "
        r"are",
    ):
        check_laws(with_laws(singular={u: 2 * x}))
    with pytest.raises(ProblemError, match=r"boundary law on 'v\.upper' given for 'u' is wrong"):
        check_laws(with_laws(boundary={u: {"v.upper": v}}))
    own = problem(
        running=x,
        dynamics={x: u1, v: u2},
        bounds={**TWO, v: (None, 2)},
        boundary={u1: {"v.upper": 0}},
    )
    with pytest.raises(ProblemError, match=r"'u1': it does not act on 'v\.upper'"):
        check_laws(own)


# -- invariance


@settings(max_examples=8, deadline=None)
@given(st.lists(st.floats(-2, 2), min_size=4, max_size=4))
@pytest.mark.slow
def test_laws_do_not_depend_on_units(exponents: list[float]) -> None:
    """The AUV with its lengths, angles, speeds and times measured in other units: the same law in
    them.
    """
    size = [10.0**e for e in exponents]
    own, scaled = public("auv"), rescaled(public("auv"), size)
    law, other = (laws.derive(p, ("r",)).feedback[0] for p in (own, scaled))
    points = sampled.admissible(own)
    moved = points.copy()
    moved[1:5] *= np.array(size)[:, None]
    a = sampled.evaluator(own, law)(points)[0]
    b = sampled.evaluator(scaled, other)(moved)[0]
    assert np.allclose(a, b, rtol=1e-8, atol=1e-10)


def rescaled(own: Problem, size: list[float]) -> Problem:
    """Return the problem in new states X = size * x."""
    old, new = list(own.dynamics), states(" ".join(f"s{k}" for k in range(len(size))))
    put = [new[k] / size[k] for k in range(len(size))]
    rates = [
        size[k] * casadi.substitute(own.dynamics[s], casadi.vertcat(*old), casadi.vertcat(*put))
        for k, s in enumerate(old)
    ]
    times = dict(zip(old, zip(new, size, strict=True), strict=True))
    bounds = {
        (times[s][0] if s in times else s): tuple(times[s][1] * b for b in box)
        if s in times
        else box
        for s, box in own.bounds.items()
    }
    ends = [
        {times[s][0]: times[s][1] * value for s, value in end.items()}
        for end in (own.start, own.end)
    ]
    target = {
        name: casadi.substitute(region, casadi.vertcat(*old), casadi.vertcat(*put))
        for name, region in own.target.items()
    }
    return Problem(
        name="scaled",
        minimise=own.minimise,
        dynamics=dict(zip(new, rates, strict=True)),
        bounds=bounds,
        start=ends[0],
        end=ends[1],
        target=target,
        final_time=own.final_time,
    )


@settings(max_examples=8, deadline=None)
@given(st.floats(-3, 3))
def test_laws_do_not_depend_on_the_unit_of_the_cost(exponent: float) -> None:
    factor = 10.0**exponent
    own = problem(running=factor * (x**2 + v**2) / 2, dynamics={x: v, v: u})
    found = laws.derive(own, ("u",))
    assert same(own, found.feedback, x)
    assert same(own, found.legendre_clebsch / factor, 1)


def test_a_parameter_may_enter_the_law() -> None:
    a = parameters("a")
    own = problem(
        running=(x**2 + a * v**2) / 2, dynamics={x: v, v: u}, bounds={u: (-1, 1), a: (1, 3)}
    )
    assert same(own, laws.derive(own, ("u",)).feedback, x / a)


# -- formulas for the reader


def test_auv_laws_come_out_by_themselves() -> None:
    lines = list(lawbook.law_lines(public("auv"), formula))
    texts = [text for _, text in lines]
    assert "r = -0.8*cos(phi)**2/cosh(y)**2 (order 1)" in texts
    assert "f = 4 on u.upper (order 1)" in texts
    assert "f = 0 on u.lower (order 1)" in texts
    assert any(
        "Legendre-Clebsch: -u*(cos(phi)*lambda_x + sin(phi)*lambda_y) >= 0" in text
        for text in texts
    )
    assert any(text.strip().startswith("f on u.upper: positive at all") for text in texts)
    assert any(text.startswith("f: none: ") and "infinite order" in text for text in texts)


def test_law_outside_its_bounds_everywhere_is_reported() -> None:
    own = problem(running=x**2, dynamics={x: u + y**2 + 3, y: 0 * x})
    texts = [text for _, text in lawbook.law_lines(own, formula)]
    assert any("outside the bounds of u at all" in text for text in texts)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (3 * x * (1 - tanh(y) ** 2), "3*x/cosh(y)**2"),
        (cos(x) ** 2 + sin(x) ** 2, "1"),
        ((x * y + x * z) / x, "y + z"),
        (exp(-500 * (x - 1)) * v * exp(500 * (x - 1)), "v"),
    ],
)
def test_simplified_formulas(before: Expr, after: str) -> None:
    own = problem(running=x, dynamics={x: u, y: v, z: y, v: z}, final_time=0.5)
    assert formula(simplified(own, before, sampled.admissible(own))) == after


def test_simplified_keeps_what_it_cannot_translate() -> None:
    own = problem(running=x, dynamics={x: u, y: x})
    odd = casadi.erf(x) + y
    assert simplified(own, odd, sampled.admissible(own)) is not None
    assert same(own, simplified(own, odd, sampled.admissible(own)), odd)


def test_a_formula_that_takes_too_long_leaves_the_next_one_whole() -> None:
    """In a process that has not loaded sympy: an import that is cut off would stay half loaded."""
    script = """
import casadi
from socp import Problem, controls, states
from socp.laws import probes, simplify
x, y = states("x y")
u = controls("u")
own = Problem(
    name="own", running=x, dynamics={x: u, y: x}, bounds={u: (-1, 1)}, start={x: 1, y: 1},
    final_time=1,
)
circle, points = casadi.cos(x) ** 2 + casadi.sin(x) ** 2, probes.admissible(own)
simplify._SECONDS = 1e-3
simplify.simplified(own, circle, points)
simplify._SECONDS = 60.0
print(simplify.simplified(own, circle, points))
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "1"


# -- the algebra beneath


def test_common_factors_leave_through_sums_and_quotients() -> None:
    factor, rest = primitive(casadi.horzcat(v * sin(x) / y + 2 * v * z / y, -(v * cos(x)) / y))
    own = problem(running=x, dynamics={x: u, y: x, z: y, v: z})
    assert same(own, factor, v / y)
    assert same(own, rest, casadi.horzcat(sin(x) + 2 * z, -cos(x)))
    assert casadi.is_equal(ratio(x * v, v * (cos(y) ** 2 + sin(y) ** 2)), x, 5)
    assert ratio(casadi.SX(0), v).is_zero()


def test_determinants_and_cramer_against_numpy() -> None:
    random = np.random.default_rng(0)
    for n in (1, 2, 3, 4):
        matrix, right = random.standard_normal((n, n)), random.standard_normal((n, 1))
        if n > 1:
            matrix[0, -1] = 0.0  # an entry that is skipped
        numerators, denominator = cramer(casadi.SX(matrix), casadi.SX(right))
        assert float(determinant(casadi.SX(matrix))) == pytest.approx(np.linalg.det(matrix))
        assert np.array(casadi.DM(numerators / denominator)).ravel() == pytest.approx(
            np.linalg.solve(matrix, right).ravel()
        )


def test_what_vanishes_identically_is_told_from_what_is_small() -> None:
    own = problem(running=x, dynamics={x: u, y: x})
    points = sampled.admissible(own)
    values = casadi.vertcat(
        sin(x) ** 2 + cos(x) ** 2 - 1, 1e-12 * x * y, x - x / 3 - 2 * x / 3, (x - y) * exp(x)
    )
    assert sampled.nonzero(own, values, points)[:, 0].tolist() == [False, True, False, True]
    line = sampled.onto(own, x - y, points)
    assert line.shape[1]
    assert sampled.nonzero(own, values, line)[:, 0].tolist() == [False, True, False, False]
