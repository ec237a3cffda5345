"""The cart that tests of many rooms drive: as a problem, as a file, and what a command said of it.

From rest to rest over a unit of distance with |u| <= 1, in least time: 2, with one switch at 1.
"""

from collections.abc import Callable
from typing import NamedTuple

from socp import Problem, controls, final_time, states

FILE = """from socp import Problem, controls, final_time, states

x, v = states("x v")
u = controls("u")
problem = Problem(
    name="cart", minimise=final_time, dynamics={x: v, v: u}, bounds={u: (-1, 1)},
    start={x: 0, v: 0}, end={x: 1, v: 0},
)
"""
x, v = states("x v")
u = controls("u")


def cart(**changed: object) -> Problem:
    """Return the cart, with some fields of the problem changed."""
    given = {
        "name": "cart",
        "minimise": final_time,
        "dynamics": {x: v, v: u},
        "bounds": {u: (-1, 1)},
        "start": {x: 0, v: 0},
        "end": {x: 1, v: 0},
    }
    return Problem(**{**given, **changed})


class Said(NamedTuple):
    """What a command returned and wrote."""

    code: int
    out: str
    err: str


Command = Callable[..., Said]
