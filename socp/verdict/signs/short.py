"""The sign of a switching function on a stretch so short that its values drown in what the
conditions leave.

Where a bang stretch meets a switch, sigma is zero there, and next to a singular arc of order q so
are its derivatives up to that of order 2 q - 1. On the stretch it is then Taylor's polynomial of
those that follow, with the last one at a time in between (Lagrange's remainder). They come from
brackets, with all their digits, however short the stretch is.
"""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from math import factorial
from typing import final

import casadi
import numpy as np

from socp.errors import MethodError
from socp.laws import extremal_arc
from socp.model import LAWS, Modes, Place, Problem, evaluate, of_motion, once, time
from socp.process import time_limit
from socp.verdict.adjoint import AdjointSystem

# Derivatives beyond those that vanish at a switch: one more may do so at the other end, as where
# that is a switch too, or the motion starts from rest
_BEYOND = 2
_LOOKS = 20  # points of a stretch at which a sign is asked


@final
@dataclass(frozen=True, eq=False)
class Short:
    """A judged solution as the signs on its short stretches are asked of it.

    costate (nx, n) at the judge's nodes; size: the Hamiltonian's magnitude; level: states and
    costates count as known up to it, times the states' own magnitude and the Hamiltonian's over
    that of the rates.
    """

    along: AdjointSystem
    costate: np.ndarray
    size: float
    level: float

    def told(self, places: Iterable[Place]) -> list[Place]:
        """Return those bang stretches on which the switching function has the right sign: from one
        of their ends it is known to have it, and from none to have the wrong one.
        """
        found = []
        for place in places:
            with suppress(MethodError), time_limit(LAWS):
                signs = list(self._signs(place))
                if signs and max(signs) > 0 and min(signs) >= 0:
                    found.append(place)
        return found

    def _signs(self, place: Place) -> Iterator[int]:
        """Yield for both ends of a stretch 1 where sigma is known from there to have the right
        sign, 0 where that is not known, -1 where it is known to have the wrong one somewhere, or
        not to be at the other end what it has to be: zero at a switch, or what is known of it.
        """
        name = str(place.control)
        mode, start, end = self.along.solution.structure[name][(place.stretch or 1) - 1]
        own = self._arc(start, end)
        if own is None:
            return
        i, right = self.along.problem.control_names.index(name), 1.0 if mode == "-" else -1.0
        zeros = [self._zeros(i, own, beside) for beside in (own - 1, own + 1)]
        for node, here, there in ((0, *zeros), (-1, *reversed(zeros))):
            if not here:
                continue
            known = self._taylor(i, own, node, here)
            ends = [known(np.ones(1), order) for order in range(there)] if known else []
            met = self._final(i, own) if node == 0 else None
            if known and met is not None:
                low, high = known(np.ones(1), 0)
                ends.append((low - met, high - met))
            if any(low[0] > 0.0 or high[0] < 0.0 for low, high in ends):
                yield -1
            elif known:
                low, high = known(np.linspace(0.0, 1.0, _LOOKS + 1)[1:-1], 0)
                wrong = high.min() < 0.0 if right > 0.0 else low.max() > 0.0
                clear = low.max() > 0.0 if right > 0.0 else high.min() < 0.0
                yield -1 if wrong else int(clear)

    def _arc(self, start: float, end: float) -> int | None:
        """Return the index of the arc that is a stretch, None where there are several, its modes
        are not all known, or the costates or the problem's functions jump in between.
        """
        along, samples = self.along, self.along.samples
        own = [
            k for k, arc in enumerate(along.solution.arcs) if start < arc.t[-1] and arc.t[0] < end
        ]
        inner = samples.edges[(samples.edges > start) & (samples.edges < end)]
        broken = samples.on_knot(inner).any() or np.isin(inner, self._jumps).any()
        lawful = len(own) == 1 and along.solution.arcs[own[0]].lawful
        whole = not broken and lawful and bool((samples.arc == own[0]).any())
        return own[0] if whole else None

    @cached_property
    def _jumps(self) -> np.ndarray:
        """Times at which the costates jump."""
        joints = [joint for _, joint in self.along.unknowns.jumps]
        return np.array(self.along.samples.edges[joints])

    def _final(self, i: int, own: int) -> float | None:
        """Return sigma_i at the final time where an arc ends there and the conditions tell it
        whatever their multipliers are, as where the states that the control moves are free.
        """
        (offset, matrix), last = self.along.sigma, len(self.along.solution.arcs) - 1
        return float(offset[i, -1]) if own == last and not matrix[i, -1].any() else None

    def _zeros(self, i: int, own: int, beside: int) -> int:
        """Return how many derivatives of sigma_i, itself among them, vanish where an arc meets the
        one beside it: none at the ends of the horizon and at knots, all that do on a singular arc
        where nothing but this control changes.
        """
        problem, arcs = self.along.problem, self.along.solution.arcs
        if not 0 <= beside < len(arcs):
            return 0
        at = arcs[max(own, beside)].t[:1]
        if self.along.samples.on_knot(at)[0]:
            return 0
        here, there = arcs[own].modes, arcs[beside].modes
        alone = all(a == b for j, (a, b) in enumerate(zip(here, there, strict=True)) if j != i)
        if there[i].kind != "singular" or not alone or np.isin(at, self._jumps)[0]:
            return 1
        return 2 * extremal_arc(problem, there).orders[problem.control_names[i]]

    def _taylor(self, i: int, own: int, node: int, zeros: int) -> "_Taylor | None":
        """Return the polynomial of sigma_i at one end of an arc, of which it is zero with all its
        derivatives below that of an order; None where a derivative jumps on the way.
        """
        along, samples = self.along, self.along.samples
        inside, last = samples.arc == own, zeros + _BEYOND
        function = _derivatives(along.problem, along.solution.arcs[own].modes, i, last)
        x, t = samples.x[:, inside], samples.t[inside]
        values, slopes = evaluate(function, x, self.costate[:, inside], t, samples.p)
        slopes = np.abs(slopes.reshape(last + 1, t.size, -1)[:, node])
        off = self.level * slopes @ np.concatenate([along.scale, self._sizes])
        most = np.ptp(t) * np.abs(values[1:]).max(axis=1) + off[:-1]
        if (np.ptp(values[:-1], axis=1) > most).any():  # as where a rate has a kink
            return None
        low, high = values[:, node] - off, values[:, node] + off
        low[last], high[last] = values[last].min() - off[last], values[last].max() + off[last]
        low[:zeros] = high[:zeros] = 0.0
        return _Taylor(low, high, float(t[0] + t[-1] - 2.0 * t[node]))

    @cached_property
    def _sizes(self) -> np.ndarray:
        """Magnitudes of the costates (nx,)."""
        along = self.along
        rates = np.abs(along.samples.values["f"]).max(axis=1)
        return np.array(self.size / np.maximum(rates, along.scale / along.horizon))


@final
@dataclass(frozen=True, eq=False)
class _Taylor:
    """Bounds `low` and `high` (n,) of a function's derivatives at an end of a stretch, those of the
    last one all along it; `length` of the stretch, negative where it ends there.
    """

    low: np.ndarray
    high: np.ndarray
    length: float

    def __call__(self, shares: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
        """Return bounds (m,) of the derivative of an order at shares of the stretch (m,)."""
        tau = self.length * shares
        low, high = np.zeros(tau.size), np.zeros(tau.size)
        for k in range(order, self.low.size):
            ends = np.outer([self.low[k], self.high[k]], tau ** (k - order) / factorial(k - order))
            low, high = low + ends.min(axis=0), high + ends.max(axis=0)
        return low, high


@of_motion
@once
def _derivatives(problem: Problem, modes: Modes, i: int, last: int) -> casadi.Function:
    """Return (x, costate, t, p) -> sigma_i and its derivatives in time up to one of an order on an
    arc (last + 1,), and their slopes by states and costates (last + 1, 2 nx).

    Raises MethodError where the controls of the arc are not known.
    """
    law, x, costate = extremal_arc(problem, modes), problem.x, problem.costate
    rate = casadi.substitute(problem.rate, problem.u, law.control)
    rows = [casadi.substitute(problem.switching[i], problem.u, law.control)]
    for _ in range(last):
        row = casadi.jtimes(rows[-1], x, rate) + casadi.jtimes(rows[-1], costate, law.costate_rate)
        rows.append(row + casadi.jacobian(rows[-1], time))
    whole = casadi.vertcat(*rows)
    slopes = casadi.densify(casadi.jacobian(whole, casadi.vertcat(x, costate)))
    given = [x, costate, time, problem.p]
    return casadi.Function("derivatives", given, [casadi.densify(whole), slopes])
