"""Move a double integrator over a distance of 10, rest to rest, under a speed limit, in minimum
time.
"""

from socp import Problem, Reference, controls, final_time, states

x, v = states("x v")  # position, speed
u = controls("u")  # acceleration

problem = Problem(
    name="double_integrator_vlimit",
    minimise=final_time,
    dynamics={x: v, v: u},
    bounds={u: (-1, 1), v: (None, 1.5)},
    start={x: 0, v: 0},
    end={x: 10, v: 0},
    title="Double integrator with limited speed, minimum time",
    source="textbook",
    reference=Reference(
        objective=49 / 6,
        switches=(3 / 2, 20 / 3),
        word="u: + b -",
        tolerance=1e-14,
        source="closed form: 1.5 s up, 1.5 s down, the remaining 7.75 at speed 1.5",
    ),
)
