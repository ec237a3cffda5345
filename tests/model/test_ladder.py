"""The ladder: which rung a verdict reaches, and what decides each."""

from dataclasses import replace

import pytest

from socp.model import Condition, Curvature, Finding, Grade, Minimum, Rung, SecondOrder, Verdict
from socp.model.ladder.rungs import ladder_steps, rung_of

HOLDS = Verdict(miss=1e-9, findings=(Finding(kind=Condition.SIGN, residual=1e-9),))
BROKEN = Verdict(miss=1e-9, findings=(Finding(kind=Condition.SIGN, residual=1e-3),))
GRADE = Grade(
    objective=0.0, error=1e-5, gain=0.0, dynamics=0.0, ends=0.0, path=0.0, size=1.0, curvature=0.0
)


def of(kind: Minimum) -> Verdict:
    curved = Curvature(least=2.0, error=1e-3, free=1)
    return replace(HOLDS, second_order=SecondOrder(kind=kind, word=curved, limits=("a kink",)))


@pytest.mark.parametrize(
    ("verdict", "rung"),
    [
        (None, Rung.INFEASIBLE),
        (Verdict(miss=0.5), Rung.INFEASIBLE),
        (BROKEN, Rung.FEASIBLE),
        (replace(BROKEN, grade=GRADE), Rung.APPROXIMATE),
        (HOLDS, Rung.EXTREMAL),
        (of(Minimum.WORD), Rung.WORD),
        (of(Minimum.STRONG), Rung.STRONG),
        (of(Minimum.DEGENERATE), Rung.EXTREMAL),
        (of(Minimum.NONE), Rung.EXTREMAL),
        (of(Minimum.UNTESTED), Rung.EXTREMAL),
    ],
)
def test_the_highest_rung_that_is_reached(verdict: Verdict | None, rung: Rung) -> None:
    assert rung_of(verdict) is rung
    if verdict is not None:
        reached = [step.rung for step in ladder_steps(verdict) if step.holds]
        assert reached[-1:] == ([] if rung is Rung.INFEASIBLE else [rung])


def test_every_step_says_what_decides_it() -> None:
    steps = {step.rung: step for step in ladder_steps(of(Minimum.WORD))}
    assert steps[Rung.FEASIBLE].figure == 1e-9
    assert (steps[Rung.WORD].figure, steps[Rung.WORD].allowed) == (2.0, 1e-3)
    assert not steps[Rung.STRONG].holds
    assert steps[Rung.STRONG].why == "a kink"
    assert [rung.height for rung in Rung] == list(range(6))
