"""Mix two catalysts along a reactor so that the product, 1 - x1 - x2, is largest at its end."""

from socp import Problem, Reference, controls, states

x1, x2 = states("x1 x2")  # mole fractions of the feed and the intermediate
u = controls("u")  # share of the first catalyst

problem = Problem(
    name="catalyst_mixing",
    minimise=x1 + x2 - 1,
    dynamics={
        x1: u * (10 * x2 - x1),
        x2: u * (x1 - 10 * x2) - (1 - u) * x2,
    },
    bounds={u: (0, 1)},
    start={x1: 1, x2: 0},
    final_time=1,
    title="Catalyst mixing, COPS data",
    source='Jackson, 1968; COPS 3 "catalyst mixing"',
    reference=Reference(
        objective=-0.04805568586087798,
        switches=(0.136299034595, 0.725230107592),
        word="u: + s -",
        tolerance=1e-14,
        source="LGR, Pontryagin boundary value problem on two meshes and DOP853 agree, 14 digits",
    ),
)
