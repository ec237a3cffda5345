"""Goddard's rocket with the flight time given, so that the Hamiltonian is an unknown constant."""

from casadi import exp

from socp import Problem, Reference, controls, states

h, v, m = states("h v m")  # height from the centre of the Earth, speed, mass
u = controls("u")  # thrust

problem = Problem(
    name="goddard_fixed_time",
    minimise=-h,
    dynamics={
        h: v,
        v: (3.5 * u - 310 * v**2 * exp(-500 * (h - 1))) / m - 1 / h**2,
        m: -7 * u,
    },
    bounds={u: (0, 1)},
    start={h: 1, v: 0, m: 1},
    end={m: 0.6},
    final_time=0.17,
    title="Goddard rocket, greatest height, given time",
    source='the model of COPS "Goddard rocket" with a prescribed final time',
    reference=Reference(
        objective=-1.0124939068571261,
        switches=(0.02746056174, 0.06612765435),
        word="u: + s -",
        tolerance=1e-13,
        source="LGR, Pontryagin boundary value problem on two meshes and DOP853 agree, 14 digits",
    ),
)
