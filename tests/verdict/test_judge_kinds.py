"""The judge on kinds of problems, each with its answer in closed form: right solutions are
certified.

Solutions are laid out exactly from formulas where possible, so that no solver stands between the
mathematics and the judge.
"""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from records import built

from socp import (
    Ipopt,
    Problem,
    Solution,
    Word,
    controls,
    default_guess,
    final_time,
    initial,
    initial_time,
    judge,
    parameters,
    solve_collocated,
    states,
    time,
    uniform,
)
from socp.methods.guess import split
from socp.model.result.arc import Arc
from socp.model.result.solution import Stop
from socp.transcription import follow
from socp.transcription.schemes import lgr

Formula = Callable[[np.ndarray], Sequence[np.ndarray]]


def solved(problem: Problem, word: str, lengths: list[float] | None = None) -> Solution:
    """Solve a word on a fixed mesh and judge it."""
    phased = follow(problem, Word.parse(word, problem.control_names))
    guess = default_guess(problem) if lengths is None else split(default_guess(problem), lengths)
    mesh = [uniform(lgr(10), 4)] * len(phased.phases)
    return judge(problem, solve_collocated(phased, mesh, Ipopt({"tol": 1e-11}), guess))


def exact(
    problem: Problem,
    ends: list[float],
    modes: list[str],
    x: Formula,
    u: list[list[float]],
    objective: float,
) -> Solution:
    """Lay out arcs between `ends` with states x(t), constant controls u by arc, and modes such as
    `+ b` by arc.
    """
    tau = (lgr(10).nodes + 1.0) / 2.0
    arcs = []
    for start, end, mode, value in zip(ends[:-1], ends[1:], modes, u, strict=True):
        t = start + (end - start) * tau
        t[-1] = end
        state = np.array([np.broadcast_to(row, t.shape) for row in x(t)], dtype=float)
        control = np.repeat(np.array(value)[:, None], t.size, axis=1)
        arcs.append(
            Arc(
                t=t,
                x=state,
                u=control,
                costate=np.full_like(state, np.nan),
                mesh=np.array([0, t.size - 1]),
                side="left",
                modes=tuple(mode.split()),
            )
        )
    return judge(
        problem,
        built(
            problem=problem.name,
            method="exact",
            arcs=tuple(arcs),
            objective=objective,
            stop=Stop.SOLVED,
            state_names=problem.state_names,
            control_names=problem.control_names,
        ),
    )


def certified(solution: Solution, objective: float, switches: list[float]) -> None:
    assert solution.verdict is not None
    assert solution.verdict.extremal, solution.verdict.reasons
    assert solution.objective == pytest.approx(objective, rel=1e-9)
    assert solution.switches == pytest.approx(switches, rel=1e-7)
    error = abs(solution.objective - objective) / abs(objective)
    assert error <= 10.0**-solution.verdict.digits


def cart(**given: object) -> Problem:
    """Return the double integrator at rest in 0, to be brought to rest in 1, unless told
    otherwise.
    """
    x, v = states("x v")
    u = controls("u")
    named = {"x": x, "v": v, "u": u}
    table = {
        "name": "cart",
        "dynamics": {x: v, v: u},
        "bounds": {u: (-1, 1)},
        "start": {x: 0, v: 0},
        "end": {x: 1, v: 0},
        "minimise": final_time,
    }
    for key, value in given.items():
        table[key] = value(named) if callable(value) else value
    return Problem(**table)  # type: ignore[arg-type]


# rest to rest over d takes 2 sqrt(d), with the switch half way
CARTS = [
    ("running one", cart(minimise=None, running=1), "+ -", 2.0, [1.0]),
    ("running t: T^2 / 2", cart(minimise=None, running=time), "+ -", 2.0, [1.0]),
    ("end interval, active", cart(end=lambda n: {n["x"]: (1, 2), n["v"]: 0}), "+ -", 2.0, [1.0]),
    ("end interval, idle", cart(end=lambda n: {n["x"]: 1, n["v"]: (-5, 5)}), "+", np.sqrt(2.0), []),
    (
        "target <=",
        cart(end=lambda n: {n["v"]: 0}, target=lambda n: {"far": n["x"] >= 1}),
        "+ -",
        2.0,
        [1.0],
    ),
    (
        "start at the end of an interval",
        cart(start=lambda n: {n["x"]: (-1, 0), n["v"]: 0}, guess=lambda n: {n["x"]: (0, 1)}),
        "+ -",
        2.0,
        [1.0],
    ),
    (
        "free initial time: t0 + 2 + (t0 - 1)^2 / 2",
        cart(
            minimise=final_time + 0.5 * (initial_time - 1) ** 2,
            initial_time=(-3, 5),
            guess={initial_time: 0.5, final_time: 3},
        ),
        "+ -",
        2.5,
        [1.0],
    ),
    (
        "initial time at its least",
        cart(
            minimise=final_time + 0.5 * (initial_time - 1) ** 2,
            initial_time=(0.5, 5),
            guess={initial_time: 0.7, final_time: 3},
        ),
        "+ -",
        2.625,
        [1.5],
    ),
    (
        "initial(x) in conditions and cost",
        cart(
            minimise=lambda n: final_time + (initial(n["x"]) - 1) ** 2,
            start=lambda n: {n["v"]: 0},
            end=lambda n: {n["v"]: 0},
            target=lambda n: {"go": n["x"] - initial(n["x"]) == 1.0},
        ),
        "+ -",
        2.0,
        [1.0],
    ),
]


@pytest.mark.parametrize(
    ("problem", "word", "objective", "switches"), [c[1:] for c in CARTS], ids=[c[0] for c in CARTS]
)
def test_ends_and_times(
    problem: Problem, word: str, objective: float, switches: list[float]
) -> None:
    certified(solved(problem, word), objective, switches)


@pytest.mark.parametrize(("low", "best"), [(0.2, 1.0), (1.5, 1.5)])
def test_parameter_inside_and_at_its_bound(low: float, best: float) -> None:
    """Rest to rest takes 2 / sqrt(p) with acceleration p, which costs p: p = 1, or the least that
    is allowed.
    """
    p = parameters("p")
    problem = cart(
        minimise=final_time + p,
        dynamics=lambda n: {n["x"]: n["v"], n["v"]: p * n["u"]},
        bounds=lambda n: {n["u"]: (-1, 1), p: (low, 5)},
        guess={p: 2.0, final_time: 3},
    )
    certified(solved(problem, "+ -"), best + 2 / np.sqrt(best), [1 / np.sqrt(best)])


def test_second_order_boundary_arc() -> None:
    """Least integral of x >= 0 from 1 back to 1 in 6: fall by - +, lie for 2, rise: four parabolas
    of area 1/2.
    """
    problem = cart(
        minimise=None,
        running=lambda n: n["x"],
        bounds=lambda n: {n["u"]: (-1, 1), n["x"]: (0, None)},
        start=lambda n: {n["x"]: 1, n["v"]: 0},
        final_time=6,
    )
    certified(solved(problem, "- + b + -"), 2.0, [1.0, 2.0, 4.0, 5.0])


def test_moving_constraint() -> None:
    """The roof x <= 1/2 + (t - 1)^2 met by x = t at (3 - sqrt 3) / 2 and followed to 1.4."""
    x = states("x")
    u = controls("u")
    problem = Problem(
        name="roof",
        running=-x,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        path={"roof": x <= 0.5 + (time - 1) ** 2},
        start={x: 0},
        final_time=1.4,
    )
    met = (3 - np.sqrt(3)) / 2
    area = met**2 / 2 + 0.5 * (1.4 - met) + (0.4**3 - (met - 1) ** 3) / 3
    certified(solved(problem, "+ b", [0.6, 0.8]), -area, [met])


def under_a_roof(**given: object) -> tuple[Problem, Formula]:
    x = states("x")
    u = controls("u")
    named = {"x": x, "u": u}
    table = {
        "name": "roof",
        "running": -x,
        "dynamics": {x: u},
        "bounds": {u: (-1, 1), x: (None, 1)},
        "start": {x: 0},
        "final_time": 3,
    }
    for key, value in given.items():
        table[key] = value(named) if callable(value) else value
    return Problem(**table), lambda t: [np.minimum(t, 1.0)]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "given",
    [{}, {"path": lambda n: {"again": 2 * n["x"] <= 2}}, {"end": lambda n: {n["x"]: 1}}],
    ids=["free end", "the same constraint twice", "end fixed on it"],
)
def test_constraint_active_at_the_final_time(given: dict[str, object]) -> None:
    problem, x = under_a_roof(**given)
    solution = exact(problem, [0, 1, 3], ["+", "b[x.upper]"], x, [[1.0], [0.0]], -2.5)
    certified(solution, -2.5, [1.0])


def test_a_constraint_left_at_a_distance_has_no_right_to_a_multiplier() -> None:
    """An arc at 1 - 1e-5 under the roof 1 is as good as active by its distance, and costs 2e-5 all
    the same.
    """
    problem, _ = under_a_roof()
    top = 1 - 1e-5
    area = top**2 / 2 + top * (3 - top)
    low = exact(
        problem,
        [0, top, 3],
        ["+", "b[x.upper]"],
        lambda t: [np.minimum(t, top)],
        [[1.0], [0.0]],
        -area,
    )
    assert low.verdict is not None
    assert "multipliers only where a constraint is met on x.upper" in low.verdict.reasons[0]


def test_two_constraints_met_at_one_time() -> None:
    y, z = states("y z")
    a, b = controls("a b")
    problem = Problem(
        name="roofs",
        running=-y - z,
        dynamics={y: a, z: b},
        bounds={a: (-1, 1), b: (-1, 1), y: (None, 1), z: (None, 1)},
        start={y: 0, z: 0},
        final_time=3,
    )
    solution = exact(
        problem,
        [0, 1, 3],
        ["+ +", "b[y.upper] b[z.upper]"],
        lambda t: [np.minimum(t, 1.0)] * 2,
        [[1.0, 1.0], [0.0, 0.0]],
        -5.0,
    )
    certified(solution, -5.0, [1.0])


def test_bang_arc_that_stays_on_a_constraint() -> None:
    problem, _ = under_a_roof(
        bounds=lambda n: {n["u"]: (-1, 1)}, path=lambda n: {"roof": n["x"] <= time}
    )
    certified(exact(problem, [0, 3], ["+"], lambda t: [t], [[1.0]], -4.5), -4.5, [])


@pytest.mark.parametrize(
    ("far", "word", "switches"), [(1, "a: - s; b: - s", [1]), (2, "a: - s s; b: - - s", [1, 2])]
)
def test_several_singular_controls(far: float, word: str, switches: list[float]) -> None:
    y, z = states("y z")
    a, b = controls("a b")
    problem = Problem(
        name="two",
        running=y**2 + z**2,
        dynamics={y: a, z: b},
        bounds={a: (-1, 1), b: (-1, 1)},
        start={y: 1, z: far},
        final_time=3,
    )
    certified(solved(problem, word), (1 + far**3) / 3, list(map(float, switches)))


def test_abnormal_extremal() -> None:
    """Only a = 1 keeps y at 0: whatever the cost, the principle holds with the sign of a from the
    end condition.
    """
    y, z = states("y z")
    a, b = controls("a b")
    problem = Problem(
        name="abnormal",
        minimise=final_time,
        dynamics={y: 1 - a, z: b},
        bounds={a: (-1, 1), b: (-1, 1)},
        start={y: 0, z: 0},
        end={y: 0, z: 0.5},
    )
    certified(exact(problem, [0, 0.5], ["+ +"], lambda t: [0 * t, t], [[1.0, 1.0]], 0.5), 0.5, [])


def test_a_totally_singular_control_is_extremal_and_a_bang_arc_of_it_is_not_asked_for() -> None:
    """With y fixed at both ends its cost is constant: every admissible control is as good, none is
    asked for.
    """
    y = states("y")
    a = controls("a")
    problem = Problem(
        name="total",
        minimise=y,
        dynamics={y: a},
        bounds={a: (-1, 1)},
        start={y: 0},
        end={y: 0.5},
        final_time=1,
    )
    assert exact(problem, [0, 1], ["*"], lambda t: [t / 2], [[0.5]], 0.5).extremal
    bang = exact(
        problem, [0, 0.75, 1], ["+", "-"], lambda t: [np.minimum(t, 1.5 - t)], [[1.0], [-1.0]], 0.5
    )
    assert bang.verdict is not None
    assert "no strict sign" in bang.verdict.reasons[0]


@pytest.mark.parametrize(
    "units", [(1e6, 1, 1), (1e-6, 1, 1), (1, 1e6, 1), (1, 1e-6, 1), (1, 1, 1e6), (1, 1, 1e-6)]
)
def test_units_do_not_matter(units: tuple[float, float, float]) -> None:
    length, pace, cost = units
    problem = cart(
        minimise=cost * final_time / pace,
        dynamics=lambda n: {n["x"]: n["v"] / pace, n["v"]: n["u"] / pace},
        bounds=lambda n: {n["u"]: (-length, length)},
        end=lambda n: {n["x"]: length, n["v"]: 0},
    )

    def x(t: np.ndarray) -> list[np.ndarray]:
        s = t / pace
        early = s <= 1
        return [
            length * np.where(early, s**2 / 2, 1 - (2 - s) ** 2 / 2),
            length * np.where(early, s, 2 - s),
        ]

    solution = exact(problem, [0, pace, 2 * pace], ["+", "-"], x, [[length], [-length]], 2 * cost)
    certified(solution, 2 * cost, [pace])
