"""Tables of many solutions as Parquet files: rows of plain values, and facts about all of them."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from socp import errors
from socp.errors import SolveError

Row = Mapping[str, Any]  # by column


def rows_to_parquet(rows: Sequence[Row], facts: Mapping[str, Any]) -> bytes:
    """Return rows of plain values as a Parquet file, with facts in its metadata.

    Raises MethodError where pyarrow is not installed.
    """
    arrow = errors.load("pyarrow", "export", "a table in Parquet")
    parquet = errors.load("pyarrow.parquet", "export", "a table in Parquet")
    table = arrow.Table.from_pylist([dict(row) for row in rows])
    table = table.replace_schema_metadata({"socp": json.dumps(dict(facts))})
    file = io.BytesIO()
    parquet.write_table(table, file)
    return file.getvalue()


def rows_from_parquet(path: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return the rows and the facts of a table that socp has written; SolveError where a file is
    none, MethodError where pyarrow is not installed.
    """
    arrow = errors.load("pyarrow", "export", "a table in Parquet")
    parquet = errors.load("pyarrow.parquet", "export", "a table in Parquet")
    try:
        table = parquet.read_table(path)
        facts: dict[str, Any] = json.loads(table.schema.metadata[b"socp"])
    except (OSError, KeyError, TypeError, ValueError, arrow.ArrowException) as error:
        raise SolveError(f"{path}: it is no table that socp has written") from error
    rows: list[dict[str, Any]] = table.to_pylist()
    return rows, facts


def columns_from(path: Path) -> dict[str, list[float]]:
    """Return the columns of numbers of a CSV file with a header, or of a Parquet file, by name.

    Raises SolveError for a file that cannot be read as one, MethodError where pyarrow is not
    installed and the file is Parquet.
    """
    try:
        if path.suffix.lower() == ".parquet":
            parquet = errors.load("pyarrow.parquet", "export", "a table in Parquet")
            columns = parquet.read_table(path).to_pydict()
        else:
            with path.open(encoding="utf-8-sig", newline="") as file:
                rows = list(csv.DictReader(file))
            columns = {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}
        return {str(name): [float(each) for each in column] for name, column in columns.items()}
    except (OSError, TypeError, ValueError) as error:
        raise SolveError(f"{path}: it is no table of numbers: {error}") from error
