"""The registry: what is broken is named with its reason and stops nothing."""

import re

import pytest
from conftest import PLUGIN, Install
from socp_plugins.collocation import TABLE

from socp.errors import MethodError, ProblemError
from socp.methods.guess import default_guess
from socp.registry.entries import Plugin, suggest
from socp.registry.plugins import HOOKS, PluginError, Registry

HOOK = "from socp import hookimpl\n\n@hookimpl\n"
BROKEN = {
    "raises": ("x = 1\n1 / 0\n", r"ZeroDivisionError: division by zero \(raises.py, line 2\)"),
    "syntax": ("x = (\n", r"SyntaxError: .*never closed \(syntax.py, line 1\)"),
    "absent": (
        "import no_such_module\n",
        r"ModuleNotFoundError: .*no_such_module.*\(absent.py, line 1\)",
    ),
    "exits": ("raise SystemExit(3)\n", r"SystemExit: 3 \(exits.py, line 1\)"),
    "misspelt": (
        HOOK + "def socp_methds():\n    return []\n",
        "unknown hook 'socp_methds'; did you mean 'socp_methods'?",
    ),
    "argument": (HOOK + "def socp_solved(problem, outcome):\n    pass\n", "outcome"),
    "unmarked": (
        "def socp_methods():\n    return []\n",
        f"implements no hook; mark {' or '.join(HOOKS)} with @hookimpl",
    ),
    "nolist": (
        HOOK + "def socp_methods():\n    return 3\n",
        "socp_methods should return a list of methods",
    ),
    "strange": (HOOK + "def socp_methods():\n    return [3]\n", "3 is no subclass of socp.Method"),
    "abstract": (
        PLUGIN.replace("def solve", "def solves").format(name="abstract"),
        "Mine does not define solve",
    ),
    "thawed": (
        PLUGIN.replace("(frozen=True)", "").format(name="thawed"),
        "Mine is no frozen dataclass",
    ),
    "nameless": (
        PLUGIN.format(name="two words"),
        "name 'two words'; it should be letters, digits and hyphens",
    ),
    "taken": (
        PLUGIN.format(name="euler-ipopt"),
        "there is a method 'euler-ipopt' already, socp_plugins.collocation.EulerIpopt",
    ),
}


def _plugin(registry: Registry, name: str) -> Plugin:
    return next(plugin for plugin in registry.plugins if plugin.name == name)


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_plugin_is_failed_with_its_reason_and_the_others_work(
    name: str, install: Install
) -> None:
    source, reason = BROKEN[name]
    install(name, source, plugin=name)
    registry = Registry.load()
    failed = _plugin(registry, name)
    assert failed.status == "failed"
    assert re.search(
        reason if name in {"raises", "syntax", "absent", "exits"} else re.escape(reason),
        failed.reason,
    )
    assert [each.name for each in registry.failures] == [name]
    assert "euler-ipopt" in registry.methods
    assert registry.methods["euler-ipopt"].__module__ == "socp_plugins.collocation"


def test_a_method_of_a_failed_plugin_is_refused_with_the_plugin_s_reason(install: Install) -> None:
    install("raises", "1 / 0\n", plugin="raises")
    with pytest.raises(
        PluginError, match="method 'raises': plugin 'raises' is failed: ZeroDivisionError"
    ):
        Registry.load().method("raises")


def test_a_plugin_with_one_good_method_keeps_it(install: Install) -> None:
    install("half", PLUGIN.format(name="mine").replace("[Mine]", "[Mine, Mine]"), plugin="half")
    registry = Registry.load()
    half = _plugin(registry, "half")
    assert (half.status, half.methods) == ("partly", ("mine",))
    assert half.reason == "there is a method 'mine' already, half.Mine"
    assert registry.owner("mine") is half


def test_socp_plugins_and_without_limit_what_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOCP_PLUGINS", "mboc, collocation,nothing")
    registry = Registry.load(without=["mboc"])
    assert set(registry.methods) == {row.name for row in TABLE}
    assert registry.warnings[0].startswith("SOCP_PLUGINS: no plugin 'nothing'; there are ")
    assert _plugin(registry, "mboc").reason == "left out by --no-plugin"
    with pytest.raises(
        MethodError, match="method 'mboc': plugin 'mboc' is off: left out by --no-plugin"
    ):
        registry.method("mboc")
    monkeypatch.setenv("SOCP_PLUGINS", "")
    nothing = Registry.load()
    assert not nothing.methods
    with pytest.raises(MethodError, match=r"unknown method 'lgr'; .*not loaded: .*collocation"):
        nothing.method("lgr")


def test_without_refuses_an_unknown_name() -> None:
    with pytest.raises(MethodError, match="--no-plugin mbocc: no such plugin; did you mean 'mboc'"):
        Registry.load(without=["mbocc"])


def test_a_name_that_is_taken_is_refused_with_the_first_owner(install: Install) -> None:
    install("other", "problem = 1\n", problem="auv", plugin="")
    registry = Registry.load()
    assert registry.entries["auv"].package.startswith("socp ")
    assert (
        registry.failures[-1].reason
        == f"there is a problem 'auv' already, from {registry.entries['auv'].package}"
    )


@pytest.mark.parametrize(
    ("source", "target", "message"),
    [
        (
            "x = 1\ny = x / 0\n",
            "",
            r"problem 'mine' of odd 1.0: ZeroDivisionError: .* \(odd.py, line 2\)",
        ),
        ("problem = 3\n", "", "odd:problem is an int, not a Problem"),
        ("problem = 3\n", "odd:prblem", "AttributeError: .*prblem"),
    ],
)
def test_a_broken_registered_problem_is_refused_when_asked_for(
    install: Install, source: str, target: str, message: str
) -> None:
    install("odd", source, problem="mine", target=target)
    registry = Registry.load(only=())
    assert "mine" in registry.problems
    with pytest.raises(ProblemError, match=message):
        registry.problem("mine")


def test_names_are_suggested(registry: Registry) -> None:
    with pytest.raises(MethodError, match="unknown method 'euler'; did you mean 'euler-ipopt'"):
        registry.method("euler")
    with pytest.raises(ProblemError, match="unknown problem 'avu'; did you mean 'auv'"):
        registry.problem("avu")
    assert suggest("x", ["first", "second"]) == "; there are first, second"
    assert suggest("x", []) == "; there are none"


def test_about_reads_a_docstring_without_importing(install: Install) -> None:
    install("silent", '"""One line.\n\nMore."""\n1 / 0\n', problem="silent")
    assert Registry.load(only=()).entries["silent"].about == "One line."


def test_listeners_are_called_and_their_faults_become_lines(
    install: Install, registry: Registry
) -> None:
    keep = (
        "def socp_solved(problem, solution):\n    SEEN.append((problem.name, "
        "solution.problem))\nSEEN = []\n"
    )
    install("good", HOOK + keep, plugin="good")
    install(
        "bad", HOOK + "def socp_solved(problem):\n    raise ValueError('no disk')\n", plugin="bad"
    )
    loaded = Registry.load()
    problem = registry.problem("auv")
    lines = loaded.solved(problem, default_guess(problem))
    assert lines == ["plugin 'bad' (bad 1.0): socp_solved: ValueError: no disk (bad.py, line 5)"]
    assert loaded.manager.get_plugin("good").SEEN == [("auv", "auv")]
    assert loaded.failures == ()
