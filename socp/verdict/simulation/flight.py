"""A solution's control on a plant: with a disturbance, from another start, as a plan in time or as
feedback.

The plant is a problem, and a disturbance is one too: that with other rates. So what is flown is
integrated and measured as the judge does it.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from socp.errors import MethodError, ProblemError
from socp.laws import feedback_function
from socp.model import (
    Arc,
    Judgement,
    Mode,
    Origin,
    Problem,
    Solution,
    Stop,
    fast,
    known_problem,
    parameters_of,
)
from socp.verdict.certify import with_statement
from socp.verdict.motion import Log, travel
from socp.verdict.reintegration import measured
from socp.verdict.simulation.pieces import Control, Piece, pieces_in_time

Feedback = Callable[[float, np.ndarray], Any]


def simulated(
    solution: Solution,
    problem: Problem | None = None,
    *,
    disturbance: Mapping[Any, Any] | None = None,
    feedback: bool | Feedback = False,
    start: Mapping[Any, float] | None = None,
) -> Solution:
    """Return the motion of a plant under the control of a solution, as a solution of its own.

    `problem` is the plant, that which the solution carries where none is given. `disturbance` is
    added to the rates of states, by name or symbol: numbers, or expressions of the plant's symbols
    and of `time`. `start` puts states elsewhere at the initial time. `feedback` False: the control
    is the plan, a function of time; True: on every arc, between the planned switching times, the
    law of the solution's own problem, at the state that is reached; a function (t, x (nx,)) -> u
    (nu,): that. Feedback is cut off at the bounds of the controls.

    The returned `objective` is the one reached; `verified` holds the misses of ends, constraints
    and box by this motion, and its distance from the plan as `drift`. Values between nodes are on
    straight lines; nodes are a twentieth of a step of DOP853 (tolerance 1e-10) apart.

    Raises MethodError for a state that there is not, where no problem is known, and where an arc
    has no law of the state.
    """
    own = known_problem(solution)
    plant = problem or own
    if plant is None:
        raise MethodError("the solution carries no problem; give one: solution.simulate(problem)")
    driven = _changed(plant, disturbance or {}, start or {})
    pieces = _pieces(solution, own or plant, plant.box, feedback)
    log = Log()
    with np.errstate(all="ignore"):  # what overflows ends as an error of the integration
        end, error = travel(driven, solution, pieces, log)
        found = measured(driven, solution, log, (end, error), feedback=bool(feedback))
    return with_statement(
        plant,
        Solution(
            problem=plant.name,
            arcs=tuple(_arcs(solution, log)),
            objective=found.objective,
            stop=Stop.FAILED if error else Stop.SIMULATED,
            message=error,
            state_names=solution.state_names,
            control_names=solution.control_names,
            parameters=solution.parameters,
            judgement=Judgement(verified=(replace(found, gap=0.0),)),
            origin=_origin(solution, feedback),
        ),
    )


def _origin(solution: Solution, feedback: Feedback | bool) -> Origin:
    kind = "function" if callable(feedback) else bool(feedback)
    versions = solution.origin.versions
    return Origin(method="simulate", options={"feedback": kind}, versions=versions)


def _pieces(
    solution: Solution, own: Problem, box: np.ndarray, feedback: bool | Feedback
) -> list[list[Piece]]:
    """Return what is flown on every arc: the plan, the laws of its own problem, or a function."""
    if not feedback:
        return [pieces_in_time(arc) for arc in solution.arcs]
    p = parameters_of(own, solution)
    controls = [feedback if callable(feedback) else _law(own, arc, p) for arc in solution.arcs]
    return [
        [Piece(float(arc.t[0]), float(arc.t[-1]), control=_cut_off(control, box))]
        for arc, control in zip(solution.arcs, controls, strict=True)
    ]


def _law(problem: Problem, arc: Arc, p: np.ndarray) -> Feedback:
    """Return the law of an arc; raises MethodError where there is none."""
    law = fast(feedback_function(problem, arc.modes))
    return lambda t, x: law(x, t, p)


def _cut_off(control: Feedback, box: np.ndarray) -> Control:
    """Return a control that stays in a box (2, nu)."""
    low, high = box
    return lambda t, x: np.clip(np.atleast_1d(np.asarray(control(t, x), dtype=float)), low, high)


def _changed(plant: Problem, disturbance: Mapping[Any, Any], start: Mapping[Any, float]) -> Problem:
    """Return a plant with what is added to its rates and with another start."""
    if not disturbance and not start:
        return plant
    added, elsewhere = _by_name(plant, disturbance), _by_name(plant, start)
    rates = {s: rate + added.get(s.name(), 0.0) for s, rate in plant.dynamics.items()}
    begun = {s.name(): value for s, value in plant.start.items()} | elsewhere
    states = {s.name(): s for s in plant.dynamics}
    try:
        return replace(
            plant,
            dynamics=rates,
            start={states[name]: value for name, value in begun.items()},
            formula=None,
            reference=None,
        )
    except ProblemError as error:
        raise MethodError(f"simulate: {error}") from error


def _by_name(plant: Problem, given: Mapping[Any, Any]) -> dict[str, Any]:
    named = {each if isinstance(each, str) else each.name(): v for each, v in given.items()}
    for name in named.keys() - set(plant.state_names):
        raise MethodError(f"simulate: no state '{name}'; there are {', '.join(plant.state_names)}")
    return named


def _arcs(solution: Solution, log: Log) -> list[Arc]:
    """Return the points looked at as arcs, one a piece, with what they follow as modes."""
    unknown = (Mode.parse("*"),) * len(solution.control_names)
    found = []
    for t, x, u in zip(log.t, log.x, log.u, strict=True):
        if t.size < 2:  # a piece without length
            continue
        found.append(
            Arc(
                t=t,
                x=x,
                u=u,
                costate=np.full(x.shape, np.nan),
                mesh=np.arange(t.size),
                side="both",
                modes=unknown,
            )
        )
    return found
