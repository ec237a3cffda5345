"""The viewer that a plugin offers: the first one is asked, and its faults bear its name."""

from pathlib import Path

import pytest
from conftest import Install

from socp.cli import main
from socp.errors import MethodError, SolveError
from socp.process import first_paragraph, one_line
from socp.registry import Registry

STRANGER = """
from socp import SolveError, hookimpl

class Viewer:
    def show(self, path): {show}
    def ready(self): {ready}

@hookimpl
def socp_viewer():
    {offer}
"""
SHOWN = """(path.parent / "seen").write_text(path.name)"""


def stranger(
    install: Install,
    name: str,
    *,
    show: str = SHOWN,
    ready: str = "return 'here'",
    offer: str = "return Viewer()",
) -> Registry:
    install(name, STRANGER.format(show=show, ready=ready, offer=offer), plugin=name)
    return Registry.load(without=["rerun"])


def test_the_first_viewer_is_asked(install: Install, tmp_path: Path) -> None:
    registry = stranger(install, "looks")
    registry.viewer().show(tmp_path / "a.rrd")
    assert (tmp_path / "seen").read_text() == "a.rrd"
    assert registry.viewer().ready() == "here"


def test_socp_view_opens_it(install: Install, tmp_path: Path) -> None:
    stranger(install, "opens")
    path = tmp_path / "a.rrd"
    path.write_bytes(b"RRF2")
    assert main(["--no-plugin", "rerun", "view", str(path)]) == 0
    assert (tmp_path / "seen").read_text() == "a.rrd"


@pytest.mark.parametrize(
    ("name", "show", "said"),
    [
        ("divides", "1 / 0", r"plugin 'divides' .*: not shown: Zero.*\(divides.py, line 5\)"),
        ("exits", "raise SystemExit(3)", r"plugin 'exits' .*: SystemExit: 3"),
        ("explains", "raise SolveError('no screen')", "^no screen$"),
    ],
)
def test_a_viewer_that_fails_is_one_error(
    name: str, show: str, said: str, install: Install, tmp_path: Path
) -> None:
    with pytest.raises(SolveError, match=said):
        stranger(install, name, show=show).viewer().show(tmp_path)


def test_an_address_is_a_text(install: Install) -> None:
    with pytest.raises(SolveError, match=r"plugin 'deaf' .* should return an address, not None"):
        stranger(install, "deaf", ready="return None").viewer().ready()


def test_a_hook_that_raises_is_named_and_one_that_declines_is_none(install: Install) -> None:
    declines = stranger(install, "declines", offer="return None")
    with pytest.raises(MethodError, match="no plugin offers a viewer"):
        declines.viewer()
    with pytest.raises(SolveError, match=r"plugin 'breaks' .*KeyError"):
        stranger(install, "breaks", offer="raise KeyError('x')").viewer()


def test_without_a_viewer_both_commands_say_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.rrd"
    path.write_bytes(b"RRF2")
    for words in (["view", str(path)], ["solve", "jacobson_1", "--live"]):
        assert main(["--no-plugin", "rerun", *words]) == 2
        assert "no plugin offers a viewer" in one_line(capsys.readouterr().err)


def test_a_fault_inside_a_package_names_the_file(tmp_path: Path, install: Install) -> None:
    (folder := tmp_path / "suite").mkdir()
    (folder / "inner.py").write_text("\n\n1 / 0\n")
    (folder / "__init__.py").write_text("from . import inner\n")
    install("suite", "", plugin="suite")  # the folder comes before the empty module
    failed = next(each for each in Registry.load().plugins if each.name == "suite")
    assert failed.reason.endswith("division by zero (suite/inner.py, line 3)")


@pytest.mark.parametrize(
    ("doc", "about"),
    [
        (None, ""),
        ("", ""),
        ("One line.", "One line."),
        ("Two\n    lines.\n", "Two lines."),
        ("\n  Two\n  lines.\n  \n  More.", "Two lines."),
    ],
)
def test_what_a_docstring_is_about_is_its_first_paragraph(doc: str | None, about: str) -> None:
    assert first_paragraph(doc) == about
