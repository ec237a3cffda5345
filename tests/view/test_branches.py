"""Tables of many solutions: what is written is read again, and branches are drawn."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from socp.errors import SolveError
from socp.view import draw_branch, rows_from_parquet, rows_to_parquet, to_bytes


def row(value: float, word: str, switches: list[float], **more: Any) -> dict[str, Any]:
    found = {"value": value, "objective": value**2, "word": word, "switches": switches}
    return {**found, "event": "", "time": float("nan"), **more}


ROWS = [
    row(1.0, "u: - s +", [1.0, 2.0]),
    row(2.0, "u: - s +", [1.25, 1.75]),
    row(3.0, "u: - s +", [1.5], event="arc vanishes", time=1.5),
    row(4.0, "u: - +", [1.75]),
]


def test_rows_are_read_as_they_were_written(tmp_path: Path) -> None:
    path = tmp_path / "branch.parquet"
    path.write_bytes(rows_to_parquet(ROWS, {"name": "rate"}))
    rows, facts = rows_from_parquet(path)
    assert facts == {"name": "rate"}
    assert [r["switches"] for r in rows] == [r["switches"] for r in ROWS]
    assert [r["word"] for r in rows] == [r["word"] for r in ROWS]


@pytest.mark.parametrize("content", [b"", b"PAR1", b"nonsense" * 9])
def test_what_is_no_table_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "branch.parquet"
    path.write_bytes(content)
    with pytest.raises(SolveError, match="it is no table that socp has written"):
        rows_from_parquet(path)


def test_words_meet_at_their_event() -> None:
    figure = draw_branch(ROWS, {"name": "rate"}, width=7.0)
    above, below = figure.axes
    assert below.get_xlabel() == "rate"
    lines = [line.get_xydata() for line in below.lines if len(line.get_xdata()) > 2]
    assert np.allclose(lines[0], [[1, 1], [2, 1.25], [3, 1.5]])
    assert np.allclose(lines[1], [[1, 2], [2, 1.75], [3, 1.5]])
    assert [text.get_text() for text in above.get_legend().get_texts()] == ["u: - s +", "u: - +"]
    assert to_bytes(figure, "svg").startswith(b"<?xml")


def test_a_table_of_something_else_is_not_drawn() -> None:
    with pytest.raises(SolveError, match="the table holds no branch"):
        draw_branch([{"value": 1.0}], {}, width=7.0)
