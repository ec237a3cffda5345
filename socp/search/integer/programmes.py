"""Programme files: a problem, with so many switches, for the solvers of other packages."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from socp.errors import MethodError
from socp.methods import default_guess, split
from socp.model import Problem
from socp.process import write_atomic
from socp.search.integer.disjunctive import disjunctive
from socp.search.integer.reduction import binary_modes
from socp.solvers import NLP, pyomo_programme, write_nl
from socp.transcription import collocate, lgr, uniform

FORMATS = {
    "nl": "AMPL's solvers: Knitro, Baron, Couenne, SCIP, Bonmin",
    "pyomo": "a Python script that builds a Pyomo.GDP model",
    "gams": "GAMS",
    "lp": "linear and quadratic programmes only",
}


def programme(problem: Problem, switches: int, points: int) -> tuple[NLP, np.ndarray]:
    """Return the mixed-binary programme with `points` Legendre-Gauss-Radau points an arc, and a
    start (n,).

    The start is the problem's guess on equal arcs, with even shares of all modes. Raises
    MethodError as `binary_modes`.
    """
    reduced = collocate(binary_modes(problem, switches), [uniform(lgr(points), 1)] * (switches + 1))
    return reduced.problem, reduced.push(split(default_guess(problem), [1.0] * (switches + 1))).v


def write(
    problem: Problem,
    path: str | Path,
    *,
    format: str,  # noqa: A002 - as the option of the command is called
    switches: int = 4,
    points: int = 8,
) -> None:
    """Write the mixed-binary programme of a problem to a file, whole or not at all; `format` is one
    of FORMATS.

    Raises MethodError for an unknown format, for a problem that the format cannot hold, and as
    `binary_modes` does.
    """
    if format not in FORMATS:
        raise MethodError(f"no format '{format}' for programmes; there are {', '.join(FORMATS)}")
    if points < 1:
        raise MethodError(f"points={points}: an arc needs 1 collocation point or more")
    if format == "pyomo":
        text = disjunctive(problem, switches, points).script
    else:
        nlp, start = programme(problem, switches, points)
        text = _text(problem, pyomo_programme(nlp, start), format)
    write_atomic(Path(path), text)


def _text(problem: Problem, model: Any, format: str) -> str:  # noqa: A002 - as above
    with tempfile.TemporaryDirectory(prefix="socp-") as place:
        path = (
            Path(place) / f"programme.{'gms' if format == 'gams' else format}"
        )  # Pyomo goes by the ending
        if format == "nl":
            write_nl(model, path)
        else:
            try:
                model.write(str(path))
            except (ValueError, RuntimeError) as error:
                said = " ".join(str(error).split())[:120]
                raise MethodError(
                    f"problem '{problem.name}' cannot be written as {format}, which holds no such "
                    f"functions: {said}; write nl, gams or pyomo"
                ) from error
        return path.read_text(encoding="utf-8")
