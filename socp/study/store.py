"""Finished starts of a census, kept on disk: what they came to, as data, for one formula of a
problem.
"""

import hashlib
import json
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from socp.errors import ProblemError, SolveError
from socp.methods import default_guess
from socp.model import Problem, from_json, to_json
from socp.process import write_atomic
from socp.study.clusters import Outcome

_SCHEMA = 2  # version of the files
_KEPT = 8  # digits of the key in a file's name: problems of other numbers stand beside each other


@final
@dataclass(frozen=True)
class Store:
    """A directory of finished starts, one JSON file each.

    Files of another problem or recipe count for nothing, nor do files that are not as they were
    written.
    """

    folder: Path
    key: str

    def read(self) -> dict[int, Outcome]:
        """Return the outcomes that are there, by number; what cannot be read is not there."""
        found = {}
        for path in sorted(self.folder.glob("start-*.json")):
            try:
                document = json.loads(path.read_text(encoding="utf-8"))
                whole = document.pop("checksum") == _checksum(document)
                if whole and document["schema"] == _SCHEMA and document["key"] == self.key:
                    result = document["result"]
                    solution = None if result is None else from_json(json.dumps(result))
                    outcome = Outcome(
                        int(document["start"]), document["about"], solution, document["error"]
                    )
                    found[outcome.number] = outcome
            except (
                OSError,
                ValueError,
                KeyError,
                TypeError,
                AttributeError,
                RecursionError,
                SolveError,
            ):
                continue
        return found

    def write(self, outcome: Outcome) -> None:
        """Keep an outcome; SolveError names the file that cannot be written."""
        path = self.folder / f"start-{outcome.number:04d}-{self.key[:_KEPT]}.json"
        result = None if outcome.solution is None else json.loads(to_json(outcome.solution))
        document = {
            "schema": _SCHEMA,
            "key": self.key,
            "start": outcome.number,
            "about": outcome.about,
        }
        document |= {"error": outcome.error, "result": result}
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise SolveError(f"{self.folder}: cannot be made: {error.strerror or error}") from error
        write_atomic(
            path, json.dumps({**document, "checksum": _checksum(document)}, allow_nan=False)
        )


def _checksum(document: dict[str, Any]) -> str:
    """Return a hash of all that a file says: what was altered on the disk, or by hand, is not
    believed.
    """
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


def fingerprint(problem: Problem, recipe: str) -> str:
    """Return a hash of a problem, of its guess, and of the recipe of starts and a version of socp
    that it holds.

    A problem that cannot be written as data is known again by nothing: its starts are never taken
    up again.
    """
    try:
        key = problem.fingerprint
    except ProblemError:
        key = secrets.token_hex()
    guess = default_guess(problem)
    values = [
        guess.t.tolist(),
        guess.rows("x").tolist(),
        guess.rows("u").tolist(),
        dict(guess.parameters),
    ]
    return hashlib.sha256(repr((recipe, key, values)).encode()).hexdigest()
