"""What to do about what the language does not take: one sentence that can be followed, for every
kind of refusal.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import casadi
import numpy as np

from socp.model.symbols import Expr, is_number, role
from socp.process import a, close

_KINKS = {casadi.OP_FABS: "fabs", casadi.OP_FMAX: "fmax", casadi.OP_FMIN: "fmin"}
_POWERS = {casadi.OP_SQ, casadi.OP_MUL, casadi.OP_POW, casadi.OP_CONSTPOW}
_STEPS = {
    casadi.OP_LT,
    casadi.OP_LE,
    casadi.OP_EQ,
    casadi.OP_NE,
    casadi.OP_NOT,
    casadi.OP_AND,
    casadi.OP_OR,
    casadi.OP_SIGN,
    casadi.OP_FLOOR,
    casadi.OP_CEIL,
    casadi.OP_IF_ELSE_ZERO,
}
_TRUTH = (
    "what a relation of expressions is worth shows in the solve only, so `if`, `and`, max(), "
    "min() and 0 <= x <= 1 cannot ask for it; write casadi's if_else(x > 0, a, b), fmax(a, b) or "
    "fmin(a, b), or two relations"
)
_CALLED = (
    "brackets after a symbol call it; write * for a product; a delay, x(time - 1), cannot be "
    "expressed"
)
_MIXED = "symbols are made by states, controls and parameters alone, which are casadi.SX, not MX"
_RAISED = {  # part of what Python or casadi says -> what was meant, as far as can be told
    "Cannot compute the truth value": _TRUTH,
    "'SX' object is not callable": _CALLED,
    "'SX' and 'MX'": _MIXED,
    "'MX' and 'SX'": _MIXED,
    "states() takes": "give the names in one string, such as states('a b')",
    "controls() takes": "give the names in one string, such as controls('a b')",
    "parameters() takes": "give the names in one string, such as parameters('a b')",
    "constants() takes": "give every constant its value, such as constants(drag=0.3)",
    "Problem.__init__() takes 1 positional": "every part has a name: Problem(name=..., "
    "dynamics={...}, bounds={...})",
    "missing 1 required keyword-only argument: 'bounds'": "bounds={u: (lower, upper)} names the "
    "controls",
}
_SPELT = {  # keyword somebody may try -> what is written instead
    "maximise": "write minimise=-(...), with a minus sign",
    "maximize": "write minimise=-(...), with a minus sign",
    "minimize": "write minimise=",
    "objective": "write minimise= for a function of the end, running= for an integrand",
    "cost": "write minimise= for a function of the end, running= for an integrand",
    "controls": "controls are named by bounds={u: (lower, upper)}",
    "states": "states are named by dynamics={x: rate}",
    "constraints": "write path={'name': left <= right}, or target= for the end",
    "time": "write final_time= and initial_time=",
}


def bent(name: str, box: Sequence[float], operation: int) -> str:
    """Return what to write for a control (name, its bounds) that an operation bends, by casadi's
    number of it.
    """
    low, high = box
    as_state = (
        f"to keep it, let {name} be a state, its rate the control: dynamics={{{name}: "
        f"{name}_rate}}, and its bounds, "
        "as those of a state, are kept along the way"
    )
    if operation in _KINKS:
        if low >= 0 or high <= 0:
            return (
                f"{name} does not change its sign in ({low:g}, {high:g}): write "
                f"{'' if low >= 0 else '-'}{name}"
            )
        return (
            f"split it, {name} = {name}_p - {name}_n:\n"
            f'  {name}_p, {name}_n = controls("{name}_p {name}_n")\n'
            f"  bounds={{{name}_p: (0, {high:g}), {name}_n: (0, {-low:g})}}\n"
            f"with {name}_p - {name}_n for {name}, {name}_p + {name}_n for fabs({name}), "
            f"{name}_p "
            f"for fmax({name}, 0)"
        )
    if operation in _POWERS:
        return (
            "a control in a power or in a product of controls has neither bang nor singular "
            f"arcs, which are what socp is for; write it as f0 + {name}*f1; {as_state}"
        )
    if operation in _STEPS:
        return (
            f"a step: take a control for each side, on_{name} with bounds (0, 1), and write a + "
            f"on_{name}*(b - a); {as_state}"
        )
    return f"write it as f0 + {name}*f1; {as_state}"


def mixed(used: Sequence[str]) -> str:
    """Return what to write where a constraint along the way holds controls (names)."""
    if len(used) == 1:
        name = used[0]
        return (
            f"for a limit {name} <= c(x, t) scale the control: a new control s with bounds (0, 1), "
            f"and c(x, t)*s in the place of {name}"
        )
    return (
        f"a row of several controls ({', '.join(used)}) cannot be expressed as it stands; "
        "let all but one of them be states, their rates the new controls, and scale the last one: "
        "u <= c(x, t) is u = c(x, t)*s with s in (0, 1)"
    )


def numbers(symbol: Expr, value: Any) -> str:
    """Return what to write for a bound, an end or a time that is no number."""
    parts = list(value) if isinstance(value, (tuple, list)) else [value]
    if any(isinstance(part, casadi.SX) and not part.is_constant() for part in parts):
        return _moving(symbol)
    made = next(
        (part for part in parts if isinstance(part, (casadi.SX, casadi.DM, np.ndarray))), None
    )
    if isinstance(made, np.ndarray) and made.size > 1:
        return "; an array is no interval: write (float(a), float(b))"
    if made is not None:
        return f"; it holds {a(made)}: float(...) makes a number of it"
    large = any(
        isinstance(part, int) and not isinstance(part, bool) and not is_number(part)
        for part in parts
    )
    return "; it is too large for a float" if large else ""


def _moving(symbol: Expr) -> str:
    """Return what to write for a bound or an end that is an expression."""
    kind = role(symbol)
    if kind == "control":
        return (
            f"; for a bound c(x, t) scale the control: write c(x, t)*s for {symbol}, with "
            f"bounds={{s: (0, 1)}}"
        )
    if kind == "state":
        row = f"path={{'name': {symbol} <= ...}}"
        return f"; a bound that moves goes into {row}, an end that moves into target"
    return (
        "; conditions between times, states and parameters go into target={'name': left == right}"
    )


def not_finite(constant: float, *, ends: bool) -> str:
    """Return where a constant that is not finite comes from, most often."""
    if constant != constant:  # noqa: PLR0124 - nan alone differs from itself
        return (
            "math.sin(x) and the like give nan for an expression: take sin from casadi, "
            "`from casadi import sin`; 0/0 and log(-1) give nan too"
        )
    return "a division by zero gives inf" + (
        "; leave a limit out where there is none" if ends else ""
    )


def expression(value: Any) -> str:
    """Return what to write for a thing that is no expression."""
    if (isinstance(value, casadi.DM) and value.is_scalar()) or (
        isinstance(value, np.ndarray) and value.size == 1
    ):
        return "; float(...) makes a number of it"
    if isinstance(value, casadi.MX):
        return "; socp's symbols are casadi.SX, made by states, controls and parameters"
    if callable(value):
        return "; call it with symbols: what it returns goes here"
    return ""


def hint_for(text: str) -> str:
    """Return what to write where Python or casadi raised an error of this text, empty where nothing
    is known.
    """
    return next((hint for part, hint in _RAISED.items() if part in text), "")


def keyword(name: str, known: Iterable[str]) -> str:
    """Return what to write for a keyword that a problem does not have."""
    known = list(known)
    return (
        f"; {_SPELT[name]}"
        if name in _SPELT
        else close(name, known) or f"; there are {', '.join(known)}"
    )
