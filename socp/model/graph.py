"""Is an expression affine in given symbols? Decided by walking through its operations, kinks and
steps included.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import casadi

from socp.errors import MethodError
from socp.model.symbols import Expr

_SUMS = {casadi.OP_ADD, casadi.OP_SUB, casadi.OP_NEG, casadi.OP_TWICE, casadi.OP_ASSIGN}
Held = frozenset[int]  # places of symbols in u
Bent = dict[
    int, int
]  # place in u -> casadi's number of the operation that the symbol enters otherwise than affinely


def not_affine(expression: Expr, u: Expr) -> Bent:
    """Return the places in u (nu, 1) of the symbols that a scalar expression is not affine in, each
    with what bends it.

    A product of two affine factors counts as curved in both, even if later terms cancel it.
    Derivatives would not do: those of sign(u), or of if_else(u > 0, ..), vanish.
    """
    others = [s for s in casadi.symvar(expression) if not casadi.depends_on(s, u)]
    function = casadi.Function("part", [u, casadi.vertcat(*others)], [expression])
    work: dict[
        int, tuple[Held, Bent]
    ] = {}  # register -> (symbols held affinely, symbols held otherwise)
    for k in range(function.n_instructions()):
        operation, output = function.instruction_id(k), function.instruction_output(k)
        if operation == casadi.OP_CONST:
            work[output[0]] = frozenset(), {}
        elif operation == casadi.OP_INPUT:
            argument, place = function.instruction_input(k)
            work[output[0]] = frozenset({place} if argument == 0 else ()), {}
        elif operation == casadi.OP_OUTPUT:
            found = work[function.instruction_input(k)[0]][1]
            return {place: found[place] for place in sorted(found)}
        else:
            work[output[0]] = _combined(
                operation, [work[register] for register in function.instruction_input(k)]
            )
    return {}


def _combined(operation: int, given: list[tuple[Held, Bent]]) -> tuple[Held, Bent]:
    """Return what an operation makes of its arguments."""
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


Operations = Mapping[int, Callable[..., Any]]


def walked(
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
    function = casadi.Function("walked", [symbols], [casadi.densify(expressions)])
    found: list[Any] = [constant(0.0)] * expressions.numel()
    work: dict[int, Any] = {}
    for k in range(function.n_instructions()):
        operation, output = function.instruction_id(k), function.instruction_output(k)
        if operation == casadi.OP_CONST:
            work[output[0]] = constant(float(function.instruction_constant(k)))
        elif operation == casadi.OP_INPUT:
            work[output[0]] = values[function.instruction_input(k)[1]]
        elif operation == casadi.OP_OUTPUT:
            found[output[1]] = work[function.instruction_input(k)[0]]
        else:
            called = operations.get(operation, unknown)
            if called is None:
                raise MethodError(
                    f"the expression holds '{operation_name(operation)}', which has no "
                    "translation here"
                )
            work[output[0]] = called(
                *(work[register] for register in function.instruction_input(k))
            )
    return found


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
