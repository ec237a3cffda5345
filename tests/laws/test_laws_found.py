"""Laws are found where random points mislead: one smallest problem for every way in which they do,
with its law.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi
import numpy as np
import pytest
from casadi import cos, pi, sin

from socp import laws
from socp.errors import MethodError
from socp.laws import book as lawbook
from socp.laws import elimination as eliminate
from socp.laws import principle, singular
from socp.laws import probes as sampled
from socp.laws.drawing import horizon
from socp.laws.invariant import spans
from socp.laws.links import LostError
from socp.laws.principle import ArcPrinciple, setting_of
from socp.laws.setting import contact
from socp.methods.chain import run
from socp.methods.guess import default_guess, guess_of
from socp.model.problem import Problem
from socp.model.result.solution import Solution
from socp.model.symbols import controls, final_time, states
from socp.model.word import Mode
from socp.registry.plugins import Registry
from socp.verdict import lessons

x, y, z, v, th = states("x y z v th")
a, b, c = states("a b c")
S, X, P, V = states("S X P V")
u, w = controls("u w")


def problem(**given: Any) -> Problem:
    return Problem(**{"name": "toy", "bounds": {u: (-1, 1)}, **given})


def across(heading: float) -> Problem:
    """Return the way of a vehicle of unit speed with a bounded turn rate to a point, from a
    heading.
    """
    return problem(
        name="across",
        minimise=final_time,
        dynamics={x: cos(th), y: sin(th), th: u},
        bounds={u: (-2, 2)},
        start={x: 4, y: 0, th: heading},
        end={x: 0, y: 0},
    )


def current() -> Problem:
    return problem(
        minimise=final_time,
        dynamics={x: cos(th) + 0.4 * y, y: sin(th), th: u},
        start={x: 0, y: 0, th: pi / 2},
        end={x: 6, y: 0},
    )


def drag() -> Problem:
    return problem(
        running=x**2, dynamics={x: u - x**2}, bounds={u: (-2, 2)}, start={x: 1}, final_time=5
    )


def cubic() -> Problem:
    return problem(
        running=(x - 1) ** 2,
        dynamics={x: x**3 - x + u},
        bounds={u: (-3, 3)},
        start={x: 0.5},
        final_time=8,
    )


def train() -> Problem:
    return problem(
        running=u * v,
        dynamics={x: v, v: u - w - (0.05 + 0.02 * v + 0.03 * v**2) - 0.15 * sin(x)},
        bounds={u: (0, 1), w: (0, 1)},
        start={x: 0, v: 0},
        end={x: 10, v: 0},
        final_time=12,
    )


def filling(second: float) -> Problem:
    """Return the filling of a fed batch with Haldane growth in least time; `second` is one in its
    unit of time.
    """
    growth = 1.3e-4 / second * S / (0.3 + S + S**2 / 0.5)
    return problem(
        minimise=final_time,
        dynamics={X: growth * X - u / V * X, S: -2 * growth * X + u / V * (8 - S), V: u},
        bounds={u: (0, 1e-4 / second), V: (0.1, 1.0)},
        start={X: 1, S: 0.05, V: 0.2},
        end={S: (None, 0.1), V: 1},
    )


def catalyst(long: float = 1) -> Problem:
    """Return catalyst mixing with its product as a state: the sum of all three is conserved."""
    return problem(
        minimise=-c,
        dynamics={a: u * (10 * b - a), b: u * (a - 10 * b) - (1 - u) * b, c: (1 - u) * b},
        bounds={u: (0, 1)},
        start={a: 1, b: 0, c: 0},
        final_time=long,
    )


def feeding() -> Problem:
    """Return a fed batch at a free time, in which all that was fed is conserved as cells and
    substrate.
    """
    growth = S / (0.2 + S + S**2)
    motion = {
        X: growth * X - u / V * X,
        S: -2 * growth * X + u / V * (10 - S),
        P: 0.5 * X * S / (0.1 + S + 4 * S**2) - 0.05 * P - u / V * P,
        V: u,
    }
    return problem(
        minimise=-P * V,
        dynamics=motion,
        bounds={u: (0, 1), V: (None, 5)},
        start={X: 1, S: 0.2, P: 0, V: 2},
    )


def ribosomes() -> Problem:
    """Return the allocation of ribosomes: where the mass, a state bounded at zero, is zero
    everything vanishes.
    """
    rate = 10 * c / (c + 0.03) * a
    return problem(
        minimise=-b,
        dynamics={a: (u - a) * rate, c: 5 * (0.45 - a) - (1 + c) * rate, b: b * rate},
        bounds={u: (0, 0.45), a: (0, 0.45), c: (0, None), b: (0, None)},
        start={a: 0.05, c: 0.01, b: 1},
        final_time=5,
    )


def corner(best: float) -> Problem:
    """Return growth that is fastest where the substrate is `best`, far below where it starts."""
    return problem(
        name="corner",
        minimise=-x,
        dynamics={S: u - S, x: S / (best + S + S**2 / best)},
        bounds={u: (0, 1)},
        start={S: 1, x: 0},
        final_time=5,
    )


def priced() -> Problem:
    """Return a fed batch with a price on its feed: growth is fastest at S = 1, and where the
    costates of cells and substrate are as 2 to 1 every control would do.
    """
    growth = S / (0.5 + S + S**2 / 2)
    return problem(
        minimise=-X * V,
        running=0.1 * u,
        dynamics={X: growth * X - u / V * X, S: u / V * (50 - S) - 2 * growth * X, V: u},
        bounds={u: (0, 2)},
        start={X: 1, S: 3, V: 4},
        final_time=6,
    )


# problem, control, order, (what vanishes on the arc, the law there)
FOUND: dict[str, tuple[Callable[[], Problem], str, int, Callable[[Problem], Any]]] = {
    "a rate that is round-off": (lambda: across(pi / 2), "u", 1, lambda _: 0),
    "a rate that is nearly round-off": (lambda: across(1.57), "u", 1, lambda _: 0),
    "round-off in a current": (current, "u", 1, lambda _: -0.4 * cos(th) ** 2),
    "backwards": (lambda: across(0.0), "u", 1, lambda _: 0),
    "escape in finite time": (drag, "u", 1, lambda _: x**2),
    "escape to both sides": (cubic, "u", 1, lambda _: 0),  # at x = 1, whose drift is zero
    "quadratic resistance on slopes": (
        train,
        "u",
        1,
        lambda _: 0.05 + 0.02 * v + 0.03 * v**2 + 0.15 * sin(x) + w,
    ),
    "far from units": (lambda: filling(1.0), "u", 1, None),
    "the same in hours": (lambda: filling(1 / 3600), "u", 1, None),
    "a conserved sum": (catalyst, "u", 1, None),
    "a conserved quantity at a free time": (feeding, "u", 1, None),
    "a state at its bound": (ribosomes, "u", 2, None),
    "a branch that leaves the control open beside it": (priced, "u", 1, lambda _: X * V / 49),
    "a corner of the states": (lambda: corner(1e-3), "u", 1, lambda _: 1e-3),
}


@pytest.mark.parametrize("kind", FOUND)
def test_law_is_found_and_keeps_its_conditions(kind: str) -> None:
    make, name, order, law = FOUND[kind]
    own = make()
    found = laws.derive(own, (name,))
    assert found.orders == {name: order}
    i = own.control_names.index(name)
    assert slopes_at(own, found, i) < 1e-6
    if law is not None:
        given = casadi.SX(law(own))
        ours, theirs = sampled.evaluator(own, found.control[i], given)(found.points)
        assert np.allclose(ours, theirs, rtol=1e-6, atol=1e-8)


def slopes_at(own: Problem, found: ArcPrinciple, i: int) -> float:
    """Return the worst slope of the conditions along the flow under the law, at the points of the
    arc.

    It is relative to its terms and to what changes in the horizon: at an equilibrium the terms are
    rounding.
    """
    rate = casadi.substitute(own.rate, own.u, found.control)
    at = casadi.vertcat(own.x, own.costate)
    slope = casadi.jacobian(found.conditions, at)
    change = casadi.mtimes(slope, casadi.vertcat(rate, found.costate_rate))
    pulls = casadi.fabs(casadi.jacobian(found.costate_rate, own.costate))
    sizes = casadi.mtimes(pulls, casadi.fabs(own.costate)) + casadi.fabs(
        casadi.substitute(found.costate_rate, own.costate, 0)
    )
    nx, first = own.x.numel(), 1 + own.x.numel() + own.p.numel()
    typical = sampled.spread(own)[[*range(1, 1 + nx), *range(first, first + nx)]] / horizon(own)
    largest = casadi.vertcat(casadi.fabs(rate), sizes) + casadi.SX(typical)
    terms = casadi.mtimes(casadi.fabs(slope), largest)
    changes, large = sampled.evaluator(own, change, terms)(found.points)
    assert np.isfinite(changes).all(), f"control {i} has no value"
    return float((np.abs(changes) / (large + 1e-300)).max())


def test_ribosomes_live_where_balanced_growth_is_fastest() -> None:
    """Growth w a with w = 10 c / (c + 0.03) is balanced at a = 2.25 / (5 + (1 + c) w): fastest
    where w^2 = 5 w'.
    """
    level = np.sqrt(0.015)  # 100 c^2 = 1.5
    share = 2.25 / (5 + (1 + level) * 10 * level / (level + 0.03))
    points = laws.derive(ribosomes(), ("u",)).points
    assert np.allclose(points[1:3], [[share], [level]], rtol=1e-8)
    assert np.ptp(points[3]) > 0.1, "of any mass"


@pytest.mark.parametrize("long", [0.5, 1, 2, 4])
def test_catalyst_law_keeps_jacksons_ratio(long: float) -> None:
    """The ratio is 10 + sqrt(10), or 10 - sqrt(10) outside the box; costates along the conserved
    sum do not matter.
    """
    found = laws.derive(catalyst(long), ("u",))
    ratio = found.points[1] / found.points[2]
    assert np.allclose(np.abs(ratio - 10), np.sqrt(10), rtol=1e-8)
    assert found.feedback is not None
    values = sampled.evaluator(found.setting.problem, found.feedback)(found.points)[0].ravel()
    assert np.allclose(values, ratio / ((ratio - 10) * (1 + ratio) + ratio), rtol=1e-7)
    assert np.isclose(values, 0.22714208).sum() > len(values) / 2


def test_laws_are_the_same_in_seconds_and_in_hours() -> None:
    seconds, hours = (filling(each) for each in (1.0, 1 / 3600))
    state = casadi.vertcat(X, S, V)
    values = [
        casadi.Function("law", [state], [laws.derive(own, ("u",)).feedback])([2.0, 0.4, 0.5])
        for own in (seconds, hours)
    ]
    assert float(values[0]) * 3600 == pytest.approx(float(values[1]), rel=1e-9)


@pytest.mark.parametrize("make", [drag, cubic, train, current, lambda: across(pi / 2), ribosomes])
def test_points_stay_where_a_problem_lives(make: Callable[[], Problem]) -> None:
    own = make()
    points = sampled.admissible(own, 100)
    low, high = own.state_box
    states_ = points[1 : 1 + own.x.numel()]
    assert np.isfinite(points).all()
    assert np.abs(states_).max() < 1e3
    assert (states_ >= low[:, None]).all()
    assert (states_ <= high[:, None]).all()


def test_points_of_a_stiff_motion_do_not_blow_up() -> None:
    cells = states("h0 h1 h2 h3 h4 h5")
    beside = zip((u, *cells[:-1]), cells, (*cells[1:], 0), strict=True)
    rates = [400 * (left - 2 * own + right) for left, own, right in beside]
    motion = dict(zip(cells, rates, strict=True))
    own = problem(minimise=cells[-1], dynamics=motion, start=dict.fromkeys(cells, 0), final_time=10)
    assert (
        np.abs(sampled.admissible(own)[1:7]).max() < 10
    )  # between the temperatures at both ends, and strayed a bit


def test_horizon_is_the_time_of_the_way_and_keeps_to_its_interval() -> None:
    assert 1 < horizon(across(pi / 2)) < 10
    assert horizon(replace(across(pi / 2), final_time=(0, 0.5))) == 0.5
    assert horizon(replace(across(pi / 2), final_time=(30, None))) == 30
    tank = problem(
        minimise=-x,
        dynamics={x: 1, v: u / 10},
        bounds={u: (0, 1), v: (None, 9)},
        start={x: 0, v: 1},
    )
    assert 40 < horizon(tank) < 160  # no end is asked for: until the tank is full


# -- infinite order is said where it is proved


def test_infinite_order_is_proved_by_a_closed_span() -> None:
    own = problem(minimise=y, dynamics={x: u, y: -y}, start={x: 1, y: 1}, final_time=5)
    with pytest.raises(MethodError, match="infinite order"):
        laws.derive(own, ("u",))
    with pytest.raises(MethodError, match="infinite order"):
        laws.derive(
            train(), ("w",)
        )  # with u constant the work is u times the way, whatever the brake does


def test_a_span_is_not_closed_where_rows_hold_on_a_surface_of_states_only() -> None:
    own = problem(running=x**2, dynamics={x: y, y: u}, start={x: 1, y: 1}, final_time=5)
    setting = setting_of(own, (Mode("singular"),), constant=True)
    touch = contact(setting)
    costate_y, costate_x = casadi.SX([0, 1, 0]).T, casadi.SX([1, 0, 0]).T
    state_x, state_y = casadi.horzcat(0, 0, x), casadi.horzcat(0, 0, y)
    assert spans(setting, touch, [costate_y], [3 * x * costate_y])
    assert not spans(setting, touch, [costate_y], [costate_x])
    assert not spans(setting, touch, [costate_y, state_x], [costate_x])
    assert not spans(setting, touch, [costate_y, state_x], [state_y])
    one = casadi.SX([0, 0, 1]).T
    assert not spans(setting, touch, [one + costate_y, costate_y], [costate_x]), "no costate: 0 = 1"


def test_a_conserved_gradient_proves_nothing() -> None:
    own = problem(minimise=y, dynamics={x: u, y: -u}, start={x: 1, y: 1}, end={x: 0}, final_time=5)
    with pytest.raises(
        MethodError, match=r"no law was found: at \d+ of \d+ points .* proves nothing"
    ):
        laws.derive(own, ("u",))


def test_what_is_not_found_is_not_called_infinite() -> None:
    with pytest.raises(
        MethodError, match=r"no such arc was found: .*\(\d+ points tried\)|no law was found"
    ) as refused:
        laws.derive(corner(1e-5), ("u",))
    assert "infinite" not in str(refused.value)


# -- solutions teach


def pretended(own: Problem, level: float) -> Solution:
    """Return a solution of the corner that keeps the substrate at a level inside the control's
    box.
    """
    t = np.linspace(0, 5, 101)
    states_ = np.vstack([np.full_like(t, level), t / 3])
    made = guess_of(own, t, states_, np.full((1, t.size), 0.3))
    costate = np.vstack([np.zeros_like(t), -np.ones_like(t)])
    return replace(made, arcs=(replace(made.arcs[0], costate=costate),))


def test_points_of_a_solution_show_a_law_that_random_ones_miss() -> None:
    own = corner(1e-5)
    with pytest.raises(MethodError):
        laws.arc_law(own, (Mode("singular"),))
    assert lessons.learn(own, pretended(own, 1.2e-5))
    found = laws.derive(own, ("u",))
    assert np.allclose(found.points[1], 1e-5, rtol=1e-6)
    assert laws.arc_law(own, (Mode("singular"),)).control.numel() == 1
    assert not lessons.learn(own, pretended(own, 1.2e-5)), "the law is known by now"


def test_nothing_is_learnt_from_bangs_and_from_costates_that_are_unknown() -> None:
    own = corner(1e-5)
    made = pretended(own, 1.2e-5)
    arc = made.arcs[0]
    assert not lessons.learn(own, replace(made, arcs=(replace(arc, u=np.zeros_like(arc.u)),)))
    assert not lessons.learn(
        own, replace(made, arcs=(replace(arc, costate=np.full_like(arc.x, np.nan)),))
    )
    assert not sampled.noted_points(own)


def test_failures_are_kept_until_points_are_noted(monkeypatch: pytest.MonkeyPatch) -> None:
    own, calls = corner(1e-5), []
    chain = principle.derivatives
    monkeypatch.setattr(principle, "derivatives", lambda *given: calls.append(1) or chain(*given))
    for _ in range(3):
        with pytest.raises(MethodError):
            laws.derive(own, ("u",))
    assert len(calls) == 1
    principle.forget_derivation(own)
    with pytest.raises(MethodError):
        laws.derive(own, ("u",))
    assert len(calls) == 2


def test_points_from_which_no_law_was_found_are_not_tried_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own, begun_from = corner(1e-5), []
    begin = singular.begun
    monkeypatch.setattr(
        singular,
        "begun",
        lambda setting, touch, points, *more: (
            begun_from.append(points.shape[1]) or begin(setting, touch, points, *more)
        ),
    )
    for noted in (0, 3, 2):
        if noted:
            sampled.note_points(own, sampled.admissible(own)[:, :noted])
        principle.forget_derivation(own)
        with pytest.raises(MethodError):
            laws.derive(own, ("u",))
    assert begun_from[-2:] == [3, 2], begun_from
    assert begun_from.count(sampled.COUNT) == 1


def test_that_there_is_no_law_is_not_forgotten_where_it_is_proved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own = problem(minimise=y, dynamics={x: u, y: -y}, start={x: 1, y: 1}, final_time=5)
    calls: list[int] = []
    chain = principle.derivatives
    monkeypatch.setattr(principle, "derivatives", lambda *given: calls.append(1) or chain(*given))
    for _ in range(2):
        with pytest.raises(LostError, match="infinite order") as caught:
            laws.derive(own, ("u",))
        assert caught.value.proved
        principle.forget_derivation(own)
    assert len(calls) == 1


# -- the law with the costate is always there


def test_costate_stays_where_it_cannot_be_eliminated(monkeypatch: pytest.MonkeyPatch) -> None:
    known = laws.derive(feeding(), ("u",))
    assert known.feedback is not None
    monkeypatch.setattr(eliminate, "_MINORS", 0)
    own = feeding()
    found = laws.derive(own, ("u",))
    assert found.feedback is None
    assert found.orders == {"u": 1}
    law = laws.arc_law(own, (Mode("singular"),))
    assert law.costate
    assert not found.surface.numel()
    ours, theirs = (
        sampled.evaluator(known_own, e)(found.points)[0]
        for known_own, e in (
            (own, found.control),
            (own, casadi.substitute(known.control, known_costate(known), own.costate)),
        )
    )
    assert np.allclose(ours, theirs, rtol=1e-6)


def known_costate(found: ArcPrinciple) -> casadi.SX:
    return found.setting.problem.costate


# -- descriptions


def test_description_of_an_arc_that_sampling_does_not_meet() -> None:
    own = problem(running=x**2 + y**2, dynamics={x: u, y: -y}, start={x: 1, y: 1}, final_time=5)
    found = laws.derive(own, ("u",))
    assert found.chain is not None
    never = casadi.horzcat(0, 0, 1 + x**2)
    nowhere = replace(found, chain=replace(found.chain, rows=[never], points=found.points[:, :0]))
    assert "met by sampling" in lawbook._remark(own, nowhere, [0], "")
    assert sampled.evaluator(own, x, casadi.vertcat(x, y))(found.points[:, :0])[1].shape == (
        0,
        2,
        1,
    )


def test_constraint_that_no_control_moves_says_so() -> None:
    own = problem(
        running=x**2 + u * y,
        dynamics={x: u, y: -y},
        start={x: 1, y: 1},
        path={"far": y <= 2},
        final_time=5,
    )
    with pytest.raises(MethodError, match="no control appears"):
        laws.derive(own, (), {"u": "far"})


def test_far_bounds_have_boundary_laws() -> None:
    """A bound that no sampled motion comes near is as good a constraint as others."""
    own = problem(
        minimise=-y,
        dynamics={x: u, y: 1e-4 * (1 + u)},
        bounds={u: (-1, 1), y: (None, 50)},
        start={x: 1, y: 0},
        final_time=5,
    )
    assert float(laws.derive(own, (), {"u": "y.upper"}).control) == -1


# -- solved from nothing


@pytest.mark.parametrize(
    ("make", "objective", "word"),
    [
        (lambda: across(pi / 2), 4.32117356299, "u: + s"),
        (current, 5.27278526, "u: - s"),
        (drag, 1 - np.sqrt(2) * np.arctan(np.sqrt(0.5)), "u: - s"),
        (lambda: filling(1.0), 55427.1810, "u: + s -"),
    ],
)
@pytest.mark.slow
def test_singular_arcs_are_found_by_auto(
    registry: Registry, make: Callable[[], Problem], objective: float, word: str
) -> None:
    own = make()
    solution = run(registry.method("auto")(), own, default_guess(own))
    assert solution.extremal
    assert solution.objective == pytest.approx(objective, rel=1e-8)
    assert str(solution.word) == word


@pytest.mark.slow
def test_a_fed_batch_at_a_free_time_is_certified_along_its_word(registry: Registry) -> None:
    own = feeding()
    solution = run(registry.method("lgr-multiphase")(word="- s -"), own, default_guess(own))
    assert solution.extremal
    assert solution.objective == pytest.approx(-10.23765295, rel=1e-8)
