"""A pond that is brought down to its level, along it, and up again: bang, singular and bang arcs in
closed form.
"""

from socp import Problem
from socp.model import constants, controls, states

x = states("x")
u = controls("u")
level, rate = constants(level=0.25, rate=1)
# x' = u, |u| <= rate, integral of (x - level)^2 from 1 to 1 in T: down to the level at
# (1 - level) / rate, along it, and up again; the objective is 2/3 (1 - level)^3 / rate. There is no
# time for the level where T <= 2 (1 - level) / rate
POND = Problem(
    name="pond",
    running=(x - level) ** 2,
    dynamics={x: u},
    bounds={u: (-rate, rate)},
    start={x: 1},
    end={x: 1},
    final_time=4,
)
