"""What is worked out once and kept beside its owner, for as long as that lives."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar, final

import casadi

from socp.model.problem import Problem
from socp.model.symbols import Expr, identity

Owner = TypeVar("Owner")
Given = ParamSpec("Given")
Found = TypeVar("Found")
Work = TypeVar("Work", bound=Callable[..., Any])
# properties of a problem, and functions, that ends, times and bounds of parameters do not change
_OF_MOTION = {
    *("x", "u", "p", "x0", "costate", "state_names", "control_names", "parameter_names"),
    *("rate", "fields", "drift", "lagrangian", "mayer", "hamiltonian", "switching"),
    *("box", "state_box", "constraints", "conditions"),
}


def once(
    function: Callable[Concatenate[Owner, Given], Found],
) -> Callable[Concatenate[Owner, Given], Found]:
    """Decorate a function to be worked out once for each owner, its first argument, and others.

    What it returns stands beside the owner's cached properties: it goes when the owner goes, and
    neither a copy nor a pickle of a problem takes it along. An error is not kept. Expressions among
    the others are told by their nodes.
    """
    place = _place(function)

    @wraps(function)
    def kept(owner: Owner, /, *args: Given.args, **kwargs: Given.kwargs) -> Found:
        """Return what is known for these arguments, computed where it is not."""
        known: dict[tuple[Any, ...], Found] = vars(owner).setdefault(place, {})
        key = (*map(_told, args), *kwargs.items()) if args or kwargs else ()
        if key not in known:
            known[key] = function(owner, *args, **kwargs)
        return known[key]

    return kept


@final
@dataclass(frozen=True)
class _Written:
    """An expression as a key: casadi would compare two of them as expressions. It is kept alive,
    else another could take the place of its nodes.
    """

    nodes: tuple[int, ...]
    expression: Expr = field(compare=False)


def _told(argument: Any) -> Any:
    return _Written(identity(argument), argument) if isinstance(argument, casadi.SX) else argument


def of_motion(function: Work) -> Work:
    """Decorate a function whose results for a problem, worked out `once` or `cached`, hold for any
    other of the same motion: of the same dynamics, costs, bounds, constraints and conditions.
    """
    _OF_MOTION.add(_place(function))
    return function


def hand_on(known: Problem, other: Problem) -> None:
    """Let a problem have all that was worked out for one of the same motion, whose dynamics, costs,
    bounds, constraints and conditions are the same. What either works out later, both have.

    It saves what a problem costs before anything is solved: laws, brackets and compiled functions.
    """
    for name in _OF_MOTION:
        if "." in name:  # of a function, to whose results either may add from now on
            vars(other)[name] = vars(known).setdefault(name, {})
        else:  # the same symbols, of costates among them, in what is added later
            vars(other)[name] = getattr(known, name)


def _place(function: Callable[..., Any]) -> str:
    """Return the name under which a function's results stand beside an owner's properties."""
    return f"{function.__module__}.{function.__qualname__}"


def cached(owner: object, function: Callable[..., Found]) -> dict[tuple[Any, ...], Found]:
    """Return what a function worked out `once` for an owner, by the arguments after the owner."""
    known: dict[tuple[Any, ...], Found] = vars(owner).setdefault(_place(function), {})
    return known


def lately(
    owner: object,
    function: Callable[..., Any],
    key: tuple[Any, ...],
    make: Callable[[], Found],
    most: int = 1,
) -> Found:
    """Return what is made for a key, kept in the place of a function for as many keys as were asked
    for last.
    """
    known: dict[tuple[Any, ...], Found] = vars(owner).setdefault(_place(function), {})
    found = known.pop(key) if key in known else make()
    while len(known) >= most:
        del known[next(iter(known))]
    known[key] = found
    return found
