"""Regulate a double integrator, position and speed weighted alike: bang, then a singular arc to the
end.
"""

from socp import Problem, Reference, controls, states

x1, x2 = states("x1 x2")  # position, speed
u = controls("u")  # acceleration

problem = Problem(
    name="jacobson_1",
    running=0.5 * x1**2 + 0.5 * x2**2,
    dynamics={x1: x2, x2: u},
    bounds={u: (-1, 1)},
    start={x1: 0, x2: 1},
    final_time=5,
    title="Jacobson's first singular problem",
    source='Jacobson, Gershwin, Lele, 1970; Bocop example "regulator"',
    reference=Reference(
        objective=0.37699193028794,
        switches=(1.41376408763,),
        word="u: - s",
        tolerance=1e-13,
        source="LGR, Pontryagin boundary value problem on two meshes and DOP853 agree, 14 digits",
    ),
)
