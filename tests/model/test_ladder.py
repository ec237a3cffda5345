"""The ladder: which rungs a solution reaches, and what decides each."""

from dataclasses import replace

import pytest
from records import revised

from socp import Solution, default_guess
from socp.model import (
    Condition,
    Curvature,
    Finding,
    Grade,
    Met,
    Minimum,
    Proof,
    Rung,
    SecondOrder,
    Starts,
    Verdict,
)
from socp.model.ladder.rungs import ladder_steps, reaches, rung_of, top_steps
from socp.registry.standard import regulator

HOLDS = Verdict(miss=1e-9, findings=(Finding(kind=Condition.SIGN, residual=1e-9),))
BROKEN = Verdict(miss=1e-9, findings=(Finding(kind=Condition.SIGN, residual=1e-3),))
GRADE = Grade(
    objective=0.0, error=1e-5, gain=0.0, dynamics=0.0, ends=0.0, path=0.0, size=1.0, curvature=0.0
)
BARE = default_guess(regulator().problem)
EXISTS, GLOBAL, LEAST = (
    Proof(rung=rung, margin=margin, statement="in balls of 128 bits")
    for rung, margin in ((Rung.EXISTS, 1e-17), (Rung.GLOBAL, 0.02), (Rung.WORD, 3.0))
)


def of(verdict: Verdict | None, starts: Starts | None = None, *proofs: Proof) -> Solution:
    return revised(BARE, objective=1.0, verdict=verdict, starts=starts, proofs=proofs)


def found(kind: Minimum) -> Verdict:
    curved = Curvature(least=2.0, error=1e-3, free=1)
    return replace(HOLDS, second_order=SecondOrder(kind=kind, word=curved, limits=("a kink",)))


def tops(solution: Solution) -> list[Rung]:
    return [step.rung for step in top_steps(solution)]


@pytest.mark.parametrize(
    ("verdict", "rung"),
    [
        (None, Rung.INFEASIBLE),
        (Verdict(miss=0.5), Rung.INFEASIBLE),
        (BROKEN, Rung.FEASIBLE),
        (replace(BROKEN, grade=GRADE), Rung.APPROXIMATE),
        (HOLDS, Rung.EXTREMAL),
        (found(Minimum.WORD), Rung.WORD),
        (found(Minimum.STRONG), Rung.STRONG),
        (found(Minimum.DEGENERATE), Rung.EXTREMAL),
        (found(Minimum.NONE), Rung.EXTREMAL),
        (found(Minimum.UNTESTED), Rung.EXTREMAL),
    ],
)
def test_the_highest_rung_that_is_reached(verdict: Verdict | None, rung: Rung) -> None:
    solution = of(verdict)
    assert rung_of(solution) is rung
    assert tops(solution) == ([] if rung is Rung.INFEASIBLE else [rung])
    trunk = list(Rung)[: list(Rung).index(Rung.STRONG) + 1]
    for each in trunk:  # these stand one on another
        assert reaches(solution, each) == (trunk.index(each) <= trunk.index(rung))


def test_every_step_says_what_decides_it() -> None:
    steps = {step.rung: step for step in ladder_steps(of(found(Minimum.WORD)))}
    assert steps[Rung.FEASIBLE].figure == 1e-9
    assert (steps[Rung.WORD].figure, steps[Rung.WORD].allowed) == (2.0, 1e-3)
    assert not steps[Rung.STRONG].holds
    assert steps[Rung.STRONG].why == "a kink"
    assert set(steps) == {Rung.FEASIBLE, Rung.EXTREMAL, Rung.WORD, Rung.STRONG}
    order = SecondOrder(kind=Minimum.STRONG, theorem="a theorem", margin=30.0)
    strong = ladder_steps(of(replace(HOLDS, second_order=order)))[-1]
    assert (strong.figure, strong.allowed, strong.why) == (30.0, 1.0, "a theorem")


def test_no_branch_stands_on_another() -> None:
    """The best of many starts need be no minimum by the second order, nor the other way round."""
    for one, other in (
        (Rung.BEST, Rung.WORD),
        (Rung.GLOBAL, Rung.EXTREMAL),
        (Rung.EXISTS, Rung.BEST),
    ):
        assert not one.implies(other)
        assert not other.implies(one)
    assert all(rung.implies(Rung.FEASIBLE) for rung in Rung if rung is not Rung.INFEASIBLE)


FOUR = Starts(tried=4, coarse=(Met(objective=1.0, starts=3), Met(objective=2.0)))


@pytest.mark.parametrize(
    ("starts", "why"),
    [
        (FOUR, ""),
        (replace(FOUR, extremals=(Met(objective=2.0, word="u: -"),)), ""),
        (Starts(tried=4), "no start ended in a local solution: nothing to compare"),
        (
            Starts(tried=4, coarse=(Met(objective=1.0),)),
            "one start ended in a local solution: nothing to compare",
        ),
        (
            replace(FOUR, extremals=(Met(objective=0.5, word="u: -"),)),
            "another extremal, u: -",
        ),
        (replace(FOUR, better=0.75), "a feasible point that is no extremal reaches 0.75"),
    ],
)
def test_the_best_of_its_starts(starts: Starts, why: str) -> None:
    solution = of(found(Minimum.DEGENERATE), starts)
    step = ladder_steps(solution)[-1]
    assert (step.rung, step.figure) == (Rung.BEST, starts.tried)
    assert step.why.startswith(why)
    assert step.holds == (not why) == reaches(solution, Rung.BEST)
    assert tops(solution) == [Rung.EXTREMAL, *([] if why else [Rung.BEST])]
    assert not reaches(of(BROKEN, starts), Rung.BEST)


def test_what_is_proved_stands_on_what_was_judged() -> None:
    every = of(found(Minimum.UNTESTED), FOUR, EXISTS, GLOBAL)
    assert tops(every) == [Rung.EXTREMAL, Rung.BEST, Rung.EXISTS, Rung.GLOBAL]
    assert [step.figure for step in ladder_steps(every)[-2:]] == [1e-17, 0.02]
    assert tops(of(BROKEN, None, EXISTS, GLOBAL)) == [Rung.FEASIBLE, Rung.GLOBAL]
    rough = of(replace(BROKEN, miss=1e-3), None, GLOBAL)  # its objective is not reached
    assert (tops(rough), reaches(rough, Rung.GLOBAL)) == ([Rung.FEASIBLE], False)
    assert not reaches(of(None, None, EXISTS), Rung.EXISTS)


def test_a_minimum_may_be_proved_as_well() -> None:
    proved = of(found(Minimum.UNTESTED), None, LEAST)
    (step,) = (each for each in ladder_steps(proved) if each.rung is Rung.WORD)
    assert (step.holds, step.proved, step.figure) == (True, True, 3.0)
    assert tops(proved) == [Rung.WORD]
