"""What the second variation is made of: the extremal between steps, and its coefficients there."""

import casadi
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_never_wrong import right

from socp import Problem, controls, parameters, states, time
from socp.model import Mode, numbers, parameters_of
from socp.transcription import Phase
from socp.verdict.minimum.goh import _quadratics
from socp.verdict.minimum.induced import Pair, induced
from socp.verdict.minimum.stages import hermite
from socp.verdict.minimum.variation import Quadratic, Reference, reference


def test_values_and_slopes_of_five_ends_give_degree_nine_and_no_more() -> None:
    nodes = (0.0, 0.03, 0.2, 0.5, 0.71, 0.97, 1.0)
    for steps in (4, 7, 16):
        ends = np.linspace(0.0, 1.0, steps + 1)
        values, slopes = hermite(steps, nodes, 5)
        for degree in range(11):
            found = values @ ends**degree + slopes @ (degree * ends ** max(degree - 1, 0)) / steps
            off = np.abs(found - np.array(nodes) ** degree).max()
            assert (off < 1e-13) == (degree < 10), (steps, degree)


@pytest.mark.parametrize(
    "name",
    ["jacobson_1", "catalyst_mixing", pytest.param("goddard", marks=pytest.mark.slow)],
)
def test_the_extremal_between_steps_is_that_of_hamilton_s_equations(name: str) -> None:
    """Integrated by another integrator from where an interval begins; the arcs take 8 steps an
    interval, 2, and 8.
    """
    problem, _, solution = right(name)
    pair = induced(problem, solution)
    assert isinstance(pair, Pair)
    quadratics = _quadratics(problem, pair)
    assert not isinstance(quadratics, str)
    shooting, p = pair.fine.conditions.shooting, parameters_of(problem, solution)
    H = problem.lagrangian + casadi.dot(problem.costate, problem.rate)
    rate = casadi.vertcat(problem.rate, -casadi.gradient(H, problem.x))
    given = [casadi.vertcat(problem.x, problem.costate), problem.u, time, problem.p]
    turn, nodes, nx = (
        casadi.Function("turn", given, [rate]),
        np.linspace(0, 1, 12),
        problem.x.numel(),
    )
    assert quadratics
    for k, each in quadratics.items():
        found = reference(pair.fine, k, each, nodes)
        control = shooting.motions[k].control
        both = np.vstack([found.x, found.costate]).T.reshape(-1, nodes.size, 2 * nx)

        def moved(t: float, y: np.ndarray, control: casadi.Function = control) -> np.ndarray:
            (u,) = numbers(control, y[:nx], np.empty((0, 1)), t, p)
            return numbers(turn, y, u, t, p)[0][:, 0]

        for t, y in zip(found.t.reshape(-1, nodes.size), both, strict=True):
            there = solve_ivp(moved, t[[0, -1]], y[0], "DOP853", t, rtol=1e-12, atol=1e-13).y.T
            assert np.abs(there - y).max() < 1e-9 * np.abs(both).max()


def test_the_coefficients_are_those_of_goh_s_transformation() -> None:
    """On dynamics that depend on time and a parameter, by the formulas as they are written: r H by
    y and controls, derivatives along the extremal by the chain rule.
    """
    x, y, z = states("x y z")
    u, v = controls("u v")
    a = parameters("a")
    problem = Problem(
        name="made",
        running=x**2 * y + a * casadi.sin(z) + u * y**2,
        dynamics={
            x: casadi.sin(y) + a * z * u + time * v,
            y: x * z + u * casadi.cos(a * x) + v * z,
            z: time * x**2 + u * y + v * a,
        },
        bounds={u: (-1, 1), v: (-1, 1), a: (0, 1)},
        start={x: 1, y: 0, z: 0},
        final_time=1,
    )
    free = Phase(modes=(Mode("free"),) * 2, control=problem.u, free=problem.u, box=problem.box)
    rng = np.random.default_rng(0)
    t, values, p = rng.random(5), rng.normal(size=(8, 5)), rng.random(1)
    along = Reference(t, values[:3], values[3:5], values[5:])
    r = casadi.SX.sym("r")
    eta = casadi.vertcat(problem.x, time, r, problem.p)
    H = problem.lagrangian + casadi.dot(problem.costate, problem.rate)
    motion = casadi.vertcat(r * problem.rate, r, 0, 0)

    def turned(each: casadi.SX) -> casadi.SX:
        """Return how a matrix changes along the extremal."""
        symbols = casadi.vertcat(problem.x, time, problem.costate)
        slopes = casadi.vertcat(problem.rate, 1, -casadi.gradient(H, problem.x))
        flat = casadi.jacobian(casadi.vec(each), symbols) @ slopes
        return casadi.reshape(flat, *each.shape)

    A, Q = casadi.jacobian(motion, eta), casadi.hessian(r * H, eta)[0]
    given = [problem.x, problem.u, problem.costate, time, problem.p, r]
    at = along.x, along.u, along.costate, t[None], p, 1.0
    for places in ((0,), (1,), (0, 1)):
        own = casadi.vertcat(*(problem.u[i] for i in places))
        B = casadi.jacobian(motion, own)
        N = casadi.jacobian(casadi.gradient(r * H, own), eta)
        B1 = A @ B - turned(B)
        M = B.T @ Q - turned(N) - N @ A
        R = B.T @ Q @ B - N @ B1 - (N @ B1).T - (turned(N) @ B + N @ turned(B))
        wanted = {"A": A, "Q": Q, "B": B, "B1": B1, "M": M, "R": R, "N": N, "NB": N @ B}
        found = Quadratic(problem, free, (0, 1)).at(along, p, places)
        assert set(found) == set(wanted)
        for name, each in wanted.items():
            (of,) = numbers(casadi.Function("of", given, [casadi.densify(each)]), *at)
            of = of.reshape(len(of), t.size, -1).swapaxes(0, 1)
            assert found[name] == pytest.approx(of, abs=1e-12), (name, places)
