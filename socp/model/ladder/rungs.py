"""The ladder: what can be said of a solution, each rung with the figure that decides it.

It is a trunk, from no point at all to an extremal, with three branches: what holds beside the
solution (local), what holds of all that a search met and of everything (global), and that an
extremal is there at all, beyond arithmetic. A rung holds where the one below it does too.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, final

from socp.model.ladder.second_order import Minimum
from socp.model.tolerances import APPROXIMATE, COMPARED, EXTREMAL, FEASIBLE

if TYPE_CHECKING:
    from socp.model.ladder.starts import Starts
    from socp.model.result.findings import Verdict
    from socp.model.result.solution import Solution


class Rung(Enum):
    """The rungs, from below on every branch; the value is what a report calls it."""

    INFEASIBLE = "not feasible"
    FEASIBLE = "feasible"
    APPROXIMATE = "approximately extremal"
    EXTREMAL = "extremal"
    WORD = "strict local minimum among controls of its word"
    STRONG = "strict strong local minimum"
    BEST = "best of several starts"
    EXISTS = "an extremal exists beside it, proved"
    GLOBAL = "within a bound of the global optimum, proved"

    @property
    def below(self) -> "Rung | None":
        """The rung that it stands on, None for the lowest."""
        return _BELOW.get(self)

    def implies(self, other: "Rung") -> bool:
        """Tell whether a solution on this rung is on another one too: it stands on it."""
        return self is other or (self.below is not None and self.below.implies(other))


# A bound of the optimum compares objectives: it asks for a feasible point alone
_BELOW = {
    Rung.FEASIBLE: Rung.INFEASIBLE,
    Rung.APPROXIMATE: Rung.FEASIBLE,
    Rung.EXTREMAL: Rung.APPROXIMATE,
    Rung.WORD: Rung.EXTREMAL,
    Rung.STRONG: Rung.WORD,
    Rung.BEST: Rung.EXTREMAL,
    Rung.EXISTS: Rung.EXTREMAL,
    Rung.GLOBAL: Rung.FEASIBLE,
}
_LOCAL = (Rung.STRONG, Rung.WORD, Rung.EXTREMAL, Rung.APPROXIMATE, Rung.FEASIBLE)
_PROVED = (Rung.EXISTS, Rung.GLOBAL)  # they hold by a proof alone


@final
@dataclass(frozen=True, kw_only=True)
class Proof:
    """A rung that arithmetic without rounding errors proved, for the result at hand.

    `margin` decides it: of EXISTS how far the objective may be from the extremal's, of GLOBAL how
    far the global optimum may be below it, over its own magnitude, of a minimum the least curvature
    that is proved. `statement` says in a line what is proved, and by which arithmetic.
    """

    rung: Rung
    margin: float
    statement: str


@final
@dataclass(frozen=True, kw_only=True)
class Step:
    """A rung with what decides it: `figure` is at most `allowed` where it holds, or, of the minima,
    above it; of BEST it is a number of starts, of a proof its margin, and nothing is allowed.
    None where nothing of it was worked out, for the reason in `why`.
    """

    rung: Rung
    holds: bool
    figure: float | None = None
    allowed: float | None = None
    why: str = ""
    proved: bool = False


def rung_of(solution: "Solution") -> Rung:
    """Return the highest rung of the trunk and the local branch that a solution reaches; the lowest
    where nobody judged.
    """
    reached = {step.rung for step in ladder_steps(solution) if step.holds}
    return next((rung for rung in _LOCAL if rung in reached), Rung.INFEASIBLE)


def reaches(solution: "Solution", rung: Rung) -> bool:
    """Tell whether a solution is on a rung, or on one that stands on it."""
    return rung is Rung.INFEASIBLE or any(
        step.holds and step.rung.implies(rung) for step in ladder_steps(solution)
    )


def top_steps(solution: "Solution") -> list[Step]:
    """Return the highest step that holds of every branch, the local one first, which may be the
    trunk's, and what is proved where what stands on it is not.
    """
    held, local = [step for step in ladder_steps(solution) if step.holds], rung_of(solution)
    return [
        step
        for step in held
        if step.rung is local
        or not any(
            each is not step and each.rung.implies(step.rung) and each.proved >= step.proved
            for each in held
        )
    ]


def ladder_steps(solution: "Solution") -> tuple[Step, ...]:
    """Return the rungs above the lowest that a solution was asked for, with what decides each, from
    below; none where nobody judged.
    """
    verdict = solution.verdict
    if verdict is None:
        return ()
    steps = [*_judged(verdict), *_counted(verdict, solution.starts, solution.objective)]
    for proof in solution.proofs:
        steps = _with(steps, proof, verdict)
    return tuple(steps)


def _with(steps: list[Step], proof: Proof, verdict: "Verdict") -> list[Step]:
    """Return steps with what a proof says of one of them.

    The rung below has to hold, and a bound compares an objective that is reached to `COMPARED`.
    """
    reached = verdict.miss <= COMPARED if proof.rung is Rung.GLOBAL else True
    below = any(
        step.holds and proof.rung.below is not None and step.rung.implies(proof.rung.below)
        for step in steps
    )
    proved = Step(
        rung=proof.rung,
        holds=below and reached,
        figure=proof.margin,
        why=proof.statement,
        proved=True,
    )
    if proof.rung in _PROVED:
        return [*steps, proved]
    return [proved if step.rung is proof.rung else step for step in steps]


def _counted(verdict: "Verdict", starts: "Starts | None", objective: float) -> Iterator[Step]:
    """Yield the step of a solution that a search took as the best of its starts."""
    if starts is None or not verdict.extremal:
        return
    lower = [each for each in starts.extremals if each.objective < objective]
    why = ""
    if starts.ended < 2:
        count = "one start" if starts.ended else "no start"
        why = f"{count} ended in a local solution: nothing to compare"
    elif lower:
        why = f"another extremal, {lower[0].word}, has {lower[0].objective:.12g}"
    elif starts.better is not None:
        why = f"a feasible point that is no extremal reaches {starts.better:.12g}"
    yield Step(rung=Rung.BEST, holds=not why, figure=float(starts.tried), why=why)


def _judged(verdict: "Verdict") -> Iterator[Step]:
    """Yield the steps of the trunk and of the local branch."""
    found, grade = verdict.second_order, verdict.grade
    kind = found.kind if found and verdict.extremal else Minimum.UNTESTED
    curved = None if found is None else found.word
    free = curved is not None and curved.free > 0
    limits = "; ".join(() if found is None else found.limits)
    yield Step(rung=Rung.FEASIBLE, holds=verdict.feasible, figure=verdict.miss, allowed=FEASIBLE)
    if grade is not None:
        allowed = APPROXIMATE * grade.size
        near = Step(rung=Rung.APPROXIMATE, holds=verdict.approximate, figure=grade.error)
        yield replace(near, allowed=allowed)
    yield Step(
        rung=Rung.EXTREMAL,
        holds=verdict.extremal,
        figure=verdict.residual if verdict.findings else None,
        allowed=EXTREMAL,
        why="; ".join(verdict.reasons[:1]),
    )
    of_word = Step(rung=Rung.WORD, holds=kind.shown, why=limits)
    if curved and free:
        figures = replace(of_word, figure=curved.least, allowed=curved.error)
        of_word = replace(figures, why="" if kind.shown else limits)
    elif curved:
        of_word = replace(of_word, why="no direction is free")
    yield of_word
    strong = Step(rung=Rung.STRONG, holds=kind is Minimum.STRONG, why=limits)
    if found is not None and found.theorem:
        strong = replace(strong, why=found.theorem)
    if found is not None and found.margin is not None:
        strong = replace(strong, figure=found.margin, allowed=1.0)
    yield strong
