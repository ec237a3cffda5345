"""Formulas as a problem's statement writes them, in MathML, which browsers set without scripts."""

import ast
import re
from collections.abc import Callable, Mapping
from html import escape

from socp.process import printable
from socp.view.figures.style import letter, parts_of

_LONGEST = 600  # characters of a formula that is set; a longer one is shown as it is written
_SUM, _PRODUCT, _SIGN, _POWER, _ATOM = range(1, 6)  # how tightly what is written binds
_SIGNS: Mapping[type[ast.AST], str] = {
    ast.Add: "+",
    ast.Sub: "−",
    ast.Mult: "⁢",  # invisible: as a product is written by hand
    ast.LtE: "≤",
    ast.Lt: "<",
    ast.Eq: "=",
    ast.NotEq: "≠",
}
_BINDS: Mapping[type[ast.AST], int] = {ast.Add: _SUM, ast.Sub: _SUM, ast.Mult: _PRODUCT}
_THIN = "<mspace width='0.14em'/>"
_ASSIGNED = re.compile(r"(?<![<>=!]) = ")
_AFTER = re.compile(r" (free|where singular|on \S+|on the boundary)$")
_BEFORE = re.compile(r"^([\w.\[\] -]+): ")
_INTEGRAL = "integral of "


class _UnreadableError(Exception):
    """What stands there is no formula that is set here."""


def mathml(line: str) -> str:
    """Return a line of a problem's statement as HTML with its formula in MathML.

    What cannot be read as a formula, or is very long, is shown as it is written.
    """
    before, after = _BEFORE.match(line), _AFTER.search(line)
    inner = line[before.end() if before else 0 : after.start() if after else None]
    try:
        shown = f'<math displaystyle="true">{_terms(inner)}</math>'
    except (SyntaxError, _UnreadableError, RecursionError, MemoryError):
        return f"<code>{escape(printable(line))}</code>"
    head = f"{escape(printable(before[1]))}: " if before else ""
    return head + shown + (f" {escape(after[1])}" if after else "")


def _terms(text: str) -> str:
    """Return a formula, one with a derivative on its left, or a cost with an integral."""
    if len(text) > _LONGEST:
        raise _UnreadableError
    state, dash, rate = text.partition("' = ")
    if dash:
        return f'<mover>{_name(state)}<mo stretchy="false">˙</mo></mover>{_sign("=")}{_set(rate)}'
    point, integral, running = text.partition(_INTEGRAL)
    if integral:
        first = f"{_set(point.removesuffix(' + '))}{_sign('+')}" if point else ""
        inner = _fenced(_parsed(running), _PRODUCT)
        return f"{first}<mo>∫</mo>{inner}<mspace width='0.2em'/><mi>d</mi><mi>t</mi>"
    return _set(text)


def _set(text: str) -> str:
    return _written(_parsed(text))[0]


def _parsed(text: str) -> ast.expr:
    return ast.parse(_ASSIGNED.sub(" == ", text), mode="eval").body


def _written(node: ast.expr) -> tuple[str, int]:
    """Return MathML of an expression, and how tightly its outermost operation binds."""
    for kind, write in _KINDS.items():
        if isinstance(node, kind):
            found: tuple[str, int] = write(node)
            return found
    raise _UnreadableError


def _binary(node: ast.BinOp) -> tuple[str, int]:
    if isinstance(node.op, ast.Div):
        return f"<mfrac>{_row(node.left)}{_row(node.right)}</mfrac>", _PRODUCT
    if isinstance(node.op, ast.Pow):
        return f"<msup>{_fenced(node.left, _ATOM)}{_row(node.right)}</msup>", _POWER
    binds = _BINDS[type(node.op)]
    first, after = _first(node.right), binds + isinstance(node.op, ast.Sub)
    sign = _sign(_SIGNS[type(node.op)])
    if binds == _PRODUCT:  # a number would run into the factor before it
        sign = _sign("·") if isinstance(first, ast.Constant) else f"{sign}{_THIN}"
    if isinstance(first, ast.UnaryOp):
        after = _ATOM
    return f"{_fenced(node.left, binds)}{sign}{_fenced(node.right, after)}", binds


def _first(node: ast.expr) -> ast.expr:
    """Return what an expression begins with."""
    while isinstance(node, ast.BinOp) and not isinstance(node.op, ast.Div):
        node = node.left
    return node


def _unary(node: ast.UnaryOp) -> tuple[str, int]:
    if not isinstance(node.op, ast.USub):
        raise _UnreadableError
    return f"{_sign('−', prefix=True)}{_fenced(node.operand, _PRODUCT)}", _PRODUCT


def _call(node: ast.Call) -> tuple[str, int]:
    if not isinstance(node.func, ast.Name) or node.keywords:
        raise _UnreadableError
    name, inner = node.func.id, [_row(each) for each in node.args]
    if name == "sqrt":
        return f"<msqrt>{inner[0]}</msqrt>", _ATOM
    if name == "fabs":
        return f"<mrow><mo>|</mo>{inner[0]}<mo>|</mo></mrow>", _ATOM
    if name == "exp":
        return f"<msup><mi>e</mi>{inner[0]}</msup>", _POWER
    return f"<mi>{escape(name)}</mi><mo>&#8289;</mo>{_brackets('<mo>,</mo>'.join(inner))}", _ATOM


def _compared(node: ast.Compare) -> tuple[str, int]:
    parts = [_written(node.left)[0]]
    for operation, each in zip(node.ops, node.comparators, strict=True):
        if type(operation) not in _SIGNS:
            raise _UnreadableError
        parts += [_sign(_SIGNS[type(operation)]), _written(each)[0]]
    return "".join(parts), 0


def _listed(node: ast.Tuple) -> tuple[str, int]:
    gap = "<mo>,</mo><mspace width='0.4em'/>"
    return gap.join(_written(each)[0] for each in node.elts), 0


def _constant(node: ast.Constant) -> tuple[str, int]:
    if not isinstance(node.value, (int, float)):
        raise _UnreadableError
    mantissa, _, power = f"{node.value:.12g}".partition("e")
    number = f"<mn>{mantissa}</mn>"
    ten = f"<msup><mn>10</mn>{_integer(int(power))}</msup>" if power else ""
    return (f"{number}{_sign('·')}{ten}", _PRODUCT) if power else (number, _ATOM)


def _integer(value: int) -> str:
    minus = _sign("−", prefix=True) if value < 0 else ""
    return f"<mrow>{minus}<mn>{abs(value)}</mn></mrow>"


_KINDS: Mapping[type[ast.expr], Callable[..., tuple[str, int]]] = {
    ast.BinOp: _binary,
    ast.UnaryOp: _unary,
    ast.Call: _call,
    ast.Compare: _compared,
    ast.Tuple: _listed,
    ast.Constant: _constant,
    ast.Name: lambda node: (_name(node.id), _ATOM),
}


def _name(name: str) -> str:
    """Return a symbol: Greek letters, what stands below."""
    base, below = ("t", ["f"]) if name == "tf" else parts_of(name)
    if not base:
        return f"<mi>{escape(name)}</mi>"
    letters = f"<mi>{escape(letter(base))}</mi>"
    if not below:
        return letters
    under = "<mo>,</mo>".join(f"<mi>{escape(letter(each))}</mi>" for each in below)
    return f"<msub>{letters}<mrow>{under}</mrow></msub>"


def _row(node: ast.expr) -> str:
    return f"<mrow>{_written(node)[0]}</mrow>"


def _fenced(node: ast.expr, binds: int) -> str:
    """Return an expression in brackets where it binds less than what stands around it."""
    shown, its = _written(node)
    return f"<mrow>{shown}</mrow>" if its >= binds else _brackets(shown)


def _brackets(shown: str) -> str:
    tall = "<mfrac" in shown or "<msqrt" in shown
    look = "" if tall else ' stretchy="false"'
    return f"<mrow><mo{look}>(</mo>{shown}<mo{look}>)</mo></mrow>"


def _sign(sign: str, *, prefix: bool = False) -> str:
    form = ' form="prefix"' if prefix else ""
    return f"<mo{form}>{escape(sign)}</mo>"
