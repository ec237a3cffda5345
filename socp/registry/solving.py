"""`socp.solve`: what `socp solve` does, in Python and without a file."""

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from socp.errors import MethodError, ProblemError, SolveError
from socp.process import shown
from socp.registry.entries import suggest
from socp.registry.loading import as_guess, load_guess, load_problem
from socp.registry.plugins import Registry

if TYPE_CHECKING:
    from socp.methods import Method
    from socp.model import Problem, Solution, Watch


def solve(
    problem: "Problem | str | Path",
    guess: "Solution | str | Path | None" = None,
    method: str = "auto",
    *,
    watch: "Watch | None" = None,
    **options: Any,
) -> "Solution":
    """Solve a problem with a method of that name and its options, and return the judged solution.

    The problem may be given by name or path as well, the guess by the path of a result, a backend
    by its name; without a guess it is the problem's own. Where the guess is a solution along a
    word, `auto` and `lgr-multiphase` go on along that word. `watch` is told of the progress;
    without one it is shown on a terminal and in a notebook, and `watch=socp.silent` shows nothing.
    Values are in the problem's units; of times, `seconds` among the options alone is a clock's.
    Raises ProblemError and MethodError as the command does, SolveError for a guess of other states,
    controls or parameters.
    """
    from socp.methods import default_guess, run
    from socp.model import Solution, view

    registry = _registry()
    how = _made(registry.method(method), options)
    posed = _posed(problem, registry)
    if guess is None:
        start = default_guess(posed)
    elif isinstance(guess, (str, Path)):
        start = load_guess(str(guess), posed)
    elif isinstance(guess, Solution):
        start = as_guess("guess", guess, posed)
    else:
        raise SolveError(f"guess: {shown(guess)} where a solution, or the path of one, is needed")
    if watch is not None:
        return run(how, posed, start, watch)
    with view("progress")(posed.name) as seen:
        return run(how, posed, start, seen)


def _posed(given: Any, registry: Registry) -> "Problem":
    from socp.model import Problem

    if isinstance(given, (str, Path)):
        return load_problem(str(given), registry)
    if not isinstance(given, Problem):
        raise ProblemError(f"solve: {shown(given)} where a problem, its name or path is needed")
    return given


@cache
def _registry() -> Registry:
    return Registry.load()


def _made(method: "type[Method]", given: dict[str, Any]) -> "Method":
    """Return a method with its options; MethodError names the one that it does not have, or that
    it lacks.
    """
    from socp.methods import is_backend, is_required, named_backend, options

    fields = {each.name: each for each in options(method)}
    for name in given:
        if name not in fields:
            raise MethodError(f"{method.name} has no option '{name}'{suggest(name, fields)}")
    for name, each in fields.items():
        if is_required(each) and name not in given:
            raise MethodError(f"{method.name} needs a value of '{name}': {name}=...")
    backends = [name for name, value in given.items() if is_backend(method, name)]
    named = {k: given[k] for k in backends if isinstance(given[k], str)}
    made = {k: named_backend(f"{method.name}: {k}", name) for k, name in named.items()}
    return method(**{**given, **made})
