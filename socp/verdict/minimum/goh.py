"""Whether an extremal with singular arcs is a minimum: its second variation with the singular
controls free, after Goh's transformation, as a matrix that has to settle under refinement.

Unknowns are the initial time, the lengths, parameters and initial states of the word, the
primitive w of every singular control's variation, a polynomial on every interval, and its values h
where it ends. A switch between a bang and a singular arc is no unknown of its own: moving it is a
change of w up to higher order, and would make any form degenerate. Where one control's w ends and
another's goes on, no term of both is left: N B is symmetric.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import casadi
import numpy as np

from socp.errors import MethodError
from socp.model import (
    TINY,
    Curvature,
    Mode,
    Problem,
    Word,
    mayer_function,
    numbers,
    once,
    parameters_of,
)
from socp.transcription import Phase, Shooting, follow
from socp.verdict.minimum.induced import WEAK, Induced, Pair
from socp.verdict.minimum.stages import gauss, stages
from socp.verdict.minimum.variation import Quadratic, quadratic, reference, singular_places

_NODES = 5  # Gauss points of a piece: the motion to order 10, and w of degree 4
_PIECES = (1, 2, 4)  # of every interval of the mesh: each matrix contains the one before it
# Steps of the least eigenvalue from one refinement to the next: a geometric series of this ratio
# bounds what is left, and a step this small against the eigenvalue is none
_FALLING, _SETTLED = 0.75, 1e-6
# Of the magnitudes: as far may w's own terms be apart where another control switches, and N B be
# from symmetric
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
        if form.asymmetric:  # v may be as large as one likes for the same w
            why = f"Goh's condition does not hold on arc {form.asymmetric[0] + 1}"
            return Curvature(least=-np.inf, error=0.0, free=form.columns[1]), why
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
    if any(count > 1 for count in pair.pieces):
        return "the dynamics have a kink on the way"
    try:
        phases = _freed(problem, shooting)
    except MethodError as error:
        return f"no law beside the free singular control: {error}"
    if any(phase.carried.numel() for phase in phases):
        return "a law beside the singular control needs the costate"
    return tuple(
        quadratic(problem, phase, place) for phase, place in zip(phases, places, strict=True)
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
    def places(self) -> list[tuple[int, ...]]:
        """Of every phase the places of its singular controls."""
        return [each.free for each in self.quadratics]

    @cached_property
    def ends(self) -> list[tuple[int, ...]]:
        """Of every phase the places of the controls whose w ends with it."""
        following = [*self.places[1:], ()]
        return [
            tuple(place for place in here if place not in there)
            for here, there in zip(self.places, following, strict=True)
        ]

    @cached_property
    def base(self) -> np.ndarray:
        """Sizes of the variables of the word: initial time, lengths, parameters, initial states."""
        first = 1 + len(self.quadratics) + self.problem.p.numel()
        return self.known.conditions.size[: first + self.problem.x.numel()]

    @cached_property
    def columns(self) -> tuple[list[int], int]:
        """Of every phase the first column of its w, control by control, which its h follow, and
        the number of all.
        """
        at, first = self.base.size, []
        for k, (places, ends) in enumerate(zip(self.places, self.ends, strict=True)):
            first.append(at)
            at += self.count(k) * len(places) + len(ends)
        return first, at

    def count(self, k: int) -> int:
        """Return how many values of w phase k has, of every singular control."""
        arc = self.shooting.pairs[k][1]
        return _NODES * (int(arc.mesh.size) - 1) * self.pieces

    def at(self, k: int, nodes: np.ndarray) -> dict[str, np.ndarray]:
        """Return the coefficients of phase k at nodes (s,) of every interval of its mesh."""
        p = parameters_of(self.problem, self.shooting.solution)
        return self.quadratics[k].at(reference(self.known, k, nodes), p)

    @cached_property
    def units(self) -> np.ndarray:
        """What w of every control (nu,) is measured in."""
        horizon = self.known.at[1 : 1 + len(self.quadratics)].sum()
        return np.array(np.diff(self.problem.box, axis=0)[0] * horizon)

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
            if k + 1 < count and self.pieces == _PIECES[0]:
                fault = fault or self._torn(k, place)
        return form, changed, np.reshape(fixed, (len(fixed), form.shape[0])), fault

    def _through(self, k: int, y: np.ndarray, form: np.ndarray) -> np.ndarray:
        """Carry changes y (ny, k) through a phase and add what it costs to the form."""
        nodes, weights, A = gauss(_NODES)
        arc, count, places = self.shooting.pairs[k][1], self.count(k), self.places[k]
        first = self.columns[0][k] + count * np.arange(len(places))
        steps = np.diff(_corners(self.known, k, arc.mesh.size - 1, self.pieces))
        inside = (np.arange(self.pieces)[:, None] + nodes) / self.pieces
        at, horizon = self.at(k, inside.ravel()), float(self.base[0])
        for j, step in enumerate(steps):
            here = {name: e[j * _NODES : (j + 1) * _NODES] for name, e in at.items()}
            measure, driven = step * weights, np.zeros((_NODES, *y.shape))
            own = first[:, None] + j * _NODES + np.arange(_NODES)
            size = self.units[list(places), None] * np.sqrt(horizon / measure)
            for a, columns in enumerate(own):
                driven[np.arange(_NODES), :, columns] = here["B1"][:, :, a] * size[a][:, None]
            xi, y = stages(here["A"], driven, y, (step, weights, A))
            bent = measure[:, None, None] * (here["Q"] @ xi)
            form += xi.reshape(-1, y.shape[1]).T @ bent.reshape(-1, y.shape[1])
            for a, columns in enumerate(own):
                mixed = (measure * size[a])[:, None] * (here["M"] @ xi)[:, a]
                form[columns] += mixed
                form[:, columns] += mixed.T
                for b, others in enumerate(own):
                    form[columns, others] += measure * size[a] * size[b] * here["R"][:, a, b]
        return self._ended(k, y, form) if self.ends[k] else y

    def _ended(self, k: int, y: np.ndarray, form: np.ndarray) -> np.ndarray:
        """Add what values h of w cost where they end, and put them into the states."""
        at = {name: each[-1] for name, each in self.at(k, np.ones(1)).items()}
        which = [self.places[k].index(place) for place in self.ends[k]]
        h = np.zeros((len(which), y.shape[1]))
        h[np.arange(len(which)), self._values[k]] = self.units[list(self.ends[k])]
        mixed = h.T @ at["N"][which] @ y
        form += mixed + mixed.T + h.T @ at["NB"][np.ix_(which, which)] @ h
        return np.array(y + at["B"][:, which] @ h)

    def _torn(self, k: int, place: int) -> str:
        """Return why there is no form across the end of phase k."""
        before, after = self.places[k], self.places[k + 1]
        going = [each for each in before if each in after]
        one, other = (phase.modes for phase in self.shooting.phased.phases[k : k + 2])
        moved = {i for i, modes in enumerate(zip(one, other, strict=True)) if modes[0] != modes[1]}
        if before != after and moved - (set(before) ^ set(after)):
            return "another control switches where a singular arc begins or ends"
        if not going:
            return ""
        ends = (
            {name: each[-1] for name, each in self.at(k, np.ones(1)).items()},
            {name: each[0] for name, each in self.at(k + 1, np.zeros(1)).items()},
        )
        terms = [
            _terms(at, [places.index(each) for each in going])
            for at, places in zip(ends, (before, after), strict=True)
        ]
        for left, right in zip(*terms, strict=True):
            size = max(float(np.abs(left).max()), float(np.abs(right).max()), 1.0)
            if np.abs(left - right).max() > _CONTINUES * size:
                return "the singular control's terms jump where another control switches"
        return self._held(k, place, terms[0][0])

    def _held(self, k: int, place: int, driven: np.ndarray) -> str:
        """Return why w cannot go on where it moves, by B (ny, m), what has to hold between phases.

        Changes of the states before and after are those of y = xi + B w, where w has no value.
        """
        nx = self.problem.x.numel()
        _, chain = self.shooting.chain
        rows = nx + self.shooting.phased.phases[k].carried.numel()
        held = np.vstack(
            [
                np.delete(self.known.slopes[:, at : at + nx], chain, axis=0)
                for at in (place - rows, place)
            ]
        )
        moved = np.abs(held @ driven[:nx])
        if (moved > _CONTINUES * np.maximum(np.abs(held).sum(axis=1)[:, None], 1.0)).any():
            return "the singular control moves what a constraint holds where an arc along it begins"
        return ""

    @property
    def fault(self) -> str:
        """Why there is no such form; empty if there is."""
        return self.laid[3]

    @property
    def asymmetric(self) -> list[int]:
        """The phases where several singular controls break Goh's condition, N B symmetric."""
        found = []
        for k in (k for k, places in enumerate(self.places) if len(places) > 1):
            at = self.at(k, np.linspace(0.0, 1.0, 3))
            size = np.maximum((np.abs(at["N"]) @ np.abs(at["B"])).max(axis=(1, 2)), TINY)
            off = np.abs(at["NB"] - at["NB"].transpose(0, 2, 1)).max(axis=(1, 2))
            found += [k] if (off > _CONTINUES * size).any() else []
        return found

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
        idle = [h for each in self._values for h in each if not self._felt(h, form, rows)]
        form, rows = (np.delete(each, idle, axis=1) for each in (form, rows))
        form = np.delete(form, idle, axis=0)
        _, values, right = np.linalg.svd(rows)
        kernel = right[int((values > _RANK * values.max(initial=TINY)).sum()) :].T
        reduced = kernel.T @ form @ kernel
        return np.linalg.eigvalsh(0.5 * (reduced + reduced.T)), bool(idle)

    @cached_property
    def _values(self) -> list[list[int]]:
        """Of every phase the columns of its values h."""
        after = [*self.columns[0][1:], self.columns[1]]
        return [
            list(range(first - len(ends), first))
            for first, ends in zip(after, self.ends, strict=True)
        ]

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


def _terms(at: dict[str, np.ndarray], which: list[int]) -> list[np.ndarray]:
    """Return B, N and N B of some of the singular controls."""
    return [at["B"][:, which], at["N"][which], at["NB"][np.ix_(which, which)]]


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
    rows = casadi.vertcat(*shooting.held, shooting.at_ends)
    places = np.setdiff1d(np.arange(known.held.size), shooting.chain[1])
    held = np.where(np.isin(places, others), known.held[places], 0.0)
    lagrangian += casadi.dot(casadi.DM(held), rows)
    hessian = casadi.hessian(lagrangian, shooting.w)[0]
    return numbers(casadi.Function("ends", [shooting.w], [hessian]), known.at)[0]


def _corners(known: Induced, k: int, count: int, pieces: int) -> np.ndarray:
    """Return the corners (m + 1,) of the pieces of phase k in time."""
    arc = known.conditions.shooting.pairs[k][1]
    shares = (arc.t[arc.mesh] - arc.t[0]) / (arc.t[-1] - arc.t[0])
    places = np.interp(np.arange(count * pieces + 1) / pieces, np.arange(count + 1), shares)
    corners: np.ndarray = known.at[: 1 + k].sum() + known.at[1 + k] * places
    return corners
