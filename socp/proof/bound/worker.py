"""The other end of `socp.proof.bound.bounding`: `python -m socp.proof.bound.worker` reads a job,
and tells of every bound as a line of JSON; of the reason where there is none.
"""

import json
import os
import pickle
import sys
from dataclasses import asdict
from typing import IO

from socp.errors import SocpError, load
from socp.process import end_with
from socp.proof.bound.searching import Job, bounds
from socp.proof.bound.told import LowerBound


def main(given: IO[bytes], told: IO[str]) -> None:
    """Do the job that is given."""
    job: Job = pickle.loads(given.read())  # noqa: S301 - the parent wrote it
    end_with(job.parent)
    found: LowerBound | None = None
    try:
        load("cvxpy", "prove", "a lower bound")  # its seconds are not those of a programme
        for found in bounds(job):
            print(json.dumps(asdict(found)), file=told, flush=True)
    except (SocpError, MemoryError) as error:
        if found is None:
            none = LowerBound(problem=job.problem.name, reason=str(error) or type(error).__name__)
            print(json.dumps(asdict(none)), file=told)


if __name__ == "__main__":
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as own:
        os.dup2(2, 1)  # whatever else prints
        main(sys.stdin.buffer, own)
