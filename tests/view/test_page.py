"""A report as a page: formulas set as they are written, plots of the true values, nothing that
asks a network.
"""

import json
import re
from html.parser import HTMLParser
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from records import revised

from socp import Problem, Solution, default_guess, errors, run
from socp.errors import MethodError
from socp.registry.plugins import Registry
from socp.view import to_page
from socp.view.web.mathml import mathml
from socp.view.web.plots import label_html
from socp.view.web.skeleton import STYLE

VOID = {"meta", "br", "link", "img", "input", "hr"}


class Seen(HTMLParser):
    """What a page is made of: its elements closed in their turn, its text outside of scripts, and
    what it would load.
    """

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: list[str] = []
        self.asked: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.asked += [str(v) for name, v in attrs if name in {"src", "href", "srcset", "action"}]

    def handle_startendtag(self, tag: str, attrs: Any) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] not in {"script", "style"}:
            self.text.append(data)


def read(page: str) -> tuple[Seen, list[dict[str, Any]]]:
    """Return what a page is made of, and the data of its plots."""
    seen = Seen()
    seen.feed(page)
    seen.close()
    assert seen.open == []
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page)
    assert found is not None
    return seen, json.loads(found[1])


@pytest.fixture(scope="module")
def problem(registry: Registry) -> Problem:
    return registry.problem("goddard_vlimit")


@pytest.fixture(scope="module")
def solution(problem: Problem, registry: Registry) -> Solution:
    assert problem.reference is not None
    method = registry.method("lgr-multiphase")(word=problem.reference.word)
    return run(method, problem, default_guess(problem))


@pytest.fixture(scope="module")
def page(solution: Solution) -> str:
    return to_page(solution)


def test_a_page_asks_nothing_of_a_network(page: str) -> None:
    seen, _ = read(page)
    assert seen.asked == []
    assert "@import" not in page[: page.index("<body>")]
    assert "Plotly.newPlot" in page
    assert len(page) > 1e6, "plotly.js is inside"


def test_a_page_says_what_the_report_says(page: str, solution: Solution) -> None:
    text = " ".join(read(page)[0].text)
    assert "an answer: an extremal, certified" in text
    assert f"{solution.objective:.12g}" in text
    for _, _, end in solution.structure["u"][:-1]:
        assert f"{end:.12g}" in text
    assert solution.verdict is not None
    for finding in solution.verdict.findings:
        assert finding.condition in text


def test_every_colour_of_a_page_is_one_that_the_dark_changes() -> None:
    """White at nine tenths of its inverse is 255 (1 - 0.9) = 0x1a a channel, the dark paper."""
    light, rest = STYLE.split("@media screen and (prefers-color-scheme: dark) {")
    dark, rules = rest.split("\n}\n", 1)
    names = re.findall(r"--(\w+): #", light)
    assert re.findall(r"--(\w+): #", dark) == names
    assert set(re.findall(r"var\(--(\w+)\)", rules)) == set(names)
    assert not re.search(r"#[0-9a-f]{3}", rules)
    assert ".plot" in dark
    assert "invert(.9)" in dark
    assert f"--paper: #{3 * format(round(255 * 0.1 + 1e-9), '02x')}" in dark


def test_plots_hold_the_values_of_the_solution(page: str, solution: Solution) -> None:
    _, plots = read(page)
    control = plots[1]["data"][0]
    t, u = np.array(control["x"]), np.array(control["y"])
    inside = np.abs(np.subtract.outer(t, solution.switches)).min(axis=1) > 1e-6
    assert u[inside] == pytest.approx(solution.at(t[inside], "u")[0], abs=1e-6)
    shades = [s for s in plots[1]["layout"]["shapes"] if s.get("layer") == "below" and "y1" in s]
    ends = [s["x1"] for s in shades if s["type"] == "rect"]
    assert ends == [end for _, _, end in solution.structure["u"]]
    assert [a["text"] for a in plots[1]["layout"]["annotations"]] == [
        "max",
        "singular",
        "boundary",
        "min",
    ]


def test_solutions_beside_one_another(problem: Problem, solution: Solution) -> None:
    later = revised(solution, method="later <b>", structure={})
    seen, plots = read(to_page(solution, problem, {"again <b>": later}))
    assert "again <b>" in seen.text
    assert [len(each["data"]) for each in plots[1:5]] == [2, 2, 2, 2]
    assert plots[1]["data"][1]["name"] == "again &lt;b&gt;"


def test_what_is_not_judged_and_has_no_problem(solution: Solution) -> None:
    bare = revised(solution, verdict=None, structure={}, statement=None, problem="<script>none")
    seen, plots = read(to_page(bare))
    text = " ".join(seen.text)
    assert "Nobody judged this solution." in text
    assert "The problem" not in text
    assert "<script>none" in text, "as text, not as an element"
    assert plots


def test_a_page_names_the_extra_that_it_lacks(
    solution: Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    def absent(_module: str, extra: str, what: str) -> Any:
        raise MethodError(f"{what}: {extra}")

    monkeypatch.setattr(errors, "load", absent)
    with pytest.raises(MethodError, match="a report as a page: report"):
        to_page(solution)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("x' = u*cos(phi) + 0.8*tanh(y)", "ẋ = u cos(φ) + 0.8 tanh(y)"),
        ("m' = -7*u", "ṁ = −7 u"),
        ("tf", "t_f"),
        ("-pi <= r <= pi/2", "−π ≤ r ≤ π/2"),
        ("x = 40, y = -2, u free", "x = 40, y = −2, u free"),
        ("disc: x**2 + y**2 <= 0.05", "disc: x^2 + y^2 ≤ 0.05"),
        ("X*V + integral of F - 2", "X V + ∫(F − 2) dt"),
        ("a*(b - c)", "a (b − c)"),
        ("a - (b - c)", "a − (b − c)"),
        ("(a + b)**2", "(a + b)^2"),
        ("2*3*x", "2 · 3 x"),
        ("a*(-b)", "a (−b)"),
        ("u = x_1/lambda_2 where singular", "u = x_1/λ_2 where singular"),
        ("1.5e-07*x", "1.5 · 10^−7 x"),
    ],
)
def test_formulas_are_set_as_they_are_written(line: str, said: str) -> None:
    assert flat(mathml(line)) == flat_text(said)


@pytest.mark.parametrize(
    "line", ["if_else(x < 0, 1", "@1=x, (@1*@1)", "x" * 700, "a if b else c", "'a'"]
)
def test_what_is_no_formula_is_shown_as_it_is(line: str) -> None:
    assert mathml(line).startswith("<code>")


def test_labels_have_letters_and_what_stands_below() -> None:
    assert label_html(r"\lambda_{\phi}", "1/s") == "λ<sub>φ</sub> (1/s)"
    assert label_html(r"\mu_{\mathrm{u.upper}}") == "μ<sub>u.upper</sub>"
    assert label_html(r"x_{<}", "<b>") == "x<sub>&lt;</sub> (&lt;b&gt;)"


def flat(html: str) -> str:
    """Return HTML with MathML as text: fractions with strokes, powers and indices with signs."""
    root = ET.fromstring(f"<p>{html}</p>".replace("&#8289;", ""))  # noqa: S314 - our own text
    return flat_text(_flat(root))


def flat_text(text: str) -> str:
    return re.sub(r"[\s\u2062]", "", text)


def _flat(node: ET.Element) -> str:
    parts = [_flat(each) for each in node]
    sign = {"mfrac": "/", "msup": "^", "msub": "_"}.get(node.tag)
    if node.tag == "mover":
        return {"x": "ẋ", "m": "ṁ"}[parts[0]] + (node.tail or "")
    inner = sign.join(parts) if sign else (node.text or "") + "".join(parts)
    return inner + (node.tail or "")
