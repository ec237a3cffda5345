"""After a solve that certified nothing: what it came to, why, and the next command, in three
lines.
"""

import shlex
from typing import TYPE_CHECKING

from socp.cli.options import DEFAULT_METHOD
from socp.cli.outcome import outcome
from socp.model import Stop
from socp.view import Outcome

if TYPE_CHECKING:
    from collections.abc import Sequence

    from socp.model import Solution

# Of the seconds allowed: a search that took as much has been ended by them
_SPENT = 0.75
_MORE = 4  # times what was not enough, of seconds and of steps: less is seldom felt
_WORDS = "mboc"  # the method that tries every word of few switches
_UNTIMED = ["--set", "final_time=free"]  # tells whether the end can be reached at all
_SWITCHES = 2  # times those that were allowed: where a control chatters each of them costs as much


def advice(solution: "Solution", problem: "Sequence[str]", result: str) -> tuple[str, ...]:
    """Return three lines: what a solve came to, why, and the command to try next; none where it is
    certified or was interrupted.

    problem: the words of a command line that name it, with what was `--set`; result: the path of
    its result.
    """
    came_to = outcome(solution)
    if came_to in {Outcome.EXTREMAL, Outcome.INTERRUPTED}:
        return ()
    on = _next(solution, result)
    if on == _UNTIMED:
        at = [k for k, word in enumerate(problem) if word.startswith("final_time=")]
        problem = [word for k, word in enumerate(problem) if k not in at and k + 1 not in at]
    tried = shlex.join(["socp", "solve", *problem, *on])
    return (
        f"what: {came_to.value.partition(': ')[2]}",
        f"why:  {_why(solution)}",
        f"next: {tried}",
    )


def _why(solution: "Solution") -> str:
    verdict = solution.verdict
    if verdict is None or not (verdict.reasons or verdict.notes):
        return solution.message or solution.stop.value
    if verdict.feasible and verdict.chattering:
        return _told(solution) + _chatter(solution, ", ".join(verdict.chattering))
    if not solution.stop.ok:
        return f"{solution.stop.value}; {(*verdict.reasons, *verdict.notes)[0]}"
    return _told(solution) + (*verdict.reasons, *verdict.notes)[0]


def _chatter(solution: "Solution", names: str) -> str:
    """Say that controls (names) chatter; where their switches are those of a grid, what it shows is
    no proof.
    """
    if solution.lawful:
        return f"{names}: chattering, which no finite word ends"
    return f"{names}: chattering, as far as a grid shows it, which no finite word ends"


def _told(solution: "Solution") -> str:
    """Say what a search took, where its time has ended it."""
    if not _spent(solution):
        return ""
    took, allowed = sum(solution.seconds.values()), solution.options["seconds"]
    return f"{took:.3g} s of the {allowed:g} s allowed are used; "


def _spent(solution: "Solution") -> bool:
    """Tell whether a search has been ended by its time."""
    took = sum(solution.seconds.values())
    return solution.method == DEFAULT_METHOD and took >= _SPENT * solution.options["seconds"]


def _timed(solution: "Solution") -> bool:
    """Tell whether its problem asks for an end at a final time that is given."""
    stated = solution.statement or {}
    first, last = stated.get("final_time", (None, None))
    asked = stated.get("end") or stated.get("target")
    return bool(asked) and first is not None and first == last


def _next(solution: "Solution", result: str) -> list[str]:
    """Return the options of the next command, by what this one was given and what it found."""
    verdict, given = solution.verdict, solution.options
    feasible = verdict is not None and verdict.feasible
    if solution.method != DEFAULT_METHOD:
        on = ["--guess", result] if feasible else []
        return _wider(solution) if solution.method == _WORDS else on
    chatters = verdict is not None and verdict.chattering
    # what a grid shows before a search has come to its words may be no more than ringing
    known = solution.lawful or not _spent(solution)
    if feasible and chatters and known and given["max_switches"]:
        return ["--max-switches", str(_SWITCHES * given["max_switches"])]
    if _spent(solution):
        # along a word the search goes on where it ended
        on = ["--guess", result] if solution.lawful and feasible else []
        return [*on, "--seconds", f"{_MORE * given['seconds']:g}"]
    if solution.stop is Stop.INFEASIBLE and _timed(solution):
        return _UNTIMED
    if not feasible:
        return ["-o", f"steps={_MORE * given['steps']}"]
    return ["-m", _WORDS, "-o", f"switches={len(solution.switches) + 1}"]


def _wider(solution: "Solution") -> list[str]:
    """Return the options of a wider search over words: back to the default method would lead in a
    circle.
    """
    most, seconds = solution.options["switches"], solution.options["time"]
    spent = sum(solution.seconds.values()) >= _SPENT * seconds
    more = ["-o", f"time={_MORE * seconds:g}"]
    if most == "auto":
        return ["-m", _WORDS, *more]
    wider = f"switches={most if spent else _SWITCHES * max(int(most), 1)}"
    return ["-m", _WORDS, "-o", wider, *(more if spent else [])]
