"""The second order of an extremal: which kind of minimum it is shown to be, by which theorem."""

import time
from dataclasses import replace
from functools import partial

import numpy as np

from socp.model import Curvature, Minimum, Problem, SecondOrder, Solution, lately
from socp.transcription import linear_tables, smooth
from socp.verdict.minimum.descent import descents
from socp.verdict.minimum.goh import singular_curvature
from socp.verdict.minimum.induced import Pair, induced
from socp.verdict.minimum.strictness import Switching, joint_switches, left_to_choose, met

# No assumption of these is that of a fixed horizon or of a problem without time: the second allows
# both ends, and time in the dynamics
BANG_BANG = (
    "Agrachev, Stefani, Zezza, SIAM J. Control Optim. 41(4), 2002; Maurer, Osmolovskii, SIAM J. "
    "Control Optim. 42(6), 2004"
)


def second_order(problem: Problem, solution: Solution, *, inside: bool = True) -> SecondOrder:
    """Return what the second order says of a certified, judged solution.

    The objective is a function of arc lengths, times, parameters and free initial states along a
    word. Where its second variation on the directions that the end conditions leave free is
    positive definite, the extremal is a strict local minimum among the controls of the word; where
    the theorems of bang-bang controls apply, a strict strong one. Where an eigenvalue is negative,
    a simulation has to show the lower objective before the extremal is called no minimum. `inside`:
    variations of a singular control itself are looked at too, on which no rung of the ladder
    depends.
    """
    # a search asks before it returns what is asked again in the end; another judge may have other
    # costates, and tell other signs from zero
    modes = tuple(arc.modes for arc in solution.arcs)
    rows = (solution.rows(name).tobytes() for name in ("x", "u", "costate"))
    values = solution.objective, solution.t.tobytes(), tuple(solution.parameters.items()), *rows
    told = None if solution.verdict is None else frozenset(solution.verdict.margins)
    make = partial(_tested, problem, solution, inside)
    return lately(problem, second_order, (modes, inside, told, *values), make)


def _tested(problem: Problem, solution: Solution, inside: bool) -> SecondOrder:
    with np.errstate(all="ignore"):
        try:
            return _second_order(problem, solution, inside)
        except (np.linalg.LinAlgError, ArithmeticError) as error:
            why = f"it could not be worked out: {error}"
            return SecondOrder(kind=Minimum.UNTESTED, limits=(why,))


def lower_sides(problem: Problem, solution: Solution) -> list[Solution]:
    """Return, for a certified solution that is no minimum, one of a lower objective on each side of
    it, as far as there are such: they keep the word and meet the conditions at the ends.
    """
    with np.errstate(all="ignore"):
        pair = induced(problem, solution)
        if isinstance(pair, SecondOrder):
            return []
        return [each.solution for each in descents(problem, solution, pair)]


def _second_order(problem: Problem, solution: Solution, inside: bool) -> SecondOrder:
    pair = induced(problem, solution)
    if isinstance(pair, SecondOrder):
        return pair
    enough = pair.curvature(weak=False)
    if enough.positive:
        return _minimum(problem, solution, (pair, enough), inside=inside)
    needed = pair.curvature(weak=True)
    if needed.negative:
        lower = next(descents(problem, solution, pair), None)
        if lower is not None:
            return SecondOrder(kind=Minimum.NONE, word=needed, descent=lower.descent)
    return SecondOrder(kind=Minimum.DEGENERATE, word=enough, limits=(_undecided(needed),))


def with_second_order(problem: Problem, solution: Solution, *, inside: bool = True) -> Solution:
    """Return a judged solution with what the second order says of it, where it is certified;
    `inside` as above.
    """
    verdict = solution.verdict
    if verdict is None or not verdict.extremal:
        return solution
    began = time.perf_counter()
    verdict = replace(verdict, second_order=second_order(problem, solution, inside=inside))
    seconds = {"second order": time.perf_counter() - began}
    return solution.with_judgement(verdict=verdict).spent(**seconds)


def _undecided(found: Curvature) -> str:
    if found.negative:
        return (
            "the second variation is negative somewhere, but no simulation shows a lower objective"
        )
    if not found.positive:
        return "the least eigenvalue of the second variation is zero within its error"
    return "multipliers of limits at the ends are zero, and without these limits it may not be one"


def _minimum(
    problem: Problem, solution: Solution, known: tuple[Pair, Curvature], *, inside: bool
) -> SecondOrder:
    """Return the claim for a word whose second variation is positive definite: a strict minimum,
    unless a control of it may be another without a change.
    """
    pair, found = known
    if places := left_to_choose(problem, solution):
        why = f"the principle leaves {'; '.join(places)} open: other controls do as well"
        return SecondOrder(kind=Minimum.DEGENERATE, word=found, limits=(why,))
    claim = SecondOrder(kind=Minimum.WORD, word=found)
    kinds = {mode.kind for arc in solution.arcs for mode in arc.modes}
    limits = [*_common(problem, solution, pair)]
    if kinds <= {"lower", "upper"}:
        strict = Switching(problem, solution).bang_conditions()
        limits += [what for what, margin in strict if not margin > 1.0]
        claim = replace(claim, margin=min(margin for _, margin in strict))
        if not limits:
            return replace(claim, kind=Minimum.STRONG, theorem=BANG_BANG)
    if "singular" in kinds and inside:
        curvature, why = singular_curvature(problem, pair)
        claim = replace(claim, singular=curvature)
        limits.append(_of_singular(curvature, why, "boundary" in kinds))
    if "boundary" in kinds:
        limits.append("no theorem is checked for arcs along a state constraint")
    return replace(claim, limits=tuple(limits))


def _of_singular(found: Curvature | None, why: str, beside: bool) -> str:
    """Return what is known of variations of the singular controls themselves, `beside` boundary
    arcs or not.
    """
    if found is None:
        return (
            f"variations of a singular control itself: the Legendre-Clebsch condition alone ({why})"
        )
    kept = ", boundary arcs kept," if beside else ""
    if found.negative:
        reason = f" ({why})" if why else ""
        return (
            f"with the singular control free{kept} the second variation is negative{reason}: "
            "controls that vary along the singular arc do better, to second order"
        )
    if not found.positive:
        return (
            f"with the singular control free{kept} the least eigenvalue of the second variation is "
            "zero within its error"
        )
    left = f"; {why}" if why else ""
    return (
        "no theorem is checked for singular arcs, though the second variation with the singular "
        f"control free{kept} is positive definite{left}"
    )


def _common(problem: Problem, solution: Solution, pair: Pair) -> list[str]:
    """Return what stands against the hypotheses that theorems of both kinds share."""
    found = [f"state constraint {name} is met" for name in met(problem, solution)]
    found += [f"two controls switch at t = {t:.6g}" for t in joint_switches(solution)]
    if not pair.fine.regular:
        found.append("the conditions at the ends depend on one another: multipliers are not unique")
    if not smooth(problem, solution):
        found.append("dynamics or running cost have a kink where the solution goes")
    if linear_tables(problem):
        found.append("dynamics or running cost look into a linear table, which has kinks")
    return found
