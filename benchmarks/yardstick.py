"""Grids as anybody would write them in casadi: what our own times are measured against.

They share nothing with socp but the problem, and keep the stock options of Ipopt, so that no
progress of ours moves them.
"""

import casadi
import numpy as np

from socp import Problem, Solution
from socp.model import end_symbols, parameters_of, time

# A grid that takes more iterations than this has failed, and measures nothing
_QUIET = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.max_iter": 500}
_RADAU = 3  # points an interval of the collocation


def trapezoid(problem: Problem, guess: Solution, steps: int = 400) -> str:
    """Solve by the trapezoidal rule on a uniform grid, written out as scalar expressions; returns
    how the solver stopped.
    """
    grid = _Grid(problem, casadi.SX, steps + 1, steps + 1)
    f = casadi.Function("f", grid.given, [problem.rate, problem.lagrangian])
    at = [f(grid.X[:, k], grid.U[:, k], grid.time(k / steps), grid.p) for k in range(steps + 1)]
    h = grid.length / steps
    defects = [
        grid.X[:, k + 1] - grid.X[:, k] - h / 2 * (at[k][0] + at[k + 1][0]) for k in range(steps)
    ]
    cost = h * sum(0.5 * (at[k][1] + at[k + 1][1]) for k in range(steps))
    return grid.solved(guess, np.linspace(0.0, 1.0, steps + 1), defects, cost)


def collocation(problem: Problem, guess: Solution, steps: int = 400) -> str:
    """Solve by Radau collocation with a constant control an interval, mapped; returns how the
    solver stopped.
    """
    tau = [0.0, *casadi.collocation_points(_RADAU, "radau")]
    C, _, B = casadi.collocation_coeff(tau[1:])
    nodes = np.append((np.arange(steps)[:, None] + np.array(tau)[None, :-1]).ravel() / steps, 1.0)
    grid = _Grid(problem, casadi.MX, nodes.size, steps)
    f = casadi.Function("f", grid.given, [problem.rate, problem.lagrangian])
    Z = [grid.X[:, j : j + (steps - 1) * _RADAU + 1 : _RADAU] for j in range(_RADAU + 1)]
    h, defects, cost = grid.length / steps, [], casadi.MX(0)
    for j in range(1, _RADAU + 1):
        t = grid.time((np.arange(steps) + tau[j]) / steps)
        F, L = f.map(steps)(Z[j], grid.U, casadi.reshape(t, 1, -1), casadi.repmat(grid.p, 1, steps))
        slope = sum(float(C[i, j - 1]) * Z[i] for i in range(_RADAU + 1))
        defects.append(casadi.vec(slope - h * F))
        cost += h * float(B[j - 1]) * casadi.sum2(L)
    return grid.solved(guess, nodes, defects, cost)


class _Grid:
    """Variables of a grid, and what is the same for every scheme."""

    def __init__(self, problem: Problem, kind: type, nodes: int, controls: int) -> None:
        nx, nu, np_ = problem.x.numel(), problem.u.numel(), problem.p.numel()
        self.problem, self.given = problem, [problem.x, problem.u, time, problem.p]
        self.t0, self.length = kind.sym("t0"), kind.sym("h")
        self.p, self.X = kind.sym("p", np_), kind.sym("X", nx, nodes)
        self.U = kind.sym("U", nu, controls)
        parts = [self.t0, self.length, self.p, casadi.vec(self.X), casadi.vec(self.U)]
        self.v, self.kind = casadi.vertcat(*parts), kind

    def time(self, share: float | np.ndarray) -> casadi.SX | casadi.MX:
        return self.t0 + self.length * share

    def solved(
        self,
        guess: Solution,
        nodes: np.ndarray,
        defects: list[casadi.SX],
        cost: casadi.SX,
    ) -> str:
        """Add the ends, the bounds and the constraints, and solve."""
        problem, tf = self.problem, self.t0 + self.length
        ends = [self.X[:, -1], self.X[:, 0], self.p, self.t0, tf]
        mayer = casadi.Function("mayer", end_symbols(problem), [problem.mayer])(*ends)
        rows, low = [*defects, tf], [np.zeros(sum(each.numel() for each in defects))]
        high = [low[0], problem.final_time_box[1:]]
        low.append(problem.final_time_box[:1])
        for each in problem.conditions:
            psi = casadi.Function("psi", end_symbols(problem), [each.expression])(*ends)
            rows.append(psi)
            low.append([0.0 if each.equation else -np.inf])
            high.append([0.0])
        for each in problem.constraints:
            if each.name in problem.path:
                c = casadi.Function("c", [problem.x, time, problem.p], [each.expression])
                t = casadi.reshape(self.time(casadi.DM(nodes)), 1, -1)
                rows.append(
                    casadi.vec(c.map(nodes.size)(self.X, t, casadi.repmat(self.p, 1, nodes.size)))
                )
                low.append(np.full(nodes.size, -np.inf))
                high.append(np.zeros(nodes.size))
        box = [np.repeat(each[:, None], nodes.size, axis=1) for each in problem.state_box]
        for at, end in ((0, problem.start_box), (-1, problem.end_box)):
            box[0][:, at] = np.maximum(box[0][:, at], end[0])
            box[1][:, at] = np.minimum(box[1][:, at], end[1])
        bounds = [
            np.concatenate(
                [
                    [problem.initial_time_box[k], (0.0, np.inf)[k]],
                    problem.parameter_box[k],
                    box[k].T.ravel(),
                    np.tile(problem.box[k], self.U.shape[1]),
                ]
            )
            for k in (0, 1)
        ]
        start, end = guess.initial_time, guess.final_time
        times = start + nodes * (end - start)
        x = [np.interp(times, guess.t, row) for row in guess.rows("x")]
        u = [np.full(self.U.shape[1], np.mean(row)) for row in problem.box.T]
        v0 = [[start, end - start], parameters_of(problem, guess)]
        v0 += [np.array(x).T.ravel(), np.array(u).T.ravel()]
        nlp = {"x": self.v, "f": cost + mayer, "g": casadi.vertcat(*map(casadi.vec, rows))}
        solver = casadi.nlpsol("grid", "ipopt", nlp, _QUIET)
        solver(
            x0=np.concatenate(v0),
            lbx=bounds[0],
            ubx=bounds[1],
            lbg=np.concatenate(low),
            ubg=np.concatenate(high),
        )
        return str(solver.stats()["return_status"])
