"""Minimum-time path of an underwater vehicle through a shear current, to a disc around the
origin.
"""

from math import pi, sqrt

from casadi import cos, fabs, sin, tanh

from socp import Problem, Reference, Scene, constants, controls, final_time, states

x, y, phi, u = states("x y phi u")  # position, heading, speed
r, f = controls("r f")  # turn rate, thrust
current = constants(current=0.8)  # its strength far from the axis

problem = Problem(
    name="auv",
    minimise=final_time,
    dynamics={
        x: u * cos(phi) + current * tanh(y),
        y: u * sin(phi),
        phi: r,
        u: f - u * fabs(u),
    },
    bounds={r: (-pi, pi), f: (-5, 5), u: (0, 2)},
    start={x: 40, y: -2, phi: pi, u: 0},
    end={phi: pi, u: 0},
    target={"disc": x**2 + y**2 <= 0.05},
    scene=Scene(plane=(x, y), heading=phi, flow=(current * tanh(y), 0), target=(0, 0, sqrt(0.05))),
    title="AUV in a shear current, minimum time",
    source="Foroozandeh, de Pinho, Shamsi, DCDS-B 24(5) 2019, doi:10.3934/dcdsb.2019092, with u "
    ">= 0",
    reference=Reference(
        objective=14.950161782153554,
        switches=(0.04905210859259, 0.6456134114460, 14.6238176532765, 14.7241631681594),
        word="r: + s s s +; f: + + b - -",
        tolerance=1e-11,
        source="Pontryagin boundary value problem and LGR on two meshes, 12 digits",
    ),
)
