"""Bring a Rayleigh oscillator to rest in minimum time."""

from socp import Problem, Reference, controls, final_time, states

x1, x2 = states("x1 x2")
u = controls("u")

problem = Problem(
    name="rayleigh_time",
    minimise=final_time,
    dynamics={x1: x2, x2: 4 * u - x1 + x2 * (1.4 - 0.14 * x2**2)},
    bounds={u: (-1, 1)},
    start={x1: -5, x2: -5},
    end={x1: 0, x2: 0},
    title="Rayleigh oscillator, minimum time",
    source="Maurer, Osmolovskii",
    reference=Reference(
        objective=3.6681733886295596,
        switches=(1.120506591935, 3.310046983855),
        word="u: + - +",
        tolerance=1e-13,
        source="LGR, Pontryagin boundary value problem on two meshes and DOP853 agree, 14 digits",
    ),
)
