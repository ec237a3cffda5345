"""What is shown of a solution: its values along time, its arcs, its picture, and how the solver
came to it.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import final

import numpy as np

from socp.model import EXTREMAL, Arc, Problem, Solution
from socp.view import traces
from socp.view.picture import Picture
from socp.view.recording.items import (
    GREY,
    PALETTE,
    Bars,
    Colour,
    Drawing,
    Item,
    Lane,
    Note,
    Plane,
    Series,
)
from socp.view.recording.plane import drawings
from socp.view.recording.summary import search, summary

LOGARITHMIC = (
    "inf_pr",
    "inf_du",
    "mu",
    "step",
)  # of a solver's trace: spread over many powers of ten
MESHES = 3.0  # width to height of the plane of the meshes, as its panel has in a column of four
BARS = {  # what is shown for every timeline, and what it is called
    "objective": "Objective, distance to the last",
    "inf_pr": "Infeasibility",
    "inf_du": "Dual infeasibility",
    "mu": "Barrier",
}
_UNSAFE = re.compile(r"[^\w./-]")  # what a path would need escapes for


@final
@dataclass(frozen=True)
class Run:
    """A run in a recording: where its paths begin, and the colour and label it has beside others.

    `among` is the picture of the first of several runs, which says to what scale all of them are
    drawn.
    """

    root: str = ""
    colour: Colour | None = None
    label: str = ""
    among: Picture | None = None

    def series(
        self, path: str, at: np.ndarray, values: np.ndarray, name: str, colour: Colour
    ) -> Series:
        """Return a series over the time of the problem, in the run's own colour where it has
        one.
        """
        shown = f"{self.label} {name}".strip()
        return Series(
            path=f"{self.root}/{_UNSAFE.sub('_', path)}",
            timeline="t",
            at=at,
            values=values,
            name=shown,
            colour=self.colour or colour,
        )

    def mark(self, path: str, at: np.ndarray, values: np.ndarray, name: str) -> Series:
        """Return a series beside the curves, grey, named the same in all runs: legends merge what
        is named the same.
        """
        return replace(self.series(path, at, values, name, GREY), name=name)


def items(problem: Problem, solution: Solution, run: Run = Run()) -> list[Item]:
    """Return everything that is shown of a solution."""
    found: list[Item] = list(_along(problem, solution, run))
    found += _arcs(solution, run)
    found += drawings(problem, solution, run.root, run.colour, run.among)
    found.append(Note(path=f"{run.root}/summary", text=summary(problem, solution)))
    found += _verdict(solution, run)
    found += _solver(solution, run)
    found += _search(solution, run)
    return found


def _along(problem: Problem, solution: Solution, run: Run) -> Iterator[Item]:
    """Yield states, controls, costates and what follows from them, at the nodes of the solution."""
    values = traces.traces(problem, solution)
    t, ends = values.t, np.array([solution.initial_time, solution.final_time])
    yield replace(run.series("time", t, t, "time", GREY))
    for k, name in enumerate(problem.state_names):
        colour = PALETTE[k % len(PALETTE)]
        yield run.series(f"states/{name}", t, values.x[k], name, colour)
        yield from _bounds(run, f"states/{name}", ends, problem.state_box[:, k])
        if np.isfinite(values.costate[k]).any():
            yield run.series(f"costates/{name}", t, values.costate[k], name, colour)
    for k, name in enumerate(problem.control_names):
        colour = PALETTE[k % len(PALETTE)]
        at, u = control(solution, k)
        yield run.series(f"controls/{name}", at, u, name, colour)
        yield from _bounds(run, f"controls/{name}", ends, problem.box[:, k])
        switches = np.array([end for _, _, end in solution.structure.get(name, ())[:-1]])
        if switches.size:
            called = (
                name if run.label else "switch"
            )  # as the curve, so that legends of several runs stay short
            marks = run.series(
                f"controls/{name}/switches", switches, solution.at(switches, "u")[k], called, GREY
            )
            yield replace(marks, points=True, width=5.0)
        if np.isfinite(values.switching[k]).any():
            yield run.series(f"switching/{name}", t, values.switching[k], name, colour)
    if np.isfinite(values.switching).any() and run.among is None:
        yield replace(run.mark("switching/zero", ends, np.zeros(2), "zero"), colour=GREY, width=1.0)
    if np.isfinite(values.hamiltonian).any():
        terms = np.nanmax(np.abs(values.costate), axis=1) * np.ptp(values.x, axis=1) / np.ptp(t)
        yield replace(
            run.series("hamiltonian", t, values.hamiltonian, "H", PALETTE[5]),
            magnitude=float(terms.sum()),
        )
    for k, (name, density) in enumerate(values.multipliers.items()):
        known = np.isfinite(density)
        if known.any():
            yield run.series(
                f"multipliers/{name}", t[known], density[known], name, PALETTE[k % len(PALETTE)]
            )


def control(solution: Solution, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,) and values (n,) of control k such that straight lines through them are the
    control.

    The nodes, and where intervals or arcs meet with a jump the values on either side of it.
    """
    parts = [_pieces(arc, k) for arc in solution.arcs]
    return np.concatenate([t for t, _ in parts]), np.concatenate([u for _, u in parts])


def _pieces(arc: Arc, k: int) -> tuple[np.ndarray, np.ndarray]:
    t: list[np.ndarray] = []
    u: list[np.ndarray] = []
    for a, b in pairwise(arc.mesh):
        inside = arc.t[a : b + 1]
        values = arc.at(inside, "u", np.full(inside.size, 0.5 * (arc.t[a] + arc.t[b])))[k]
        stored = arc.u[k, a : b + 1]
        close = np.abs(values - stored) <= 1e-9 * (
            1.0 + np.abs(stored)
        )  # the node's own value, not its rounding
        values = np.where(close, stored, values)
        first = 1 if t and values[0] == u[-1][-1] else 0  # no jump: the node stands once
        t.append(inside[first:])
        u.append(values[first:])
    return np.concatenate(t), np.concatenate(u)


def _bounds(run: Run, path: str, ends: np.ndarray, box: np.ndarray) -> Iterator[Item]:
    for side, bound in zip(("lower", "upper"), box, strict=True):
        if np.isfinite(bound) and run.among is None:
            line = run.mark(f"{path}/{side}", ends, np.full(2, bound), "bound")
            yield replace(line, colour=GREY, width=1.0)


def _arcs(solution: Solution, run: Run) -> Iterator[Item]:
    for name, row in solution.structure.items():
        if row:
            starts, last = [start for _, start, _ in row], row[-1][2]
            states = (*(mode for mode, _, _ in row), "")
            yield Lane(path=f"{run.root}/arcs/{name}", at=np.array([*starts, last]), states=states)


def _verdict(solution: Solution, run: Run) -> Iterator[Item]:
    """Yield the residuals of the principle where they are worst, as powers of ten, and what is
    allowed.
    """
    if solution.verdict is None:
        return
    ends = np.array([solution.initial_time, solution.final_time])
    allowed = run.mark("principle/allowed", ends, np.full(2, np.log10(EXTREMAL)), "allowed")
    if run.among is None:
        yield replace(allowed, colour=GREY, width=1.0)
    names = list(dict.fromkeys(each.condition for each in solution.verdict.findings))
    for k, name in enumerate(names):
        these = [each for each in solution.verdict.findings if each.condition == name]
        at = [solution.final_time if each.t is None else each.t for each in these]
        order = np.argsort(at, kind="stable")
        values = log10(np.array([each.residual for each in these]))[order]
        points = run.series(
            f"principle/{name}", np.array(at)[order], values, name, PALETTE[k % len(PALETTE)]
        )
        yield replace(points, points=True, width=4.0)


def _solver(solution: Solution, run: Run) -> Iterator[Item]:
    """Yield the trace of the solver by iteration, as it is and, where it spans powers of ten, as
    logarithms.
    """
    for k, (name, values) in enumerate(solution.effort.trace.items()):
        colour, at = PALETTE[k % len(PALETTE)], np.arange(len(values), dtype=float)
        plain = run.series(f"solver/{name}", at, np.array(values, dtype=float), name, colour)
        yield replace(plain, timeline="iteration")
        if name in LOGARITHMIC:
            logarithm = log10(plain.values)
            line = replace(
                plain,
                path=f"{run.root}/solver/log10/{name}",
                values=logarithm,
                name=f"log10 {plain.name}",
            )
            yield replace(line, timeline="iteration")
        last = values[-1] if name == "objective" and values else 0.0
        shown = log10(np.abs(plain.values - last))
        if name in BARS and np.isfinite(shown).any():
            yield Bars(
                path=f"{run.root}/solver/bars/{name}",
                at=at,
                values=np.nan_to_num(shown),
                colour=colour,
            )


def _search(solution: Solution, run: Run) -> Iterator[Item]:
    """Yield the nodes of a search and the meshes of refinement."""
    if solution.nodes:
        yield Note(path=f"{run.root}/search/words", text=search(solution))
        at = np.arange(len(solution.nodes), dtype=float)
        for k, name in enumerate(("objective", "bound", "miss", "residual")):
            values = np.array([getattr(node, name) for node in solution.nodes], dtype=float)
            if np.isfinite(values).any():
                shown = log10(values) if name in {"miss", "residual"} else values
                line = run.series(f"search/{name}", at, shown, name, PALETTE[k])
                yield replace(line, timeline="refinement")
                if name == "residual" and np.isfinite(shown).any():
                    bars = np.nan_to_num(shown)
                    path = f"{run.root}/search/bars"
                    yield Bars(path=path, at=at, values=bars, colour=PALETTE[k])
    meshes = [np.array(mesh) for mesh in (*solution.effort.meshes, solution.corners)]
    for k, mesh in enumerate(meshes):
        row = run.series(
            f"mesh/{k}", mesh, np.full(mesh.size, float(k)), f"mesh {k}", PALETTE[k % len(PALETTE)]
        )
        yield replace(row, points=True, width=2.5)
        yield Drawing(
            path=f"{run.root}/mesh/nodes/{k}",
            kind="points",
            points=_mesh_row(mesh, k, meshes),
            colour=PALETTE[k % len(PALETTE)],
        )
    yield Plane(path=f"{run.root}/mesh/nodes", scale=(1.0, 1.0))
    sizes = np.array([mesh.size - 1.0 for mesh in meshes])
    at = np.arange(sizes.size, dtype=float)
    line = run.series("mesh/intervals", at, sizes, "intervals", PALETTE[0])
    yield replace(line, timeline="refinement")
    if sizes.size > 1:
        yield Bars(path=f"{run.root}/mesh/bars", at=at, values=sizes, colour=PALETTE[0])


def _mesh_row(mesh: np.ndarray, k: int, meshes: list[np.ndarray]) -> np.ndarray:
    """Return the nodes of the k-th mesh as points (n, 2) of a row, the first lowest, in a plane of
    width `MESHES` and height 1 which all meshes of a run fill.
    """
    first, last = min(each[0] for each in meshes), max(each[-1] for each in meshes)
    across = MESHES * (mesh - first) / (last - first)
    return np.column_stack([across, np.full(mesh.size, (k + 0.5) / len(meshes))])


def log10(values: np.ndarray) -> np.ndarray:
    """Return the powers of ten of values (n,), nan for zero and below."""
    return np.log10(np.where(values > 0, values, np.nan))
