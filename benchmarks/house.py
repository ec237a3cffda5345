"""Measure the house: rooms, arrows between them, circles, sizes; and draw its picture into
docs/architecture.md.

`python benchmarks/house.py [ROOT]` prints a table for the checkout at ROOT (this one by default),
so that two states are measured by one ruler. `python benchmarks/house.py --write` writes the table
and the picture of the rooms between the markers of docs/architecture.md; a test holds the page
against the code.
"""

import ast
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import final

HERE = Path(__file__).parents[1]
BEGIN, END = "<!-- rooms: python benchmarks/house.py --write -->", "<!-- end of rooms -->"
WIDE = 100  # characters a line

# A room imports rooms above it, through their front; the order is the whole rule.
ROOMS = (
    "errors",
    "process",
    "model",
    "laws",
    "solvers",
    "transcription",
    "verdict",
    "proof",
    "methods",
    "search",
    "study",
    "view",
    "registry",
    "cli",
)


@final
@dataclass(frozen=True)
class Import:
    """One import of the package by one of its modules: `names` are what is imported from
    `module`.
    """

    module: str
    names: tuple[str, ...]
    late: bool
    types: bool


def modules(root: Path) -> dict[str, Path]:
    """Return the modules of `socp` under a checkout, by dotted name without the package's own."""
    found = {}
    for path in sorted((root / "socp").rglob("*.py")):
        parts = path.relative_to(root / "socp").with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(tree: ast.AST, *, late: bool = False, types: bool = False) -> Iterator[Import]:
    """Yield what a module imports from `socp`, at once, late, or for type checkers only."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "socp":
            yield Import(node.module or "", tuple(each.name for each in node.names), late, types)
        elif isinstance(node, ast.Import):
            mine = tuple(each.name for each in node.names if each.name.split(".")[0] == "socp")
            yield from (Import(name, (), late, types) for name in mine)
        inside = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        guarded = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        yield from imports(node, late=late or inside, types=types or guarded)


def targets(
    each: Import, known: dict[str, Path], fronts: dict[str, dict[str, str]]
) -> Iterator[str]:
    """Yield the modules that an import reaches, names of a lazy front followed to their homes."""
    module = each.module.partition("socp.")[2] if each.module != "socp" else ""
    for name in each.names or ("",):
        inner = f"{module}.{name}".strip(".")
        if inner in known and inner:
            yield inner
        elif name in fronts.get(module, {}):
            yield fronts[module][name]
        elif module:
            yield module


def homes(root: Path) -> dict[str, dict[str, str]]:
    """Return the names of every lazy front with the modules they come from."""
    found: dict[str, dict[str, str]] = {}
    for stub in (root / "socp").rglob("__init__.pyi"):
        room = ".".join(stub.relative_to(root / "socp").parts[:-1])
        lines = [
            node for node in ast.parse(stub.read_text()).body if isinstance(node, ast.ImportFrom)
        ]
        found[room] = {
            name.asname or name.name: f"{room}.{node.module}".strip(".")
            for node in lines
            for name in node.names
        }
    for room, names in found.items():  # the front door leads to fronts
        for name, home in names.items():
            names[name] = found.get(home, {}).get(name, home)
        found[room] = names
    return found


def graph(root: Path, *, types: bool = False) -> dict[str, set[str]]:
    """Return for every module the modules that it imports, late imports among them."""
    known, fronts = modules(root), homes(root)
    arrows: dict[str, set[str]] = {}
    for name, path in known.items():
        found = [each for each in imports(ast.parse(path.read_bytes())) if types or not each.types]
        reached = {target for each in found for target in targets(each, known, fronts)}
        arrows[name] = {each for each in reached if each in known and each != name}
    return arrows


def circles(arrows: dict[str, set[str]]) -> list[list[str]]:
    """Return the strongly connected components of more than one module, the largest first (Tarjan
    1972).
    """
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in arrows.get(node, ()):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            at = stack.index(node)
            component = stack[at:]
            del stack[at:]
            if len(component) > 1:
                found.append(sorted(component))

    for node in arrows:
        if node not in index:
            visit(node)
    return sorted(found, key=len, reverse=True)


def room(module: str) -> str:
    """Return the room of a module; what lies in no room is the front door."""
    first = module.split(".", maxsplit=1)[0]
    return first if first in ROOMS else "socp"


def between(arrows: dict[str, set[str]]) -> dict[str, set[str]]:
    """Return for every room the other rooms that its modules import."""
    found: dict[str, set[str]] = {}
    for module, others in arrows.items():
        found.setdefault(room(module), set()).update(room(each) for each in others)
    return {name: others - {name, "socp"} for name, others in found.items() if name != "socp"}


def back(rooms: dict[str, set[str]]) -> list[str]:
    """Return the arrows that lead to a later room."""
    return [
        f"{name} -> {other}"
        for name, others in rooms.items()
        for other in sorted(others)
        if name in ROOMS and other in ROOMS and ROOMS.index(other) > ROOMS.index(name)
    ]


def sizes(root: Path) -> dict[str, str]:
    """Return lines, the longest function and wide lines of the package and its plugins."""
    paths = [
        path for folder in ("socp", "plugins") for path in sorted((root / folder).rglob("*.py"))
    ]
    texts = {path: path.read_text(encoding="utf-8").splitlines() for path in paths}
    nodes = [node for path in paths for node in ast.walk(ast.parse(path.read_bytes()))]
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef)]
    longest = max(functions, key=lambda node: (node.end_lineno or 0) - node.lineno)
    folders: dict[Path, int] = {}
    for path in paths:
        folders[path.parent] = folders.get(path.parent, 0) + (path.name != "__init__.py")
    crowd, count = max(folders.items(), key=lambda each: each[1])
    lines = sum(map(len, texts.values()))
    wide = sum(len(line) > WIDE for text in texts.values() for line in text)
    thoughts = sum(isinstance(node, ast.expr | ast.stmt) for node in nodes)
    return {
        "modules": str(len(paths)),
        "fullest folder": f"{count} modules in {crowd.relative_to(root)}",
        "lines": f"{lines}, the longest module {max(map(len, texts.values()))}",
        "expressions and statements": str(thoughts),
        "longest function": f"{longest.name}, {(longest.end_lineno or 0) - longest.lineno + 1} "
        "lines",
        f"lines over {WIDE} characters": f"{wide} ({100.0 * wide / lines:.1f} %)",
    }


def measured(root: Path) -> dict[str, str]:
    """Return the figures of a checkout, label by label."""
    arrows = graph(root)
    rooms = between(arrows)
    found, typed = circles(arrows), circles(graph(root, types=True))
    return {
        **sizes(root),
        "rooms": str(len([name for name in rooms if name in ROOMS])),
        "arrows between rooms": str(sum(map(len, rooms.values()))),
        "arrows back": ", ".join(back(rooms)) or "0",
        "circles, late imports counted": ", ".join(f"{len(each)} modules" for each in found) or "0",
        "circles, types counted too": ", ".join(f"{len(each)} modules" for each in typed) or "0",
    }


def page(root: Path) -> str:
    """Return the picture of the rooms and their table, in Markdown."""
    rooms, known = between(graph(root)), modules(root)
    lines = [
        "```text",
        *picture(rooms),
        "```",
        "",
        "| room | what it is | modules |",
        "|---|---|---|",
    ]
    for name in ROOMS:
        doc = (ast.get_docstring(ast.parse(known[name].read_bytes())) or "").partition("\n\n")[0]
        held = [each for each in known if room(each) == name and known[each].name != "__init__.py"]
        lines.append(f"| `{name}` | {' '.join(doc.split()).rstrip('.')} | {len(held)} |")
    return "\n".join(lines)


def picture(rooms: dict[str, set[str]]) -> list[str]:
    """Return the rooms floor by floor, the ground floor last, with the rooms that each one stands
    on.
    """
    floors: dict[int, list[str]] = {}
    floor: dict[str, int] = {}
    for name in ROOMS:
        floor[name] = 1 + max((floor[other] for other in rooms.get(name, ())), default=-1)
        floors.setdefault(floor[name], []).append(name)
    lines = []
    for level in sorted(floors, reverse=True):
        for name in floors[level]:
            direct = {other for other in rooms.get(name, set()) if other in ROOMS}
            covered = {far for other in direct for far in reachable(rooms, other)}
            stands = [other for other in ROOMS if other in direct - covered]
            lines.append(
                f"{level}  {name:14} {'on ' + ', '.join(stands) if stands else ''}".rstrip()
            )
    return lines


def reachable(rooms: dict[str, set[str]], name: str) -> set[str]:
    """Return the rooms that a room imports, those that these import, and so on."""
    found: set[str] = set()
    ahead = list(rooms.get(name, ()))
    while ahead:
        other = ahead.pop()
        if other not in found:
            found.add(other)
            ahead += rooms.get(other, ())
    return found


def written(text: str, root: Path) -> str:
    """Return the text of the architecture page with its part on rooms made anew."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n{page(root)}\n\n{END}{after}"


def main(arguments: list[str]) -> None:
    """Print the figures, or write the page."""
    if arguments == ["--write"]:
        path = HERE / "docs" / "architecture.md"
        path.write_text(written(path.read_text(encoding="utf-8"), HERE), encoding="utf-8")
        return
    for label, value in measured(Path(arguments[0]).resolve() if arguments else HERE).items():
        print(f"{label:32} {value}")


if __name__ == "__main__":
    main(sys.argv[1:])
