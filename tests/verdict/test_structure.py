"""Reading the word off a solution: bounds, singular stretches, boundary arcs, and where exactly
they switch.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from records import built

from socp.model.problem import Problem
from socp.model.result.arc import Arc
from socp.model.result.solution import Solution, Stop
from socp.model.symbols import controls, final_time, states
from socp.model.word import Mode
from socp.transcription.mesh import table
from socp.transcription.schemes import Scheme, euler, lgr, radau_iia, trapezoid
from socp.verdict.structure import misfit, structure_of

x, y = states("x y")
u, w = controls("u w")

problem = Problem(
    name="two masses",
    minimise=final_time,
    dynamics={x: u, y: w - u},
    bounds={u: (-1, 3), w: (0, 1), x: (None, 2)},
    start={x: 0, y: 0},
)


def held(
    steps: Any, others: Any = 0.5, *, height: Callable[[np.ndarray], np.ndarray] | None = None
) -> Solution:
    """Return a solution whose controls are constant on intervals of length 1."""
    steps = np.asarray(steps, dtype=float)
    t = np.arange(steps.size + 1.0)
    rows = np.array([steps, np.broadcast_to(others, steps.shape)])
    states_ = np.array([t * 0 if height is None else height(t), t])
    arc = Arc(
        t=t,
        x=states_,
        u=np.hstack([rows[:, :1], rows]),
        costate=np.full_like(states_, np.nan),
        mesh=np.arange(t.size),
        side="right",
        modes=("*", "*"),
    )
    return built(problem=problem.name, method="m", arcs=(arc,), objective=0.0, stop=Stop.SOLVED)


def read(steps: Any, **options: Any) -> tuple[tuple[str, float, float], ...]:
    return structure_of(problem, held(steps, **options))["u"]


def test_bounds_and_interior_values() -> None:
    assert read([3, 3, -1, -1, -1]) == (("+", 0, 2), ("-", 2, 5))
    assert read([0.5, 1.5, 0.7]) == (("s", 0, 3),)
    assert read([3, 3, 0.5, 0.6, -1, -1]) == (("+", 0, 2), ("s", 2, 4), ("-", 4, 6))


def test_a_bound_is_met_as_nearly_as_an_interior_point_solver_does() -> None:
    assert read([3 - 1e-6, 3 - 1e-6, -1 + 1e-6]) == (("+", 0, 2), ("-", 2, 3))
    assert read([2.9, 2.9]) == (("s", 0, 2),)


@pytest.mark.parametrize("value", [-0.9, 0.0, 1.0, 2.5])
def test_a_switch_inside_an_interval_keeps_the_integral(value: float) -> None:
    (_, start, switch), (_, again, end) = read([3, 3, value, -1, -1])
    assert (start, end) == (0, 5)
    assert switch == again
    assert 3 * (switch - 2) - 1 * (3 - switch) == pytest.approx(value)


def test_a_switch_onto_a_singular_stretch_is_placed_likewise() -> None:
    (_, _, switch), _ = read([3, 3, 2.0, 1.0, 1.0 + 1e-9])
    assert 2 <= switch <= 4


def test_every_control_has_its_own_stretches() -> None:
    found = structure_of(problem, held([3, 3, -1, -1], [0, 1, 1, 0.5]))
    assert found["u"] == (("+", 0, 2), ("-", 2, 4))
    assert [mode for mode, _, _ in found["w"]] == ["-", "+", "s"]


def test_an_interior_control_on_an_active_constraint_is_a_boundary_arc() -> None:
    # x <= 2 is active from t = 2 to t = 5, and u = x' acts on it
    found = read([1, 1, 0, 0, 0, -1, -1], height=lambda t: np.interp(t, [0, 2, 5, 7], [0, 2, 2, 0]))
    assert found == (("s", 0, 2), ("b[x.upper]", 2, 5), ("-", 5, 7))


def test_a_control_that_does_not_act_on_the_constraint_is_on_no_boundary_arc() -> None:
    solution = held(
        [1, 1, 0, 0, 0, -1, -1], 0.5, height=lambda t: np.interp(t, [0, 2, 5, 7], [0, 2, 2, 0])
    )
    assert structure_of(problem, solution)["w"] == (("s", 0, 7),)


def test_a_bound_counts_before_a_constraint() -> None:
    assert read([3, 3, 3], height=lambda t: 0 * t + 2) == (("+", 0, 3),)


def test_arcs_that_follow_a_law_carry_its_mode() -> None:
    solution = held([3, 3, -1, -1])
    (arc,) = solution.arcs
    lawful = replace(arc, modes=("s", "b[x.upper]"))
    later = replace(arc, t=arc.t + 4, modes=("s", "-"))
    found = structure_of(problem, replace(solution, arcs=(lawful, later)))
    assert found == {"u": (("s", 0, 8),), "w": (("b[x.upper]", 0, 4), ("-", 4, 8))}


def test_stretches_of_no_length_are_dropped() -> None:
    solution = held([3, 3])
    (arc,) = solution.arcs
    empty = replace(arc, t=0 * arc.t + 2, modes=("s", "s"))
    later = replace(arc, t=arc.t + 2, modes=("-", "+"))
    found = structure_of(
        problem, replace(solution, arcs=(replace(arc, modes=("+", "+")), empty, later))
    )
    assert found["u"] == (("+", 0, 2), ("-", 2, 4))
    assert found["w"] == (("+", 0, 4),)


@pytest.mark.parametrize(
    "scheme", [euler(), trapezoid(), lgr(3), radau_iia(2)], ids=lambda s: s.name
)
def test_every_scheme_is_read(scheme: Scheme) -> None:
    joined = table([(1.0, scheme)] * 10)
    t = 10 * joined.tau
    values = np.where(t < 5 - (scheme.side == "both") / 2, 3.0, -1.0)
    values[joined.mesh[5]] = {"left": -1.0, "right": 3.0, "both": 1.0}[scheme.side]
    arc = Arc(
        t=t,
        x=np.zeros((2, t.size)),
        u=np.array([values, 0 * t + 0.5]),
        costate=np.zeros((2, t.size)),
        mesh=joined.mesh,
        side=joined.side,
        modes=("*", "*"),
    )
    solution = built(problem=problem.name, method="m", arcs=(arc,), objective=0.0, stop=Stop.SOLVED)
    found = structure_of(problem, solution)["u"]
    if scheme.side == "both":  # linear from 3 to 1 and on to -1: two intervals hold the switch
        assert [found[0][0], found[-1][0]] == ["+", "-"]
    else:
        assert found == (("+", 0, pytest.approx(5)), ("-", pytest.approx(5), 10))


def test_how_badly_a_control_fits_a_mode() -> None:
    solution, t = held([3, 1, -1]), np.array([0.5, 1.5, 2.5])
    assert misfit(problem, solution, 0, Mode("upper"), t).tolist() == [0, 0.5, 1]
    assert misfit(problem, solution, 0, Mode("lower"), t).tolist() == [1, 0.5, 0]
    assert misfit(problem, solution, 0, Mode("singular"), t).tolist() == [0.5, 0, 0.5]
