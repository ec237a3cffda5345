"""What notebooks show: well-formed HTML that says what is so; the tutorial runs from top to
bottom.
"""

import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from records import revised

from socp import Problem, Solution, default_guess, errors, run
from socp.errors import MethodError
from socp.model.result.findings import Condition, Finding, Place
from socp.model.result.solution import Stop
from socp.registry.plugins import Registry

ROOT = Path(__file__).parents[2]
TUTORIAL = ROOT / "docs" / "tutorial.ipynb"


class Balanced(HTMLParser):
    """Checks that every element is closed in its turn."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.cells: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:  # noqa: ARG002 - the parser calls it so
        self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: Any) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.cells.append(data)


def seen(html: str) -> str:
    """Return the text that a reader sees of well-formed HTML."""
    parser = Balanced()
    parser.feed(html)
    parser.close()
    assert parser.open == []
    return re.sub(r"\s+", " ", " ".join(parser.cells))


@pytest.fixture(scope="module")
def problem(registry: Registry) -> Problem:
    return registry.problem("goddard_vlimit")


@pytest.fixture(scope="module")
def solution(problem: Problem, registry: Registry) -> Solution:
    return run(
        registry.method("lgr-multiphase")(word=problem.reference.word),
        problem,
        default_guess(problem),
    )


def test_solution_shows_arcs_verdict_and_a_picture(solution: Solution) -> None:
    html = solution._repr_html_()
    text = seen(html)
    assert f"{solution.objective:.12g}" in text
    assert "an answer: an extremal, certified" in text
    assert "u: + s b[v.upper] -" in text
    for _, _, end in solution.structure["u"][:-1]:
        assert f"{end:.12g}" in text
    svg = html[html.index("<svg") : html.index("</svg>") + 6]
    assert len(ET.fromstring(svg).findall(".//{*}path")) > 20  # noqa: S314 - our own text
    assert "http" not in re.sub(r'xmlns[^"]*"[^"]*"|"http://purl.org[^"]*"', "", html)


def test_solution_without_matplotlib_has_no_picture(
    solution: Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    def absent(_module: str, extra: str, _what: str) -> Any:
        raise MethodError(extra)

    monkeypatch.setattr(errors, "load", absent)
    html = solution._repr_html_()
    assert "<svg" not in html
    assert "u: + s b[v.upper] -" in seen(html)


def test_solution_that_nobody_judged(solution: Solution) -> None:
    bare = revised(solution, verdict=None, structure={}, stop=Stop.LIMIT)
    text = seen(bare._repr_html_())
    assert "not judged" in text
    assert Stop.LIMIT.value in text


def test_many_arcs_are_counted(solution: Solution) -> None:
    ringing = tuple((mode, k / 20, (k + 1) / 20) for k, mode in enumerate("+-" * 10))
    text = seen(revised(solution, structure={"u": ringing})._repr_html_())
    assert "(20 arcs)" in text
    assert "19 switches" in text


def test_problem_shows_its_formula(problem: Problem) -> None:
    text = seen(problem._repr_html_())
    for part in (
        problem.name,
        problem.title,
        "m' = -7*u",
        "0 <= u <= 1",
        "m = 0.6",
        "v <= 0.1",
        "minimise",
        "-h",
    ):
        assert part in text


def test_text_of_the_user_is_escaped(problem: Problem) -> None:
    html = replace(problem, title="<script>alert(1)</script> & co")._repr_html_()
    assert "<script>" not in html
    assert "&lt;script&gt;" in html
    assert "& co" in seen(html)


def test_verdict_shows_every_condition(solution: Solution) -> None:
    verdict = solution.verdict
    assert verdict is not None
    text = seen(verdict._repr_html_())
    for finding in verdict.findings:
        assert finding.condition in text
        assert f"{finding.residual:.1e}" in text
    assert "broken" not in text
    broken = replace(
        verdict,
        findings=(
            Finding(
                kind=Condition.OTHER,
                text="one <of> them",
                residual=0.5,
                place=Place(arc=1),
                t=0.25,
            ),
        ),
    )
    text = seen(broken._repr_html_())
    assert "one <of> them" in text
    assert "5.0e-01, broken" in text
    assert "arc 1 at t = 0.25" in text


def test_gallery_has_a_picture_of_every_problem(registry: Registry) -> None:
    page = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    own = {name for name, each in registry.entries.items() if each.package.startswith("socp ")}
    assert set(re.findall(r"^## `(\w+)`$", page, re.MULTILINE)) == own
    for name in own:
        assert f"](images/gallery/{name}.svg)" in page
        picture = ET.parse(ROOT / "docs" / "images" / "gallery" / f"{name}.svg")  # noqa: S314 - our own file
        assert len(picture.findall(".//{*}path")) > 30


def test_gallery_shows_the_words_that_auto_finds() -> None:
    page = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    table = (
        (ROOT / "docs" / "problems" / "index.md")
        .read_text(encoding="utf-8")
        .split("What `auto` finds")[1]
    )
    shown = dict(re.findall(r"^## `(\w+)`\n\n.*?Word `([^`]*)`", page, re.MULTILINE))
    found = dict(re.findall(r"^\| `(\w+)` \| `([^`]*)`", table, re.MULTILINE))
    assert shown == found


def test_tutorial_keeps_what_it_shows() -> None:
    import nbformat

    notebook = nbformat.read(TUTORIAL, as_version=4)
    nbformat.validate(notebook)
    kinds = {
        kind
        for cell in notebook.cells
        for each in cell.get("outputs", [])
        for kind in each.get("data", {})
    }
    assert {"text/html", "image/png"} <= kinds
    assert not [
        each
        for cell in notebook.cells
        for each in cell.get("outputs", [])
        if each.output_type == "error"
    ]


@pytest.mark.slow
def test_tutorial_runs_and_prints_what_it_shows(tmp_path: Path) -> None:
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(TUTORIAL, as_version=4)
    shown = printed(notebook)
    for cell in notebook.cells:
        cell.pop("outputs", None) if cell.cell_type != "code" else cell.update(outputs=[])
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert printed(notebook) == shown
    assert len(shown) >= 3
    assert (tmp_path / "rocket.socp.json").exists()


def printed(notebook: Any) -> list[str]:
    """Return what the cells of a notebook print."""
    outputs = [each for cell in notebook.cells for each in cell.get("outputs", [])]
    return [each.text for each in outputs if each.output_type == "stream" and each.name == "stdout"]
