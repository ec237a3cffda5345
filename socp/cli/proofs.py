"""What is proved of a result: that its extremal exists, and how far the optimum may be below it."""

import json
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from socp.cli.keeping import ENDING
from socp.cli.progress import progress
from socp.cli.session import messages
from socp.process import breakable, give_way, heard, write_atomic

if TYPE_CHECKING:
    from socp.model import Problem, Solution
    from socp.proof import Existence, LowerBound

BOUND = ".bound.json"


@final
@dataclass(frozen=True)
class Proofs:
    """A solution with what was proved of it, as lines where it was not, and as plain values; the
    paths of certificates.
    """

    solution: "Solution"
    lines: tuple[tuple[str, str], ...] = ()
    data: dict[str, Any] = field(default_factory=dict)
    certificates: tuple[Path, ...] = ()


def provable() -> None:
    """Raise SolveError, with what to install, where nothing can be proved."""
    from socp.proof import flint

    flint()


def searched(
    problem: "Problem",
    solution: "Solution",
    seconds: float = 60.0,
    degree: int | None = None,
    *,
    quiet: bool,
) -> "LowerBound":
    """Return a lower bound of a problem, its search shown; KeyboardInterrupt where it ends before
    there is one.
    """
    from socp.proof import lower_bound

    with breakable(), progress(messages(), f"{problem.name}, bound", quiet=quiet) as watch:
        give_way()
        return lower_bound(problem, solution, seconds, degree, watch)


def proofs_of(
    problem: "Problem", solution: "Solution", path: Path, *, asked: tuple[bool, bool], quiet: bool
) -> Proofs:
    """Return a solution with what is asked for: a proof that it exists, a lower bound, whose
    certificate is written beside the path of the result.

    What Ctrl-C breaks off is not proved; the solution is what it was.
    """
    existence, bound = asked
    found = Proofs(solution)
    with suppress(KeyboardInterrupt):
        if existence and not heard():
            found = _existing(problem, found)
        if bound and not heard():
            found = _bounded(problem, found, path, quiet=quiet)
    return found


def _existing(problem: "Problem", before: Proofs) -> Proofs:
    from socp.proof import prove

    with breakable():
        found = prove(problem, before.solution)
    lines = () if found.holds else (("not proved", f"{found.step}: {found.reason}"),)
    return _more(before, found, {"existence": found.data}, lines)


def _bounded(problem: "Problem", before: Proofs, path: Path, *, quiet: bool) -> Proofs:
    found = searched(problem, before.solution, quiet=quiet)
    if found.bound is None:
        return _more(before, found, {"bound": found.data}, tuple(found.lines))
    place = path.with_name(path.name.removesuffix(ENDING).removesuffix(".json") + BOUND)
    write_atomic(place, json.dumps(found.certificate))
    proofs = _more(before, found, {"bound": found.data}, (("certificate", str(place)),))
    return replace(proofs, certificates=(*before.certificates, place))


def _more(
    before: Proofs,
    found: "Existence | LowerBound",
    data: dict[str, Any],
    lines: tuple[tuple[str, str], ...],
) -> Proofs:
    """Return proofs with those of one more."""
    known = before.solution.proofs
    solution = before.solution.with_judgement(proofs=(*known, *found.rungs(before.solution)))
    return replace(
        before, solution=solution, lines=before.lines + lines, data={**before.data, **data}
    )
