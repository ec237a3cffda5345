"""The conformance suite: what every method must do, and every problem must be, with stated
tolerances.

`assert_conforms(MyMethod())` in a test of your own is all that is needed; socp's own methods pass
the same.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, is_dataclass
from typing import Any, final

import casadi
import numpy as np

from socp.errors import SocpError
from socp.methods import Method, check_options, default_guess, option_values
from socp.model import (
    OUTSIDE,
    SAME_TIME,
    Arc,
    Problem,
    Progress,
    Solution,
    Stop,
    Watch,
    from_json,
    parameters_of,
    time,
    to_json,
)
from socp.registry.standard import STANDARD, Standard
from socp.verdict import verify

__all__ = ["STANDARD", "Finding", "Standard", "assert_conforms", "check_problem", "conforms"]

# Of objective and feasibility, relative: what a first-order method reaches on some hundred steps
TOLERANCE = 2e-2
_COSTATES = 5.0  # times the tolerance: where controls ring, the multipliers ring more


@final
@dataclass(frozen=True)
class Finding:
    """One breach: on which problem, of which check, and what was seen."""

    problem: str
    check: str
    text: str

    def __str__(self) -> str:
        return f"{self.problem}: {self.check}: {self.text}"


def assert_conforms(
    method: Method, problems: Sequence[Standard] = STANDARD, tolerance: float = TOLERANCE
) -> None:
    """Raise AssertionError listing every breach that `conforms` finds."""
    found = conforms(method, problems, tolerance)
    if found:
        lines = "\n".join(f"  {finding}" for finding in found)
        raise AssertionError(
            f"method '{getattr(method, 'name', method)}' does not conform:\n{lines}"
        )


def conforms(
    method: Method, problems: Sequence[Standard] = STANDARD, tolerance: float = TOLERANCE
) -> list[Finding]:
    """Run a method on standard problems from the default guess and return every breach of the
    contract.

    Every problem is solved twice: the same input must give the same output. `tolerance` is
    relative: of the objective, and of the conditions that re-integration finds violated; costates
    at the initial time, where the method gives any, may be five times as far from the exact ones.
    """
    found = [Finding("-", "method", text) for text in _of_class(method)]
    if found:
        return found
    for standard in problems:
        name = standard.problem.name
        found += [Finding(name, check, text) for check, text in _on(method, standard, tolerance)]
    name = problems[0].problem.name
    return found + [Finding(name, "watch", text) for text in _watched(method, problems[0].problem)]


def check_problem(problem: Problem) -> list[Finding]:
    """Return what would stop a solver at once: what is not finite on the default guess, or has
    slopes that are not.

    The laws that the problem gives are looked at too, and the reference, where there is one.
    """
    guess = default_guess(problem)
    t, x, u = guess.t, guess.rows("x"), guess.rows("u")
    p = parameters_of(problem, guess)[:, None]
    found = [
        Finding(problem.name, place, text)
        for place, text in _not_finite(problem, (x, u, t[None, :], p))
    ]
    if not guess.final_time > guess.initial_time:
        found.append(
            Finding(
                problem.name,
                "guess",
                f"final time {guess.final_time} is not after {guess.initial_time}",
            )
        )
    reference = problem.reference
    if reference is not None and not all(np.diff(reference.switches) > 0):
        found.append(
            Finding(
                problem.name, "reference", f"switching times {reference.switches} do not increase"
            )
        )
    return found


def _not_finite(problem: Problem, arguments: tuple[Any, ...]) -> Iterator[tuple[str, str]]:
    places = [(f"rate of '{name}'", problem.rate[k]) for k, name in enumerate(problem.state_names)]
    places.append(("running cost", problem.lagrangian))
    places += [(f"path '{each.name}'", each.expression) for each in problem.constraints]
    places += [
        (f"singular law of '{control}'", casadi.SX(law))
        for control, law in problem.singular.items()
    ]
    symbols = [problem.x, problem.u, time, problem.p]
    for place, expression in places:
        slope = casadi.jacobian(expression, casadi.vertcat(problem.x, problem.u, problem.p))
        function = casadi.Function(
            "place", symbols, [casadi.horzcat(expression, casadi.densify(slope))]
        )
        values = function.map(arguments[0].shape[1])(
            *(casadi.DM(a) for a in _spread(arguments))
        ).full()
        bad = ~np.isfinite(values.reshape(1, arguments[0].shape[1], -1)).all(axis=(0, 2))
        if bad.any():
            k = int(np.flatnonzero(bad)[0])
            where = f"t = {arguments[2][0, k]:.6g}, x = {arguments[0][:, k]}"
            yield place, f"it or its slope is not finite at {where}"


def _spread(arguments: tuple[Any, ...]) -> list[Any]:
    count = arguments[0].shape[1]
    return [a if a.shape[1] == count else np.repeat(a, count, axis=1) for a in arguments]


def _of_class(method: Any) -> Iterator[str]:
    if not isinstance(method, Method):
        yield f"{type(method).__name__} is no socp.Method"
        return
    kind: Any = type(method)
    if not is_dataclass(kind) or not vars(kind)["__dataclass_params__"].frozen:
        yield f"{kind.__name__} is no frozen dataclass"
    for field in ("name", "source"):
        if not isinstance(getattr(kind, field, None), str):
            yield f"{kind.__name__}.{field} is no text"
    try:
        check_options(method)
    except SocpError as error:
        yield str(error)


def _on(method: Method, standard: Standard, tolerance: float) -> Iterator[tuple[str, str]]:
    problem = standard.problem
    guess = default_guess(problem)
    before = to_json(guess)
    try:
        found: list[Any] = [method.solve(problem, guess), method.solve(problem, guess)]
    except Exception as error:  # noqa: BLE001 - the suite reports, whatever a method raises
        yield "solve", f"raised {type(error).__name__}: {error}"
        return
    if to_json(guess) != before:
        yield "guess", "was modified by the solve"
    solution, again = found
    if not isinstance(solution, Solution):
        yield "solution", f"is {type(solution).__name__}, not a Solution"
        return
    broken = list(_shapes(problem, solution))
    yield from (("shape", text) for text in broken)
    if broken:
        return
    yield from (("values", text) for text in _values(problem, solution))
    yield from _accuracy(standard, solution, tolerance)
    yield from _file(method, solution)
    if _numbers(solution) != _numbers(again):
        yield "determinism", "a second solve from the same guess gave another solution"


def _shapes(problem: Problem, solution: Solution) -> Iterator[str]:
    if solution.problem != problem.name:
        yield f"the solution is of problem '{solution.problem}'"
    for kind in ("state", "control"):
        if getattr(solution, f"{kind}_names") != getattr(problem, f"{kind}_names"):
            yield (
                f"{kind} names {getattr(solution, f'{kind}_names')}, not "
                f"{getattr(problem, f'{kind}_names')}"
            )
    if set(solution.parameters) != set(problem.parameter_names):
        yield f"parameters {sorted(solution.parameters)}, not {sorted(problem.parameter_names)}"
    if not solution.arcs:
        yield "the solution has no arcs"
    for k, arc in enumerate(solution.arcs):
        yield from (f"arc {k}: {text}" for text in _arc_shapes(problem, arc))


def _arc_shapes(problem: Problem, arc: Arc) -> Iterator[str]:
    rows = {
        "x": len(problem.state_names),
        "u": len(problem.control_names),
        "costate": len(problem.state_names),
    }
    for which, count in rows.items():
        if getattr(arc, which).shape != (count, arc.t.size):
            yield f"{which} {getattr(arc, which).shape}, not {(count, arc.t.size)}"
    ends_right = arc.mesh.size > 1 and arc.mesh[0] == 0 and arc.mesh[-1] == arc.t.size - 1
    if not (ends_right and (np.diff(arc.mesh) > 0).all()):
        yield (
            f"mesh {arc.mesh[:3]}..{arc.mesh[-1:]} does not lead from node 0 to node "
            f"{arc.t.size - 1}"
        )
    if len(arc.modes) != rows["u"]:
        yield f"{len(arc.modes)} modes, not one for each of {rows['u']} controls"


def _values(problem: Problem, solution: Solution) -> Iterator[str]:
    if not solution.stop.ok:
        yield f"stopped because {solution.stop.value} ({solution.message})"
    horizon = solution.final_time - solution.initial_time
    if not horizon > 0:
        yield f"the horizon has length {horizon}"
    for k, arc in enumerate(solution.arcs):
        yield from (f"arc {k}: {text}" for text in _arc_values(problem, arc))
    for k, (left, right) in enumerate(zip(solution.arcs[:-1], solution.arcs[1:], strict=True)):
        if abs(left.t[-1] - right.t[0]) > SAME_TIME * horizon:
            yield f"arc {k} ends at {left.t[-1]}, the next begins at {right.t[0]}"


def _arc_values(problem: Problem, arc: Arc) -> Iterator[str]:
    if not (np.diff(arc.t) >= 0).all():
        yield "times decrease"
    for which in ("t", "x", "u"):
        if not np.isfinite(getattr(arc, which)).all():
            yield f"{which} is not finite"
    low, high = problem.box[0][:, None], problem.box[1][:, None]
    slack = OUTSIDE * (high - low)
    collocated = np.hstack([arc.u[:, arc.nodes(k, "u")] for k in range(len(arc.mesh) - 1)])
    if ((collocated < low - slack) | (collocated > high + slack)).any():
        yield "a control leaves its box"
    claimed = ~np.isnan(arc.costate)
    if claimed.any() and not np.isfinite(arc.costate).all():
        yield (
            "costates are given at some nodes and not finite at others; give all of them, or nan "
            "everywhere"
        )


def _accuracy(
    standard: Standard, solution: Solution, tolerance: float
) -> Iterator[tuple[str, str]]:
    error = solution.objective - standard.objective
    if not abs(error) <= tolerance * abs(standard.objective):
        yield "objective", f"{solution.objective:.9g}, but {standard.objective:.9g} is exact"
    for each in verify(standard.problem, solution):
        if each.error or not max(each.miss, each.path) <= tolerance:
            seen = (
                each.error
                or f"the end missed by {each.miss:.1e}, a path constraint violated by "
                f"{each.path:.1e}"
            )
            yield "feasibility", f"re-integration finds {seen}"
    costate = solution.arcs[0].costate[:, 0]
    exact = np.array(standard.costate)
    allowed = _COSTATES * tolerance * np.abs(exact).max(initial=0.0)
    if exact.size and np.isfinite(costate).all() and not np.abs(costate - exact).max() <= allowed:
        yield (
            "costate",
            f"{costate} at the initial time, but {exact} is exact; H = -1 for minimum time",
        )


def _file(method: Method, solution: Solution) -> Iterator[tuple[str, str]]:
    try:
        text = to_json(solution.with_origin(method=method.name, options=option_values(method)))
        if to_json(from_json(text)) != text:
            yield "file", "the result file does not read back as it was written"
    except (SocpError, ValueError, TypeError) as error:
        yield "file", f"the result file cannot be written and read: {error}"


def _numbers(solution: Solution) -> list[bytes]:
    return [getattr(arc, which).tobytes() for arc in solution.arcs for which in ("t", "x", "u")]


def _watched(method: Method, problem: Problem) -> Iterator[str]:
    """Check that a watch's request to stop is granted with a last iterate; a method may call no
    watch at all.
    """
    called = []
    solution: Any

    def stop(progress: Progress, /) -> bool:
        """Keep what is told, and ask to stop."""
        called.append(progress)
        return True

    watch: Watch = stop
    try:
        solution = method.solve(problem, default_guess(problem), watch)
    except Exception as error:  # noqa: BLE001 - the suite reports, whatever a method raises
        yield f"raised {type(error).__name__} where the watch asked it to stop: {error}"
        return
    if called and isinstance(solution, Solution) and solution.stop is not Stop.INTERRUPTED:
        yield f"the watch asked it to stop, but it says: {solution.stop.value}"
