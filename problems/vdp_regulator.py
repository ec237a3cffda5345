"""Regulate a van der Pol oscillator: two bang arcs, then a singular arc to the end."""

from socp import Problem, Reference, controls, states

x1, x2 = states("x1 x2")
u = controls("u")

problem = Problem(
    name="vdp_regulator",
    running=0.5 * x1**2 + 0.5 * x2**2,
    dynamics={x1: x2, x2: u - x1 + x2 * (1 - x1**2)},
    bounds={u: (-1, 1)},
    start={x1: 0, x2: 1},
    final_time=4,
    title="Van der Pol oscillator, singular regulator",
    source="Vossen, Journal of Optimization Theory and Applications 144, 2010",
    reference=Reference(
        objective=0.7576179286593926,
        switches=(1.366740031063, 2.460874384319),
        word="u: - + s",
        tolerance=1e-12,
        source="LGR, Pontryagin boundary value problem on two meshes and DOP853 agree, 13 digits",
    ),
)
