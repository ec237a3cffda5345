"""Is an expression affine in given symbols? Decided by walking through its operations, kinks and
steps included.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import casadi

from socp.errors import MethodError
from socp.model.symbols import Expr

Operations = Mapping[int, Callable[..., Any]]

# functions by the names that casadi, Python and most languages give them
TRIGONOMETRIC = ("sin", "cos", "tan", "asin", "acos", "atan")
HYPERBOLIC = ("sinh", "cosh", "tanh")
AREA = ("asinh", "acosh", "atanh")
POWERS = ("exp", "log", "sqrt")
ARITHMETIC: Operations = {
    casadi.OP_ASSIGN: lambda a: a,
    casadi.OP_ADD: lambda a, b: a + b,
    casadi.OP_SUB: lambda a, b: a - b,
    casadi.OP_MUL: lambda a, b: a * b,
    casadi.OP_DIV: lambda a, b: a / b,
    casadi.OP_NEG: lambda a: -a,
    casadi.OP_POW: lambda a, b: a**b,
    casadi.OP_CONSTPOW: lambda a, b: a**b,
    casadi.OP_SQ: lambda a: a**2,
    casadi.OP_TWICE: lambda a: 2 * a,
    casadi.OP_INV: lambda a: 1 / a,
}
_SUMS = {casadi.OP_ADD, casadi.OP_SUB, casadi.OP_NEG, casadi.OP_TWICE, casadi.OP_ASSIGN}
Held = frozenset[int]  # places of symbols in u
Bent = dict[
    int, int
]  # place in u -> casadi's number of the operation that the symbol enters otherwise than affinely


def not_affine(expressions: Expr, u: Expr) -> list[Bent]:
    """Return for each of expressions (m, 1) the places in u (nu, 1) of the symbols that it is not
    affine in, each with what bends it.

    A product of two affine factors counts as curved in both, even if later terms cancel it.
    Derivatives would not do: those of sign(u), or of if_else(u > 0, ..), vanish.
    """
    own = set(casadi.vertsplit(u))
    found = fold(
        expressions,
        casadi.vertcat(u, *(s for s in casadi.symvar(expressions) if s not in own)),
        lambda place: (frozenset({place} if place < u.numel() else ()), {}),
        lambda _number: (frozenset(), {}),
        _combined,
    )
    return [{} if each is None else dict(sorted(each[1].items())) for each in found]


def _combined(operation: int, *given: tuple[Held, Bent]) -> tuple[Held, Bent]:
    """Return what an operation makes of symbols held affinely and of those held otherwise."""
    held: Held = frozenset().union(*(h for h, _ in given))
    curved: Bent = {place: bend for _, its in given for place, bend in its.items()}
    if operation in _SUMS:
        keeps = True
    elif operation == casadi.OP_MUL:
        keeps = not (given[0][0] and given[1][0])
    elif operation == casadi.OP_DIV:
        keeps = not given[1][0]
    elif operation == casadi.OP_IF_ELSE_ZERO:
        keeps = not given[0][0]
    else:
        keeps = not held
    return held, curved if keeps else {**dict.fromkeys(held, operation), **curved}


def fold(
    expressions: Expr,
    symbols: Expr,
    of_symbol: Callable[[int], Any],
    of_number: Callable[[float], Any],
    of_operation: Callable[..., Any],
) -> list[Any]:
    """Return what expressions (m, 1) of symbols (n, 1) come to, step by step as casadi evaluates.

    A value of any kind is made of a symbol's place, of a number, and of an operation's code with
    the values of its arguments. None stands for an expression that is zero throughout.
    """
    function = casadi.Function("traced", [symbols], [casadi.densify(expressions)])
    found: list[Any] = [None] * function.numel_out(0)
    work: dict[int, Any] = {}
    for k in range(function.n_instructions()):
        operation, into = function.instruction_id(k), function.instruction_input(k)
        out = function.instruction_output(k)
        if operation == casadi.OP_CONST:
            work[out[0]] = of_number(float(function.instruction_constant(k)))
        elif operation == casadi.OP_INPUT:
            work[out[0]] = of_symbol(into[1])
        elif operation == casadi.OP_OUTPUT:
            found[out[1]] = work[into[0]]
        else:
            value = of_operation(operation, *(work[register] for register in into))
            work.update(dict.fromkeys(out, value))  # a table has its value and slopes at once
    return found


def nodes(expressions: Expr) -> Iterator[Expr]:
    """Return every part (1, 1) of expressions (m, n) once, arguments before what is made of them.

    Unlike what `fold` makes of codes, parts keep the tables that they look into.
    """
    left, seen = [(each, False) for each in reversed(expressions.nonzeros())], set[int]()
    while left:
        node, entered = left.pop()
        if entered:
            yield node
        elif node.element_hash() not in seen:
            seen.add(node.element_hash())
            left.append((node, True))
            left.extend((node.dep(k), False) for k in reversed(range(node.n_dep())))


def interpret(
    expressions: Expr,
    symbols: Expr,
    values: Sequence[Any],
    operations: Operations,
    constant: Callable[[float], Any] = float,
    unknown: Callable[..., Any] | None = None,
) -> list[Any]:
    """Evaluate expressions (m, 1) of symbols (n, 1) at n values of any kind; returns m of that
    kind.

    `operations` maps casadi's operation codes to functions of values, `constant` makes a value of a
    number. Where an operation is missing, `unknown` is called in its place; without one,
    MethodError names the operation.
    """

    def applied(operation: int, *arguments: Any) -> Any:
        called = operations.get(operation, unknown)
        if called is None:
            named = operation_name(operation)
            raise MethodError(f"the expression holds '{named}', which has no translation here")
        return called(*arguments)

    found = fold(expressions, symbols, values.__getitem__, constant, applied)
    return [constant(0.0) if each is None else each for each in found]


def operation_names(*names: str) -> dict[int, str]:
    """Return the names of operations by casadi's codes."""
    return {int(getattr(casadi, f"OP_{name.upper()}")): name for name in names}


def operation_name(operation: int) -> str:
    """Return the name of an operation code, such as `tanh`."""
    return _names().get(operation, f"operation {operation}")


@cache
def _names() -> dict[int, str]:
    return {
        int(getattr(casadi, name)): name[3:].lower()
        for name in dir(casadi)
        if name.startswith("OP_")
    }
