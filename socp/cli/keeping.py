"""What becomes of results: a better one is never replaced by a worse one, and a disk that fails
loses none.
"""

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, final

from socp.errors import KeepingError, SocpError
from socp.process import signals_held

if TYPE_CHECKING:
    from socp.model import Problem, Solution

ENDING = ".socp.json"
# Relative: objectives of certified results closer than this are equally good, and the newer one
# stays
_ALIKE = 1e-9


@final
@dataclass(frozen=True)
class Place:
    """Where a result was written; `said` is what the user has to know where that is not where it
    was to be.
    """

    path: Path
    said: str = ""
    failed: bool = False

    def tell(self, warn: Callable[[str], None]) -> None:
        """Warn of what the user has to know; KeepingError where the result could not be written
        where it was to be.
        """
        if self.failed:
            raise KeepingError(self.said)
        if self.said:
            warn(self.said)


def keep(problem: "Problem", solution: "Solution", path: Path) -> Place:
    """Write a result, whole: beside the path where a better one is there, elsewhere where the path
    cannot be written.

    Better is what the judge certifies now, for this problem, where the new one is not certified or
    has a higher objective. Raises KeepingError where it can be written nowhere.
    """
    from socp.model import save

    with signals_held():
        taken = path.is_file() and _better(problem, path, solution)
        place = path
        if taken:
            place = path.with_name(f"{_stem(path)}.{_kind(solution)}{ENDING}")
        try:
            save(solution, place)
        except (SocpError, OSError) as error:
            return _elsewhere(solution, place, str(error))
    if taken:
        return Place(
            place,
            f"{path} holds a better certified result and stays as it is; this one is in {place}",
        )
    return Place(place)


def _stem(path: Path) -> str:
    return path.name.removesuffix(ENDING) if path.name.endswith(ENDING) else path.stem


def _kind(solution: "Solution") -> str:
    if solution.stop.name == "INTERRUPTED":
        return "interrupted"
    if solution.verdict is None:
        return "unverified"
    return "worse" if solution.extremal else "uncertified"


def _better(problem: "Problem", path: Path, new: "Solution") -> bool:
    """Tell whether a file holds a certified result of this problem that is better; what it says is
    judged anew.
    """
    from socp.methods import check_solution
    from socp.model import load
    from socp.verdict import certified

    try:
        old = load(path)
        if not old.extremal or old.problem != problem.name:
            return False
        if new.extremal and new.objective <= old.objective + _ALIKE * max(
            abs(old.objective), abs(new.objective)
        ):
            return False
        return bool(certified(problem, check_solution(old.method, problem, old)).extremal)
    except (
        SocpError,
        ArithmeticError,
        ValueError,
        KeyError,
        TypeError,
        IndexError,
    ):  # no result of this problem
        return False


def _elsewhere(solution: "Solution", path: Path, error: str) -> Place:
    """Write a result where there is room for it, when its own place cannot be written."""
    from socp.model import save

    for place in _refuges(path):
        try:
            save(solution, place)
        except (SocpError, OSError):
            continue
        return Place(place, f"{error}; the result is in {place}", failed=True)
    raise KeepingError(
        f"{error}; nor can it be written anywhere else, and is lost: make room, and solve again"
    )


def _refuges(path: Path) -> Iterator[Path]:
    """Yield paths of which one may be written: beside, in the folder for temporary files, at
    home.
    """
    name = f"{_stem(path)}.rescued-{os.getpid()}{ENDING}"
    yield path.with_name(name)
    for folder in (tempfile.gettempdir, Path.home):
        with suppress(
            OSError, RuntimeError
        ):  # no folder for temporary files can be written, or there is no home
            yield Path(folder()) / name
