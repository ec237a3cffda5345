"""Goddard's rocket: burn the given fuel so that it climbs highest, the time free."""

from casadi import exp

from socp import Problem, Reference, controls, states

h, v, m = states("h v m")  # height from the centre of the Earth, speed, mass
u = controls("u")  # thrust

problem = Problem(
    name="goddard",
    minimise=-h,
    dynamics={
        h: v,
        v: (3.5 * u - 310 * v**2 * exp(-500 * (h - 1))) / m - 1 / h**2,
        m: -7 * u,
    },
    bounds={u: (0, 1)},
    start={h: 1, v: 0, m: 1},
    end={m: 0.6},
    title="Goddard rocket, greatest height, free time",
    source='Goddard, 1919; COPS "Goddard rocket", scaling of Seywald and Cliff',
    reference=Reference(
        objective=-1.0128369183174941,
        switches=(0.02350968404, 0.07267074344),
        word="u: + s -",
        tolerance=1e-13,
        source="LGR, Pontryagin boundary value problem on two meshes and DOP853 agree, 14 digits",
    ),
)
