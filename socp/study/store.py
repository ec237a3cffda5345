"""Finished work kept on disk, as data, for one formula of a problem: starts of a census, chains of
a sweep.
"""

import hashlib
import json
import secrets
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from socp.errors import ProblemError, SolveError
from socp.methods import default_guess
from socp.model import Problem, from_json, to_json
from socp.process import write_atomic
from socp.study.clusters import Outcome

_SCHEMA = 2  # version of the files
_UNREADABLE = (ValueError, KeyError, TypeError, AttributeError, RecursionError)
_KEPT = 8  # digits of the key in a file's name: problems of other numbers stand beside each other


@final
@dataclass(frozen=True)
class Drawer:
    """A directory of finished pieces of work, one JSON file each, told apart by a number.

    Files of another kind or key count for nothing, nor do files that are not as they were written.
    """

    folder: Path
    key: str
    kind: str

    def documents(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield number and contents of all files that are there and whole."""
        for path in sorted(self.folder.glob(f"{self.kind}-*.json")):
            try:
                document = json.loads(path.read_text(encoding="utf-8"))
                whole = document.pop("checksum") == _checksum(document)
                if whole and document["schema"] == _SCHEMA and document["key"] == self.key:
                    yield int(document[self.kind]), document
            except (OSError, *_UNREADABLE):
                continue

    def write(self, number: int, contents: Mapping[str, Any]) -> None:
        """Keep a piece of work; SolveError names the file that cannot be written."""
        path = self.folder / f"{self.kind}-{number:04d}-{self.key[:_KEPT]}.json"
        document = {"schema": _SCHEMA, "key": self.key, self.kind: number, **contents}
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise SolveError(f"{self.folder}: cannot be made: {error.strerror or error}") from error
        write_atomic(
            path, json.dumps({**document, "checksum": _checksum(document)}, allow_nan=False)
        )


@final
@dataclass(frozen=True)
class Store:
    """The finished starts of a census, in a drawer."""

    folder: Path
    key: str

    @property
    def _drawer(self) -> Drawer:
        return Drawer(self.folder, self.key, "start")

    def read(self) -> dict[int, Outcome]:
        """Return the outcomes that are there, by number; what cannot be read is not there."""
        found = {}
        for number, document in self._drawer.documents():
            with suppress(SolveError, *_UNREADABLE):
                result = document["result"]
                solution = None if result is None else from_json(json.dumps(result))
                found[number] = Outcome(number, document["about"], solution, document["error"])
        return found

    def write(self, outcome: Outcome) -> None:
        """Keep an outcome; SolveError names the file that cannot be written."""
        result = None if outcome.solution is None else json.loads(to_json(outcome.solution))
        kept = {"about": outcome.about, "error": outcome.error, "result": result}
        self._drawer.write(outcome.number, kept)


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
