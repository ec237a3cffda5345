"""Derivatives of shooting equations, put together from those of single intervals."""

from dataclasses import replace
from typing import Any

import casadi
import numpy as np
import pytest

from socp import Problem, Word, controls, default_guess, parameters, states, time
from socp.methods.guess import split
from socp.transcription import dormand_prince, follow
from socp.transcription.linearised import Linearised
from socp.transcription.motion import bent, motion_of, moved, swept
from socp.transcription.shooting import Shooting


def shooting() -> Shooting:
    """Return three arcs of a motion with a parameter, explicit time and a running cost."""
    x, v = states("x v")
    u, c = controls("u"), parameters("c")
    problem = Problem(
        name="driven",
        minimise=x**2 + c * v,
        running=v**2 * casadi.cos(time) + u * x,
        dynamics={x: v + c * casadi.sin(time), v: u - c * x * v},
        bounds={u: (-1, 2), c: (0, 3)},
        start={x: 1},
        guess={v: 0.5, c: 0.7},
        final_time=(1, 4),
    )
    word = Word.parse("u: + - +", ("u",))
    return Shooting(
        follow(problem, word), split(default_guess(problem), [0.4, 0.5, 0.3]), (3, 2, 3)
    )


@pytest.mark.slow
def test_slopes_and_curvatures_are_those_of_differences() -> None:
    known = shooting()
    rng = np.random.default_rng(0)
    w = known.start + 0.1 * rng.normal(size=known.start.size)
    here, held = Linearised.of(known, w), rng.normal(size=known.signs.size)
    hessian, step = here.hessian(held), 1e-4
    # the initial time, all lengths, the parameter, some states
    for k in (*range(5), 5, 106, 313, w.size - 2):
        one = np.eye(w.size)[k]
        a, b, c, d = (Linearised.of(known, w + n * step * one) for n in (-2, -1, 1, 2))
        for slope, values in (
            (here.slopes[:, k], [each.equations for each in (a, b, c, d)]),
            (here.gradient[k], [each.cost for each in (a, b, c, d)]),
            (hessian[:, k], [each.gradient + held @ each.slopes for each in (a, b, c, d)]),
        ):
            difference = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step)
            assert slope == pytest.approx(difference, rel=1e-8, abs=1e-9)


def test_rough_curvatures_are_those_of_steps_four_times_as_long() -> None:
    """Of one interval in four steps and in one: same variables, and as many multipliers."""
    motion, random = shooting().motions[0], np.random.default_rng(2)
    z, t, h, p = random.normal(size=(2, 4)), np.arange(4.0), np.full(4, 0.3), np.array([[0.7]])
    given, held = [z, t[None, :], h[None, :], p], random.normal(size=(2, 4))
    rough, long = motion.sweep(given, 4).bent(held, 4), motion.sweep(given, 1).bent(held)
    assert np.abs(rough - long).max() <= 1e-8 * np.abs(long).max()
    errors = [
        np.abs(motion.sweep(given, 8).bent(held, n) - motion.sweep(given, 32).bent(held)).max()
        for n in (4, 8)
    ]
    assert 2.0**6 < errors[1] / errors[0] < 2.0**10  # of order 8


def test_arcs_worked_out_at_once_are_what_each_is_alone() -> None:
    """Two arcs of one law, or of one but for constants, in different numbers of steps."""
    known, random = shooting(), np.random.default_rng(3)
    p, steps = np.array([[0.7]]), [3, 4, 2]
    given, held = [], []
    for n in (4, 1, 2):
        given.append([random.normal(size=(2, n)), random.normal(size=(1, n)), np.ones((1, n)), p])
        held.append(random.normal(size=(2, n)))
    together = swept(known.motions, given, steps)
    assert together[0].stages is together[1].stages is together[2].stages
    alone = [m.sweep(each, k) for m, each, k in zip(known.motions, given, steps, strict=True)]
    ends = moved(known.motions, [(z, t[0], h[0]) for z, t, h, _ in given], p[:, 0], 5)
    for motion, end, (z, t, h, _) in zip(known.motions, ends, given, strict=True):
        assert np.array_equal(end, motion.moved(z, t[0], h[0], p[:, 0], 5)[-1][:-1])
    for stride in (1, 2):
        curvatures = bent(together, held, stride)
        for one, other, own, found in zip(together, alone, held, curvatures, strict=True):
            assert one.ends == pytest.approx(other.ends, rel=1e-13)
            assert one.slopes == pytest.approx(other.slopes, rel=1e-13, abs=1e-13)
            assert found == pytest.approx(other.bent(own, stride), rel=1e-12, abs=1e-12)


def test_many_steps_are_worked_out_portion_by_portion(monkeypatch: pytest.MonkeyPatch) -> None:
    motion, random = shooting().motions[0], np.random.default_rng(4)
    z, t, h, p = random.normal(size=(2, 5)), np.arange(5.0), np.full(5, 0.3), np.array([[0.7]])
    given, held = [z, t[None, :], h[None, :], p], random.normal(size=(2, 5))
    whole = motion.sweep(given, 3)
    monkeypatch.setattr(dormand_prince, "_HELD", 1000)
    apart = motion.sweep(given, 3)
    sizes = [own.stop - own.start for _, own in apart.stages.portions()]
    assert 1 <= sizes[0] < 15 / 2
    assert apart.slopes == pytest.approx(whole.slopes, rel=1e-14, abs=1e-14)
    for stride in (1, 3):
        assert apart.bent(held, stride) == pytest.approx(whole.bent(held, stride), rel=1e-13)


def test_a_motion_that_nothing_changes_has_the_slopes_of_its_length_alone() -> None:
    x, u = states("x"), controls("u")
    problem = Problem(
        name="even",
        minimise=x,
        running=2 * u,
        dynamics={x: u},
        bounds={u: (-1, 2)},
        start={x: 0},
        final_time=1,
    )
    phase = follow(problem, Word.parse("u: +", ("u",))).phases[0]
    given = [np.zeros((1, 2)), np.zeros((1, 2)), np.array([[0.5, 1.5]]), np.empty((0, 1))]
    sweep = motion_of(problem, phase).sweep(given, 2)
    assert sweep.ends == pytest.approx(np.array([[1.0, 2.0], [3.0, 6.0]]), rel=1e-14)
    wanted = np.array([[1.0, 0.0, 2.0], [0.0, 0.0, 4.0]])
    assert sweep.slopes[0] == pytest.approx(wanted, rel=1e-14)
    assert sweep.bent(np.ones((1, 2))) == pytest.approx(0.0, abs=1e-14)


def test_arcs_of_one_law_share_their_functions() -> None:
    known = shooting()
    first, middle, last = known.motions
    assert first is last
    assert first is not middle
    assert motion_of(known.phased.of, known.phased.phases[2]) is first


def test_bangs_share_their_functions_and_each_goes_its_own_way() -> None:
    """Along v' = u, x' = v from rest, over h: v = u h, x = u h^2 / 2, the cost u^2 h^3 / 6."""
    x, v, y = states("x v y")
    u, w = controls("u w")
    problem = Problem(
        name="bangs",
        minimise=x,
        running=u * x,
        dynamics={x: v, v: u, y: w},
        bounds={u: (-1, 2), w: (0, 1)},
        start={x: 0, v: 0, y: 0},
        singular={w: casadi.sin(v)},
        final_time=1,
    )
    words = ("u: + -; w: + -", "u: + -; w: s s")
    both = [follow(problem, Word.parse(each, ("u", "w"))).phases for each in words]
    motions = [[motion_of(problem, phase) for phase in phases] for phases in both]
    (up, down), others = motions
    assert up.flow is down.flow is not others[0].flow is others[1].flow
    h, rest, none = np.array([0.5, 1.5]), np.zeros((3, 2)), np.empty(0)
    for motion, level in ((up, 2.0), (down, -1.0), (others[0], 2.0), (others[1], -1.0)):
        end = motion.moved(rest, np.zeros(2), h, none, 3)[-1]
        wanted = np.array([level * h**2 / 2, level * h, level**2 * h**3 / 6, h])
        assert end[[0, 1, 3, 4]] == pytest.approx(wanted, rel=1e-13)
        given = [rest, np.zeros((1, 2)), h[None, :], np.empty((0, 1))]
        sweep = motion.sweep(given, 3)
        by_length = sweep.slopes[:, [0, 1, 3], 4].T
        wanted = np.array([level * h, [level, level], level**2 * h**2 / 2])
        assert by_length == pytest.approx(wanted, rel=1e-13)
        bent = sweep.bent(np.array([[1.0, 1.0], [1.0, 1.0], [0.0, 0.0]]))[:, 4, 4]
        assert bent == pytest.approx(level + level**2 * h, rel=1e-12)


def test_what_holds_where_one_arc_ends_is_not_taken_for_another_s() -> None:
    def left(known: Shooting, first: tuple[casadi.SX, ...], then: tuple[casadi.SX, ...]) -> Any:
        a, b, c = known.phased.phases
        phases = replace(a, exit=first), replace(b, exit=then), c
        other = Shooting(replace(known.phased, phases=phases), known.solution, known.steps)
        return other.joined[0](other.start)[0].full()

    known, again = shooting(), shooting()
    x, v = casadi.vertsplit(known.phased.of.x)
    both = left(known, (x, v), ())
    y, w = casadi.vertsplit(again.phased.of.x)
    assert np.array_equal(left(known, (x,), (v,)), left(again, (y,), (w,)))
    assert not np.array_equal(both, left(again, (y,), (w,)))
