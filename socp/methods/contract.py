"""Methods: the one abstract class of the plugin contract, its options, and the solve that most
methods share.
"""

import abc
import inspect
import math
import numbers
import time
from collections.abc import Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, replace
from types import NoneType
from typing import Any, ClassVar, final, get_args, get_type_hints

from socp.errors import MethodError
from socp.model import Problem, Progress, Solution, Stop, Watch, is_number, silent
from socp.process import close, one_thread, short, shown
from socp.solvers import BACKENDS, NLP, Backend, NLPPoint, Solver
from socp.transcription import (
    Layout,
    Mesh,
    PhasedProblem,
    laid_out,
    lift,
    prolonged,
    push,
    single_phase,
)

LARGEST = 100_000  # steps, points or arcs: programmes of more do not fit into memory
WANTED = {int: "a whole number", float: "a number", bool: "true or false", str: "a text"}  # by type

_LONGER = (
    2.0,
    5.0,
    12.0,
)  # horizons tried, over the guessed one; the guess is of the right order of magnitude
_EQUAL = 1e-9  # relative: intervals that differ by less do so by rounding


class Method(abc.ABC):
    """A way to solve problems; concrete methods are final frozen dataclasses whose fields are their
    options.

    Fields are made by `option`; `source` names the paper the method comes from.
    """

    name: ClassVar[str]
    source: ClassVar[str]

    @abc.abstractmethod
    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Solve from a guess; a solver that fails gives a Solution with its `stop`.

        Raises MethodError for what cannot be tried.
        """

    def near(
        self, _problem: Problem, _guess: Solution, _origin: Problem, _watch: Watch = silent
    ) -> Solution | None:
        """Return what `solve` gives where a guess along a word leads to it by Newton alone, None
        where it does not, as for methods that do not go on along words. `origin`: the problem that
        the guess is a solution of.

        Both problems may hold constants of the user's as parameters, so that what is derived of one
        serves the other.
        """
        return None


def option(default: Any, doc: str, *, least: float | None = None, most: float | None = None) -> Any:
    """Declare an option of a method: its default, one line for the user, the least and the greatest
    value allowed.

    A whole number without a greatest value of its own is at most `LARGEST`. `run` and `socp.solve`
    raise MethodError for a value of another type or out of range.
    """
    return field(default=default, metadata={"doc": doc, "least": least, "most": most})


def options(method: type[Method]) -> tuple[Field[Any], ...]:
    """Return the options of a method as dataclass fields."""
    return fields(method)  # type: ignore[arg-type]


def check_options(method: Method) -> None:
    """Raise MethodError for an option of a wrong type or out of its range."""
    hints = get_type_hints(type(method))
    for each in options(type(method)):
        value, kinds = getattr(method, each.name), get_args(hints[each.name]) or (hints[each.name],)
        place = f"{method.name}: {each.name}"
        if Backend in kinds and not callable(value):
            raise MethodError(f"{place}={shown(value)}, but it should be a backend")
        if Backend in kinds:
            _takes_both(place, value)
        kind = next((kind for kind in kinds if isinstance(kind, type) and kind in WANTED), None)
        if kind is None or (value is None and NoneType in kinds):
            continue
        if not _of(value, kind):
            finite = ", finite" if kind is float else ""
            raise MethodError(f"{place}={shown(value)}, but it should be {WANTED[kind]}{finite}")
        if kind in {int, float}:
            _in_range(place, value, each, whole=kind is int)


def _takes_both(place: str, backend: Any) -> None:
    """Refuse a backend whose `limited` takes iterations alone, before a search asks for more."""
    try:
        inspect.signature(backend.limited).bind(1, 1)
    except (AttributeError, ValueError):  # one that is asked for nothing, or tells nothing of it
        return
    except TypeError as error:
        lost = "iterations in a row that seek the constraints alone"
        what = f"limited(iterations, lost=None) of a backend takes {lost} as well"
        raise MethodError(f"{place}={shown(backend)}: {what}; this one: {error}") from error


def is_backend(method: type[Method], name: str) -> bool:
    """Tell whether any backend will do for an option."""
    return get_type_hints(method).get(name) is Backend


def named_backend(place: str, name: str) -> Backend:
    """Return the backend of a name; MethodError, starting with the place, where there is none."""
    if name not in BACKENDS:
        near = close(name, BACKENDS) or f"; there are {', '.join(BACKENDS)}"
        raise MethodError(f"{place}: no backend '{short(name)}'{near}")
    found: Backend = BACKENDS[name]()
    return found


def option_range(each: Field[Any], *, whole: bool) -> tuple[float | None, float | None]:
    """Return the least and the greatest value of an option that is a number, None where there is no
    limit.
    """
    least, most = each.metadata.get("least"), each.metadata.get("most")
    return least, LARGEST if most is None and whole else most


def _of(value: Any, kind: type) -> bool:
    """Tell whether a value can stand for an option of a type; a flag is no number, and no number is
    infinite.
    """
    if isinstance(value, bool) or kind is bool:
        return isinstance(value, bool) and kind is bool
    if kind is float:
        return is_number(value) and math.isfinite(value)
    return isinstance(value, numbers.Integral if kind is int else kind)


def _in_range(place: str, value: float, each: Field[Any], *, whole: bool) -> None:
    least, most = option_range(each, whole=whole)
    if least is not None and value < least:
        raise MethodError(f"{place}={shown(value)}, but it must be at least {least}")
    if most is not None and value > most:
        raise MethodError(f"{place}={shown(value)}, but it must be at most {most}")


@one_thread()
def solve_collocated(
    phased: PhasedProblem,
    meshes: Sequence[Mesh],
    backend: Solver,
    guess: Solution,
    watch: Watch = silent,
    *,
    longer: bool = True,
) -> Solution:
    """Transcribe a phased problem on one mesh a phase, solve it with a backend, and lift the point.

    Unless `longer` is false: a solver that shortens a free horizon too eagerly gets caught where no
    control can meet the ends any more. Then the ends are met with longer horizons held fixed first,
    and the horizon is set free there. Guess and solution are in the problem's units. Raises
    MethodError where the meshes do not fit the phases.
    """
    how = backend, watch
    solution = _attempt(phased, meshes, how, guess)
    low, high = phased.of.final_time_box
    if not longer or solution.stop not in {Stop.INFEASIBLE, Stop.FAILED} or low == high:
        return solution
    for factor in _LONGER:
        held = guess.initial_time + factor * (guess.final_time - guess.initial_time)
        if not low <= held <= high:
            continue
        fixed = replace(phased, of=replace(phased.of, final_time=held))
        met = _attempt(fixed, meshes, how, guess).after(solution)
        if met.stop is Stop.INTERRUPTED:
            return met
        if met.stop.ok:
            again = _attempt(phased, meshes, how, met).after(met)
            return again if again.stop.ok else solution
    return solution


@final
@dataclass(frozen=True, eq=False)
class Coarse:
    """The point that a solution of free controls in one phase was lifted from, its mesh, and where
    everything stands in its programme.
    """

    mesh: Mesh
    layout: Layout
    point: NLPPoint

    def leads_to(self, mesh: Mesh) -> bool:
        """Tell whether both meshes have equal intervals of one scheme: then multipliers go over."""
        shares = [[share for share, _ in each] for each in (self.mesh, mesh)]
        equal = all(max(each) - min(each) <= _EQUAL * max(each) for each in shares)
        return equal and len({scheme for _, scheme in (*self.mesh, *mesh)}) == 1


def solve_directly(
    problem: Problem,
    mesh: Mesh,
    backend: Solver,
    guess: Solution,
    watch: Watch = silent,
    coarse: Coarse | None = None,
) -> Solution:
    """Solve a problem in one phase of free controls as `solve_collocated` does; where that fails,
    with everything in the problem's own units: another way, where magnitudes lead nowhere.

    `coarse`: what the guess was lifted from; from its multipliers a mesh of the same scheme is
    solved first, in fewer iterations.
    """
    phased, how = single_phase(problem), (backend, watch)
    tried: Solution | None = None
    if coarse is not None and coarse.leads_to(mesh):
        tried = _attempt(phased, [mesh], how, guess, coarse=coarse)
        if tried.stop.ok or tried.stop is Stop.INTERRUPTED:
            return tried
    solution = solve_collocated(phased, [mesh], backend, guess, watch)
    solution = solution if tried is None else solution.after(tried)
    if solution.stop.ok or solution.stop is Stop.INTERRUPTED:
        return solution
    return _attempt(phased, [mesh], how, guess, scaled=False).after(solution)


def _attempt(
    phased: PhasedProblem,
    meshes: Sequence[Mesh],
    how: tuple[Solver, Watch],
    guess: Solution,
    *,
    scaled: bool = True,
    coarse: Coarse | None = None,
) -> Solution:
    began = time.perf_counter()
    nlp, layout = laid_out(phased, meshes, guess if scaled else None)
    if coarse is None:
        start = push(layout, guess)
    else:
        start = prolonged(coarse.layout, layout, coarse.point, guess)
    transcribed = time.perf_counter() - began
    backend, watch = how
    point = backend(nlp, start, lifting_watch(watch, nlp, layout))
    solution = lift(layout, point)
    return solution.spent(build=point.seconds.get("build", 0.0) + transcribed)


def lifting_watch(watch: Watch, nlp: NLP, layout: Layout) -> Watch:
    """Return a watch whose progress can be lifted to the solution that it stands for; a silent one
    stays silent.
    """
    if watch is silent:
        return silent

    def see(now: Progress, /) -> bool:
        v, objective = now.v, now.objective * nlp.unit
        now = replace(now, objective=objective)
        return watch(
            now if v is None else replace(now, iterate=lambda: lift(layout, NLPPoint(v=v)))
        )

    return see


def is_required(each: Field[Any]) -> bool:
    """Tell whether an option has no default."""
    return each.default is MISSING
