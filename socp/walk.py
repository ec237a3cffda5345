"""Walk through the operations of casadi expressions with other things than numbers: intervals, Pyomo's, or text."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import casadi

from socp.errors import MethodError
from socp.symbols import Expr

Operations = Mapping[int, Callable[..., Any]]


def walked(
    expressions: Expr, symbols: Expr, values: Sequence[Any], operations: Operations,
    constant: Callable[[float], Any] = float, unknown: Callable[..., Any] | None = None,
) -> list[Any]:  # fmt: skip
    """Evaluate expressions (m, 1) of symbols (n, 1) at n values of any kind; returns m of that kind.

    `operations` maps casadi's operation codes to functions of values, `constant` makes a value of a number. Where an
    operation is missing, `unknown` is called in its place; without one, MethodError names the operation.
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
                raise MethodError(f"the expression holds '{operation_name(operation)}', which has no translation here")
            work[output[0]] = called(*(work[register] for register in function.instruction_input(k)))
    return found


def operation_name(operation: int) -> str:
    """Return the name of an operation code, such as `tanh`."""
    return _names().get(operation, f"operation {operation}")


@cache
def _names() -> dict[int, str]:
    return {int(getattr(casadi, name)): name[3:].lower() for name in dir(casadi) if name.startswith("OP_")}
