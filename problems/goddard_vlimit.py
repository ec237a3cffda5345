"""Goddard's rocket under a speed limit: the singular arc runs into a boundary arc."""

from casadi import exp

from socp import Problem, Reference, controls, states

h, v, m = states("h v m")  # height from the centre of the Earth, speed, mass
u = controls("u")  # thrust

problem = Problem(
    name="goddard_vlimit",
    minimise=-h,
    dynamics={
        h: v,
        v: (3.5 * u - 310 * v**2 * exp(-500 * (h - 1))) / m - 1 / h**2,
        m: -7 * u,
    },
    bounds={u: (0, 1), v: (None, 0.1)},
    start={h: 1, v: 0, m: 1},
    end={m: 0.6},
    title="Goddard rocket, greatest height, limited speed",
    source='control-toolbox, CTProblems "goddard"',
    reference=Reference(
        objective=-1.0125763246569277,
        switches=(0.023509684041, 0.059737380901, 0.101571348425),
        word="u: + s b -",
        tolerance=1e-13,
        source="LGR, Pontryagin boundary value problem on two meshes and DOP853 agree, 14 digits",
    ),
)
