"""socp: singular optimal control problems, from one file to arcs, switching times and a verdict.

The names below are the public language. They are loaded on first use, so that `import socp` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from socp.backends import Ipopt as Ipopt
    from socp.chain import judge as judge
    from socp.chain import run as run
    from socp.collocate import collocate as collocate
    from socp.collocate import uniform as uniform
    from socp.errors import MethodError as MethodError
    from socp.errors import ProblemError as ProblemError
    from socp.errors import SocpError as SocpError
    from socp.errors import SolveError as SolveError
    from socp.guess import default_guess as default_guess
    from socp.hookspecs import hookimpl as hookimpl
    from socp.method import Method as Method
    from socp.method import option as option
    from socp.method import solve_collocated as solve_collocated
    from socp.nlp import Backend as Backend
    from socp.nlp import Watch as Watch
    from socp.nlp import silent as silent
    from socp.phases import follow as follow
    from socp.phases import single_phase as single_phase
    from socp.problem import Problem as Problem
    from socp.problem import Reference as Reference
    from socp.problem import Scene as Scene
    from socp.problem import controls as controls
    from socp.problem import final_time as final_time
    from socp.problem import free as free
    from socp.problem import initial as initial
    from socp.problem import initial_time as initial_time
    from socp.problem import parameters as parameters
    from socp.problem import states as states
    from socp.problem import time as time
    from socp.solution import Solution as Solution
    from socp.word import Word as Word

_HOMES = {
    "backends": ["Ipopt"],
    "chain": ["judge", "run"],
    "collocate": ["collocate", "uniform"],
    "errors": ["MethodError", "ProblemError", "SocpError", "SolveError"],
    "guess": ["default_guess"],
    "hookspecs": ["hookimpl"],
    "method": ["Method", "option", "solve_collocated"],
    "nlp": ["Backend", "Watch", "silent"],
    "phases": ["follow", "single_phase"],
    "problem": [
        "Problem", "Reference", "Scene", "controls", "final_time", "free", "initial", "initial_time", "parameters",
        "states", "time",
    ],
    "solution": ["Solution"],
    "word": ["Word"],
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'socp' has no attribute '{name}'")
    return getattr(import_module(f"socp.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
