"""The documentation is run: every page reads as one session, and its tables name what there is.

On a page, ```python fences share a namespace and a temporary working directory. A fence with a title such as
`title="rocket.py"` is a file of that session. A ```text fence titled "prints" is the exact output of the fence before it.
In ```bash and ```console fences the lines that start with `socp` are run; `# exit 3` after one states its exit code.
"""

import contextlib
import dataclasses
import io
import re
import shlex
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from socp.cli import main
from socp.chain import described
from socp.method import options
from socp.solution import Arc, Feasibility, Solution, Stop

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
FENCE = re.compile(r"^```(?P<language>\w+)(?P<info>[^\n]*)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)


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
        yield Fence(match["language"], title[1] if title else "", match["body"], text.count("\n", 0, match.start()) + 2, headings[-1])


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
            assert printed == fence.body, f"{self.page}:{fence.line}: the page shows another output than the fence before it prints"
        return ""

    def write(self, fence: Fence) -> None:
        (self.folder / fence.title).write_text(fence.body, encoding="utf-8")
        if fence.title == "pyproject.toml":  # what an installation would leave on the path
            project = tomllib.loads(fence.body)["project"]
            info = self.folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
            info.mkdir()
            (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
            groups = [f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in them.items()) for group, them in project["entry-points"].items()]
            (info / "entry_points.txt").write_text("\n".join(groups))

    def python(self, fence: Fence) -> str:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.chdir(self.folder):
            exec(compile("\n" * (fence.line - 1) + fence.body, name_of(self.page), "exec"), self.names)  # noqa: S102
        return printed.getvalue()

    def command(self, line: str) -> str:
        words = shlex.split(line.removeprefix("$ "), comments=True)
        if not words or words[0] != "socp":
            return ""
        expected = int(stated[1]) if (stated := re.search(r"# exit (\d+)", line)) else 0
        printed, said = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said), contextlib.chdir(self.folder):
            code = main(words[1:])
        assert code == expected, f"{name_of(self.page)}: {line}\nexit {code}\n{printed.getvalue()}{said.getvalue()}"
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
def test_page_runs_as_one_session(page: Path, session: Session) -> None:
    printed = ""
    for fence in fences(page):
        printed = session.read(fence, printed)


def test_fences_are_found() -> None:
    found = [fence for page in PAGES for fence in fences(page)]
    opened = sum(len(re.findall(r"^```\w", page.read_text(encoding="utf-8"), re.MULTILINE)) for page in PAGES)
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
    missing = [target for target in targets if "://" not in target and not (page.parent / target).exists()]
    assert not missing


def table(page: Path, heading: str) -> list[list[str]]:
    """Return the cells of the first table under a heading, without its head."""
    section = page.read_text(encoding="utf-8").split(f"# {heading}\n", 1)[1]
    rows = re.search(r"^\|.*\n\|[-| :]+\n((?:\|.*\n)+)", section, re.MULTILINE)
    assert rows is not None
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]] for row in rows[1].splitlines()]


def code(cell: str) -> str:
    return cell.strip("`")
