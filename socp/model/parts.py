"""Parts of a problem: named state constraints, named end conditions, known values to compare with,
the plane it is drawn in.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import Any, final

import casadi

from socp.errors import ProblemError
from socp.model.symbols import Expr, is_number, is_symbol, role
from socp.process import plainly, shown


@final
@dataclass(frozen=True, eq=False)
class Constraint:
    """A state constraint c(x, t, p) <= 0; a bound of state `v` is named `v.lower` or `v.upper`."""

    name: str
    expression: Expr


@final
@dataclass(frozen=True, eq=False)
class EndCondition:
    """An end condition psi = 0 (equation) or psi <= 0 on x(t0), x(tf), t0, tf and the
    parameters.
    """

    name: str
    expression: Expr
    equation: bool


@final
@dataclass(frozen=True, kw_only=True)
class Reference:
    """Known values to compare with, in the problem's units; no method reads them.

    `switches` are all switching times in order, `word` one as reports print it, `tolerance` is of
    the objective, relative. `Problem` raises ProblemError for what is no number, time or text.
    """

    objective: float
    switches: tuple[float, ...] = ()
    word: str = ""
    tolerance: float = 1e-9
    source: str = ""


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """The plane in which a solution is drawn; all expressions are of states, time and parameters.

    plane: the two coordinates. heading: direction of the vehicle in the plane, an angle in radians.
    flow: the two components of a current; with it the plane's coordinates are states, and the flow
    depends on no other states. target: centre and radius of a disc, (cx, cy, radius), in the units
    of the plane. What is left out is not drawn. `Problem` raises ProblemError for anything else.
    """

    plane: tuple[Expr, Expr]
    heading: Expr | None = None
    flow: tuple[Expr, Expr] | None = None
    target: tuple[float, float, float] | None = None


def check_text(place: str, value: Any) -> None:
    """Raise ProblemError, starting with the place, for what is no text."""
    if not isinstance(value, str):
        raise ProblemError(f"{place}: {shown(value)} where a string is needed")


def check_reference(given: Any) -> None:
    """Raise ProblemError unless known values are numbers, times and texts."""
    if given is None:
        return
    if not isinstance(given, Reference):
        raise ProblemError(f"reference: {shown(given)} where a Reference(objective=...) is needed")
    for name in ("objective", "tolerance"):
        if not is_number(getattr(given, name)):
            raise ProblemError(
                f"reference {name}: {shown(getattr(given, name))} where a number is needed"
            )
    if not isinstance(given.switches, (tuple, list)) or not all(map(is_number, given.switches)):
        raise ProblemError(
            f"reference switches: {shown(given.switches)} where times (t1, t2, ...) are needed"
        )
    for name in ("word", "source"):
        check_text(f"reference {name}", getattr(given, name))


def check_scene(scene: Any) -> None:
    """Raise ProblemError unless a scene has the shape of one; its expressions are checked with all
    the others.
    """
    if scene is None:
        return
    if not isinstance(scene, Scene):
        raise ProblemError(f"scene: {shown(scene)} where a Scene(plane=(x, y)) is needed")
    for name, value in (("plane", scene.plane), ("flow", scene.flow)):
        pair = isinstance(value, (tuple, list)) and len(value) == 2
        if not pair and not (name == "flow" and value is None):
            raise ProblemError(
                f"scene {name}: {shown(value)} where a pair of expressions is needed"
            )
    if scene.target is not None:
        _check_target(scene.target)
    if scene.flow is not None:
        _check_flow(scene)


def scene_expressions(scene: Scene | None) -> Iterator[tuple[str, Expr]]:
    """Yield (where it stands, expression) for everything in a scene."""
    if scene is not None:
        yield from (("scene plane", each) for each in scene.plane)
        yield from (("scene flow", each) for each in scene.flow or ())
        yield from (("scene heading", each) for each in [scene.heading] if each is not None)


def _check_target(target: Any) -> None:
    numbers = isinstance(target, (tuple, list)) and len(target) == 3 and all(map(is_number, target))
    if not numbers or not all(map(isfinite, target)) or target[2] <= 0:
        raise ProblemError(
            f"scene target: {shown(target)} where (cx, cy, radius), a disc, is needed"
        )


def _check_flow(scene: Scene) -> None:
    for each in scene.plane:
        if not is_symbol(each) or role(each) != "state":
            what = f"the plane's coordinate {plainly(each)} is no state"
            raise ProblemError(f"scene flow: {what}; a flow needs a plane of states")
    allowed = set(scene.plane)
    for each in scene.flow or ():
        for symbol in casadi.symvar(each) if isinstance(each, casadi.SX) else []:
            if role(symbol) == "state" and symbol not in allowed:
                raise ProblemError(
                    f"scene flow: depends on '{symbol}', which is no coordinate of the plane"
                )
