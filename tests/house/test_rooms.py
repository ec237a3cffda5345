"""The rooms: one order, imports of another room through its front, and nothing too large to
read.
"""

import ast
import sys
from importlib import import_module
from pathlib import Path

import house
import pytest

ROOT = Path(__file__).parents[2]
FILES = [
    path for room in ("socp", "plugins", "problems") for path in sorted((ROOT / room).rglob("*.py"))
]
CORE = [path for path in FILES if path.is_relative_to(ROOT / "socp")]
# rooms that do not see everything before them
SEES = {
    "laws": {"errors", "process", "model"},
    "solvers": {"errors", "process", "model"},
    "transcription": {"errors", "process", "model", "laws", "solvers"},
    "verdict": {"errors", "process", "model", "laws", "transcription"},
    "proof": {"errors", "process", "model"},
    "view": {"errors", "process", "model"},
    "registry": {"errors", "process", "model", "verdict", "methods"},
}
OTHERS = {  # packages that plugins and problems may use beside socp
    "plugins": {"socp", "socp_plugins", "numpy", "rerun", *sys.stdlib_module_names},
    "problems": {"socp", "casadi", "math", "numpy"},
}


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def packages(tree: ast.AST) -> set[str]:
    """Return the packages that a module imports, at once or late, its own left out."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.partition(".")[0])
        elif isinstance(node, ast.Import):
            found |= {each.name.partition(".")[0] for each in node.names}
    return found


@pytest.mark.parametrize("path", CORE, ids=name_of)
def test_another_room_is_entered_through_its_front(path: Path) -> None:
    module = ".".join(path.relative_to(ROOT / "socp").with_suffix("").parts)
    own = house.room(module)
    if own == "socp":
        return
    before = house.ROOMS[: house.ROOMS.index(own)]
    seen = {own} | SEES.get(own, set(before))
    assert seen - {own} <= set(before)
    for each in house.imports(ast.parse(path.read_bytes())):
        parts = each.module.split(".")
        entered = {parts[1]} if len(parts) > 1 else set(each.names)
        assert entered <= seen, f"{each.module} is no room that {own} sees"
        if parts[-1] != own and own not in parts[1:2]:
            assert len(parts) <= 2, f"{each.module}: import from the front of {parts[1]}"


@pytest.mark.parametrize("path", [path for path in FILES if path not in CORE], ids=name_of)
def test_plugins_and_problems_use_fronts(path: Path) -> None:
    tree, folder = ast.parse(path.read_bytes()), path.relative_to(ROOT).parts[0]
    assert packages(tree) <= OTHERS[folder]
    for each in house.imports(tree):
        assert each.module.count(".") <= (1 if folder == "plugins" else 0), each.module


def test_no_circles_and_no_arrow_back() -> None:
    arrows = house.graph(ROOT)
    assert house.circles(arrows) == []
    assert house.back(house.between(arrows)) == []


@pytest.mark.parametrize("room", [room for room in house.ROOMS if room not in {"errors", "cli"}])
def test_a_front_says_what_it_is_and_hides_no_file(room: str) -> None:
    front = ROOT / "socp" / room / "__init__.py"
    doc = ast.get_docstring(ast.parse(front.read_bytes()))
    assert doc
    assert doc.partition("\n\n")[0].rstrip(".").count(". ") == 0, "one sentence"
    public = [name for name, home in house.homes(ROOT)[room].items() if home]
    files = {path.stem for path in front.parent.glob("*.py")} | {
        path.name for path in front.parent.iterdir()
    }
    assert sorted(public) == sorted(set(public))
    assert not set(public) & files


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_files_can_be_read(path: Path) -> None:
    tree = ast.parse(path.read_bytes())
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    assert len(path.read_bytes().splitlines()) <= 400
    assert [node.name for node in functions if (node.end_lineno or 0) - node.lineno >= 60] == []


@pytest.mark.parametrize("folder", sorted({path.parent for path in CORE}), ids=name_of)
def test_a_room_is_seen_at_a_glance(folder: Path) -> None:
    assert len([path for path in folder.glob("*.py") if path.name != "__init__.py"]) <= 16


def test_the_architecture_page_shows_the_house_as_it_is() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert text == house.written(text, ROOT), "run: python benchmarks/house.py --write"


@pytest.mark.parametrize(
    "room", ["", *(room for room in house.ROOMS if room not in {"errors", "cli"})]
)
def test_every_name_of_a_front_is_there(room: str) -> None:
    front = import_module(f"socp.{room}".rstrip("."))
    names = house.homes(ROOT)[room]
    for name in names:
        assert getattr(front, name) is not None
        assert name in dir(front)
    with pytest.raises(AttributeError, match="nonsense"):
        getattr(front, "nonsense")  # noqa: B009
