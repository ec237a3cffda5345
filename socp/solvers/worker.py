"""The other end of `socp.solvers.process`: runs one solver in a process that may be ended at any
time.

`python -m socp.solvers.worker MODULE FOLDER` calls `work(job, tell)` of a module with the folder's
`job.json`. What is told is written to the folder at once, a line of JSON each, so that nothing is
lost when the process is ended.
"""

import ctypes
import importlib
import json
import os
import resource
import signal
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

TOLD = "told.jsonl"
Tell = Callable[[Mapping[str, Any]], None]
_PARENT_ENDS = 1  # PR_SET_PDEATHSIG


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
            file.write(json.dumps(record) + "\n")
            file.flush()

        try:
            importlib.import_module(module).work({**job, "folder": folder}, tell)
        except Exception as error:  # noqa: BLE001 - the parent is told of it, whatever it is
            tell({"error": f"{type(error).__name__}: {error}".strip().splitlines()[-1][:300]})


def environment() -> dict[str, str]:
    """Return the environment for such a process in any folder: with Python's search path as it is
    from here.
    """
    places = filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    absolute = os.pathsep.join(str(Path(place).absolute()) for place in places)
    return {**os.environ, **({"PYTHONPATH": absolute} if absolute else {})}


def end_with(parent: int) -> None:
    """Have this process ended with its parent, however that ends; elsewhere than on Linux others
    have to see to it.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PARENT_ENDS, signal.SIGKILL)
    if os.getppid() != parent:  # it has ended already
        sys.exit()


if __name__ == "__main__":
    main(*sys.argv[1:3])
