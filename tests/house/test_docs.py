"""The documentation is run: every page reads as one session, and its tables name what there is.

On a page, ```python fences share a namespace and a temporary working directory. A fence with a
title such as `title="rocket.py"` is a file of that session. A ```text fence titled "prints" is the
exact output of the fence before it; of one titled "looks like" the lines begin with the same words.
In ```bash and ```console fences the lines that start with `socp` are run; `# exit 3` after one
states its exit code.
"""

import ast
import contextlib
import dataclasses
import io
import re
import shlex
import sys
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import click
import pytest
from socp_plugins.collocation import TABLE
from test_auto import FULLER, spelt

import socp as public
from socp.cli import main
from socp.cli.app import socp
from socp.cli.commands.describing import option_rows
from socp.cli.session import Exit
from socp.methods.chain import run
from socp.methods.contract import Method, options
from socp.methods.guess import default_guess
from socp.model.problem import Problem
from socp.model.result.arc import Arc
from socp.model.result.findings import Feasibility, Verdict
from socp.model.result.records import Effort, Judgement, Origin
from socp.model.result.solution import Solution, Stop
from socp.model.symbols import final_time
from socp.registry.plugins import Registry

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
FENCE = re.compile(
    r"^```(?P<language>\w+)(?P<info>[^\n]*)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL
)


@dataclasses.dataclass(frozen=True)
class Fence:
    language: str
    title: str
    body: str
    line: int
    heading: str


def fences(page: Path) -> Iterator[Fence]:
    text = page.read_text(encoding="utf-8")
    for match in FENCE.finditer(text):
        title = re.search(r'title="([^"]*)"', match["info"])
        headings = re.findall(r"^#+ (.+)$", FENCE.sub("", text[: match.start()]), re.MULTILINE)
        line = text.count("\n", 0, match.start()) + 2
        yield Fence(match["language"], title[1] if title else "", match["body"], line, headings[-1])


def labels(output: str) -> list[str]:
    """Return the first word of every line that starts at the margin."""
    return [line.split()[0] for line in output.splitlines() if line[:1].strip()]


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


class Session:
    """One reading of a page, in a folder that has the problem files beside it."""

    def __init__(self, page: Path, folder: Path) -> None:
        self.page, self.folder = page, folder
        self.names: dict[str, object] = {"__name__": page.stem}
        (folder / "problems").symlink_to(ROOT / "problems")

    def read(self, fence: Fence, printed: str) -> str:
        if "." in fence.title:
            self.write(fence)
        if fence.language == "python":
            return self.python(fence)
        if fence.language in {"bash", "console"} and fence.heading != "Quick start":
            return "".join(self.command(line) for line in fence.body.splitlines())
        if fence.title == "prints":
            assert printed == fence.body, (
                f"{self.page}:{fence.line}: not what the fence before prints"
            )
        if fence.title == "looks like":
            assert labels(printed) == labels(fence.body), (
                f"{self.page}:{fence.line}: not what the fence before shows"
            )
        return ""

    def write(self, fence: Fence) -> None:
        (self.folder / fence.title).write_text(fence.body, encoding="utf-8")
        if fence.title == "pyproject.toml":  # what an installation would leave on the path
            project = tomllib.loads(fence.body)["project"]
            name, version = project["name"], project["version"]
            info = self.folder / f"{name.replace('-', '_')}-{version}.dist-info"
            info.mkdir()
            (info / "METADATA").write_text(
                f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
            )
            points = project["entry-points"].items()
            groups = [
                f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in them.items())
                for group, them in points
            ]
            (info / "entry_points.txt").write_text("\n".join(groups))

    def python(self, fence: Fence) -> str:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.chdir(self.folder):
            code = compile("\n" * (fence.line - 1) + fence.body, name_of(self.page), "exec")
            exec(code, self.names)  # noqa: S102 - our own pages
        return printed.getvalue()

    def command(self, line: str) -> str:
        words = shlex.split(line.removeprefix("$ "), comments=True)
        if not words or words[0] != "socp":
            return ""
        expected = int(stated[1]) if (stated := re.search(r"# exit (\d+)", line)) else 0
        printed, said = io.StringIO(), io.StringIO()
        with (
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(said),
            contextlib.chdir(self.folder),
        ):
            code = main(words[1:])
        assert code == expected, (
            f"{name_of(self.page)}: {line}\nexit {code}\n{printed.getvalue()}{said.getvalue()}"
        )
        return printed.getvalue()


@pytest.fixture
def session(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Session]:
    before = set(sys.modules)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")
    yield Session(page, tmp_path)
    for name in set(sys.modules) - before:
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
@pytest.mark.slow
def test_page_runs_as_one_session(page: Path, session: Session) -> None:
    printed = ""
    for fence in fences(page):
        printed = session.read(fence, printed)


def test_fences_are_found() -> None:
    found = [fence for page in PAGES for fence in fences(page)]
    opened = sum(
        len(re.findall(r"^```\w", page.read_text(encoding="utf-8"), re.MULTILINE)) for page in PAGES
    )
    assert len(found) == opened
    assert {"python", "bash", "text"} <= {fence.language for fence in found}


def test_quick_start_is_one_fence_of_two_commands() -> None:
    (fence,) = [fence for fence in fences(ROOT / "README.md") if fence.heading == "Quick start"]
    lines = fence.body.splitlines()
    assert len(lines) == 2
    assert "pip install" in lines[0]
    assert "socp solve problems/auv.py" in lines[0]
    assert "pytest" in lines[1]


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md"], ids=name_of)
def test_links_to_files_lead_somewhere(page: Path) -> None:
    targets = re.findall(r"\]\(([^)#\s]+)[^)]*\)", FENCE.sub("", page.read_text(encoding="utf-8")))
    missing = [
        target for target in targets if "://" not in target and not (page.parent / target).exists()
    ]
    assert not missing


def table(page: Path, heading: str) -> list[list[str]]:
    """Return the cells of the first table under a heading, without its head."""
    section = page.read_text(encoding="utf-8").split(f"# {heading}\n", 1)[1]
    rows = re.search(r"^\|.*\n\|[-| :]+\n((?:\|.*\n)+)", section, re.MULTILINE)
    assert rows is not None
    return [
        [cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]] for row in rows[1].splitlines()
    ]


def code(cell: str) -> str:
    return cell.strip("`")


@pytest.fixture(scope="module")
def registry() -> Registry:
    return Registry.load()


def built_in(registry: Registry) -> dict[str, type[Method]]:
    own = [plugin for plugin in registry.plugins if plugin.package.startswith("socp ")]
    return {name: registry.methods[name] for plugin in own for name in plugin.methods}


def test_methods_page_lists_every_method_with_its_options(registry: Registry) -> None:
    page = ROOT / "docs" / "methods.md"
    listed = {code(row[0].split(",")[0]) for row in table(page, "Methods")}
    assert listed == set(built_in(registry))
    for name, method in built_in(registry).items():
        shown = [(code(row[0]), code(row[1]), row[2]) for row in table(page, f"`{name}`")]
        assert shown == [
            (option, default, about) for option, _, default, about in option_rows(method)
        ]


def test_readme_shows_methods_with_their_options(registry: Registry) -> None:
    rows = table(ROOT / "README.md", "Methods")
    shown = {code(row[0]): {code(word) for word in row[2].split(", ")} for row in rows}
    wanted = {
        name: {each.name for each in options(method)} for name, method in built_in(registry).items()
    }
    assert shown == {name: wanted[name] - {"backend"} for name in shown}
    grids = {row.name for row in TABLE}
    assert {*built_in(registry)} - grids < set(shown), "grids but one are in docs/methods.md alone"


def commands(group: click.Group, path: str = "socp") -> dict[str, click.Command]:
    """Return all commands by the words that call them, groups replaced by what is in them."""
    found: dict[str, click.Command] = {}
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        words = f"{path} {name}"
        found |= commands(command, words) if isinstance(command, click.Group) else {words: command}
    return found


def spellings(command: click.Command) -> set[str]:
    return {word for each in command.params if isinstance(each, click.Option) for word in each.opts}


def test_commands_page_lists_every_command_with_its_options() -> None:
    page = ROOT / "docs" / "commands.md"
    everything = commands(socp)
    listed = [re.sub(r" [A-Z_]+(\.\.\.)?$", "", code(row[0])) for row in table(page, "Commands")]
    assert sorted(listed) == sorted(everything)
    for words, command in {"socp": socp, **everything}.items():
        rows = table(page, f"`{words}`") if spellings(command) else []
        shown = {word.split()[0] for row in rows for word in re.findall(r"`(-[^`]+)`", row[0])}
        assert shown == spellings(command), words


@pytest.mark.parametrize(
    ("record", "heading"),
    [
        (Solution, "Fields"),
        (Effort, "Effort"),
        (Judgement, "Judgement"),
        (Origin, "Origin"),
        (Arc, "Arcs"),
        (Feasibility, "Feasibility"),
        (Verdict, "Verdict"),
    ],
)
def test_results_page_lists_every_field(record: type[Any], heading: str) -> None:
    rows = table(ROOT / "docs" / "results.md", heading)
    shown = {word for row in rows for word in re.findall(r"`(\w+)`", row[0])}
    assert shown == {each.name for each in dataclasses.fields(record)}


def test_results_page_lists_every_stop_and_exit_code() -> None:
    page = ROOT / "docs" / "results.md"
    assert {code(row[0]): row[1] for row in table(page, "Stop")} == {
        stop.name: stop.value for stop in Stop
    }
    assert {int(row[0]) for row in table(page, "Exit codes")} == {code.value for code in Exit}


DIRECTIVE = re.compile(r"^::: (\S+)\n(?: +options:\n +members: \[([^]]+)\])?", re.MULTILINE)


def test_api_page_has_every_public_name() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    shown = set()
    for module, members in DIRECTIVE.findall(page):
        names = members.split(", ") if members else vars(import_module(module)).keys()
        for name in names:
            assert getattr(import_module(module), name).__doc__ or not members, name
        shown |= set(names)
    symbols = {"time", "initial_time", "final_time", "free", "hookimpl"}  # values, not functions
    assert set(public.__all__) - symbols <= shown
    tasks = {word for row in table_of(page) for word in re.findall(r"`(\w+)`", row)}
    assert set(public.__all__) <= tasks | symbols
    assert all(f"`{name}`" in page for name in symbols)


def test_api_page_uses_what_is_asked_for_most() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    code = " ".join(re.findall(r"```python\n(.*?)```", page, re.DOTALL))
    used = set(re.findall(r"\w+", code)) & set(public.__all__)
    methods = {"Backend", "Ipopt", "Method", "collocate", "hookimpl", "option"}
    methods |= {"single_phase", "solve_collocated", "uniform"}  # on the page "write a method"
    records = {"Kept", "Solution", "Watch", "initial_time"}
    assert set(public.__all__) - used == methods | records


def table_of(page: str) -> list[str]:
    return [line for line in page.splitlines() if line.startswith("| ")]


def test_everything_public_is_imported_by_a_star() -> None:
    names: dict[str, object] = {}
    exec("from socp import *", names)  # noqa: S102 - what is tested
    assert set(public.__all__) <= set(names)
    assert set(public.__all__) <= set(dir(public))
    assert not {"Any", "TYPE_CHECKING"} & set(dir(public))


def test_language_page_lists_every_field() -> None:
    rows = table(ROOT / "docs" / "language.md", "Fields of `Problem`")
    shown = [word for row in rows for word in re.findall(r"`(\w+)`", row[0])]
    assert sorted(shown) == sorted(each.name for each in dataclasses.fields(Problem))


@pytest.mark.parametrize(
    "module",
    [f"model/{name}" for name in ("keys", "checks", "ranges", "parts", "symbols", "word")],
)
def test_language_page_shows_every_refusal(module: str) -> None:
    page = (ROOT / "docs" / "language.md").read_text(encoding="utf-8")
    tree = ast.parse((ROOT / "socp" / f"{module}.py").read_text(encoding="utf-8"))
    calls = [
        node.exc
        for node in ast.walk(tree)
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)
    ]
    longest = [max(texts(call), key=len) for call in calls if texts(call)]
    assert [text for text in longest if text not in page] == []


def texts(call: ast.Call) -> list[str]:
    """Return the fixed parts of the message that an exception is made with."""
    parts = [
        part.value
        for argument in call.args
        for part in ast.walk(argument)
        if isinstance(part, ast.Constant)
    ]
    return [part for part in parts if isinstance(part, str)]


GALLERY = ROOT / "docs" / "problems" / "index.md"


def own_problems(registry: Registry) -> dict[str, Problem]:
    return {
        name: registry.problem(name)
        for name, each in registry.entries.items()
        if each.package.startswith("socp ")
    }


def end_time(problem: Problem, registry: Registry) -> float:
    """Return the final time: fixed, the reference's objective itself, or solved for along the
    reference's word.
    """
    low, high = problem.final_time_box
    if low == high:
        return low
    if str(problem.minimise) == str(final_time):
        return problem.reference.objective
    method = registry.method("lgr-multiphase")(word=problem.reference.word)
    return run(method, problem, default_guess(problem)).final_time


@pytest.mark.slow
def test_gallery_lists_every_problem_with_its_reference(registry: Registry) -> None:
    shown = {code(row[0]): row[1:] for row in table(GALLERY, "Table")}
    problems = own_problems(registry)
    assert set(shown) == set(problems)
    for name, problem in problems.items():
        title, word, objective, tf, source = shown[name]
        reference = problem.reference
        assert (title, source) == (problem.title, problem.source)
        assert code(word) == reference.word or (not reference.word and "infinitely" in word)
        assert objective == f"{reference.objective:.12g}"
        assert float(tf) == pytest.approx(end_time(problem, registry), rel=1e-8)


def test_gallery_shows_what_auto_finds_of_every_problem(registry: Registry) -> None:
    assert [code(row[0]) for row in table(GALLERY, "What `auto` finds")] == sorted(
        own_problems(registry)
    )


FOUND = table(GALLERY, "What `auto` finds")
CERTIFIED = [row for row in FOUND if row[2] == "yes" and "below" in row[3]]


@pytest.mark.parametrize("row", CERTIFIED, ids=lambda row: code(row[0]))
def test_gallery_shows_references_that_auto_certifies(row: list[str], registry: Registry) -> None:
    """That it does so is tested with the method."""
    word = spelt(registry.problem(code(row[0])))
    assert re.sub(r"\[[^]]*\]", "", code(row[1])) == re.sub(r"\[[^]]*\]", "", word)


def test_gallery_shows_the_word_of_what_chatters() -> None:
    """That `auto` finds it, with its objective and no certificate, is tested with the method."""
    (row,) = (row for row in FOUND if row not in CERTIFIED)
    assert [code(row[0]), code(row[1]), row[2]] == ["fuller", FULLER, "no"]
