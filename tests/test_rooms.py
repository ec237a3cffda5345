"""The rooms: modules of `socp` import only those before them, plugins and problems what they may; all are small."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ORDER = """
    errors extras symbols walk enclosure word schemes tables arc affinity ranges scene traces tabular style panels
    layout figures formula statement notebook verdict records results solution checks problem recording pace drawing
    points brackets factors extremal invariant links singular eliminate contacts principle laws simplify given
    lawbook modes words phases binary kinks nlp lifting collocate reach modelling template disjunctive backends
    structure lessons misses insertion simulate softening meshing guess programmes sampling adjoint ends along
    conditions claims junctions margins fitting method scouting following pmp chain mending rounding layouts minlp
    substitutes hidden shooting polish trust search refine coarse branching spread extremals kept pool census
    neighbours limits frontier standard testing hookspecs entries registry cli
""".split()  # noqa: SIM905
FILES = [path for room in ("socp", "plugins", "problems") for path in sorted((ROOT / room).rglob("*.py"))]
ALLOWED = {
    "plugins": {"socp", "numpy", "rerun", *sys.stdlib_module_names},
    "problems": {"socp", "casadi", "math", "numpy"},
}


def imports(node: ast.AST) -> Iterator[str]:
    """Yield every module that is imported at once or late; what only type checkers see does not count."""
    if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        return
    if isinstance(node, ast.ImportFrom) and node.module:
        yield from ([f"socp.{each.name}" for each in node.names] if node.module == "socp" else [node.module])
    elif isinstance(node, ast.Import):
        yield from (each.name for each in node.names)
    for child in ast.iter_child_nodes(node):
        yield from imports(child)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_rooms(path: Path) -> None:
    tree, (room, name, *_) = ast.parse(path.read_bytes()), path.relative_to(ROOT).with_suffix("").parts
    if room == "socp" and name != "__init__":
        inner = {module.split(".")[1] for module in imports(tree) if module.startswith("socp.")}
        assert inner <= set(ORDER[: ORDER.index(name) + 1])
    elif room != "socp":
        assert {module.split(".")[0] for module in imports(tree)} <= ALLOWED[room]
    assert len(path.read_bytes().splitlines()) <= 250
    assert [f.name for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) and f.end_lineno - f.lineno >= 60] == []
