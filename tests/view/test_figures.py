"""Figures: true to the values, nothing over anything else, the same in grey, drawn without
pyplot.
"""

import ast
import io
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from carts import cart, v, x
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from records import revised

from socp import (
    Problem,
    Scene,
    Solution,
    controls,
    default_guess,
    errors,
    final_time,
    run,
    silent,
    solve,
    states,
    time,
)
from socp.cli import main
from socp.errors import MethodError
from socp.model.data.files import save
from socp.registry.plugins import Registry
from socp.view.figures import draw as figures
from socp.view.figures import style
from socp.view.figures.arrangement import TimeAxis
from socp.view.figures.curves import scene_of_group
from socp.view.figures.overlay import overlaid
from socp.view.picture import picture_of
from socp.view.traces import sampled

ROOT = Path(__file__).parents[2]
Solved = Callable[[str], tuple[Problem, Solution]]


@pytest.fixture(scope="module")
def solved(registry: Registry) -> Solved:
    """Return a problem and its solution along the word of the reference, solved once."""
    kept: dict[str, tuple[Problem, Solution]] = {}

    def solve(name: str) -> tuple[Problem, Solution]:
        if name not in kept:
            problem = registry.problem(name)
            method = registry.method("lgr-multiphase")(word=problem.reference.word)
            kept[name] = problem, run(method, problem, default_guess(problem))
        return kept[name]

    return solve


def boxes(figure: Any) -> Iterator[tuple[str, Any]]:
    """Yield every text that is seen, with its box in pixels."""
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            for tick in axis.get_major_ticks():
                if (
                    low <= tick.get_loc() <= high
                    and tick.label1.get_visible()
                    and tick.label1.get_text()
                ):
                    yield tick.label1.get_text(), tick.label1.get_window_extent(renderer)
        for text in [axes.xaxis.label, axes.yaxis.label, *axes.texts]:
            if text.get_visible() and text.get_text():
                yield text.get_text(), text.get_window_extent(renderer)
    for legend in figure.legends:
        yield "legend", legend.get_window_extent(renderer)


def drawn(solution: Solution, problem: Problem | None, **look: Any) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = solution.plot(problem, **look)
    FigureCanvasAgg(figure)
    return figure


LOOKS: list[tuple[str, dict[str, Any]]] = [
    ("auv", {}),
    ("auv", {"stretch": True}),
    ("robot_arm", {}),
    ("goddard_vlimit", {"width": 3.5, "panels": figures.PANELS}),
    ("goddard_vlimit", {"panels": ("scene", "controls", "switching", "states")}),
]


@pytest.mark.parametrize(("name", "look"), LOOKS, ids=str)
@pytest.mark.slow
def test_no_text_covers_another_or_leaves_the_page(
    name: str, look: dict[str, Any], solved: Solved
) -> None:
    problem, solution = solved(name)
    figure = drawn(solution, problem, **look)
    found = list(boxes(figure))
    width, height = figure.get_size_inches() * figure.dpi
    assert len(found) > 30
    for text, box in found:
        assert box.x0 >= -1, text
        assert box.x1 <= width + 1, text
        assert box.y0 >= -1, text
        assert box.y1 <= height + 1, text
    for (first, a), (second, b) in combinations(found, 2):
        across, up = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        assert across < 1 or up < 1, (first, second)


def panel(figure: Any, label: str) -> Any:
    (found,) = [axes for axes in figure.axes if axes.get_ylabel().startswith(f"${label}$")]
    return found


def curve(axes: Any) -> tuple[np.ndarray, np.ndarray]:
    return max((line.get_data() for line in axes.get_lines()), key=lambda data: len(data[0]))


def test_controls_jump_where_they_switch(solved: Solved) -> None:
    problem, solution = solved("goddard_vlimit")
    t, u = curve(panel(drawn(solution, problem), "u"))
    for arc in solution.arcs:
        inside = (t > arc.t[0]) & (t < arc.t[-1])
        np.testing.assert_allclose(u[inside], arc.at(t[inside], "u")[0], atol=1e-13)
    for switch, before, after in zip(
        solution.switches, solution.arcs, solution.arcs[1:], strict=False
    ):
        pair = u[np.flatnonzero(np.abs(t - switch) < 1e-12)]
        np.testing.assert_allclose(pair, [before.u[0, -1], after.u[0, 0]], atol=1e-9)
        assert abs(pair[0] - pair[1]) > 0.1


@pytest.mark.slow
def test_arcs_are_shaded_in_their_colours_and_bounds_are_lines(solved: Solved) -> None:
    problem, solution = solved("auv")
    axes = panel(drawn(solution, problem), "f")
    shaded = [
        (each.get_x(), each.get_x() + each.get_width(), each.get_facecolor()[:3])
        for each in axes.patches
    ]
    assert len(shaded) == len(solution.structure["f"])
    for (left, right, colour), (mode, start, end) in zip(
        shaded, solution.structure["f"], strict=True
    ):
        assert (left, right) == pytest.approx((start, end))
        assert colour == style.tint(style.MODES[style.kind(mode)][1])
    levels = {
        float(line.get_ydata()[0]) for line in axes.get_lines() if len(set(line.get_ydata())) == 1
    }
    assert {-5.0, 5.0} <= levels


def test_switching_functions_are_those_of_the_principle(solved: Solved) -> None:
    problem, solution = solved("goddard_vlimit")
    _, sigma = curve(panel(drawn(solution, problem), r"\sigma_{u}"))
    along = sampled(problem, solution, 500)
    np.testing.assert_array_equal(sigma, along.switching[0])
    assert (along.switching[0][along.arc == 3] > -1e-12).all()  # at the lower bound


def test_modes_are_told_apart_in_grey() -> None:
    colours = [style.MODES[sign][1] for sign in "-+sb"]
    grey, shade = (
        sorted(
            float(np.dot(each, (0.299, 0.587, 0.114)))
            for each in (made(colour) for colour in colours)
        )
        for made in (to_rgb, style.tint)
    )
    assert min(np.diff(grey)) > 0.1
    assert min(np.diff(shade)) > 0.03
    assert len({hatch for _, _, hatch in style.MODES.values()}) == 4


def test_units_stand_in_the_labels(solved: Solved) -> None:
    problem, solution = solved("goddard_vlimit")
    h, v, _ = problem.dynamics
    figure = drawn(solution, replace(problem, units={h: "m", v: "m/s", time: "s"}))
    labels = [axes.get_ylabel() for axes in figure.axes] + [
        axes.get_xlabel() for axes in figure.axes
    ]
    assert {"$h$ (m)", "$v$ (m/s)", "$m$", "$t$ (s)", r"$\lambda_{h}$"} <= set(labels)


def test_tiny_values_have_their_power_of_ten_in_the_label(solved: Solved) -> None:
    _, solution = solved("goddard_vlimit")
    arcs = tuple(replace(arc, u=1e-7 * arc.u) for arc in solution.arcs)
    axes = panel(drawn(replace(solution, arcs=arcs), None), "u")
    assert axes.get_ylabel() == "$u$ ($10^{-7}$)"
    assert curve(axes)[1].max() == pytest.approx(1.0)


def test_short_arcs_are_widened_and_time_keeps_its_order(solved: Solved) -> None:
    _, solution = solved("auv")
    axis = TimeAxis.of(solution, "s", stretch=True)
    places = axis.warp([0.0, *solution.switches, solution.final_time])
    assert places[0] == 0.0
    assert places[-1] == pytest.approx(1.0)
    assert min(np.diff(places)) > 0.06
    t = np.linspace(0.0, solution.final_time, 1000)
    assert (np.diff(axis.warp(t)) > 0).all()
    assert "widened" in axis.label
    assert "widened" not in TimeAxis.of(solution, "s", stretch=False).label


def test_a_solution_alone_shows_what_it_knows(solved: Solved) -> None:
    _, solution = solved("auv")
    alone = revised(solution, statement=None)
    labels = [axes.get_ylabel() for axes in drawn(alone, None).axes]
    assert len(labels) == 2 + 4 + 4  # controls, states, costates
    assert r"$\sigma_{r}$" not in labels


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("x", "x"),
        ("x1", "x_{1}"),
        ("phi", r"\phi"),
        ("u_rho", r"u_{\rho}"),
        ("x1_dot", r"x_{1,\mathrm{dot}}"),
        ("thrust", r"\mathrm{thrust}"),
        ("Omega", r"\Omega"),
        ("u.upper", r"\mathrm{u.upper}"),
        ("é", r"\mathrm{ }"),
    ],
)
def test_names_are_written_as_in_mathematics(name: str, shown: str) -> None:
    assert style.symbol(name) == shown


@pytest.mark.parametrize("ending", figures.ENDINGS)
def test_files_are_the_same_every_time(ending: str, solved: Solved) -> None:
    problem, solution = solved("goddard_vlimit")
    first, second = (
        figures.to_bytes(solution.plot(problem, panels=["controls", "scene"]), ending)
        for _ in range(2)
    )
    assert first == second
    starts = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    assert first.startswith(starts[ending])
    rung = b"goddard_vlimit; strict local minimum among controls of its word"
    assert ending == "pdf" or rung in first  # a PDF's own spelling is packed
    if ending == "png":
        ink = imread(io.BytesIO(first))[..., :3].mean(axis=2)
        assert 0.02 < (ink < 0.9).mean() < 0.6


def test_nothing_global_is_touched(solved: Solved) -> None:
    problem, solution = solved("goddard_vlimit")
    before = dict(mpl.rcParams)
    figures.to_bytes(solution.plot(problem, panels=["controls"]), "svg")
    assert dict(mpl.rcParams) == before
    files = sorted((ROOT / "socp" / "view").rglob("*.py"))
    assert files
    for file in files:
        tree = ast.parse(file.read_text())
        modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert "matplotlib.pyplot" not in modules


def test_a_panel_that_there_is_not(solved: Solved) -> None:
    _, solution = solved("auv")
    with pytest.raises(MethodError, match="no panel 'control'; there are scene, controls"):
        solution.plot(panels=["control"])


@pytest.fixture
def saved(solved: Solved, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    save(solved("goddard_vlimit")[1], "rocket.socp.json")
    return tmp_path


def test_command_draws(saved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plot", "rocket.socp.json"]) == 0
    assert capsys.readouterr().out == "rocket.svg\n"
    assert (
        main(
            [
                "plot",
                "rocket.socp.json",
                "-o",
                "a.PDF",
                "--panels",
                "controls, states",
                "--width",
                "3.5",
            ]
        )
        == 0
    )
    assert (saved / "a.PDF").read_bytes().startswith(b"%PDF")
    assert (saved / "rocket.svg").stat().st_size < 200_000
    assert len(list(saved.iterdir())) == 3


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (
            ["rocket.socp.json", "-o", "a.gif"],
            2,
            "-o a.gif: it ends with '.gif'; figures end with .png, .svg, .pdf",
        ),
        (
            ["rocket.socp.json", "--panels", "costate"],
            2,
            "no panel 'costate'; there are scene, controls",
        ),
        (["rocket.socp.json", "--width", "1"], 2, "--width"),
        (
            ["rocket.socp.json", "-o", "nowhere/a.svg"],
            2,
            "-o nowhere/a.svg: there is no directory nowhere",
        ),
        (["gone.json"], 1, "gone.json: No such file"),
    ],
)
def test_command_says_what_is_wrong(
    arguments: list[str], code: int, said: str, saved: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plot", *arguments]) == code
    assert said in capsys.readouterr().err
    assert [each.name for each in saved.iterdir()] == ["rocket.socp.json"]


def test_missing_matplotlib_is_one_line(
    saved: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def absent(module: str) -> Any:
        if module == "matplotlib":
            raise ModuleNotFoundError("No module named 'matplotlib'", name="matplotlib")
        return import_module(module)

    monkeypatch.setattr(errors, "import_module", absent)
    assert main(["plot", "rocket.socp.json"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "pip install 'socp[plot]'" in lines[0]
    assert len(list(saved.iterdir())) == 1


def test_solutions_beside_one_another_share_their_panels(solved: Solved) -> None:
    problem, solution = solved("goddard_vlimit")
    slower = solution.simulate(problem, disturbance={"v": -0.05})
    figure = drawn(
        solution, None, beside={"gravity": slower}, panels=("controls", "states"), title=True
    )
    axes = panel(figure, "v")
    (own, other) = [line for line in axes.get_lines() if len(line.get_xdata()) > 100]
    np.testing.assert_allclose(other.get_ydata()[-1], slower["v"][-1])
    np.testing.assert_allclose(own.get_ydata()[-1], solution["v"][-1])
    low, _ = axes.get_ylim()
    assert low < min(solution["v"].min(), slower["v"].min())
    names = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert names[:2] == ["lgr-multiphase", "gravity"]
    (title,) = (text.get_text() for text in figure.texts)
    assert title.startswith("goddard_vlimit by lgr-multiphase: objective ")
    assert title.endswith(", extremal") or "minimum" in title


def test_what_has_other_states_has_no_path_in_the_plane() -> None:
    """A runner from 0 to 1 at |u| <= 1 has no v: its control is drawn beside the cart's."""
    a, u = states("a"), controls("u")
    runner = Problem(
        name="runner",
        minimise=final_time,
        dynamics={a: u},
        bounds={u: (-1, 1)},
        start={a: 0},
        end={a: 1},
    )
    flat = cart()
    flat = replace(flat, scene=Scene(plane=(x, v)))
    solution, other = (
        solve(each, method="lgr-multiphase", word=word, watch=silent)
        for each, word in ((flat, "+ -"), (runner, "+"))
    )
    drawn, _ = scene_of_group(solution, flat, overlaid(flat, solution, [other]))
    assert [path.shape for path in drawn.others] == [(2, 0)]
    assert len(solution.plot(beside=[other]).axes) > 1
    with pytest.raises(MethodError, match="'lgr-multiphase' shares no state or control"):
        solution.plot(beside=[replace(other, state_names=("u",), control_names=("x",))])


def test_what_shares_nothing_is_not_drawn_beside(solved: Solved) -> None:
    _, solution = solved("goddard_vlimit")
    _, other = solved("auv")
    with pytest.raises(MethodError, match="shares no state or control"):
        solution.plot(beside=[replace(other, state_names=tuple("abcd"))], panels=["states"])
    with pytest.raises(MethodError, match="a figure has no option 'besides'"):
        solution.plot(besides=[other])


def test_costates_stand_in_their_order(solved: Solved) -> None:
    problem, solution = solved("auv")
    labels = [axes.get_ylabel() for axes in drawn(solution, problem).figure.axes]
    found = [label for label in labels if label.startswith(r"$\lambda")]
    assert found == [rf"$\lambda_{{{style.symbol(name)}}}$" for name in problem.state_names]


@pytest.mark.parametrize(("unit", "equal"), [("m", True), ("m/s", False)])
def test_a_plane_of_one_unit_has_equal_scales(unit: str, equal: bool) -> None:
    problem = cart(units={x: "m", v: unit})
    assert picture_of(problem, default_guess(problem)).spatial is equal


def test_the_multiplier_of_a_constraint_far_away_is_noise(solved: Solved) -> None:
    problem, solution = solved("goddard_vlimit")
    (low, high) = problem.state_box[:, problem.state_names.index("v")]
    assert np.isinf(low)
    far = problem.with_({"bounds.v.upper": 10 * high})
    shown = [axes.get_ylabel() for axes in drawn(solution, far).axes]
    assert not any("mu" in label for label in shown)
