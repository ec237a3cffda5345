"""Standard problems with solutions known in closed form, one for each kind of thing that a method
must cope with.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import final

from socp.model import Problem, controls, final_time, parameters, states, time


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Standard:
    """A problem with its exact objective and its exact costates at the initial time, in the order
    of the states.
    """

    problem: Problem
    objective: float
    costate: tuple[float, ...] = ()


def minimum_time() -> Standard:
    """Double integrator from (1, -1) to rest: u = -1, then +1; tf = sqrt 6 - 1.

    With x at distance d and v the final time is v + 2 sqrt(d + v^2/2), a half of the root after the
    switch. H = -1 with lambda_x constant, lambda_v = 0 at the switch and -1 at the end.
    """
    half = sqrt(1.5)
    return _double_integrator("minimum_time", -1.0, sqrt(6) - 1, (1 / half, (half - 1) / half))


def turning_back() -> Standard:
    """Double integrator from (1, 1) to rest, as in `minimum_time` but for v: tf = 1 + sqrt 6.

    It is kept out of STANDARD: to brake for a unit of time and stop far off is a stationary point
    of the infeasibility, in which any local solver may end.
    """
    half = sqrt(1.5)
    return _double_integrator("turning_back", 1.0, sqrt(6) + 1, (1 / half, (half + 1) / half))


def _double_integrator(
    name: str, speed: float, objective: float, costate: tuple[float, float]
) -> Standard:
    x, v = states("x v")
    u = controls("u")
    problem = Problem(
        name=name,
        minimise=final_time,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1)},
        start={x: 1, v: speed},
        end={x: 0, v: 0},
    )
    return Standard(problem=problem, objective=objective, costate=costate)


def regulator() -> Standard:
    """Integral of x^2 on [0, 2] with x' = u, |u| <= 1, x(0) = 1: bang until x = 0 at t = 1, then
    singular; 1/3.

    lambda' = -2 x with lambda = 0 on the singular arc, so lambda(0) = 1.
    """
    x = states("x")
    u = controls("u")
    problem = Problem(
        name="regulator",
        running=x**2,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 1},
        final_time=2.0,
        singular={u: 0},
    )
    return Standard(problem=problem, objective=1 / 3, costate=(1.0,))


def control_cost() -> Standard:
    """Integral of x + u/2 on [0, 2] with x' = -u, 0 <= u <= 1, x(0) = 1: sigma = 1/2 - lambda,
    lambda = 2 - t.

    So u = 1 until t = 3/2, then 0; the integral is 3/8 - 1/4 + 3/4 = 7/8.
    """
    x = states("x")
    u = controls("u")
    problem = Problem(
        name="control_cost",
        running=x + u / 2,
        dynamics={x: -u},
        bounds={u: (0, 1)},
        start={x: 1},
        final_time=2.0,
    )
    return Standard(problem=problem, objective=7 / 8, costate=(2.0,))


def tracking() -> Standard:
    """Integral of (x - t^2/2)^2 on [0, 1], x' = u, |u| <= 1, x(0) = 1/2: bang until sqrt 2 - 1,
    then singular u = t.

    With s = t + 1 the bang arc costs the integral of (1 - s^2/2)^2 over [1, sqrt 2], and lambda(0)
    is that of 2 (1 - s^2/2).
    """
    x = states("x")
    u = controls("u")
    problem = Problem(
        name="tracking",
        running=(x - time**2 / 2) ** 2,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 0.5},
        final_time=1.0,
        singular={u: time},
    )
    return Standard(
        problem=problem, objective=8 * sqrt(2) / 15 - 43 / 60, costate=((4 * sqrt(2) - 5) / 3,)
    )


def speed_limit() -> Standard:
    """Double integrator from rest at 0 to rest at 2 with v <= 1: u = +1, 0, -1, a unit of time
    each; tf = 3.

    H = -1 along the limit gives lambda_x = -1; at the start it gives lambda_v = -1.
    """
    x, v = states("x v")
    u = controls("u")
    problem = Problem(
        name="speed_limit",
        minimise=final_time,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1), v: (-10, 1)},
        start={x: 0, v: 0},
        end={x: 2, v: 0},
    )
    return Standard(problem=problem, objective=3.0, costate=(-1.0, -1.0))


def parameter() -> Standard:
    """Smallest parameter p that, helped by |u| <= 1, brings x' = p + u from 0 to 2 in one unit of
    time: p = 1, u = 1.

    The end value changes with p at rate 1, so lambda = -1 balances the cost p.
    """
    x = states("x")
    u = controls("u")
    p = parameters("p")
    problem = Problem(
        name="parameter",
        minimise=p,
        dynamics={x: p + u},
        bounds={u: (-1, 1), p: (-5, 5)},
        start={x: 0},
        end={x: 2},
        final_time=1.0,
    )
    return Standard(problem=problem, objective=1.0, costate=(-1.0,))


_MAKERS: tuple[Callable[[], Standard], ...] = (
    minimum_time,
    regulator,
    control_cost,
    tracking,
    speed_limit,
    parameter,
)
STANDARD: tuple[Standard, ...] = tuple(make() for make in _MAKERS)
