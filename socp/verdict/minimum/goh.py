"""Whether an extremal with singular arcs is a minimum: its second variation with the singular
control free, after Goh's transformation, as a matrix that has to settle under refinement.

Unknowns are the initial time, the lengths, parameters and initial states of the word, the
primitive w of the singular control's variation, a polynomial on every interval, and its values h
where it ends. A switch between a bang and a singular arc is no unknown of its own: moving it is a
change of w up to higher order, and would make any form degenerate.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import casadi
import numpy as np

from socp.errors import MethodError
from socp.model import TINY, Curvature, Mode, Problem, Word, mayer_function, once, parameters_of
from socp.transcription import Phase, Shooting, follow
from socp.verdict.minimum.induced import WEAK, Induced, Pair
from socp.verdict.minimum.variation import Quadratic, reference, singular_places

_NODES = 5  # Gauss points of a piece: the motion to order 10, and w of degree 4
_PIECES = (1, 2, 4)  # of every interval of the mesh: each matrix contains the one before it
# Steps of the least eigenvalue from one refinement to the next: a geometric series of this ratio
# bounds what is left, and a step this small against the eigenvalue is none
_FALLING, _SETTLED = 0.75, 1e-6
# Of the magnitudes: as far may w's own terms be apart where another control switches
_CONTINUES = 1e-6
# Of the largest entries: a value of w with none larger neither costs nor moves anything
_IDLE = 1e-9
_RANK = 1e-10  # of the largest singular value of the conditions: a smaller one is rounding


def singular_curvature(problem: Problem, pair: Pair) -> tuple[Curvature | None, str]:
    """Return the curvature of the second variation with the singular control free, None where it
    was not found, and the reason or what it leaves out.
    """
    quadratics = _quadratics(problem, pair)
    if isinstance(quadratics, str):
        return None, quadratics
    least: list[float] = []
    for pieces in _PIECES:
        form = _Form(problem, pair.coarse, quadratics, pieces)
        if form.fault:
            return None, form.fault
        values, idle = form.eigenvalues
        if not values.size:
            return Curvature(least=np.inf, error=0.0, free=0), ""
        least.append(float(values[0]))
        if len(least) > 1 and abs(least[-1] - least[-2]) <= _SETTLED * abs(least[-1]):
            break
    found = _settled(least, values.size)
    if found is None:
        return None, "the least eigenvalue does not settle under refinement"
    return found, "an impulse where a singular arc ends costs nothing" if idle else ""


def _quadratics(problem: Problem, pair: Pair) -> tuple[Quadratic, ...] | str:
    """Return the coefficients of every phase, or the reason why there are none."""
    shooting = pair.coarse.conditions.shooting
    places = singular_places(shooting)
    if any(len(each) > 1 for each in places):
        return "several controls are singular at once"
    if any(count > 1 for count in pair.pieces):
        return "the dynamics have a kink on the way"
    try:
        phases = _freed(problem, shooting)
    except MethodError as error:
        return f"no law beside the free singular control: {error}"
    if any(phase.carried.numel() for phase in phases):
        return "a law beside the singular control needs the costate"
    return tuple(
        Quadratic(problem, phase, place[0] if place else None)
        for phase, place in zip(phases, places, strict=True)
    )


def _settled(least: list[float], free: int) -> Curvature | None:
    """Return the limit of least eigenvalues under refinement, with what may be left to it.

    Spaces contain one another, so that the eigenvalues fall; where w concentrates at the least of R
    they fall to it by a power of the length of the pieces.
    """
    steps = np.abs(np.diff(least))
    if steps[-1] > _SETTLED * abs(least[-1]) and not steps[-1] <= _FALLING * steps[0]:
        return None
    return Curvature(least=least[-1], error=float(steps[-1] / (1.0 - _FALLING)), free=free)


def _freed(problem: Problem, shooting: Shooting) -> list[Phase]:
    """Return the phases of a word with its singular controls free."""
    arcs = tuple(
        tuple(Mode("free") if mode.kind == "singular" else mode for mode in phase.modes)
        for phase in shooting.phased.phases
    )
    return list(follow(problem, Word(problem.control_names, arcs)).phases)


@final
@dataclass(frozen=True, eq=False)
class _Form:
    """The quadratic form with so many pieces an interval; columns are scaled to norm 1: times by
    the horizon, w by the width of the control's box times the horizon.
    """

    problem: Problem
    known: Induced
    quadratics: tuple[Quadratic, ...]
    pieces: int

    @property
    def shooting(self) -> Shooting:
        """The shooting equations that it belongs to."""
        return self.known.conditions.shooting

    @cached_property
    def places(self) -> list[int | None]:
        """Of every phase the place of its singular control."""
        return [each.free for each in self.quadratics]

    @cached_property
    def ends(self) -> list[bool]:
        """Of every phase whether a singular control's w ends with it."""
        following = [*self.places[1:], None]
        return [
            here is not None and here != there
            for here, there in zip(self.places, following, strict=True)
        ]

    @cached_property
    def base(self) -> np.ndarray:
        """Sizes of the variables of the word: initial time, lengths, parameters, initial states."""
        first = 1 + len(self.quadratics) + self.problem.p.numel()
        return self.known.conditions.size[: first + self.problem.x.numel()]

    @cached_property
    def columns(self) -> tuple[list[int], int]:
        """Of every phase the first column of its w, which its h follows, and the number of all."""
        at, first = self.base.size, []
        for (_, arc), place, ends in zip(self.shooting.pairs, self.places, self.ends, strict=True):
            first.append(at)
            count = _NODES * (arc.mesh.size - 1) * self.pieces
            at += (count if place is not None else 0) + int(ends)
        return first, at

    def at(self, k: int, nodes: np.ndarray) -> dict[str, np.ndarray]:
        """Return the coefficients of phase k at nodes (s,) of every interval of its mesh."""
        p = parameters_of(self.problem, self.shooting.solution)
        return self.quadratics[k].at(reference(self.known, k, nodes), p)

    def unit(self, k: int) -> float:
        """Return what w of phase k is measured in."""
        place = self.places[k]
        horizon = float(self.known.at[1 : 1 + len(self.quadratics)].sum())
        width = 0.0 if place is None else float(np.diff(self.problem.box[:, place])[0])
        return width * horizon

    @cached_property
    def laid(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
        """The form of the motion (k, k), the change of the shooting variables (n, k), times that
        stay (j, k), and why it is none.
        """
        nx, count = self.problem.x.numel(), len(self.quadratics)
        form = np.zeros((self.columns[1],) * 2)
        changed = np.zeros((self.known.at.size, form.shape[0]))
        inner = np.arange(1 + count + self.problem.p.numel())
        changed[inner, inner] = self.base[inner]
        y = np.zeros((nx + 2 + self.problem.p.numel(), form.shape[0]))
        y[:nx, inner.size : self.base.size] = np.diag(self.base[inner.size :])
        y[nx, 0] = self.base[0]
        y[nx + 2 :, 1 + count : inner.size] = np.diag(self.base[1 + count : inner.size])
        fixed, place, fault = [], inner.size, ""
        for k, (phase, arc) in enumerate(self.shooting.pairs):
            rows = nx + phase.carried.numel()
            y[nx + 1] = 0.0
            y[nx + 1, 1 + k] = self.base[1 + k] / self.known.at[1 + k]
            changed[place : place + nx] = y[:nx]
            y = self._through(k, y, form)
            place += rows * arc.mesh.size
            changed[place - rows : place - rows + nx] = y[:nx]
            if k + 1 < count and self.places[k] != self.places[k + 1]:
                fixed.append(y[nx] / self.base[0])
            elif k + 1 < count and self.places[k] is not None:
                fault = fault or (self._torn(k, place) if self.pieces == _PIECES[0] else "")
        return form, changed, np.reshape(fixed, (len(fixed), form.shape[0])), fault

    def _through(self, k: int, y: np.ndarray, form: np.ndarray) -> np.ndarray:
        """Carry changes y (ny, k) through a phase and add what it costs to the form."""
        nodes, weights, A = gauss(_NODES)
        arc, column, unit = self.shooting.pairs[k][1], self.columns[0][k], self.unit(k)
        steps = np.diff(_corners(self.known, k, arc.mesh.size - 1, self.pieces))
        inside = (np.arange(self.pieces)[:, None] + nodes) / self.pieces
        at, horizon = self.at(k, inside.ravel()), float(self.base[0])
        for j, step in enumerate(steps):
            here = {name: e[j * _NODES : (j + 1) * _NODES] for name, e in at.items()}
            measure, driven = step * weights, np.zeros((_NODES, *y.shape))
            own = column + j * _NODES + np.arange(_NODES)
            size = unit * np.sqrt(horizon / measure)
            if "B1" in here:
                driven[np.arange(_NODES), :, own] = here["B1"][:, :, 0] * size[:, None]
            xi, y = _stages(here["A"], driven, y, (step, weights, A))
            bent = measure[:, None, None] * (here["Q"] @ xi)
            form += xi.reshape(-1, y.shape[1]).T @ bent.reshape(-1, y.shape[1])
            if "B1" in here:
                mixed = (measure * size)[:, None] * (here["M"] @ xi)[:, 0]
                form[own] += mixed
                form[:, own] += mixed.T
                form[own, own] += measure * size**2 * here["R"][:, 0, 0]
        return self._ended(k, y, form) if self.ends[k] else y

    def _ended(self, k: int, y: np.ndarray, form: np.ndarray) -> np.ndarray:
        """Add what the value h of w costs where it ends, and put it into the states."""
        at = {name: each[-1:] for name, each in self.at(k, np.ones(1)).items()}
        h = np.zeros(y.shape[1])
        h[[*self.columns[0][1:], self.columns[1]][k] - 1] = self.unit(k)
        mixed = np.outer(h, at["N"][0, 0] @ y)
        form += mixed + mixed.T + at["NB"][0, 0, 0] * np.outer(h, h)
        return np.array(y + at["B"][0] * h)

    def _torn(self, k: int, place: int) -> str:
        """Return why w cannot go on where another control switches at the end of phase k."""
        after = {name: each[:1] for name, each in self.at(k + 1, np.zeros(1)).items()}
        ends = {name: each[-1:] for name, each in self.at(k, np.ones(1)).items()}, after
        nx = self.problem.x.numel()
        for name in ("B", "N", "NB"):
            one, other = (each[name][0] for each in ends)
            size = max(float(np.abs(one).max()), float(np.abs(other).max()), 1.0)
            if np.abs(one - other).max() > _CONTINUES * size:
                return "the singular control's terms jump where another control switches"
        _, chain = self.shooting.chain
        rows = nx + self.shooting.phased.phases[k].carried.numel()
        held = np.vstack(
            [
                np.delete(self.known.slopes[:, at : at + nx], chain, axis=0)
                for at in (place - rows, place)
            ]
        )
        moved = np.abs(held @ ends[0]["B"][0][:nx])
        if (moved > _CONTINUES * np.maximum(np.abs(held).sum(axis=1)[:, None], 1.0)).any():
            return "the singular control moves what a constraint holds where an arc along it begins"
        return ""

    @property
    def fault(self) -> str:
        """Why there is no such form; empty if there is."""
        return self.laid[3]

    @cached_property
    def eigenvalues(self) -> tuple[np.ndarray, bool]:
        """Eigenvalues of the form on the directions that keep the conditions, ascending, and
        whether a value h that costs nothing and moves no condition was left out.
        """
        form, changed, fixed, _ = self.laid
        slopes = self.known.slopes
        _, chain = self.shooting.chain
        others = np.setdiff1d(np.arange(len(slopes)), chain)
        others = others[~(slopes[np.ix_(others, self._carried)] != 0).any(axis=1)]
        form = form + changed.T @ _at_ends(self.known, tuple(others.tolist())) @ changed
        others = others[(self.shooting.signs[others] == 0) | ~self._weak(others)]
        rows = np.vstack([slopes[others] @ changed, fixed])
        rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), TINY)
        idle = [h for h in self._values if not self._felt(h, form, rows)]
        form, rows = (np.delete(each, idle, axis=1) for each in (form, rows))
        form = np.delete(form, idle, axis=0)
        _, values, right = np.linalg.svd(rows)
        kernel = right[int((values > _RANK * values.max(initial=TINY)).sum()) :].T
        reduced = kernel.T @ form @ kernel
        return np.linalg.eigvalsh(0.5 * (reduced + reduced.T)), bool(idle)

    @property
    def _values(self) -> list[int]:
        """Columns of the values h."""
        first = [*self.columns[0][1:], self.columns[1]]
        return [after - 1 for after, ends in zip(first, self.ends, strict=True) if ends]

    @staticmethod
    def _felt(h: int, form: np.ndarray, rows: np.ndarray) -> bool:
        size = np.abs(np.diag(form)).max(initial=TINY)
        return bool(
            np.abs(form[h]).max() > _IDLE * size or np.abs(rows[:, h]).max(initial=0.0) > _IDLE
        )

    def _weak(self, others: np.ndarray) -> np.ndarray:
        held = np.abs(self.known.held)
        return np.array(held[others] <= WEAK * held.max(initial=0.0))

    @cached_property
    def _carried(self) -> np.ndarray:
        """Places of what phases carry beside the states."""
        nx, found = self.problem.x.numel(), []
        at = 1 + len(self.quadratics) + self.problem.p.numel()
        for phase, arc in self.shooting.pairs:
            rows = nx + phase.carried.numel()
            block = at + np.arange(rows * arc.mesh.size).reshape(-1, rows)
            found.append(block[:, nx:].ravel())
            at += block.size
        return np.concatenate(found).astype(int)


@once
def _at_ends(known: Induced, others: tuple[int, ...]) -> np.ndarray:
    """Return the Hessian (n, n) of what the Lagrangian has at the ends and where phases begin, of
    the equations there that are among `others`.
    """
    shooting = known.conditions.shooting
    problem, (t0, lengths, p, z) = shooting.phased.of, shooting.parts
    nx = problem.x.numel()
    ends = [z[-1][:nx, -1], z[0][:nx, 0], p, t0, t0 + casadi.sum1(lengths)]
    lagrangian = mayer_function(problem)(*ends)
    rows = casadi.vertcat(*shooting.held, *(row.expression for row in shooting.ends))
    places = np.setdiff1d(np.arange(known.held.size), shooting.chain[1])
    held = np.where(np.isin(places, others), known.held[places], 0.0)
    lagrangian += casadi.dot(casadi.DM(held), rows)
    hessian = casadi.hessian(lagrangian, shooting.w)[0]
    found: np.ndarray = casadi.Function("ends", [shooting.w], [hessian])(known.at).full()
    return found


def _corners(known: Induced, k: int, count: int, pieces: int) -> np.ndarray:
    """Return the corners (m + 1,) of the pieces of phase k in time."""
    arc = known.conditions.shooting.pairs[k][1]
    shares = (arc.t[arc.mesh] - arc.t[0]) / (arc.t[-1] - arc.t[0])
    places = np.interp(np.arange(count * pieces + 1) / pieces, np.arange(count + 1), shares)
    corners: np.ndarray = known.at[: 1 + k].sum() + known.at[1 + k] * places
    return corners


def _stages(
    A: np.ndarray, driven: np.ndarray, y: np.ndarray, rule: tuple[float, np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return solutions of xi' = A xi + driven at the Gauss points (s, ny, k) and at the end
    (ny, k), from y (ny, k); `rule` is the step with weights (s,) and matrix (s, s).
    """
    step, weights, matrix = rule
    count, ny = A.shape[:2]
    left = np.eye(count * ny) - step * np.einsum("ij,jab->iajb", matrix, A).reshape(count * ny, -1)
    right = y[None] + step * np.einsum("ij,jak->iak", matrix, driven)
    inside = np.linalg.solve(left, right.reshape(count * ny, -1)).reshape(right.shape)
    slopes = np.einsum("jab,jbk->jak", A, inside) + driven
    return inside, y + step * np.einsum("j,jak->ak", weights, slopes)


def gauss(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return nodes (s,), weights (s,) and matrix (s, s) of the Gauss method on [0, 1] (Hairer,
    Norsett, Wanner, Solving ODEs I, II.7).
    """
    nodes, weights = np.polynomial.legendre.leggauss(count)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    powers = np.vander(nodes, count, increasing=True)
    integrals = nodes[:, None] * powers / np.arange(1, count + 1)
    return nodes, weights, np.linalg.solve(powers.T, integrals.T).T
