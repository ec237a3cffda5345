"""Bring a double integrator from (1, 1) to rest at the origin in minimum time."""

from math import sqrt

from socp import Problem, Reference, controls, final_time, states

x, v = states("x v")  # position, speed
u = controls("u")  # acceleration

problem = Problem(
    name="double_integrator_time",
    minimise=final_time,
    dynamics={x: v, v: u},
    bounds={u: (-1, 1)},
    start={x: 1, v: 1},
    end={x: 0, v: 0},
    title="Double integrator, minimum time",
    source="textbook",
    reference=Reference(
        objective=1 + sqrt(6),
        switches=(1 + sqrt(1.5),),
        word="u: - +",
        tolerance=1e-14,
        source="closed form: tf = 1 + sqrt(6), t1 = 1 + sqrt(3/2)",
    ),
)
