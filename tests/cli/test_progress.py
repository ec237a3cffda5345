"""The display of progress: what it keeps of what it is told, when it shows it, and how."""

import io
import math

import pytest
from rich.console import Console

from socp.cli.progress import Display, progress
from socp.model.progress import Progress, silent


def shown() -> tuple[Display, list[str]]:
    lines: list[str] = []
    display = Display("auv, auto", lambda view: lines.append(view.line().plain), 0.0)
    return display, lines


def test_a_line_says_all_that_is_known() -> None:
    display, lines = shown()
    assert not display(Progress("ipopt", 0, 1.5, 0.25))
    display(Progress("word", 7, 2.0, 1e-3, word="u: + s", best=1.25, violation=1e-5))
    assert lines[0].startswith(
        "auv, auto: iteration 0  objective 1.5  infeasibility 2.5e-01  solves 1  elapsed "
    )
    assert lines[1].startswith(
        "auv, auto: word: iteration 7  objective 2  infeasibility 1.0e-03  best 1.25  violation "
        "1.0e-05  word u: + s"
    )


def test_the_best_and_the_word_stay_until_others_are_told() -> None:
    display, lines = shown()
    display(Progress("word", 0, 2.0, 0.0, word="u: + s", best=1.25, violation=1e-5))
    display(Progress("2 of 9 starts, ipopt", 0, 3.0, math.nan))
    assert (
        "auv, auto: 2 of 9 starts: iteration 0  objective 3  best 1.25  violation 1.0e-05  word "
        "u: + s" in lines[1]
    )
    assert "solves 2" in lines[1]
    assert "infeasibility" not in lines[1]


def test_what_comes_too_soon_is_kept_but_not_shown() -> None:
    lines: list[str] = []
    display = Display("p", lambda view: lines.append(view.line().plain), 1e9)
    for k in range(5):
        display(Progress("ipopt", k, float(k), 0.0))
    assert (len(lines), display.now.iteration) == (1, 4)


def console(*, terminal: bool, width: int = 80) -> Console:
    return Console(
        file=io.StringIO(),
        force_terminal=terminal,
        width=width,
        highlight=False,
        legacy_windows=False,
    )


def test_a_terminal_has_one_display_that_goes_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socp.cli.progress._LIVE", 0.0)
    on = console(terminal=True)
    with progress(on, "auv, auto", quiet=False) as watch:
        watch(Progress("word", 3, 2.0, 1e-3, word="u: " + "+ - " * 60, best=1.25, violation=1e-5))
    text = on.file.getvalue()
    for part in (
        "auv, auto: building",
        "auv, auto:",
        "word",
        "3   objective 2   infeasibility 1.0e-03",
        "1.25   violation 1.0e-05",
    ):
        assert part in text
    assert "\u2026" in text  # a long word is cut, not wrapped
    assert "\x1b[2K" in text


def test_what_is_no_terminal_gets_no_line_at_once() -> None:
    plain = console(terminal=False)
    with progress(plain, "p", quiet=False) as watch:
        watch(Progress("ipopt", 0, 1.0, 0.0))
    assert plain.file.getvalue() == ""


def test_quiet_is_silent() -> None:
    loud = console(terminal=True)
    with progress(loud, "p", quiet=True) as watch:
        assert watch is silent
    assert loud.file.getvalue() == ""
