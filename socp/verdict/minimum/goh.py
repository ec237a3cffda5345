"""Whether an extremal with singular arcs is a minimum: its second variation with the singular
controls free, after Goh's transformation, as a matrix that has to settle under refinement.
"""

from dataclasses import replace

import casadi
import numpy as np

from socp.errors import MethodError
from socp.laws import tower
from socp.model import (
    TINY,
    Curvature,
    Mode,
    Problem,
    Word,
    column,
)
from socp.transcription import Phase, Shooting, follow
from socp.verdict.minimum.form import Form
from socp.verdict.minimum.induced import CLEAR, Pair
from socp.verdict.minimum.variation import Quadratic, quadratic, singular_places

# Steps of the least eigenvalue from one refinement to the next: a geometric series of this ratio
# bounds what is left, and a step this small against the eigenvalue is none
_FALLING, _SETTLED = 0.75, 1e-6
# Of the magnitudes: as far may w's own terms be apart where another control switches, and N B be
# from symmetric
_CONTINUES = 1e-6
_RANK = 1e-10  # of the largest singular value of the conditions: a smaller one is rounding


def singular_curvature(problem: Problem, pair: Pair) -> tuple[Curvature | None, str]:
    """Return the curvature of the second variation with the singular control free, None where it
    was not found, and the reason or what it leaves out.
    """
    quadratics = _quadratics(problem, pair)
    if isinstance(quadratics, str):
        return None, quadratics
    form = Form(problem, pair.fine, quadratics)
    if broken := _asymmetric(form):  # v may be as large as one likes for the same w
        why = f"Goh's condition does not hold on arc {broken[0] + 1}"
        return Curvature(least=-np.inf, error=0.0, free=form.free), why
    faults = (_torn(form, k) for k in range(len(form.places) - 1))
    if fault := next((fault for fault in faults if fault), ""):
        return None, fault
    found = _settled(form)
    if isinstance(found, str):
        return None, found
    idle = form.idle and found.free
    return found, "an impulse where a singular arc ends costs nothing" if idle else ""


def _quadratics(problem: Problem, pair: Pair) -> dict[int, Quadratic] | str:
    """Return the coefficients by phase with singular controls, or the reason why there are none."""
    shooting = pair.fine.conditions.shooting
    if any(count > 1 for count in pair.pieces):
        return "the dynamics have a kink on the way"
    try:
        phases = _freed(problem, shooting)
    except MethodError as error:
        return f"no law beside the free singular control: {error}"
    if any(phase.carried.numel() for phase, _ in phases.values()):
        return "a law beside the singular control needs the costate"
    return {k: quadratic(problem, *each) for k, each in phases.items()}


def _settled(form: Form) -> Curvature | str:
    """Return the limit of least eigenvalues under refinement, with what may be left to it, or why
    there is none.

    Spaces contain one another, so that the eigenvalues fall; where w concentrates at the least of R
    they fall to it by a power of the length of the pieces. What the quadrature leaves is the same
    for all of them: another one of the first form tells, no eigenvalue of which is further away
    than the norm of what sets both apart (Weyl). Where that is not small neither is to be believed.
    """
    least: list[float] = []
    for matrix, rows in form.refined:
        values = _eigenvalues(matrix, rows)
        if not values.size:
            return Curvature(least=np.inf, error=0.0, free=0)
        least.append(float(values[0]))
        if len(least) > 1 and abs(least[-1] - least[-2]) <= _SETTLED * abs(least[-1]):
            break
    steps = np.abs(np.diff(least))
    if steps[-1] > _SETTLED * abs(least[-1]) and not steps[-1] <= _FALLING * steps[0]:
        return "the least eigenvalue does not settle under refinement"
    apart = CLEAR * _between(form.refined[0], form.again)
    if not apart < abs(least[-1]):
        return "the least eigenvalue does not settle under another quadrature"
    error = max(float(steps[-1]) / (1.0 - _FALLING), _SETTLED * abs(least[-1])) + apart
    return Curvature(least=least[-1], error=error, free=values.size)


def _freed(problem: Problem, shooting: Shooting) -> dict[int, tuple[Phase, tuple[int, ...]]]:
    """Return, by phase with singular controls, that phase with these free, and their places."""
    phases, places = shooting.phased.phases, singular_places(shooting)
    own = [k for k, here in enumerate(places) if here]
    if all(_apart(problem, phase) for phase in phases):
        singular = sorted({place for each in places for place in each})
        return {k: _left(problem, phases[k], singular) for k in own}
    arcs = tuple(
        tuple(Mode("free") if mode.kind == "singular" else mode for mode in phase.modes)
        for phase in phases
    )
    free = follow(problem, Word(problem.control_names, arcs)).phases
    return {k: (free[k], places[k]) for k in own}


def _apart(problem: Problem, phase: Phase) -> bool:
    """Tell whether the law along the state constraints of an arc stays what it is when its singular
    controls are let go: these do not act where the arc's own control does.
    """
    for i, mode in enumerate(phase.modes):
        if mode.kind == "boundary":
            (constraint,) = (e for e in problem.constraints if e.name == mode.constraint)
            _, top = tower(problem, constraint)
            free = column(problem.u[j] for j, e in enumerate(phase.modes) if e.kind == "singular")
            if not casadi.depends_on(top, problem.u[i]) or casadi.depends_on(top, free):
                return False
    return True


def _left(problem: Problem, phase: Phase, singular: list[int]) -> tuple[Phase, tuple[int, ...]]:
    """Return a phase with the controls free that are `singular` anywhere and follow no constraint
    on it, and their places. Those at bounds may have any value: one law serves all such arcs.
    """
    u, held = casadi.vertsplit(problem.u), [mode.kind == "boundary" for mode in phase.modes]
    own = (phase.control[i] if held[i] else u[i] for i in range(len(u)))
    modes = (e if fixed else Mode("free") for e, fixed in zip(phase.modes, held, strict=True))
    places = tuple(i for i in singular if not held[i])
    nothing = column(())
    found = replace(
        phase,
        modes=tuple(modes),
        control=column(own),
        free=column(u[i] for i in places),
        carried=nothing,
        carried_rate=nothing,
    )
    return found, places


def _eigenvalues(form: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the eigenvalues of a form (k, k), ascending, on the directions that `rows` (r, k) let
    be.
    """
    fixed = _fixed(rows)
    # the others are moved to the end of the spectrum
    kept = _projected(form, fixed, np.abs(form).sum(axis=1).max(initial=0.0))
    return np.linalg.eigvalsh(kept)[: len(kept) - len(fixed)]


def _fixed(rows: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (f, k) of the directions that `rows` (r, k) fix."""
    _, values, right = np.linalg.svd(rows, full_matrices=False)
    return np.array(right[values > _RANK * values.max(initial=TINY)])


def _projected(form: np.ndarray, fixed: np.ndarray, there: float = 0.0) -> np.ndarray:
    """Return a form (k, k) without the directions `fixed` (f, k), where all its eigenvalues are
    those `there`.
    """
    across = fixed @ form
    own = 0.5 * (across @ fixed.T + there * np.eye(len(fixed)))
    taken = fixed.T @ (across - own @ fixed)
    kept = form - taken - taken.T
    return np.array(0.5 * (kept + kept.T))


def _between(*forms: tuple[np.ndarray, np.ndarray]) -> float:
    """Return how far apart two forms are on what their conditions let be: inf where these leave not
    as many directions.
    """
    one, other = (_fixed(rows) for _, rows in forms)
    kept = [_projected(form, each) for (form, _), each in zip(forms, (one, other), strict=True)]
    return float(np.linalg.norm(kept[0] - kept[1], 2)) if len(one) == len(other) else np.inf


def _asymmetric(form: Form) -> list[int]:
    """Return the phases where several singular controls break Goh's condition, N B symmetric."""
    found = []
    for k in (k for k, places in enumerate(form.places) if len(places) > 1):
        at = form.along[k]
        size = np.maximum((np.abs(at["N"]) @ np.abs(at["B"])).max(axis=(2, 3)), TINY)
        off = np.abs(at["NB"] - at["NB"].swapaxes(2, 3)).max(axis=(2, 3))
        found += [k] if (off > _CONTINUES * size).any() else []
    return found


def _torn(form: Form, k: int) -> str:
    """Return why there is no form across the end of phase k, empty if there is one."""
    before, after = form.places[k], form.places[k + 1]
    going = [each for each in before if each in after]
    one, other = (phase.modes for phase in form.shooting.phased.phases[k : k + 2])
    moved = {i for i, modes in enumerate(zip(one, other, strict=True)) if modes[0] != modes[1]}
    if before != after and moved - (set(before) ^ set(after)):
        return "another control switches where a singular arc begins or ends"
    if not going:
        return ""
    ends = form.at_end(k, -1), form.at_end(k + 1, 0)
    terms = [
        _terms(at, [places.index(each) for each in going])
        for at, places in zip(ends, (before, after), strict=True)
    ]
    for left, right in zip(*terms, strict=True):
        size = max(float(np.abs(left).max()), float(np.abs(right).max()), 1.0)
        if np.abs(left - right).max() > _CONTINUES * size:
            return "the singular control's terms jump where another control switches"
    return _held(form, k, terms[0][0])


def _held(form: Form, k: int, driven: np.ndarray) -> str:
    """Return why w cannot go on where it moves, by B (ny, m), what has to hold between phases.

    Changes of the states before and after are those of y = xi + B w, where w has no value.
    """
    nx, blocks = form.problem.x.numel(), form.shooting.blocks
    sides = blocks[k].variables[-1, :nx], blocks[k + 1].variables[0, :nx]
    slopes = np.delete(form.known.slopes, form.shooting.chain[1], axis=0)
    held = np.vstack([slopes[:, at] for at in sides])
    moved = np.abs(held @ driven[:nx])
    if (moved > _CONTINUES * np.maximum(np.abs(held).sum(axis=1)[:, None], 1.0)).any():
        return "the singular control moves what a constraint holds where an arc along it begins"
    return ""


def _terms(at: dict[str, np.ndarray], which: list[int]) -> list[np.ndarray]:
    """Return B, N and N B of some of the singular controls."""
    return [at["B"][:, which], at["N"][which], at["NB"][np.ix_(which, which)]]
