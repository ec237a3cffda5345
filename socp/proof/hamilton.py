"""The Hamiltonian system of a problem in exact numbers, and its closed loop on an arc of a word.

On an arc the controls that are singular, those on a constraint, and the constraints' multipliers
are unknown inputs v: the motion of z = (x, lambda, cost, t) is affine in them. What has to vanish
all along, switching functions and constraints, is derived along the motion until inputs appear;
these derivatives vanish for v = -M^-1 A, and then so does all that does where the arc begins. That
is the whole argument: nothing here comes from the laws that found the solution, and that a matrix M
is regular is for the enclosures to show.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import casadi
import numpy as np

from socp.errors import SolveError
from socp.model import Expr, Mode, Modes, Problem, column, final_time, initial_time, time
from socp.proof.exact import Numbers

_ASIDE = 1e-6  # relative: far above rounding, and near enough for a slope to stay what it is

DEEPEST = 6  # derivatives of what vanishes until an input appears: arcs of order 3


@final
@dataclass(frozen=True, eq=False)
class Hamiltonian:
    """The system of a problem: z (nz, 1) are states, costates, the running cost so far where there
    is one, and time; `start` are the symbols of z at the initial time.
    """

    problem: Problem
    numbers: Numbers
    z: Expr
    start: Expr
    u: Expr
    rate: Expr
    running: Expr
    constraints: Mapping[str, Expr]
    mayer: Expr
    conditions: tuple[tuple[str, Expr, bool], ...]

    @classmethod
    def of(cls, problem: Problem) -> "Hamiltonian":
        """Return the system; SolveError says why there is none."""
        if problem.p.numel():
            raise SolveError("it has free parameters")
        names = problem.state_names
        cost = () if is_zero(problem.lagrangian) else ("cost",)
        every = [*names, *(f"lambda_{name}" for name in names), *cost, "time"]
        z, start = (column(casadi.SX.sym(n + end) for n in every) for end in ("", "(t0)"))
        u = column(casadi.SX.sym(name) for name in problem.control_names)
        count, numbers = len(names), Numbers()
        put = dict(zip(casadi.vertsplit(problem.x), casadi.vertsplit(z[:count]), strict=True))
        at_start = casadi.vertsplit(start[:count])
        put |= dict(zip(casadi.vertsplit(problem.x0), at_start, strict=True))
        put |= dict(zip(casadi.vertsplit(problem.u), casadi.vertsplit(u), strict=True))
        put |= {time: z[-1], final_time: z[-1], initial_time: start[-1]}

        def exact(expression: Expr) -> Expr:
            return numbers.expression(casadi.SX(expression), put)

        conditions = tuple((c.name, exact(c.expression), c.equation) for c in problem.conditions)
        bounds = {name: exact(c) for name, c in _constraints(problem).items()}
        return cls(
            problem=problem,
            numbers=numbers,
            z=z,
            start=start,
            u=u,
            rate=exact(problem.rate),
            running=exact(problem.lagrangian),
            constraints=bounds,
            mayer=exact(problem.mayer),
            conditions=conditions,
        )

    @property
    def x(self) -> Expr:
        """States (nx, 1)."""
        return self.z[: self.problem.x.numel()]

    @property
    def costate(self) -> Expr:
        """Costates (nx, 1)."""
        return self.z[self.problem.x.numel() : 2 * self.problem.x.numel()]

    @property
    def costs(self) -> bool:
        """Whether there is a running cost."""
        return bool(self.z.numel() > 2 * self.problem.x.numel() + 1)

    @cached_property
    def value(self) -> Expr:
        """H = L + lambda . f."""
        return self.running + casadi.dot(self.costate, self.rate)

    @cached_property
    def switching(self) -> Expr:
        """The switching functions dH/du (nu, 1)."""
        return casadi.substitute(casadi.jacobian(self.value, self.u).T, self.u, 0)

    def bound(self, control: int, kind: str) -> Expr:
        """Return a bound of a control as an exact number."""
        return self.numbers.of(self.problem.box[int(kind == "upper"), control])


def _constraints(problem: Problem) -> dict[str, Expr]:
    return {constraint.name: constraint.expression for constraint in problem.constraints}


@final
@dataclass(frozen=True, eq=False)
class Loop:
    """The motion z' = field (nz, 1) on an arc with its inputs put in, `control` (nu, 1), the
    multipliers of its constraints, and what vanishes on it all along; `kept` are the derivatives of
    every constraint that do.

    `pulls` are A and M of every boundary control's own equation A + M mu = 0, `convexity` is the
    Legendre-Clebsch matrix of its singular controls, `regular` the determinant that must not
    vanish.
    """

    modes: Modes
    field: Expr
    control: Expr
    multipliers: Mapping[str, Expr]
    vanishing: tuple[Expr, ...]
    kept: Mapping[str, Sequence[Expr]]
    pulls: Mapping[str, tuple[Expr, Expr]]
    convexity: Expr
    regular: Expr

    def derivative(self, z: Expr, expression: Expr) -> Expr:
        """Return the derivative of an expression along the motion."""
        return casadi.jtimes(expression, z, self.field)


def slope_of_switching(system: Hamiltonian, its: Loop, control: int) -> Expr:
    """Return sigma' of a control on an arc, as it is written where this control is an input: it
    does not depend on it.
    """
    kept = column(system.u[i] if i == control else its.control[i] for i in range(system.u.numel()))
    mu = column(its.multipliers.values())
    moved = casadi.substitute(_moved(system, list(its.multipliers), mu), system.u, kept)
    top = casadi.jtimes(system.switching[control], system.z, moved)
    return casadi.simplify(casadi.substitute(top, system.u[control], 0))


def loop(system: Hamiltonian, modes: Modes, near: Callable[[Expr], np.ndarray]) -> Loop:
    """Return the closed loop of an arc, with values of expressions `near` it; SolveError says what
    it lacks.
    """
    kinds = [mode.kind for mode in modes]
    if "free" in kinds:
        free = system.problem.control_names[kinds.index("free")]
        raise SolveError(f"'{free}' follows no law on an arc: what is proved is a word's extremal")
    singular = [i for i, kind in enumerate(kinds) if kind == "singular"]
    on = {
        i: _followed(system, i, mode)
        for i, mode in enumerate(modes)
        if mode.constraint or mode.kind == "boundary"
    }
    mu = column(casadi.SX.sym(f"mu_{name}") for name in on.values())
    v = casadi.vertcat(*(system.u[i] for i in (*singular, *on)), mu)
    rows: list[tuple[Expr, int | None]] = [(system.switching[i], i) for i in (*singular, *on)]
    rows += [(system.constraints[name], None) for name in on.values()]
    given = _driven(system, modes, list(on.values()), mu)
    chains = [
        _chain(system.z, given, v, row, system.u[own] if own is not None else None)
        for row, own in rows
    ]
    matrix = casadi.vertcat(*(chain[2] for chain in chains)) if chains else casadi.SX(0, 0)
    right = column(chain[1] for chain in chains)
    laws = -casadi.mtimes(casadi.inv_minor(matrix), right) if chains else casadi.SX(0, 1)
    put = [casadi.substitute(each, v, laws) for each in (given, _controls(system, modes), mu)]
    signs = [(-1.0) ** (len(chain[0]) // 2) for chain in chains[: len(singular)]]
    convexity = (
        casadi.vertcat(*(sign * matrix[k, : len(singular)] for k, sign in enumerate(signs)))
        if singular
        else casadi.SX(0, 0)
    )
    if any(len(chain[0]) % 2 for chain in chains[: len(singular)]):
        raise SolveError(
            "a singular control appears in an odd derivative of its switching function"
        )
    own = {}
    for k, name in enumerate(on.values(), start=len(singular)):
        alone = matrix[k, :]
        place = len(singular) + len(on) + list(on.values()).index(name)
        others = [alone[j] for j in range(v.numel()) if j != place]
        if all(each.is_zero() for each in others):
            own[name] = (chains[k][1], alone[place])
    multipliers = dict(zip(on.values(), casadi.vertsplit(put[2]) if on else (), strict=True))
    regular = casadi.det(casadi.densify(matrix)) if chains else casadi.SX(1)
    vanishing = tuple(each for chain in chains for each in chain[0])
    kept = {name: chain[0] for name, chain in zip(on.values(), chains[-len(on) :], strict=False)}
    field = _reduced(system, put[0], vanishing, near)
    return Loop(modes, field, put[1], multipliers, vanishing, kept, own, convexity, regular)


def _reduced(
    system: Hamiltonian,
    field: Expr,
    vanishing: Sequence[Expr],
    near: Callable[[Expr], np.ndarray],
) -> Expr:
    """Return a field that is the same wherever all that vanishes does, in which what this fixes
    stands as the number that it is, and of every other condition the costate that enters it most
    as what it has to be.

    Motions on the arc are those of either field. But of this one a rate that is zero is zero, and
    enclosures of it are less wide.
    """
    z, places = system.z, range(system.x.numel(), 2 * system.x.numel())
    put = determined(z, vanishing, near, lambda i, alone: alone or i in places)
    found = put_in(z, field, put)
    for i, value in put.items():
        if not casadi.depends_on(value, z):
            found[i] = 0
    return casadi.sparsify(found)


def determined(
    z: Expr,
    vanishing: Sequence[Expr],
    near: Callable[[Expr], np.ndarray],
    chosen: Callable[[int, bool], bool],
) -> dict[int, Expr]:
    """Return entries of z by place as what they have to be in the others where expressions vanish
    that are affine in them: one of every expression that has such, the one that enters it most. A
    slope that vanishes with the rest, up to rounding, is none.

    `chosen` tells whether an entry may be, by its place, and by whether it stands alone.
    """
    put = dict[int, Expr]()
    for each in sorted(
        vanishing, key=lambda e: sum(casadi.depends_on(e, z[i]) for i in range(z.numel()))
    ):
        left = put_in(z, each, put)
        held = [i for i in range(z.numel()) if casadi.depends_on(left, z[i])]
        slopes = {i: casadi.simplify(casadi.jacobian(left, z[i])) for i in held}
        affine = [i for i in held if not casadi.depends_on(slopes[i], z[i])]
        affine = [i for i in affine if chosen(i, len(held) == 1)]
        sizes = {i: _size(z, slopes[i], near) for i in affine}
        if not sizes or not max(sizes.values()) > 0.0:
            continue
        most = max(sizes, key=lambda i: sizes[i])
        own = -casadi.substitute(left, z[most], 0) / slopes[most]
        put = {i: put_in(z, value, {most: own}) for i, value in put.items()} | {most: own}
    return put


def _size(z: Expr, slope: Expr, near: Callable[[Expr], np.ndarray]) -> float:
    """Return the least size of a slope; zero where it vanishes with the rest and is rounding: it is
    a thousand times as large a little aside then.
    """
    turns = np.resize([1.0, -1.0], z.numel()) * np.linspace(1.0, 2.0, z.numel())
    aside = casadi.substitute(slope, z, z * (1.0 + _ASIDE * turns))
    size, other = np.abs(near(slope)), np.abs(near(aside))
    return float(size.min()) if (size > 1e-3 * other).all() else 0.0


def put_in(z: Expr, expression: Expr, put: Mapping[int, Expr]) -> Expr:
    """Return an expression with entries of z as what they are by place."""
    return casadi.substitute(expression, column(z[i] for i in put), column(put.values()))


def _followed(system: Hamiltonian, control: int, mode: Mode) -> str:
    if mode.constraint:
        return mode.constraint
    names = list(system.constraints)
    if len(names) != 1:
        raise SolveError(f"the arc of {system.problem.control_names[control]} names no constraint")
    return names[0]


def _controls(system: Hamiltonian, modes: Modes) -> Expr:
    """Return the controls (nu, 1): bounds where they are known, their symbols else."""
    return column(
        system.bound(i, mode.kind) if mode.kind in {"lower", "upper"} else system.u[i]
        for i, mode in enumerate(modes)
    )


def _driven(system: Hamiltonian, modes: Modes, on: Sequence[str], mu: Expr) -> Expr:
    """Return z' (nz, 1) on an arc with the inputs as symbols."""
    return casadi.substitute(_moved(system, on, mu), system.u, _controls(system, modes))


def _moved(system: Hamiltonian, on: Sequence[str], mu: Expr) -> Expr:
    """Return z' (nz, 1) with all controls as symbols, and multipliers mu of constraints."""
    slopes = -casadi.gradient(system.value, system.x)
    for k, name in enumerate(on):
        slopes -= mu[k] * casadi.gradient(system.constraints[name], system.x)
    cost = [system.running] if system.costs else []
    return casadi.vertcat(system.rate, slopes, *cost, 1)


def _chain(z: Expr, given: Expr, v: Expr, row: Expr, own: Expr) -> tuple[list[Expr], Expr, Expr]:
    """Return (what vanishes, A, M) of a row: its derivatives up to the one, A + M v, with inputs.

    The first derivative of a switching function does not hold its own control: the bracket of a
    function with itself is zero, whether or not its terms cancel as they are written.
    """
    vanishing = [row]
    for k in range(DEEPEST):
        top = casadi.jtimes(vanishing[-1], z, given)
        slopes = [casadi.simplify(casadi.jacobian(top, each)) for each in casadi.vertsplit(v)]
        if k == 0 and own is not None:
            slopes = [
                casadi.SX(0) if own.is_symbolic() and each.name() == own.name() else slope
                for each, slope in zip(casadi.vertsplit(v), slopes, strict=True)
            ]
        rest = casadi.simplify(casadi.substitute(top, v, casadi.SX.zeros(v.numel(), 1)))
        if not all(slope.is_zero() for slope in slopes):
            return vanishing, rest, casadi.horzcat(*slopes)
        vanishing.append(rest)
    raise SolveError(f"no input appears in {DEEPEST} derivatives of what vanishes on an arc")


def is_zero(expression: Expr) -> bool:
    """Tell whether an expression is zero as it is written."""
    return bool(casadi.simplify(casadi.sparsify(casadi.SX(expression))).nnz() == 0)


def fixed(box: np.ndarray) -> np.ndarray:
    """Tell which values of a box (2, n) are fixed by it."""
    found: np.ndarray = box[0] == box[1]
    return found
