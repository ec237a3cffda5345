"""The judge says whether a solution is an extremal of Pontryagin's principle, and how far it is
from one.

It takes a problem and a solution, nothing else. Along the given states and controls every condition
is affine in the multipliers, so the question whether any multipliers satisfy them all is a convex
programme. Least squares over the equations usually finds them; where the result fails, a linear
programme finds the multipliers of least worst residual, or proves by that residual that there are
none within tolerance.
"""

import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from socp.errors import LateError, ProblemError
from socp.laws import completed, independent
from socp.model import (
    EXTREMAL,
    SAME_TIME,
    SHORTEST,
    Arc,
    Condition,
    Finding,
    Place,
    Problem,
    Solution,
    Verdict,
    cached,
    check_names,
    digits_of,
    lately,
)
from socp.process import one_thread
from socp.verdict import claims, estimates, margins
from socp.verdict.accuracy import sharpened, values_of
from socp.verdict.adjoint import AdjointSystem, Ends, condense, unknowns_of
from socp.verdict.conditions import conditions
from socp.verdict.junctions import chattering
from socp.verdict.lessons import learn
from socp.verdict.multipliers import Case, multipliers
from socp.verdict.nodes import sample
from socp.verdict.reintegration import verify, verify_finely
from socp.verdict.signs.short import Short
from socp.verdict.structure import structure_of

__all__ = ["Case", "case", "certify", "multipliers"]


def case(problem: Problem, solution: Solution, seen: Sequence[float] = ()) -> Case:
    """Lay out a solution for judging: choose the unknowns, condense the adjoint, write down every
    condition. There are nodes at times that something was `seen` at.
    """
    samples = sample(problem, solution, seen)
    ends = Ends.of(problem, solution)
    unknowns = unknowns_of(problem, solution, samples, ends)
    along = AdjointSystem(
        problem, solution, samples, unknowns, condense(samples, unknowns, ends.slope_final), ends
    )
    return Case(along, tuple(conditions(along)))


# -- the verdict


def certify(problem: Problem, solution: Solution) -> tuple[Verdict, tuple[Arc, ...]]:
    """Judge a solution; returns the verdict and the arcs with the principle's own costates and
    multipliers.

    `solution` needs its structure and its verification (`socp.verdict.certify.judge` fills both
    in).
    """
    laid = case(problem, solution)
    z, distance = multipliers(laid)
    if (hidden := _hidden(laid, z)).size:
        laid = case(problem, solution, hidden.tolist())
        z, distance = multipliers(laid)
    along, samples = laid.along, laid.along.samples
    costate, size = along.costates.at(z), laid.magnitude(z)
    offset, matrix = along.sigma
    switching = offset + matrix @ z
    density = np.einsum("ncz,z->cn", along.costates.mu, z)
    slack = np.abs(density * samples.values["c"])
    strict = margins.strictness(problem, solution, samples, switching, size)
    findings = (
        *laid.findings(z),
        *claims.claims(along, density, size),
        *_complementary(laid, slack, z, size),
    )
    level = min(max((each.residual for each in findings), default=0.0), EXTREMAL)
    drowned = (place for place, margin in strict.items() if margin <= level)
    told = Short(along, costate, size, level).told(drowned)
    findings = _worst_of((*findings, *_without_length(solution, told)))
    certain = all(finding.holds for finding in findings)
    # where all holds, the gain would measure the judge
    gain = slack.sum(axis=0) + (0.0 if certain else _gain(problem, samples.u, switching))
    error = estimates.objective_error(solution, samples, costate, gain)
    error += sum(
        float(np.abs(rows.offset + rows.matrix @ z).max()) * rows.slack
        for rows in laid.rows
        if rows.slack
    )
    error += estimates.worth_of_misses(along, z, switching, density)
    unused = estimates.integral(samples, _gain(problem, samples.u, switching)) if certain else 0.0
    open_ = margins.indifferent(problem, solution, samples, switching, size)
    clebsch, unknown = margins.legendre_clebsch(problem, solution, samples, costate)
    verdict = Verdict(
        miss=max((f.off for f in solution.verified), default=float("inf")),
        miss_at=max(solution.verified, key=lambda f: f.off).off_at if solution.verified else "",
        drift=max((f.drift for f in solution.verified), default=0.0),
        findings=findings,
        distance=distance,
        normality=min(laid.cost / size, 1.0),
        legendre_clebsch=clebsch,
        chattering=tuple(chattering(problem, solution)),
        notes=(*unknown, *map(_left_open, open_), *map(_by_derivatives, told)),
        margins={place: each for place, each in strict.items() if place not in {*open_, *told}},
        ringing=margins.ringing(problem, solution),
        objective_error=error,
        remaining_error=error + unused,
        switch_errors=estimates.switch_errors(problem, solution, samples, switching, size),
        flat=estimates.flat(problem, solution, samples, switching, size),
        digits=digits_of(error, solution.objective) if certain else 0,
    )
    return verdict, _with_multipliers(along, z)


def _hidden(laid: Case, z: np.ndarray) -> np.ndarray:
    """Return the times between nodes at which a switching function has the wrong sign, where it has
    the right one at all nodes: once on every interval.
    """
    samples, (offset, matrix) = laid.along.samples, laid.along.sigma
    switching = offset + matrix @ z
    problem, least = laid.along.problem, EXTREMAL * laid.magnitude(z)
    if not _gain(problem, samples.u, switching).max(initial=0.0) <= least:
        return np.empty(0)
    t, (u, sigma) = samples.amid(samples.u, switching)
    gain = _gain(problem, u, sigma).reshape(samples.intervals, -1)
    worst = gain.argmax(axis=1)
    wrong = gain.max(axis=1) > least
    return np.array(t.reshape(gain.shape)[wrong, worst[wrong]])


def _left_open(place: Place) -> str:
    return (
        f"the principle leaves {place} open: its switching function vanishes throughout, so any "
        "other control of the same effect on the states at the end of it does as well"
    )


def _by_derivatives(place: Place) -> str:
    return (
        f"{place} is so short that its switching function stays within what the conditions leave: "
        "its derivatives where it switches tell its sign"
    )


def _worst_of(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Keep the worst finding of every condition."""
    worst: dict[Condition, Finding] = {}
    for each in findings:
        if each.kind not in worst or each.residual > worst[each.kind].residual:
            worst[each.kind] = each
    return tuple(worst.values())


def _complementary(laid: Case, slack: np.ndarray, z: np.ndarray, size: float) -> Iterator[Finding]:
    """Yield multipliers of what is not quite active: slack (nc, n) is density times distance, jumps
    count likewise.
    """
    along, samples, kind = laid.along, laid.along.samples, Condition.COMPLEMENTARY
    for rows in laid.rows:
        if rows.slack:
            worth = (
                float(np.abs(rows.offset + rows.matrix @ z).max())
                * rows.slack
                / along.horizon
                / size
            )
            yield Finding(kind=kind, residual=worth, place=rows.where[0], t=float(rows.t[0]))
    for j, constraint in enumerate(along.problem.constraints):
        k = int(np.argmax(slack[j]))
        yield Finding(
            kind=kind,
            residual=float(slack[j, k]) / size,
            place=Place(of=constraint.name),
            t=float(samples.t[k]),
        )
    for jump, (j, joint) in enumerate(along.unknowns.jumps):
        off = abs(
            float(
                z[along.unknowns.jump_column(jump)]
                * samples.values["c"][j, joint * samples.width - 1]
            )
        )
        place, t = Place(of=along.problem.constraints[j].name), float(samples.edges[joint])
        yield Finding(kind=kind, residual=off / along.horizon / size, place=place, t=t)


def _gain(problem: Problem, u: np.ndarray, switching: np.ndarray) -> np.ndarray:
    """Return the Hamiltonian (n,) that the best admissible controls would gain in place of controls
    u (nu, n).
    """
    low, high = problem.box
    gap = np.maximum(switching * (u - low[:, None]), switching * (u - high[:, None]))
    return np.array(np.maximum(gap, 0.0).sum(axis=0))


def _without_length(solution: Solution, told: Sequence[Place]) -> tuple[Finding, ...]:
    """Find the arcs of a word that have no length: the word has too many. Those that are stretches
    whose sign is `told` by derivatives have one as long as their ends are two times.
    """
    horizon = solution.final_time - solution.initial_time
    rows = (solution.structure[str(each.control)][(each.stretch or 1) - 1] for each in told)
    asked = {(start, end) for _, start, end in rows}
    lengths = [
        (arc.t[-1] - arc.t[0], SAME_TIME if (arc.t[0], arc.t[-1]) in asked else SHORTEST)
        for arc in solution.arcs
    ]
    return tuple(
        Finding(
            kind=Condition.NO_LENGTH,
            residual=1.0,
            place=Place(arc=k),
            t=float(arc.t[0]),
        )
        for k, (arc, (length, least)) in enumerate(
            zip(solution.arcs, lengths, strict=True), start=1
        )
        if length <= least * horizon
    )


def _with_multipliers(along: AdjointSystem, z: np.ndarray) -> tuple[Arc, ...]:
    """Return the arcs, those that follow laws with the costates and densities of z in place of
    their programme's.

    Along a law the nonlinear programme's multipliers are not the principle's: they take the law for
    part of the dynamics.
    """
    costate = along.costates.at(z)
    density = np.einsum("ncz,z->cn", along.costates.mu, z)
    names = [constraint.name for constraint in along.problem.constraints]
    both, arcs = np.vstack([costate, density]), list(along.solution.arcs)
    lawful = [k for k, arc in enumerate(arcs) if arc.lawful]
    carried = margins.on_arcs(along.samples, [(k, arcs[k].t) for k in lawful], both)
    for k, rows in zip(lawful, carried, strict=True):
        own = dict(zip(names, rows[len(costate) :], strict=True))
        arcs[k] = replace(arcs[k], costate=rows[: len(costate)], multipliers=own)
    return tuple(arcs)


@one_thread()
def judge(problem: Problem, solution: Solution) -> Solution:
    """Return a solution with its structure, its verification, its verdict and its problem, all
    worked out anew; one that is feasible and no extremal is graded as well.

    Misses and residuals in it are relative, derivatives and switching times in the problem's units.
    Raises SolveError where the solution has other states, controls or parameters than the problem,
    ProblemError for a law in it that is none.
    """
    check_names("solution", solution, problem)
    return graded(problem, certified(problem, solution))


def graded(problem: Problem, solution: Solution) -> Solution:
    """Return a judged solution with its grade, where it is feasible and no extremal, and the time
    allowed is enough.
    """
    verdict = solution.verdict
    if verdict is None or verdict.extremal or not verdict.feasible:
        return solution
    from socp.verdict.grading.grade import grade  # it brings scipy

    began = time.perf_counter()
    failures = np.linalg.LinAlgError, ValueError, ArithmeticError, LateError
    with np.errstate(all="ignore"), suppress(*failures):
        verdict = replace(verdict, grade=grade(problem, solution))
    spent = solution.seconds.get("judge", 0.0) + time.perf_counter() - began
    return solution.with_judgement(verdict=verdict).spent(judge=spent)


def certified(problem: Problem, solution: Solution) -> Solution:
    """Return a solution judged as by `judge` but for its grade, which a search has no use for.

    It is verified against all end conditions, and certified with multipliers of those that do not
    follow from others by what motions conserve: those of the rest are any.
    """
    judged = tested(problem, solution)
    verdict = judged.verdict
    if verdict is None or not verdict.extremal:
        return judged
    began, own = time.perf_counter(), independent(problem)
    sharper = lately(problem, certified, values_of(judged), lambda: sharpened(own, judged, verdict))
    judged, spent = judged.with_judgement(verdict=sharper), judged.seconds.get("judge")
    if spent is None:  # it was judged before
        return judged
    return judged.spent(judge=spent + time.perf_counter() - began)


def tested(problem: Problem, solution: Solution) -> Solution:
    """Return what `certified` does, with errors of the objective and of the times by the conditions
    alone: whether a solution is an extremal they do not tell, and finding better ones by a Newton
    step takes as long as all the rest.
    """
    # what was proved, was proved of what was judged before
    solution = with_statement(problem, solution).with_judgement(proofs=())
    # a search ends with what it has judged, which is asked for again in the end
    known: dict[tuple[Any, ...], Solution] = cached(problem, tested)
    if found := known.get(values_of(solution)):
        own = found.judgement
        return solution.with_judgement(
            structure=own.structure, verified=own.verified, verdict=own.verdict
        )
    judged = _tested(problem, solution)
    if judged.extremal:
        known.clear()
        known[values_of(judged)] = judged
    return judged


def _tested(problem: Problem, solution: Solution) -> Solution:
    stated, problem = completed(problem), independent(problem)
    values = [each for arc in solution.arcs for each in (arc.x, arc.u)]
    values.append(np.array(list(solution.parameters.values()), dtype=float))
    if not all(np.isfinite(each).all() for each in values):
        verdict = Verdict(miss=float("inf"), notes=("the solution is not finite",))
        return solution.with_judgement(verified=(), verdict=verdict)
    began = time.perf_counter()
    with np.errstate(
        all="ignore"
    ):  # what overflows is infinite or nan, and no condition holds with either
        solution = solution.with_judgement(structure=structure_of(problem, solution))
        learn(problem, solution)
        solution = solution.with_judgement(verified=verify(stated, solution))
    integrated = time.perf_counter()
    try:
        with np.errstate(all="ignore"):
            verdict, arcs = certify(problem, solution)
            if not verdict.extremal and replace(verdict, miss=0.0, drift=0.0).extremal:
                solution = solution.with_judgement(verified=verify_finely(stated, solution))
                verdict, arcs = certify(problem, solution)
    except (np.linalg.LinAlgError, ValueError, ArithmeticError, RecursionError) as error:
        worst = max(solution.verified, key=lambda f: f.off)
        notes = (f"the principle could not be judged: {error}",)
        verdict, arcs = Verdict(miss=worst.off, miss_at=worst.off_at, notes=notes), solution.arcs
    solution = replace(solution, arcs=arcs).with_judgement(verdict=verdict)
    seconds = {"verify": integrated - began, "judge": time.perf_counter() - integrated}
    return solution.spent(**seconds)


def with_statement(problem: Problem, solution: Solution) -> Solution:
    """Return a solution that carries the statement of its problem, or the reason why it cannot."""
    try:
        said: dict[str, Any] = {"statement": problem.statement, "unstated": ""}
    except ProblemError as error:
        said = {"statement": None, "unstated": str(error)}
    return replace(solution, problem=problem.name).with_origin(**said)
