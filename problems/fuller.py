"""Fuller's problem: the bang arcs shorten geometrically and pile up where the singular arc
begins.
"""

from socp import Problem, Reference, controls, states

x1, x2 = states("x1 x2")  # position, speed
u = controls("u")  # acceleration

problem = Problem(
    name="fuller",
    running=0.5 * x1**2,
    dynamics={x1: x2, x2: u},
    bounds={u: (-1, 1)},
    start={x1: 0, x2: 1},
    final_time=5,
    title="Fuller's problem, chattering",
    source="Fuller, Journal of Electronics and Control 15, 1963; Zelikin, Borisov, Theory of "
    "Chattering Control, 1994",
    reference=Reference(
        objective=0.13419691528445565,
        tolerance=1e-15,
        source="closed form: infinitely many switches, from 1.72753788888581 on by a ratio of "
        "0.24212137, then u = 0",
    ),
)
