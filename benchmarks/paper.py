"""The tables and figures of the paper, made anew: doi:10.3934/dcdsb.2019092, tables 1 and 2,
figures 1 to 6.

Run as `python benchmarks/paper.py [--quick]`; --quick takes a tenth of the steps in table 2. It
prints the tables, writes them into docs/paper.md between their marks, and the figures into
docs/images/paper/.
"""

import argparse
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from socp import Ipopt, Problem, Solution, Word, default_guess, run
from socp.methods.guess import guess_along
from socp.methods.solving import Follower
from socp.registry.plugins import Registry

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "paper.md"
IMAGES = ROOT / "docs" / "images" / "paper"

# table 1: points an arc -> t1 .. t4, tf as printed
PRINTED = {
    6: (0.049341739, 0.6454231790, 14.626412022, 14.72348234, 14.956410213),
    8: (0.049051513, 0.6456145668, 14.623890223, 14.72412511, 14.950131513),
    10: (0.049052155, 0.6456134127, 14.623817123, 14.72416201, 14.950161798),
    12: (0.049052100, 0.6456134114, 14.623817653, 14.72416210, 14.950161782),
    14: (0.049052100, 0.6456134114, 14.623817653, 14.72416210, 14.950161782),
}
# table 2: method in the paper, method here and its options, N, tf, iterations and seconds as
# printed
METHODS: tuple[tuple[str, str, dict[str, Any], str, int, float, int, float], ...] = (
    (
        "AMPL + IPOPT, implicit Euler",
        "euler-ipopt",
        {"steps": 1000},
        "steps",
        1000,
        14.941407,
        180,
        1809.557,
    ),
    (
        "ICLOCS, direct transcription",
        "trapezoidal",
        {"steps": 1000},
        "steps",
        1000,
        14.943225,
        1075,
        20.265,
    ),
    (
        "GPOPS, three phases",
        "lgr-multiphase",
        {"phases": 3, "points": 40},
        "points",
        80,
        14.949946,
        20682,
        1027.5,
    ),
    ("MBOC, KNITRO", "mboc", {"switches": "4", "points": 14}, "", 14, 14.950161, 6, 4.472),
)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def solved(registry: Registry, problem: Problem, name: str, **options: Any) -> Solution:
    """Solve cold and judge."""
    return run(registry.methods[name](**options), problem, default_guess(problem))


def along(problem: Problem, solution: Solution, points: int) -> Solution:
    """Solve along the word of a solution with one LGR interval of so many points on every arc."""
    word = Word(problem.control_names, tuple(arc.modes for arc in solution.arcs))
    follower = Follower(points=points, intervals=1, backend=Ipopt({"tol": 1e-12}))
    return follower(problem, word, guess_along(problem, solution, word))


def times(solution: Solution) -> list[float]:
    """Return the ends of all arcs."""
    return [*solution.junctions.tolist(), solution.final_time]


def first_table(problem: Problem, word: Solution) -> str:
    """Return table 1, ours above the paper's figures, and the differences of tf from the converged
    value.
    """
    rows, converged = [], word.final_time
    for points, printed in PRINTED.items():
        ours = times(along(problem, word, points))
        rows.append(
            [str(points), "ours", *(f"{t:.9f}" for t in ours), f"{ours[-1] - converged:+.1e}"]
        )
        rows.append(
            ["", "paper", *(f"{t:.9f}" for t in printed), f"{printed[-1] - converged:+.1e}"]
        )
    for points in (18, 24, 30):
        ours = times(along(problem, word, points))
        rows.append(
            [str(points), "ours", *(f"{t:.9f}" for t in ours), f"{ours[-1] - converged:+.1e}"]
        )
    rows.append(["", "converged", *(f"{t:.9f}" for t in times(word)), ""])
    return table(["n", "", "t1", "t2", "t3", "t4", "tf", "tf - converged"], rows)


def spurious(solution: Solution) -> str:
    """Return the words that the search with s = 5 judged, in order."""
    rows = []
    for node in solution.nodes:
        residual = "not judged" if math.isnan(node.residual) else f"{node.residual:.1e}"
        rows.append([f"`{node.word}`", f"{node.objective:.12f}", residual])
    return table(["word tried, arc by arc", "objective", "residual of the principle"], rows)


def second_table(registry: Registry, problem: Problem, factor: int) -> tuple[str, list[Solution]]:
    """Return table 2 and the solutions behind it; steps are divided by the factor."""
    rows, found = [], []
    for title, name, options, scaled, size, objective, iterations, seconds in METHODS:
        chosen = {**options, **({scaled: options[scaled] // factor} if scaled == "steps" else {})}
        began = time.process_time()
        solution = registry.methods[name](**chosen).solve(problem, default_guess(problem))
        spent = time.process_time() - began
        given = ", ".join(f"{key}={value}" for key, value in chosen.items())
        rows.append(
            [
                f"`{name}` ({given})",
                f"{solution.objective:.9f}",
                str(solution.effort.iterations),
                f"{spent:.2f}",
                title,
                str(size),
                f"{objective:.6f}",
                str(iterations),
                f"{seconds:g}",
            ]
        )
        found.append(solution)
    head = ["ours", "tf", "iterations", "CPU s", "the paper's", "N", "tf", "iterations", "CPU s"]
    return table(head, rows), found


# -- figures


def sampled(solution: Solution, which: str) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of x or u, arc after arc, so that jumps between arcs show as
    jumps.
    """
    pieces = []
    for arc in solution.arcs:
        for k in range(len(arc.mesh) - 1):
            a, b = arc.t[arc.mesh[k]], arc.t[arc.mesh[k + 1]]
            t = np.linspace(a, b, 3 if len(arc.mesh) > 100 else 60)
            hair = 1e-9 * (b - a)
            pieces.append((t, arc.at(np.clip(t, a + hair, b - hair), which)))  # type: ignore[arg-type]
    return np.concatenate([t for t, _ in pieces]), np.hstack([values for _, values in pieces])


def draw(number: int, solution: Solution, which: str, names: Sequence[str], title: str) -> None:
    """Draw one figure, a panel a row, as SVG."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams["svg.hashsalt"] = "socp"
    from matplotlib import pyplot as plt

    t, values = sampled(solution, which)
    figure, axes = plt.subplots(
        1, len(names), figsize=(3.2 * len(names), 2.6), layout="constrained"
    )
    for axis, name, row in zip(np.atleast_1d(axes), names, values, strict=True):
        axis.plot(t, row, linewidth=1.0, color="#1f4e79")
        axis.set_xlabel("t")
        axis.set_ylabel(name)
        axis.grid(alpha=0.3)
    figure.suptitle(title, fontsize="medium")
    IMAGES.mkdir(parents=True, exist_ok=True)
    figure.savefig(IMAGES / f"figure-{number}.svg", metadata={"Date": None})
    plt.close(figure)


def figures(problem: Problem, direct: Sequence[Solution], five: Solution, four: Solution) -> None:
    """Draw figures 1 to 6."""
    controls, states = problem.control_names, problem.state_names
    titles = ("Implicit Euler", "Trapezoidal", "Three phases of LGR")
    for number, solution, title in zip((1, 2, 3), direct, titles, strict=True):
        draw(number, solution, "u", controls, f"{title}: controls")
    draw(4, five, "u", controls, "MBOC, s = 5: controls")
    draw(5, four, "u", controls, "MBOC, s = 4: controls")
    draw(6, four, "x", states, "MBOC, s = 4: states")


def put(mark: str, text: str) -> None:
    """Put a text into the page between its marks, and print it."""
    print(f"\n{mark}\n{text}")
    page = PAGE.read_text(encoding="utf-8")
    head, _, rest = page.partition(f"<!-- {mark} -->\n")
    _, end, tail = rest.partition(f"<!-- end of {mark} -->")
    if not end:
        raise SystemExit(f"{PAGE}: no marks of {mark}")
    PAGE.write_text(f"{head}<!-- {mark} -->\n\n{text}\n\n{end}{tail}", encoding="utf-8")


def main() -> None:
    """Make all tables and figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of the steps in table 2")
    quick = parser.parse_args().quick
    registry = Registry.load()
    problem = registry.problem("auv")
    four = solved(registry, problem, "mboc", switches="4", points=14)
    five = solved(registry, problem, "mboc", switches="5", points=20)
    put("table 1", first_table(problem, four))
    put("five switches", spurious(five))
    text, found = second_table(registry, problem, 10 if quick else 1)
    put("table 2", text)
    figures(problem, found[:3], five, four)


if __name__ == "__main__":
    main()
