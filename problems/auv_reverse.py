"""The underwater vehicle as printed: no lower bound on the speed; driving backwards is faster."""

from math import pi, sqrt

from casadi import cos, fabs, sin, tanh

from socp import Problem, Reference, Scene, controls, final_time, states

x, y, phi, u = states("x y phi u")  # position, heading, speed
r, f = controls("r f")  # turn rate, thrust

problem = Problem(
    name="auv_reverse",
    minimise=final_time,
    dynamics={x: u * cos(phi) + 0.8 * tanh(y), y: u * sin(phi), phi: r, u: f - u * fabs(u)},
    bounds={r: (-pi, pi), f: (-5, 5), u: (None, 2)},
    start={x: 40, y: -2, phi: pi, u: 0},
    end={phi: pi, u: 0},
    target={"disc": x**2 + y**2 <= 0.05},
    scene=Scene(plane=(x, y), heading=phi, flow=(0.8 * tanh(y), 0), target=(0, 0, sqrt(0.05))),
    title="AUV in a shear current as printed, reverse driving allowed",
    source="Foroozandeh, de Pinho, Shamsi, DCDS-B 24(5) 2019, doi:10.3934/dcdsb.2019092, problem "
    "(P)",
    reference=Reference(
        objective=14.49097722886439,
        switches=(
            0.2259576834809,
            1.0574034885052,
            13.6032382057994,
            13.9843161216795,
            14.4140490578992,
        ),
        word="r: + + s - - -; f: + - - - + -",
        tolerance=1e-11,
        source="Pontryagin boundary value problem and LGR on two meshes, 12 digits; best of 130 "
        "starts",
    ),
)
