"""`socp check`: judge a saved result."""

import math
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import click
from rich.table import Table
from rich.text import Text

from socp.cli.opening import open_result, unknown
from socp.cli.session import Exit, Session, heading, show, write_json
from socp.errors import ProblemError

if TYPE_CHECKING:
    from socp.model import Verdict

_TOLD = 4  # reasons told in a report; `socp check` tells them all


@click.command(short_help="Judge a saved result by Pontryagin's principle.")
@click.argument("result", metavar="RESULT")
@click.option(
    "--problem", metavar="FILE_OR_NAME", help="Its problem.  [default: that of the result]"
)
@click.option("--json", "as_json", is_flag=True, help="Write the verdict as JSON.")
@click.pass_obj
def check(session: Session, /, result: str, problem: str | None, as_json: bool) -> int:
    """Judge a saved result: whether it is feasible, whether it is an extremal of Pontryagin's
    principle, how clearly.

    Everything is worked out anew from the problem that the result carries, as data, and from its
    states and controls. Exit code 0 if the result is certified as an extremal, 1 if it is not or
    cannot be read.
    """
    from socp.verdict import judge

    solution, found = open_result(session, result, problem)
    if found is None:
        raise ProblemError(f"{result}: {unknown(solution)}")
    solution = judge(found, solution)
    verdict = solution.verdict
    if verdict is None:
        return Exit.UNSOLVED
    if as_json:
        write_json({"problem": found.name, "word": solution.word, **plain(verdict)})
    else:
        show(heading(found.name, found.title), details(verdict))
    return Exit.SOLVED if verdict.extremal else Exit.UNSOLVED


def plain(verdict: "Verdict") -> dict[str, Any]:
    """Return a verdict as plain values, what follows from them included."""
    derived = {
        name: getattr(verdict, name)
        for name in ("feasible", "extremal", "residual", "reasons", "rings")
    }
    own = {f.name: getattr(verdict, f.name) for f in fields(verdict)}
    return {**derived, **own, "findings": [finding.data for finding in verdict.findings]}


def lines(verdict: "Verdict", told: int = _TOLD) -> list[Text]:
    """Return a verdict in a few lines."""
    from socp.model import EXTREMAL, FEASIBLE

    margin = f"re-integration off by {verdict.miss:.1e} (allowed {FEASIBLE:.0e})"
    found = [_answer(verdict.feasible, "feasible", margin)]
    if verdict.findings:
        found.append(
            _answer(
                verdict.extremal,
                "extremal",
                f"residual {verdict.residual:.1e} (allowed {EXTREMAL:.0e})",
            )
        )
    found += [Text(f"  {reason}", "red") for reason in verdict.reasons[:told]]
    if len(verdict.reasons) > told:
        found.append(Text(f"  and {len(verdict.reasons) - told} more reasons; see socp check"))
    if verdict.extremal:
        found.append(
            Text(f"objective within {verdict.objective_error:.1e}: {verdict.digits} digits")
        )
    if verdict.rings:
        ratios = [
            f"{name} varies {verdict.ringing[name]:.3g} times as much as its mean"
            for name in verdict.rings
        ]
        found.append(Text(f"ringing: {', '.join(ratios)}", "yellow"))
    return [*found, *(Text(note, "yellow") for note in verdict.notes)]


def details(verdict: "Verdict") -> Table:
    """Return a verdict in full, a condition a row."""
    grid = Table.grid(padding=(0, 2, 0, 0))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column(overflow="fold")
    for k, line in enumerate(lines(verdict, len(verdict.reasons))):
        grid.add_row("verdict" if k == 0 else "", line)
    for k, finding in enumerate(verdict.findings):
        grid.add_row(
            "conditions" if k == 0 else "", Text(str(finding), "" if finding.holds else "red")
        )
    if verdict.distance is not None:
        grid.add_row("distance", f"no multipliers leave less than {verdict.distance:.1e} at worst")
    rows = [
        (
            "Legendre-Clebsch",
            [f"{name}: {value:.1e}" for name, value in verdict.legendre_clebsch.items()],
        ),
        ("bang margins", [f"{name}: {value:.1e}" for name, value in verdict.margins.items()]),
        ("normality", [f"{verdict.normality:.1e}"]),
        (
            "variation",
            [
                f"{name}: {value:.3g} times that of its mean"
                for name, value in verdict.ringing.items()
            ],
        ),
        ("switches", [f"{t:.12g}, {within(error)}" for t, error in verdict.switch_errors]),
    ]
    for label, texts in rows:
        for k, text in enumerate(texts):
            grid.add_row(label if k == 0 else "", text)
    return grid


def within(error: float) -> str:
    """Return the error of a switching time as text; an infinite one belongs to a time that is not
    determined.
    """
    return f"within {error:.1e}" if math.isfinite(error) else "not determined"


def _answer(holds: bool, what: str, margin: str) -> Text:
    return Text.assemble(
        (what if holds else f"not {what}", "green" if holds else "red"), f": {margin}"
    )
