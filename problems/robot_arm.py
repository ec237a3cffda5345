"""Move a robot arm from rest to rest in minimum time: three controls, no singular arc."""

from math import pi

from casadi import sin

from socp import Problem, Reference, controls, final_time, states

rho, rhod, theta, thetad, phi, phid = states(
    "rho rhod theta thetad phi phid"
)  # length and angles, each with its rate
u_rho, u_theta, u_phi = controls("u_rho u_theta u_phi")

inertia = ((5 - rho) ** 3 + rho**3) / 3

problem = Problem(
    name="robot_arm",
    minimise=final_time,
    dynamics={
        rho: rhod,
        rhod: u_rho / 5,
        theta: thetad,
        thetad: u_theta / (inertia * sin(phi) ** 2),
        phi: phid,
        phid: u_phi / inertia,
    },
    bounds={u_rho: (-1, 1), u_theta: (-1, 1), u_phi: (-1, 1)},
    start={rho: 4.5, rhod: 0, theta: 0, thetad: 0, phi: pi / 4, phid: 0},
    end={rho: 4.5, rhod: 0, theta: 2 * pi / 3, thetad: 0, phi: pi / 4, phid: 0},
    title="Robot arm, minimum time",
    source='COPS "robot arm"',
    reference=Reference(
        objective=9.140911745915018,
        switches=(2.285227936479, 2.79604321001, 4.570455872958, 6.344868535905, 6.855683809436),
        word="u_rho: - + + + + -; u_theta: + + + - - -; u_phi: - - + + - -",
        tolerance=1e-12,
        source="LGR, Pontryagin boundary value problem on two meshes and DOP853 agree, 14 digits",
    ),
)
