"""The other end of `socp.solvers.process`: runs one solver in a process that may be ended at any
time.

`python -m socp.solvers.worker MODULE FOLDER` calls `work(job, tell)` of a module with the folder's
`job.json`. What is told is written to the folder at once, a line of JSON each, so that nothing is
lost when the process is ended.
"""

import importlib
import json
import resource
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from socp.process import end_with

TOLD = "told.jsonl"
Tell = Callable[[Mapping[str, Any]], None]


def main(module: str, folder: str) -> None:
    """Run the job of a folder."""
    job = json.loads((Path(folder) / "job.json").read_text(encoding="utf-8"))
    limit = (
        int(job["killed_after"]) * 4 + 60
    )  # of processor time, on several threads: should the parent be gone
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
    end_with(job["parent"])
    with (Path(folder) / TOLD).open("w", encoding="utf-8", buffering=1) as file:

        def tell(record: Mapping[str, Any]) -> None:
            """Write a record at once, as a line."""
            file.write(json.dumps(record) + "\n")
            file.flush()

        try:
            importlib.import_module(module).work({**job, "folder": folder}, tell)
        except Exception as error:  # noqa: BLE001 - the parent is told of it, whatever it is
            tell({"error": f"{type(error).__name__}: {error}".strip().splitlines()[-1][:300]})


if __name__ == "__main__":
    main(*sys.argv[1:3])
