"""Digits and errors are true: what a verdict says to be known of objective and switching times is,
on known truths.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi
import numpy as np
import pytest
from records import revised

from socp import Ipopt, Problem, Solution, Word, controls, default_guess, final_time, silent, states
from socp.laws import probes as points
from socp.methods.guess import split
from socp.methods.solving import Follower
from socp.model.data.family import Family
from socp.model.data.files import from_json, to_json
from socp.model.evaluation import numbers, scales
from socp.model.result.findings import Agreement
from socp.model.result.solution import Stop
from socp.model.symbols import time
from socp.registry.plugins import Registry
from socp.registry.solving import solve
from socp.registry.standard import STANDARD, turning_back
from socp.search.digits import with_agreement
from socp.transcription.kinks import kinks
from socp.verdict.accuracy import word_problem
from socp.verdict.certify import judge
from socp.view.report import agreed_digits, switch_error

REGISTRY = Registry.load()
BACKEND = Ipopt({"tol": 1e-11})
ROUNDING = 4e-15  # of the truth itself, which is worked out in floating point


@dataclass(frozen=True, eq=False)
class Known:
    """A problem with its word, rough lengths of its arcs, and the true objective and switching
    times.
    """

    problem: Problem
    word: str
    lengths: tuple[float, ...]
    objective: float
    switches: tuple[float, ...] = ()


def handover(drive: float = 1.0, brake: float = 2.0, way: float = 10.0) -> Known:
    """Rest to rest with throttle and brake as two controls, in least time: they hand over at one
    time.

    Driving at a for s, braking at b for r: a s = b r and a s^2/2 + b r^2/2 = d, so s = sqrt(2 d b /
    (a (a + b))).
    """
    x, v = states("x v")
    r, b = controls("r b")
    problem = Problem(
        name="handover",
        minimise=final_time,
        dynamics={x: v, v: r - b},
        bounds={r: (0, drive), b: (0, brake)},
        start={x: 0, v: 0},
        end={x: way, v: 0},
    )
    s = math.sqrt(2 * way * brake / (drive * (drive + brake)))
    total = s * (1 + drive / brake)
    return Known(problem, "r: + -; b: - +", (s, total - s), total, (s,))


def known() -> dict[str, Known]:
    """Return standard problems with their words, and others in closed form."""
    words = {
        "minimum_time": ("u: - +", (0.2, 1.2), (math.sqrt(1.5) - 1,)),
        "regulator": ("u: - s", (1.0, 1.0), (1.0,)),
        "control_cost": ("u: + -", (1.5, 0.5), (1.5,)),
        "tracking": ("u: - s", (0.4, 0.6), (math.sqrt(2) - 1,)),
        "speed_limit": ("u: + b[v.upper] -", (1.0, 1.0, 1.0), (1.0, 2.0)),
        "parameter": ("u: +", (1.0,), ()),
        "turning_back": ("u: - +", (2.2, 1.2), (1 + math.sqrt(1.5),)),
    }
    found = {}
    for each in (*STANDARD, turning_back()):
        word, lengths, switches = words[each.problem.name]
        found[each.problem.name] = Known(each.problem, word, lengths, each.objective, switches)
    auv = REGISTRY.problem("auv")
    assert auv.reference is not None
    times = auv.reference.switches
    lengths = tuple(np.diff([0.0, *times, auv.reference.objective]).tolist())
    word = "r: + s s s +; f: + + b[u.upper] - -"
    found["auv"] = Known(auv, word, lengths, auv.reference.objective, tuple(times))
    found["handover"] = handover()
    return found


KNOWN = known()


def along(
    of: Known, problem: Problem, backend: Ipopt = BACKEND, guess: Solution | None = None
) -> Solution:
    """Solve a problem along a known word."""
    word = Word.parse(of.word, problem.control_names)
    start = split(default_guess(problem), list(of.lengths)) if guess is None else guess
    return Follower(backend=backend)(problem, word, start)


@pytest.fixture(scope="module")
def exact() -> Callable[[str], Solution]:
    made: dict[str, Solution] = {}

    def get(name: str) -> Solution:
        if name not in made:
            made[name] = judge(KNOWN[name].problem, along(KNOWN[name], KNOWN[name].problem))
        return made[name]

    return get


def ends_moved(problem: Problem, by: float, base: Solution) -> Problem:
    """Return a problem with its fixed ends, or else its start, a share of the states' sizes
    away.
    """
    ends = {
        name: (b, a)
        for name, b, a in zip(problem.state_names, *problem.end_box, strict=True)
        if b == a
    }
    which, box = ("end", problem.end_box) if ends else ("start", problem.start_box)
    values, scale = {}, scales(problem, base)
    for i, symbol in enumerate(_symbols(problem.x)):
        if box[0, i] == box[1, i]:
            at_bound = box[0, i] in problem.state_box[:, i]  # it can go nowhere
            values[symbol] = float(box[0, i]) + (0.0 if at_bound else (-1) ** i * by * scale[i])
    free = problem.final_time_box[0] != problem.final_time_box[1]
    guess = (
        {**problem.guess, final_time: sum(KNOWN[problem.name].lengths)} if free else problem.guess
    )
    return replace(problem, guess=guess, **{which: values})


def _symbols(column: object) -> list[object]:
    return [column[i] for i in range(column.numel())]  # type: ignore[attr-defined, index]


def box_widened(problem: Problem, by: float, _base: Solution) -> Problem:
    """Return a problem whose controls, and states where they have bounds, may go a share
    further.
    """
    bounds = {}
    for symbol, row in problem.bounds.items():
        low, high = row
        width = by * (high - low) if None not in row else 0.0
        bounds[symbol] = (
            None if low is None else low - width,
            None if high is None else high + width,
        )
    return replace(problem, bounds=bounds)


def time_moved(problem: Problem, by: float, _base: Solution) -> Problem:
    """Return a problem whose final time, where it is given, is a share later."""
    return replace(problem, final_time=problem.final_time_box[0] * (1 + by))


def claims_hold(of: Known, solution: Solution) -> None:
    """Assert that the truth is where a certified solution says that it is."""
    verdict = solution.verdict
    assert verdict is not None
    off, rounding = abs(solution.objective - of.objective), ROUNDING * abs(of.objective)
    assert off <= verdict.objective_error + rounding
    assert off <= verdict.remaining_error + rounding
    assert off <= abs(of.objective) * 10.0**-verdict.digits + rounding
    found = solution.switches
    if len(found) == len(of.switches):
        errors = dict(verdict.switch_errors)
        for t, truth in zip(found, of.switches, strict=True):
            assert abs(t - truth) <= errors[t] + ROUNDING * solution.final_time
    for line in agreed_digits(solution):
        assert off <= abs(of.objective) * 10.0 ** -int(line.split()[0]) + rounding
        if found and "within" in line:
            within = float(line.rsplit("within ", 1)[1].split(",")[0])
            assert (
                max(abs(np.array(found) - of.switches))
                <= 1.05 * within + ROUNDING * solution.final_time
            )


NAMES = sorted(KNOWN)


TIMED = ("regulator", "control_cost", "tracking", "parameter")  # their final time is given
NEXT_DOOR = [
    *((name, ends_moved) for name in NAMES),
    *((name, box_widened) for name in NAMES if name != "auv"),
    *((name, time_moved) for name in TIMED),
]


@pytest.mark.parametrize("by", [1e-7, 9e-7])
@pytest.mark.parametrize(
    ("name", "change"), NEXT_DOOR, ids=lambda each: getattr(each, "__name__", each)
)
@pytest.mark.slow
def test_a_solution_of_a_problem_next_door_claims_no_more_than_is_true(
    name: str, change: Callable[..., Problem], by: float, exact: Callable[[str], Solution]
) -> None:
    of, base = KNOWN[name], exact(name)
    moved = change(of.problem, by, base)
    solution = judge(of.problem, along(of, moved, guess=base))
    if solution.extremal:
        claims_hold(of, solution)
    else:
        assert solution.verdict is not None
        assert solution.verdict.reasons


@pytest.mark.parametrize(
    ("name", "change"), NEXT_DOOR, ids=lambda each: getattr(each, "__name__", each)
)
def test_the_judge_claims_no_more_than_is_true_where_no_newton_step_tells(
    name: str,
    change: Callable[..., Problem],
    exact: Callable[[str], Solution],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    of, base = KNOWN[name], exact(name)
    monkeypatch.setattr("socp.verdict.accuracy.accuracy", lambda *_: None)
    moved = change(of.problem, 9e-8, base)
    solution = judge(of.problem, along(of, moved, guess=base))
    assert solution.extremal
    claims_hold(of, solution)


@pytest.mark.parametrize(
    "name", ["minimum_time", "turning_back", "speed_limit", "parameter", "handover"]
)
def test_a_missed_end_costs_digits(name: str, exact: Callable[[str], Solution]) -> None:
    of, base = KNOWN[name], exact(name)
    solution = judge(of.problem, along(of, ends_moved(of.problem, 9e-8, base), guess=base))
    assert solution.extremal
    assert solution.verdict is not None
    assert 5 <= solution.verdict.digits <= 8  # not thirteen, and not none either
    assert solution.verdict.objective_error < 1e3 * abs(solution.objective - of.objective)


@pytest.mark.parametrize("tolerance", [pytest.param(1e-9, marks=pytest.mark.slow), 1e-7, 1e-5])
@pytest.mark.parametrize("name", [name for name in NAMES if name != "auv"])
def test_a_coarse_solution_claims_no_more_than_is_true(name: str, tolerance: float) -> None:
    of = KNOWN[name]
    solution = judge(of.problem, along(of, of.problem, Ipopt({"tol": tolerance})))
    if solution.extremal:
        claims_hold(of, solution)
    else:
        assert tolerance > 1e-9


@pytest.mark.parametrize("name", NAMES)
def test_what_is_trusted_claims_no_more_than_is_true(
    name: str, exact: Callable[[str], Solution]
) -> None:
    of = KNOWN[name]
    solution = with_agreement(of.problem, exact(name), 9, BACKEND)
    assert solution.judgement.agreement is not None
    assert solution.verdict is not None
    assert solution.verdict.digits >= 9
    claims_hold(of, solution)
    assert agreed_digits(solution)[0].startswith(("15 ", "14 ", "13 "))


# -- two controls that switch at one time


def with_sliver(of: Known, length: float) -> Solution:
    """Return a solution with an arc of a given length between two switches that belong to one
    time.
    """
    word = "r: + + -; b: - + +"
    lengths = (of.switches[0], length, of.objective - of.switches[0])
    return along(Known(of.problem, word, lengths, of.objective), of.problem)


@pytest.mark.parametrize(
    "numbers", [(1.0, 2.0, 10.0), (3.0, 1.0, 7.0), (0.4, 5.0, 200.0), (2.0, 2.0, 1.0)]
)
def test_a_sliver_between_two_switches_is_merged(numbers: tuple[float, float, float]) -> None:
    of = handover(*numbers)
    sliver = judge(of.problem, with_sliver(of, 1e-3 * of.objective))
    assert len(sliver.arcs) == 3
    if sliver.extremal:  # its ends say how far they are off
        claims_hold(replace(of, switches=of.switches * 2), sliver)
    solution = with_agreement(of.problem, sliver, 9, BACKEND)
    assert len(solution.arcs) == 2
    assert solution.extremal
    claims_hold(of, solution)
    assert solution.switches == pytest.approx(of.switches, abs=1e-12 * of.objective)


# -- switches that the principle hardly determines, or not at all


def shaped(cost: casadi.SX) -> Known:
    """Return a control in [0, 1] on [0, 2] at a price that is negative before t = 1 and positive
    after it.
    """
    x = states("x")
    u = controls("u")
    problem = Problem(
        name="shaped",
        running=cost * u,
        dynamics={x: u},
        bounds={u: (0, 1)},
        start={x: 0},
        final_time=2,
    )
    return Known(problem, "u: + -", (0.9, 1.1), 0.0, (1.0,))


@pytest.mark.parametrize("newton", [True, False])
@pytest.mark.parametrize(
    ("order", "objective"), [(1, -1 / 2), (3, -1 / 4), (5, -1 / 6), (7, -1 / 8)]
)
def test_a_flat_switching_function_leaves_its_time_uncertain(
    order: int, objective: float, newton: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    of = replace(shaped((time - 1) ** order), objective=objective)
    if not newton:
        monkeypatch.setattr("socp.verdict.accuracy.accuracy", lambda *_: None)
    solution = judge(of.problem, along(of, of.problem))
    assert solution.extremal
    claims_hold(of, solution)
    assert solution.verdict is not None
    (_, error), *_ = solution.verdict.switch_errors
    assert (error < 1e-8) == (order == 1)


def test_a_time_that_is_left_open_is_given_no_number(exact: Callable[[str], Solution]) -> None:
    solution = exact("speed_limit")
    assert solution.verdict is not None
    times = solution.switches
    verdict = replace(solution.verdict, switch_errors=((times[0], math.inf), (times[1], 1e-3)))
    shown = revised(solution, agreement=Agreement(objective=1e-12, switches=1e-9), verdict=verdict)
    (text,) = agreed_digits(shown)
    assert text.startswith(
        "12 of the objective: two computations differ by 1.0e-12, switching times within 1.0e-03"
    )
    assert text.endswith(", 1 of 2 switching times not determined")
    again = from_json(to_json(shown)).verdict
    assert again is not None
    assert again.switch_errors == verdict.switch_errors
    assert (again.flat, again.remaining_error) == (verdict.flat, verdict.remaining_error)
    assert "not determined" in verdict._repr_html_()
    assert switch_error(math.inf) == "not determined"
    assert switch_error(1e-3) == "within 1.0e-03"


# -- controls that switch at one time by symmetry: more equations than unknowns


def pair(ways: tuple[float, ...], reaches: tuple[float, ...]) -> Known:
    """Bring several carts from rest to rest at once, in least time: each takes 2 sqrt(way /
    reach).
    """
    names = "xyz"[: len(ways)]
    x, v = ([states(f"{letter}{k}") for k in names] for letter in "xv")
    u = [controls(f"u{k}") for k in names]
    problem = Problem(
        name="pair",
        minimise=final_time,
        dynamics={**dict(zip(x, v, strict=True)), **dict(zip(v, u, strict=True))},
        bounds={each: (-reach, reach) for each, reach in zip(u, reaches, strict=True)},
        start=dict.fromkeys([*x, *v], 0),
        end={**dict(zip(x, ways, strict=True)), **dict.fromkeys(v, 0)},
    )
    total = 2 * math.sqrt(ways[0] / reaches[0])
    word = "; ".join(f"u{k}: + -" for k in names)
    return Known(problem, word, (0.45 * total, 0.6 * total), total, (total / 2,))


@pytest.mark.parametrize(
    "of", [pair((1, 1), (1, 1)), pair((1, 3), (1, 3)), pair((2, 2, 2), (1, 1, 1))]
)
def test_symmetric_controls_switch_at_one_time(of: Known) -> None:
    found = along(of, of.problem)
    assert found.stop is Stop.SOLVED
    assert "which agree" in found.message
    solution = with_agreement(of.problem, judge(of.problem, found), 9, BACKEND)
    assert solution.extremal
    assert solution.judgement.agreement is not None
    assert len(solution.arcs) == 2
    claims_hold(of, solution)


def test_equations_that_contradict_each_other_are_infeasible() -> None:
    of = pair((1, 1.1), (1, 1))  # no joint switch serves both
    found = along(of, of.problem)
    assert found.stop is Stop.INFEASIBLE
    assert "equations for" in found.message
    assert "agree" not in found.message


# -- kinks at one place, and arcs and laws without a point


def test_a_pedal_with_two_gains_has_one_kink() -> None:
    """Raise p at the highest rate, then lower it: v' = p above zero, 2 p below it.

    From p = -0.2 to a peak of q and back to 0, v gains q^2 - 0.04, so q = sqrt(1.04) and tf = 0.2 +
    2 q.
    """
    v, p = states("v p")
    j = controls("j")
    problem = Problem(
        name="pedal",
        minimise=final_time,
        dynamics={v: casadi.fmax(p, 0) - 2 * casadi.fmax(-p, 0), p: j},
        bounds={j: (-1, 1)},
        start={v: 0, p: -0.2},
        end={v: 1, p: 0},
    )
    q = math.sqrt(1.04)
    of = Known(problem, "j: + -", (1.2, 1.0), 0.2 + 2 * q, (0.2 + q,))
    solution = judge(problem, along(of, problem))
    assert solution.extremal
    claims_hold(of, solution)


@pytest.mark.parametrize(("times", "count"), [((-1.0,), 1), ((2.0, -3.0), 1), ((1e6,), 1)])
def test_multiples_of_a_kink_are_the_kink(times: tuple[float, ...], count: int) -> None:
    a, b = casadi.SX.sym("a"), casadi.SX.sym("b")
    base = casadi.fabs(a * b - 2)
    expression = base + sum(casadi.fabs(k * (a * b - 2)) for k in times)
    assert kinks(expression, casadi.vertcat(a, b)).numel() == count
    other = casadi.fabs(a - 1e6) + casadi.fabs(
        a - 1.001e6
    )  # far off, alike near the origin, and not the same
    assert kinks(other, casadi.vertcat(a, b)).numel() == 2


@pytest.mark.parametrize("level", [0.0, 0.3])
def test_an_arc_on_a_constraint_from_start_to_end_can_be_solved(level: float) -> None:
    x = states("x")
    u = controls("u")
    problem = Problem(
        name="floor",
        running=x,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        path={"floor": x >= level},
        start={x: level},
        final_time=3,
    )
    of = Known(problem, "u: b[floor]", (3.0,), 3 * level)
    found = along(of, problem)
    assert found.stop is Stop.SOLVED
    assert found.objective == pytest.approx(of.objective, abs=1e-12)


def test_no_points_give_no_values() -> None:
    problem = KNOWN["regulator"].problem
    first, second = points.evaluator(problem, problem.x, problem.rate)(
        np.empty((points.symbols(problem).numel(), 0))
    )
    assert first.shape == second.shape == (0, 1, 1)
    function = casadi.Function(
        "f", [problem.x], [2 * problem.x, casadi.vertcat(problem.x, problem.x)]
    )
    assert [each.shape for each in numbers(function, np.empty((1, 0)))] == [(1, 0), (2, 0)]


def test_a_word_is_laid_out_once_for_the_same_values(exact: Callable[[str], Solution]) -> None:
    problem, base = KNOWN["minimum_time"].problem, exact("minimum_time")
    known = word_problem(problem, base, 10)
    assert known is not None
    assert word_problem(problem, replace(base), 10) is known
    for other in (replace(base, objective=base.objective + 1.0), moved_slightly(base)):
        anew = word_problem(problem, other, 10)
        assert anew is not None
        assert anew is not known
        assert anew.solution.objective == other.objective
        assert np.array_equal(anew.solution.arcs[0].x, other.arcs[0].x)


def moved_slightly(solution: Solution) -> Solution:
    """Return a solution with a state moved by rounding."""
    first, *rest = solution.arcs
    return replace(solution, arcs=(replace(first, x=np.nextafter(first.x, np.inf)), *rest))


def test_a_word_is_not_cut_at_a_knot_of_a_longer_horizon() -> None:
    x, u = states("x"), controls("u")
    dear = 1 + casadi.fmax(time - 3, 0)
    posed = Problem(
        name="dear at last",
        running=(x - 0.25) ** 2 * dear,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 1},
        final_time=4,
    )
    solution = solve(posed, method="lgr-multiphase", word="- s", watch=silent)
    family = Family(posed, ("final_time",))
    found = [word_problem(family.at({"final_time": tf}), solution, 10) for tf in (4.0, 2.0)]
    assert [each.pieces for each in found if each] == [[1, 2], [1, 1]]
