"""Fish a predator and its prey so that both settle at 1: the fishing effort without its
integrality.
"""

from socp import Problem, Reference, controls, states

x1, x2 = states("x1 x2")  # prey, predator
w = controls("w")  # fishing effort

problem = Problem(
    name="lotka_fishing",
    running=(x1 - 1) ** 2 + (x2 - 1) ** 2,
    dynamics={
        x1: x1 - x1 * x2 - 0.4 * w * x1,
        x2: x1 * x2 - x2 - 0.2 * w * x2,
    },
    bounds={w: (0, 1)},
    start={x1: 0.5, x2: 0.7},
    final_time=12,
    title="Lotka-Volterra fishing, relaxed",
    source='Sager, mintOC "Lotka Volterra fishing problem"',
    reference=Reference(
        objective=1.3440811981372496,
        switches=(2.43669998435, 3.94197093002),
        word="w: - + s",
        tolerance=1e-12,
        source="LGR, Pontryagin boundary value problem on two meshes and DOP853 agree, 13 digits",
    ),
)
