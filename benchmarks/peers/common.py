"""A problem as every peer is given it, and what every peer gives back."""

import contextlib
import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np


class Statement:
    """A problem: names, formulas as text in Python's signs, boxes (2, n) with None for infinity.

    A running cost is a state `cost`. `relations` <= 0 hold at the end. `guess`: final time.
    """

    def __init__(self, given: Mapping[str, Any]) -> None:
        self.states: list[str] = given["states"]
        self.controls: list[str] = given["controls"]
        self.dynamics: list[str] = given["dynamics"]
        self.objective: str = given["objective"]
        self.relations: list[str] = given["relations"]
        self.box, self.control_box, self.start, self.end, self.horizon = (
            _numbers(given[name]) for name in ("box", "control_box", "start", "end", "horizon")
        )
        self.guess: float = given.get("guess", self.horizon[0, 0])

    @property
    def free(self) -> bool:
        """Whether the final time is free."""
        return bool(self.horizon[0] < self.horizon[1])

    def line(self, count: int) -> np.ndarray:
        """Return states (nx, count) on a straight line from start to end, from start on where the
        end is free.
        """
        first = np.clip(0.0, *self.start)
        last = np.where(self.end[0] == self.end[1], self.end[0], first)
        return np.linspace(first, last, count).T

    @property
    def middle(self) -> np.ndarray:
        """The middles of the controls' boxes (nu,)."""
        return self.control_box.mean(axis=0)

    def rates(self, functions: Any, x: Sequence[Any], u: Sequence[Any]) -> list[Any]:
        """Return the dynamics with the functions of a module for the states and controls given."""
        names = dict(zip([*self.states, *self.controls], [*x, *u], strict=True))
        return [value(text, functions, names) for text in self.dynamics]

    def at_end(self, texts: Sequence[str], functions: Any, x: Sequence[Any], tf: Any) -> list[Any]:
        """Return formulas of the final states and the final time."""
        names = {**dict(zip(self.states, x, strict=True)), "tf": tf}
        return [value(text, functions, names) for text in texts]


def value(text: str, functions: Any, names: Mapping[str, Any]) -> Any:
    """Evaluate a formula that `peers.py` wrote, with the functions of a module."""
    known = ("sin", "cos", "tanh", "exp", "sqrt", "fabs")
    found = {name: getattr(functions, name) for name in known if hasattr(functions, name)}
    return eval(text, {"__builtins__": {}, "pi": np.pi}, {**found, **names})  # noqa: S307


def _numbers(box: Any) -> np.ndarray:
    rows = [[each if each is not None else sign * np.inf for each in row]
            for row, sign in zip(box, (-1, 1), strict=True)]  # fmt: skip
    return np.array(rows, dtype=float)


def main(solve: Callable[[Statement], dict[str, Any]]) -> None:
    """Solve the problem in the file that is named, and print what came of it as JSON: `objective`,
    `status`, `u` (nu, n) along time, and the seconds of
    processors, those of other processes that it started among them, from statement to solution.
    """
    statement = Statement(json.loads(Path(sys.argv[1]).read_text()))
    begin = sum(os.times()[:4])
    with contextlib.redirect_stdout(sys.stderr):
        found = solve(statement)
    found["seconds"] = sum(os.times()[:4]) - begin
    found["u"] = [np.ravel(row).tolist() for row in found["u"]]
    found["objective"] = float(np.ravel(found["objective"])[0])
    print(json.dumps(found))
