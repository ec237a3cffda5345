"""The word that a report prints can be given back, and leads to the same solution."""

import pytest

from socp import Ipopt, MethodError, silent, solve
from socp.registry.plugins import Registry


@pytest.mark.slow
@pytest.mark.parametrize("name", ["robot_arm", "auv"])
def test_a_printed_word_is_followed(name: str, registry: Registry) -> None:
    problem = registry.problem(name)
    reference = solve(problem, watch=silent)
    commas = "; ".join(
        f"{control}: {', '.join(mode for mode, _, _ in row)}"
        for control, row in reference.structure.items()
    )
    # a reading that is not the one meant leads nowhere, and would do so for thousands of steps
    short = Ipopt({"max_iter": 200})
    found = solve(problem, method="lgr-multiphase", word=commas, backend=short, watch=silent)
    assert found.extremal
    assert found.word == reference.word
    assert found.objective == pytest.approx(problem.reference.objective, abs=1e-9)


def test_an_ambiguous_word_is_refused_with_its_readings(registry: Registry) -> None:
    problem = registry.problem("auv")
    with pytest.raises(MethodError, match=r"has two readings: write 'r: . . s . .; f: "):
        solve(problem, method="lgr-multiphase", word="r: + s +; f: + b -", watch=silent)
