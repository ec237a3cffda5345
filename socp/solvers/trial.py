"""Ipopt's linear solvers on trial in a process of their own: some that it knows by name end the
process they run in.
"""

import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

CHOSEN = ("linear_solver", "linear_system_scaling", "hsllib", "pardisolib")  # may load foreign code
_SHIPPED = {
    ("linear_solver", "mumps"),
    ("linear_system_scaling", "none"),
    ("linear_system_scaling", "slack-based"),
}
_LIMIT = 60.0  # seconds: a hundred times what a trial takes
_PROGRAMME = """
import sys, casadi
v = casadi.SX.sym("v")
own = {"ipopt." + name: value for name, _, value in (text.partition("=") for text in sys.argv[1:])}
plain = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
solver = casadi.nlpsol("trial", "ipopt", {"x": v, "f": v**2 + v, "g": v}, {**plain, **own})
solver(x0=1.0, lbg=-5, ubg=5)
print("status", solver.stats()["return_status"], flush=True)
"""


def fault_of(options: Mapping[str, Any]) -> str:
    """Return what is wrong with the linear solver that options ask for, empty where it works or
    none is chosen.
    """
    given = tuple((name, str(options[name])) for name in CHOSEN if name in options)
    if not {pair[0] for pair in given if pair not in _SHIPPED} - {"hsllib", "pardisolib"}:
        return ""
    return _tried((given,))[0]


def working(names: Sequence[str]) -> tuple[str, ...]:
    """Return those of some linear solvers that solve a programme here."""
    faults = _tried(tuple((("linear_solver", name),) for name in names))
    return tuple(name for name, fault in zip(names, faults, strict=True) if not fault)


@cache
def _tried(cases: tuple[tuple[tuple[str, str], ...], ...]) -> tuple[str, ...]:
    """Return the fault of every case of options, side by side; empty for one that solves a
    programme.
    """
    running = []
    for case in cases:
        command = [
            sys.executable,
            "-P",
            "-c",
            _PROGRAMME,
            *(f"{name}={value}" for name, value in case),
        ]
        running.append(
            subprocess.Popen(  # noqa: S603 - this Python and the programme above
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
        )
    return tuple(_fault(each) for each in running)


def _fault(process: "subprocess.Popen[str]") -> str:
    try:
        out, _ = process.communicate(timeout=_LIMIT)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return f"it did not end within {_LIMIT:.0f} seconds"
    if process.returncode < 0:
        return f"it ends the process, signal {-process.returncode}"
    if "status Solve_Succeeded" in out.splitlines():
        return (
            ""
            if process.returncode == 0
            else f"it ends the process, exit code {process.returncode}"
        )
    return "it cannot be loaded or fails at the smallest programme"
