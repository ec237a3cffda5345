"""Ipopt's options as this build of Ipopt documents them: which there are, and which values they
take.
"""

import html
import math
import re
from collections.abc import Mapping
from contextlib import redirect_stdout
from functools import cache
from io import StringIO
from typing import Any

import casadi

from socp.errors import MethodError
from socp.process import close, shown
from socp.solvers import trial

_PRINTING = {"options_documentation": "yes", "options_mode": "doxygen", "advanced_options": "yes"}


def check(options: Mapping[str, Any]) -> None:
    """Raise MethodError for an option that Ipopt does not have, a value that it does not take, or
    no linear solver.
    """
    for name, value in options.items():
        _check(name, value)
    fault = trial.fault_of(options)
    if fault:
        given = ", ".join(f"{name}={options[name]}" for name in trial.CHOSEN if name in options)
        there = ", ".join(trial.working(_words("linear_solver")))
        raise MethodError(
            f"ipopt.linear_solver: {given}: {fault}; linear solvers that work here: {there}"
        )


@cache
def _documented() -> Mapping[str, str]:
    """Return Ipopt's own options: name -> documentation, as this build of Ipopt prints them."""
    text = StringIO()
    with redirect_stdout(text):  # of its formats this one alone tells integers from reals
        _probe({f"print_{what}": how for what, how in _PRINTING.items()})(x0=1.0)
    powers = text.getvalue().replace("10<sup>", "1e").replace("</sup>", "")
    plain = html.unescape(re.sub(r"</?(strong|blockquote)>", "", powers)).replace("\u2264", "<=")
    found = re.split(r"^\\anchor OPT_(\w+)$", plain, flags=re.MULTILINE)
    return dict(zip(found[1::2], found[2::2], strict=True))


def _probe(options: Mapping[str, Any]) -> casadi.Function:
    v = casadi.SX.sym("v")
    settings = {
        f"ipopt.{name}": value
        for name, value in {"sb": "yes", "option_file_name": "", **options}.items()
    }
    return casadi.nlpsol("probe", "ipopt", {"x": v, "f": v**2}, {"print_time": False, **settings})


def _check(name: str, value: Any) -> None:
    """Raise MethodError for an option that Ipopt does not have, or a value that it does not
    take.
    """
    try:
        with redirect_stdout(StringIO()):  # Ipopt explains itself there, at length
            _probe({"print_level": 0, name: value if _plain(name, value) else [value]})
    except (RuntimeError, NotImplementedError):
        if name not in _documented():
            raise MethodError(
                f"ipopt has no option '{name}'{close(str(name), _documented())}"
            ) from None
        raise MethodError(
            f"ipopt.{name}: {shown(value)} is not allowed; {_allowed(name)}"
        ) from None


def _plain(name: str, value: Any) -> bool:
    """Tell whether a value is of a kind that arrives: casadi cuts fractions off and passes None on
    as nothing.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return False
    if isinstance(value, str) or float(value).is_integer():
        return True
    return math.isfinite(value) and "this integer option" not in _documented().get(name, "")


def _words(name: str) -> list[str]:
    return re.findall(r"^ - (\S+):", _documented()[name], flags=re.MULTILINE)


def _allowed(name: str) -> str:
    """Return the values that an option takes: `monotone, adaptive`, or `0 < tol and its default
    value is 10-08`.
    """
    words = [word for word in _words(name) if word != "*"]
    if words:
        return f"allowed: {', '.join(words)}"
    sentence = re.search(
        r"valid range for this (\w+) option is (.*?)\.?$", _documented()[name], flags=re.MULTILINE
    )
    return f"allowed: {sentence[1]}, {sentence[2]}" if sentence else "see Ipopt's documentation"
