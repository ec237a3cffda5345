"""`socp export`: a saved result, or the programme of a problem, in the formats of other
programs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, final

import click

from socp.cli.commands.completing import files
from socp.cli.opening import open_result, problem_missing
from socp.cli.session import Exit, Session, writable
from socp.errors import MethodError
from socp.registry import load_problem, suggest


@final
@dataclass(frozen=True, kw_only=True)
class Asked:
    """What `socp export` was asked for."""

    source: str
    format: str | None
    out: str | None
    problem: str | None
    switches: int
    points: int


@final
@dataclass(frozen=True)
class Format:
    """A format: what it is made of, how its files end, what it is, and what writes one."""

    takes: Literal["result", "problem"]
    ending: str
    about: str
    write: Callable[[Session, Asked, Path], None]


def _result(session: Session, asked: Asked, path: Path) -> None:
    """Write the values of a saved result."""
    from socp.process import write_atomic
    from socp.view import WRITERS

    solution, problem = open_result(session, asked.source, asked.problem)
    if problem is None:
        session.note(f"no units and no switching functions: {problem_missing(solution)}")
    write_atomic(path, WRITERS[_chosen(asked)](solution, problem))


def _programme(session: Session, asked: Asked, path: Path) -> None:
    """Write a problem as a mixed-binary programme: arcs that choose their modes."""
    from socp.search import write

    problem = load_problem(asked.source, session.registry())
    write(problem, path, format=_chosen(asked), switches=asked.switches, points=asked.points)


FORMATS: Mapping[str, Format] = {
    "csv": Format("result", ".csv", "a table, one row a node", _result),
    "netcdf": Format("result", ".nc", "named dimensions, units; for xarray and others", _result),
    "mat": Format("result", ".mat", "for MATLAB, in the layout of GPOPS-II", _result),
    "parquet": Format("result", ".parquet", "a table for pandas, polars and databases", _result),
    "nl": Format("problem", ".nl", "for the solvers that read AMPL's files", _programme),
    "pyomo": Format(
        "problem", ".pyomo.py", "a Python script that builds a Pyomo.GDP model", _programme
    ),
    "gams": Format("problem", ".gms", "for GAMS", _programme),
    "lp": Format("problem", ".lp", "for linear and quadratic programmes only", _programme),
}


_COUNT = click.IntRange(max=100)  # files of more arcs or points no solver reads in any useful time


@click.command()
@click.argument("source", metavar="SOURCE", shell_complete=files)
@click.option(
    "--format", metavar="|".join(FORMATS), help="Format.  [default: by the ending of the file]"
)
@click.option(
    "-o", "--out", metavar="FILE", help="File.  [default: SOURCE with the ending of the format]"
)
@click.option(
    "--problem", metavar="FILE_OR_NAME", help="Its problem.  [default: the name in the result]"
)
@click.option(
    "--switches",
    type=_COUNT,
    default=4,
    show_default=True,
    help="Most switches of a problem's programme.",
)
@click.option(
    "--points", type=_COUNT, default=8, show_default=True, help="Its collocation points an arc."
)
@click.pass_obj
def export(session: Session, /, **given: str | None) -> int:
    """Write the values of a saved result, bit for bit, as CSV, NetCDF, MAT or Parquet file.

    With the problem at hand, units, switching functions and the Hamiltonian are written too.

    Of a problem, by path or name, the formats nl, pyomo, gams and lp hold a mixed-binary programme:
    arcs that choose their modes by binaries, collocated at Legendre-Gauss-Radau points.
    """
    asked = Asked(**given)  # type: ignore[arg-type]  # click gives every name, the argument always
    chosen = FORMATS[_chosen(asked)]
    path = writable(
        Path(asked.out) if asked.out else Path(stem(asked.source) + chosen.ending), "-o"
    )
    _check_source(asked, chosen)
    chosen.write(session, asked, path)
    session.tell(path)
    return Exit.SOLVED


def _check_source(asked: Asked, chosen: Format) -> None:
    """Raise MethodError where a problem file is given to a format of results, or the other way
    round.
    """
    given = {".py": "problem", ".json": "result"}.get(Path(asked.source).suffix, chosen.takes)
    if given != chosen.takes:
        others = ", ".join(name for name, each in FORMATS.items() if each.takes == given)
        made = f"but {_chosen(asked)} is made of a {chosen.takes}"
        raise MethodError(f"{asked.source} is a {given}, {made}; for a {given} take {others}")


def stem(source: str) -> str:
    """Return what names the files made of a result or a problem file: the file's name without its
    endings.
    """
    name = Path(source).name
    for ending in (".socp.json", ".json", ".py", ".parquet"):
        name = name.removesuffix(ending)
    return name


def _chosen(asked: Asked) -> str:
    """Return the name of the format: as given, or by the ending of the file."""
    if asked.format is None:
        found = [
            name for name, each in FORMATS.items() if asked.out and asked.out.endswith(each.ending)
        ]
        if not found:
            raise MethodError(
                f"which format? give --format {'|'.join(FORMATS)}, or -o FILE with the ending of "
                "one"
            )
        return found[0]
    if asked.format not in FORMATS:
        raise MethodError(f"no format '{asked.format}'{suggest(asked.format, list(FORMATS))}")
    return asked.format
