"""Shortest path of bounded curvature between two positions with given headings: left, straight,
right.
"""

from math import pi

from casadi import cos, sin

from socp import Problem, Reference, controls, final_time, states

x, y, th = states("x y th")  # position, heading
u = controls("u")  # curvature

problem = Problem(
    name="dubins_csc",
    minimise=final_time,
    dynamics={x: cos(th), y: sin(th), th: u},
    bounds={u: (-1, 1)},
    start={x: 0, y: 0, th: 0},
    end={x: 4, y: 3, th: -pi / 2},
    title="Dubins path, turn - straight - turn",
    source="Dubins, American Journal of Mathematics 79, 1957, doi:10.2307/2372560",
    reference=Reference(
        objective=6.922806740985164,
        switches=(1.1760052070951355, 4.176005207095133),
        word="u: + s -",
        tolerance=1e-13,
        source="closed form, all Dubins words compared",
    ),
)
