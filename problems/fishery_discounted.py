"""Harvest a fish stock for the largest discounted profit: wait, hold the golden-rule stock, fish
out at the end.
"""

from casadi import exp

from socp import Problem, Reference, controls, states, time

x = states("x")  # stock
E = controls("E")  # fishing effort

problem = Problem(
    name="fishery_discounted",
    running=-E * (0.6 * x - 0.8) * exp(-0.12 * time),
    dynamics={x: 0.71 * x * (1 - x / 8) - 0.6 * E * x},
    bounds={E: (0, 1)},
    start={x: 2.5},
    final_time=12,
    title="Schaefer fishery with discounting",
    source="Clark, Mathematical Bioeconomics, 1976, chapter 2; chosen data",
    reference=Reference(
        objective=-5.18473166067834,
        switches=(1.2549801211248, 9.8839817255498),
        word="E: - s +",
        tolerance=1e-13,
        source="golden-rule stock in closed form, last switch from a scalar equation, 15 digits",
    ),
)
