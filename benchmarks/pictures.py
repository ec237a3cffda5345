"""The pictures of the documentation, its gallery page and the outputs of its notebook, all made
anew.

Run as `python benchmarks/pictures.py [NAME ...]`; without names everything is made.
"""

import argparse
import re
import tempfile
from pathlib import Path

from socp import load
from socp.cli import main as socp
from socp.registry.plugins import Registry

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGE = DOCS / "gallery.md"
NOTEBOOK = DOCS / "tutorial.ipynb"
PANELS = "scene,controls,switching,states"
STORIES = ("bioreactor", "crane")  # tutorials that write a problem of their own
STORY = "controls,switching,states"
FRONT = "scene,controls,switching"  # of README's picture

HEAD = """# Gallery

Every problem that comes with socp, solved from a cold start by `socp solve NAME`, drawn by
`socp plot NAME.socp.json --panels scene,controls,switching,states`.

Shaded arcs are at the lower bound (min), at the upper bound (max), singular, or on a state
constraint (boundary). Dashed lines are bounds, dotted lines switching times, σ the switching
function of a control: at its lower bound where it is positive. [Figures](figures.md) says how to
make such pictures, and [problems](problems/index.md) what is known of each problem.
`python benchmarks/pictures.py` makes this page anew.
"""


def command(*words: str) -> None:
    """Run a command of socp, which has to succeed."""
    code = socp(words)
    if code:
        raise SystemExit(f"socp {' '.join(words)}: exit code {code}")


def section(name: str, title: str, result: Path) -> str:
    """Solve a problem, draw it and return its part of the page."""
    command("solve", name, "--quiet", "--out", str(result))
    command(
        "plot",
        str(result),
        "--panels",
        PANELS,
        "-o",
        str(DOCS / "images" / "gallery" / f"{name}.svg"),
    )
    if name == "auv":
        command(
            "plot",
            str(result),
            "--panels",
            FRONT,
            "--stretch",
            "-o",
            str(DOCS / "images" / "auv.svg"),
        )
    solution = load(result)
    judged = (
        "an extremal of Pontryagin's principle"
        if solution.extremal
        else "approximately extremal, not certified"
        if solution.verdict is not None and solution.verdict.approximate
        else "feasible, not certified as an extremal"
    )
    return (
        f"## `{name}`\n\n{title}. Word `{solution.word}`, objective {solution.objective:.10g}; "
        f"{judged}.\n\n![{title}](images/gallery/{name}.svg)\n"
    )


def story(name: str) -> None:
    """Solve the problem that a tutorial writes, and draw its picture."""
    found = re.search(
        rf'^```python title="{name}.py"\n(.*?)^```$',
        (DOCS / f"{name}.md").read_text(encoding="utf-8"),
        re.MULTILINE | re.DOTALL,
    )
    assert found is not None
    with tempfile.TemporaryDirectory() as folder:
        problem, result = Path(folder) / f"{name}.py", str(Path(folder) / "result.socp.json")
        problem.write_text(found[1], encoding="utf-8")
        command("solve", str(problem), "--quiet", "--out", result)
        picture = str(DOCS / "images" / f"{name}.svg")
        command("plot", result, "--panels", STORY, "--width", "4.8", "-o", picture)


def notebook() -> None:
    """Run the tutorial and keep what it shows, without the times at which it ran."""
    import nbformat
    from nbclient import NotebookClient

    found = nbformat.read(NOTEBOOK, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(found, resources={"metadata": {"path": folder}}).execute()
    for cell in found.cells:
        cell.metadata.pop("execution", None)
    nbformat.write(found, NOTEBOOK)


def main() -> None:
    """Make the pictures of the named problems, or of all, and then the page and the notebook."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    chosen = parser.parse_args().names
    registry = Registry.load()
    (DOCS / "images" / "gallery").mkdir(parents=True, exist_ok=True)
    own = sorted(
        name for name, each in registry.entries.items() if each.package.startswith("socp ")
    )
    with tempfile.TemporaryDirectory() as folder:
        results = Path(folder) / "result.socp.json"
        parts = [section(name, registry.problem(name).title, results) for name in chosen or own]
    if not chosen:
        PAGE.write_text("\n".join([HEAD, *parts]), encoding="utf-8")
        for name in STORIES:
            story(name)
        notebook()


if __name__ == "__main__":
    main()
