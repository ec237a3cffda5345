"""Exports of a solution: its values at the nodes as CSV, NetCDF, MAT and Parquet files and as an
xarray Dataset.

All of them hold the numbers bit for bit. With the problem at hand they hold units, switching
functions and the Hamiltonian as well.
"""

import csv
import io
import json
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from socp import errors
from socp.model import known_problem
from socp.view.traces import traces

if TYPE_CHECKING:
    from socp.model import Problem, Sensitivities, Solution


def unit(problem: "Problem | None", name: str) -> str:
    """Return the unit of a quantity by its name, empty where none is known."""
    return "" if problem is None else problem.unit(name)


def attributes(solution: "Solution") -> dict[str, Any]:
    """Return what is known of a solution as a whole, as texts, numbers and lists of numbers."""
    from socp.model import rung_of

    return {
        "problem": solution.problem,
        "method": solution.method,
        "objective": solution.objective,
        "stop": solution.stop.name,
        "word": solution.word,
        "switches": solution.switches,
        "initial_time": solution.initial_time,
        "final_time": solution.final_time,
        "options": json.dumps(dict(solution.options)),
        "versions": json.dumps(dict(solution.origin.versions)),
        "extremal": {None: "not judged", True: "yes", False: "no"}[solution.extremal],
        "rung": rung_of(solution).name if solution.verdict else "",
    }


def to_xarray(solution: "Solution", problem: "Problem | None" = None) -> Any:
    """Return an xarray.Dataset over the dimensions time, state, control, constraint and parameter.

    Variables: states and costates (state, time), controls (control, time), multipliers (constraint,
    time), parameters (parameter), and of the problem switching_functions (control, time) and
    hamiltonian (time). Times increase and stand once: `.sel(time=1, method="nearest")` and
    `.interp(time=...)` work. At a switch these are the values after it; those before it are under
    the same names with `_before`, over the dimension junction, whose coordinate is its time. `arc`
    is the number of the arc, from 1. Units are attributes: of `time` as such, of the others as
    "x: m, y: m". A node without distance to the next is left out; `to_frame` has all of them.

    Raises MethodError where xarray is not installed.
    """
    by_node = nodes_to_xarray(solution, problem)
    times, first = np.unique(solution.t, return_index=True)
    last = solution.t.size - 1 - np.unique(solution.t[::-1], return_index=True)[1]
    found = by_node.isel(node=last).swap_dims(node="time")
    junctions = np.searchsorted(times, np.unique(solution.junctions))
    before = by_node.isel(node=first[junctions]).drop_vars(["time", "arc"])
    for name, values in before.data_vars.items():
        if "node" in values.dims:
            found[f"{name}_before"] = values.rename(node="junction")
    return found.assign_coords(junction=times[junctions])


def nodes_to_xarray(solution: "Solution", problem: "Problem | None" = None) -> Any:
    """Return the same over all nodes: in place of time and junction it has the dimension node, with
    `time` and `arc` as coordinates, a switching time twice, once on either arc.
    """
    xarray = errors.load("xarray", "export", "an xarray Dataset")
    problem = problem or known_problem(solution)
    named, values = _blocks(solution, problem), {}
    names = {
        "state": solution.state_names,
        "control": solution.control_names,
        "parameter": tuple(solution.parameters),
    }
    names["constraint"] = tuple(_multipliers(solution))
    for name, (dimensions, array) in named.items():
        rows = names.get(dimensions[0], ()) if name in {"states", "controls", "parameters"} else ()
        text = ", ".join(f"{each}: {u}" for each in rows if (u := unit(problem, each)))
        values[name] = (dimensions, array, {"units": text} if text else {})
    coordinates: dict[str, Any] = {kind: list(each) for kind, each in names.items() if each}
    time = unit(problem, "time")
    coordinates["time"] = ("node", solution.t, {"units": time} if time else {})
    coordinates["arc"] = ("node", _arcs(solution))
    return xarray.Dataset(values, coordinates, attributes(solution))


def derivatives_to_xarray(found: "Sensitivities") -> Any:
    """Return derivatives as an xarray.Dataset: `objective`, `initial_time` and `final_time`
    (datum), `junctions` (datum, junction), `parameters` (datum, parameter) and `states` (datum,
    time, state).

    The coordinate of a junction is its time; each value is per unit of its datum.

    Raises MethodError where xarray is not installed.
    """
    xarray = errors.load("xarray", "export", "an xarray Dataset")
    first, rows = found[0], tuple(found)
    values: dict[str, Any] = {
        name: ("datum", [getattr(each, name) for each in rows])
        for name in ("objective", "initial_time", "final_time")
    }
    values["junctions"] = (("datum", "junction"), [each.junctions for each in rows])
    parameters = [list(each.parameters.values()) for each in rows]
    values["parameters"] = (("datum", "parameter"), parameters)
    states = np.reshape(
        [list(each.states.values()) for each in rows], (len(rows), -1, len(found.states))
    )
    values["states"] = (("datum", "time", "state"), states)
    coordinates = {
        "datum": [each.to for each in rows],
        "junction": list(found.junctions),
        "parameter": list(first.parameters),
        "time": list(first.states),
        "state": list(found.states),
    }
    return xarray.Dataset(values, coordinates, {"problem": found.problem, "word": found.word})


def table(solution: "Solution", problem: "Problem | None" = None) -> dict[str, np.ndarray]:
    """Return the columns of a flat table by name, one row a node: time, arc, states, controls and
    what else is known.

    Costates are named `lambda_x`, switching functions `sigma_r`, the Hamiltonian `H`, densities of
    the multipliers of state constraints `mu_u.upper`; a name that is taken gets underscores.
    """
    prefixes = {
        "states": "",
        "controls": "",
        "costates": "lambda_",
        "switching_functions": "sigma_",
    }
    names = {"state": solution.state_names, "control": solution.control_names}
    columns: dict[str, np.ndarray] = {"time": solution.t, "arc": _arcs(solution)}
    problem = problem or known_problem(solution)

    def add(name: str, values: np.ndarray) -> None:
        """Add a column, under a name of its own."""
        while name in columns:
            name += "_"
        columns[name] = values

    for block, ((kind, *_), array) in _blocks(solution, problem).items():
        if block in prefixes:
            for name, row in zip(names[kind], array, strict=True):
                add(prefixes[block] + name, row)
    if problem is not None:
        add("H", traces(problem, solution).hamiltonian)
    for name, values in _multipliers(solution).items():
        add(f"mu_{name}", values)
    return columns


def to_frame(solution: "Solution", problem: "Problem | None" = None) -> Any:
    """Return a table as a pandas.DataFrame with the times as its index: a switch stands twice, once
    on either arc, so a line drawn through a column jumps there. Units are under `attrs["units"]`.

    Raises MethodError where pandas is not installed.
    """
    pandas = errors.load("pandas", "export", "a pandas DataFrame")
    problem = problem or known_problem(solution)
    columns = table(solution, problem)
    frame = pandas.DataFrame(
        {name: values for name, values in columns.items() if name != "time"},
        index=pandas.Index(columns["time"], name="time"),
    )
    frame.attrs["units"] = {name: u for name in columns if (u := unit(problem, name))}
    return frame


def to_csv(solution: "Solution", problem: "Problem | None" = None) -> bytes:
    """Return a table in CSV: a header, then a row a node, numbers in 17 digits, nan where unknown.

    A name in the header is followed by its unit in brackets where the problem has one.
    """
    problem = problem or known_problem(solution)
    columns, file = table(solution, problem), io.StringIO(newline="")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow([f"{name} [{u}]" if (u := unit(problem, name)) else name for name in columns])
    arc = list(columns).index("arc")
    for row in zip(*columns.values(), strict=True):
        writer.writerow(
            [str(int(value)) if k == arc else f"{value:.17g}" for k, value in enumerate(row)]
        )
    return file.getvalue().encode()


def to_parquet(solution: "Solution", problem: "Problem | None" = None) -> bytes:
    """Return a table in Parquet, with units as metadata of its columns and facts about the solution
    as its own.
    """
    problem = problem or known_problem(solution)
    arrow = errors.load("pyarrow", "export", "format parquet")
    parquet = errors.load("pyarrow.parquet", "export", "format parquet")
    columns = table(solution, problem)
    meta = {name: {"units": u} if (u := unit(problem, name)) else {} for name in columns}
    fields = [
        arrow.field(k, arrow.from_numpy_dtype(v.dtype), metadata=meta[k])
        for k, v in columns.items()
    ]
    facts = {**attributes(solution), "parameters": dict(solution.parameters)}
    schema = arrow.schema(fields, metadata={"socp": json.dumps(facts)})
    file = io.BytesIO()
    parquet.write_table(
        arrow.table([arrow.array(each) for each in columns.values()], schema=schema), file
    )
    return file.getvalue()


def to_netcdf(solution: "Solution", problem: "Problem | None" = None) -> bytes:
    """Return the dataset of `nodes_to_xarray` as a NetCDF 3 file."""
    errors.load("xarray", "export", "format netcdf")
    dataset = nodes_to_xarray(solution, problem)
    dataset.attrs = {
        name: value for name, value in dataset.attrs.items() if not isinstance(value, list) or value
    }
    return bytes(dataset.to_netcdf(None, engine="scipy", format="NETCDF3_64BIT"))


def to_mat(solution: "Solution", problem: "Problem | None" = None) -> bytes:
    """Return a MAT 5 file with a struct `result`, laid out as users of GPOPS-II know it.

    `result.solution.phase(i)` has an arc's time (n, 1), state (n, nx), control (n, nu) and costate
    (n, nx), a node a row, and `modes`, one text a control; `result.solution.parameter` (1, np);
    `result.objective`. `result.names` and `result.units` hold the names and units of the columns.
    """
    problem = problem or known_problem(solution)
    from scipy.io import savemat

    fields = ("time", "state", "control", "costate", "modes")
    phases = np.empty((1, len(solution.arcs)), dtype=[(name, object) for name in fields])
    for k, arc in enumerate(solution.arcs):
        phases[0, k] = (
            arc.t[:, None],
            arc.x.T,
            arc.u.T,
            arc.costate.T,
            _texts(map(str, arc.modes)),
        )
    names = {
        "state": solution.state_names,
        "control": solution.control_names,
        "parameter": tuple(solution.parameters),
    }
    result = {
        "solution": {
            "phase": phases,
            "parameter": np.array([list(solution.parameters.values())], dtype=float),
        },
        **attributes(solution),
        "names": {kind: _texts(each) for kind, each in names.items()},
        "units": {
            kind: _texts([unit(problem, name) for name in each]) for kind, each in names.items()
        },
    }
    result["units"]["time"] = unit(problem, "time")
    file = io.BytesIO()
    savemat(file, {"result": result}, oned_as="row", long_field_names=True)
    return file.getvalue()


Writer = Callable[["Solution", "Problem | None"], bytes]
WRITERS: Mapping[str, Writer] = {
    "csv": to_csv,
    "netcdf": to_netcdf,
    "mat": to_mat,
    "parquet": to_parquet,
}


def _blocks(
    solution: "Solution", problem: "Problem | None"
) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Return the dimensions and values of all variables by name, those without a row left out."""
    found: dict[str, tuple[tuple[str, ...], np.ndarray]] = {
        "states": (("state", "node"), solution.rows("x")),
        "controls": (("control", "node"), solution.rows("u")),
        "costates": (("state", "node"), solution.rows("costate")),
    }
    if problem is not None:
        along = traces(problem, solution)
        found["switching_functions"] = (("control", "node"), along.switching)
        found["hamiltonian"] = (("node",), along.hamiltonian)
    found["multipliers"] = (("constraint", "node"), np.array(list(_multipliers(solution).values())))
    found["parameters"] = (
        ("parameter",),
        np.array(list(solution.parameters.values()), dtype=float),
    )
    return {name: each for name, each in found.items() if each[1].size}


def _multipliers(solution: "Solution") -> dict[str, np.ndarray]:
    """Return the densities (n,) of all constraints' multipliers by name, nan on arcs that have
    none.
    """
    names = dict.fromkeys(name for arc in solution.arcs for name in arc.multipliers)

    def values(name: str) -> Iterator[np.ndarray]:
        """Yield a multiplier arc by arc, nan where there is none."""
        for arc in solution.arcs:
            yield arc.multipliers.get(name, np.full(arc.t.size, np.nan))

    return {name: np.concatenate(list(values(name))) for name in names}


def _arcs(solution: "Solution") -> np.ndarray:
    """Return the number of the arc of every node (n,), from 1."""
    return np.repeat(
        np.arange(1, len(solution.arcs) + 1, dtype=np.int32), [arc.t.size for arc in solution.arcs]
    )


def _texts(names: Any) -> np.ndarray:
    """Return texts as a row that MATLAB reads as a cell array."""
    return np.array([list(names)], dtype=object)
