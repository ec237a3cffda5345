"""That an extremal exists: the word's equations have exactly one solution in a box, and it
satisfies every condition of Pontryagin's principle; and that it is a minimum of its word.
"""

import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from decimal import ROUND_FLOOR, Context
from typing import Any, final

from socp.errors import SolveError
from socp.model import Problem, Proof, Rung, Solution, column, scales
from socp.proof.balls import Ball, compiled, flint, precision
from socp.proof.chain import chain
from socp.proof.hamilton import Hamiltonian
from socp.proof.krawczyk import Proved, Shot, tested
from socp.proof.minimum import curved
from socp.proof.signs import Signs

BITS = 128  # of the balls: what enclosures lose over some hundred steps leaves half of them
# Of the horizon, of the states' sizes and of the objective: what is proved is what the result says
# when it is as near as this
_NEAR = 1e-6
_UP = 1.01  # times a radius before it is rounded to three digits
_NOTHING = "no extremal is proved to exist"
_SHOWN = 18  # digits of an enclosure that are told
_DOWN = Context(prec=6, rounding=ROUND_FLOOR)  # what is told of a curvature is no more than it is
# What a proof may meet: a condition that is not shown, or arithmetic without a result
_FAILURES = (SolveError, ArithmeticError, ValueError, RecursionError)


@final
@dataclass(frozen=True, kw_only=True)
class LeastCurvature:
    """Whether the extremal was proved to be a strict local minimum among the controls of its word,
    else why not.

    `free` directions are left by the conditions of the word's problem; `least` is what the
    curvature is at least along each, in units of the objective for changes of norm 1, lengths
    measured in horizons, initial states in their magnitudes; None where no direction is free.
    """

    free: int = 0
    least: float | None = None
    reason: str = ""
    seconds: float = 0.0

    @property
    def text(self) -> str:
        """What is proved, or why it is not."""
        if self.reason:
            return f"not proved: {self.reason}"
        proved = "local minimum of the word (proved)"
        if self.least is None:
            return f"{proved}: no direction is free"
        directions = "1 direction" if self.free == 1 else f"{self.free} directions"
        least = _DOWN.create_decimal(self.least)
        return f"{proved}: least curvature at least {least}, {directions} free"


@final
@dataclass(frozen=True, kw_only=True)
class Existence:
    """What was proved of a result, or the step that failed and why.

    Enclosures are (middle, radius) as decimals; `times` are those of the joints between arcs and of
    the end; `radius` is that of the box of unknowns with exactly one solution, `contraction` the
    norm of Krawczyk's operator on it. `shown` names the conditions, `numbers` how numbers of the
    problem were read where they are no short decimals, `minimum` whether it is one of its word.
    """

    problem: str
    word: str
    step: str = ""
    reason: str = ""
    objective: tuple[str, str] = ("", "")
    times: tuple[tuple[str, str], ...] = ()
    radius: float = 0.0
    contraction: float = 0.0
    steps: int = 0
    bits: int = BITS
    shown: tuple[str, ...] = ()
    numbers: Mapping[str, str] = field(default_factory=dict)
    minimum: LeastCurvature = field(default_factory=lambda: LeastCurvature(reason=_NOTHING))
    seconds: float = 0.0

    @property
    def holds(self) -> bool:
        """Whether the extremal is proved to exist."""
        return not self.reason

    def rungs(self, solution: Solution) -> tuple[Proof, ...]:
        """Return what it proves of a solution as rungs of the ladder, none where it fails."""
        if not self.holds:
            return ()
        middle, radius = map(float, self.objective)
        statement = (
            f"exactly one within {self.radius:.1e}, objective {_written(self.objective)}, "
            f"balls of {self.bits} bits"
        )
        margin = abs(middle - solution.objective) + radius
        found = Proof(rung=Rung.EXISTS, margin=margin, statement=statement)
        if self.minimum.reason:
            return (found,)
        least = math.inf if self.minimum.least is None else self.minimum.least
        return (found, Proof(rung=Rung.WORD, margin=least, statement=self.minimum.text))

    @property
    def data(self) -> dict[str, Any]:
        """The proof as plain values."""
        return {"proved": self.holds, **asdict(self)}

    @property
    def lines(self) -> list[tuple[str, str]]:
        """The proof as lines of a report: labels and texts."""
        found = [("word", self.word)]
        if not self.holds:
            return [*found, ("not proved", f"{self.step}: {self.reason}")]
        named = "exactly one solution of the word's equations within"
        found += [
            ("proved", "an extremal of Pontryagin's principle exists"),
            ("objective", _written(self.objective)),
            *(("arc ends", _written(each)) for each in self.times),
            ("existence", f"{named} {self.radius:.1e}, contraction {self.contraction:.1e}"),
            ("conditions", "; ".join(self.shown)),
            ("minimum", self.minimum.text),
        ]
        read = ", ".join(f"{text} as {number}" for text, number in self.numbers.items())
        found += [("numbers", f"read {read}")] if read else []
        how = f"{self.bits} bits, {self.steps} steps, {self.seconds:.1f} s"
        return [*found, ("arithmetic", f"balls of python-flint, {how}")]


def _written(enclosure: tuple[str, str]) -> str:
    return " +/- ".join(enclosure)


def prove(problem: Problem, solution: Solution, bits: int = BITS) -> Existence:
    """Prove that an extremal of a solution's word exists where the solution is, in ball arithmetic
    with so many bits; a proof that fails says at which step, and why.

    Raises SolveError where python-flint is missing.
    """
    flint()
    began, step = time.perf_counter(), "the word's equations"
    empty = Existence(problem=problem.name, word=solution.word, bits=bits)
    try:
        system = Hamiltonian.of(problem)
        equations = chain(system, solution)
        with precision(bits):
            shot = Shot(equations)
            step = "existence"
            proved = tested(shot)
            step = "conditions of the principle"
            shown = Signs(shot, proved).check()
            step = "comparison with the result"
            _same(problem, solution, shot, proved)
            found = replace(
                _told(empty, shot, proved), minimum=_minimum(problem, solution, shot, proved)
            )
    except _FAILURES as error:
        seconds = time.perf_counter() - began
        return replace(empty, step=step, reason=_reason(error), seconds=seconds)
    read = {repr(float(each)): str(each) for each in system.numbers.values.values() if each.pi}
    seconds = time.perf_counter() - began
    return replace(found, shown=tuple(shown), numbers=read, seconds=seconds)


def _reason(error: Exception) -> str:
    return str(error) or type(error).__name__


def _minimum(problem: Problem, solution: Solution, shot: Shot, proved: Proved) -> LeastCurvature:
    began = time.perf_counter()
    try:
        found = curved(problem, solution, shot, proved)
    except _FAILURES as error:
        return LeastCurvature(reason=_reason(error), seconds=time.perf_counter() - began)
    least = float(found.least.lower()) if found.free else None
    return LeastCurvature(free=found.free, least=least, seconds=time.perf_counter() - began)


def _told(empty: Existence, shot: Shot, proved: Proved) -> Existence:
    return replace(
        empty,
        objective=_pair(objective(shot, proved)),
        times=tuple(_pair(t) for t in times(shot, proved)),
        radius=proved.radius,
        contraction=proved.contraction,
        steps=sum(map(len, proved.run.stages)),
    )


def objective(shot: Shot, proved: Proved) -> Ball:
    """Return the enclosure of the objective."""
    system, corners = shot.chain.system, proved.run.corners
    cost = system.z[2 * system.x.numel()] if system.costs else 0
    given = column([*_parts(system.z), *_parts(system.start)])
    values = shot.at(shot.chain.pieces[-1].signs)
    found = compiled(system.mayer + cost, given, values).call([*corners[-1], *corners[0]])[0]
    return flint().arb(0 if found is None else found)


def _parts(symbols: Any) -> list[Any]:
    return [symbols[i] for i in range(symbols.numel())]


def times(shot: Shot, proved: Proved) -> list[Ball]:
    """Return enclosures of the times at which arcs end."""
    total, found = shot.begin(proved.unknowns)[-1], []
    pieces, lengths = shot.chain.pieces, shot.lengths(proved.unknowns)
    for k, (piece, length) in enumerate(zip(pieces, lengths, strict=True)):
        total = total + length
        if k + 1 == len(pieces) or pieces[k + 1].arc != piece.arc:
            found.append(total)
    return found


def _pair(value: Ball) -> tuple[str, str]:
    """Return a decimal middle and the radius around it, both rounded so that they contain the
    ball.
    """
    middle = value.mid().str(_SHOWN, radius=False)
    radius = (value - flint().arb(middle)).abs_upper()
    return middle, f"{float(radius) * _UP:.2e}"


def _same(problem: Problem, solution: Solution, shot: Shot, proved: Proved) -> None:
    """Refuse a proof of another extremal than the result's."""
    horizon = solution.final_time - solution.initial_time
    ends = [float(arc.t[-1]) for arc in solution.arcs]
    for t, its in zip(times(shot, proved), ends, strict=True):
        if not (t - its).abs_upper() <= _NEAR * horizon:
            raise SolveError(f"the extremal has a joint at {t.str(8)}, the result at {its:.8g}")
    value = objective(shot, proved)
    if not (value - solution.objective).abs_upper() <= _NEAR * max(abs(solution.objective), 1.0):
        raise SolveError(
            f"the extremal's objective is {value.str(8)}, the result's {solution.objective:.8g}"
        )
    size, last = scales(problem, solution), {}
    for k, piece in enumerate(shot.chain.pieces):
        last[piece.arc] = proved.run.corners[k + 1]
    for arc, z in last.items():
        for i, name in enumerate(problem.state_names):
            its = float(solution.arcs[arc].x[i, -1])
            if not (z[i] - its).abs_upper() <= _NEAR * float(size[i]):
                where = f"where arc {arc + 1} ends"
                raise SolveError(f"the extremal has {name} = {z[i].str(8)} {where}, not {its:.8g}")
