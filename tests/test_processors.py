"""An answer is the same whatever code linear algebra takes for the processor."""

from copy import deepcopy

import pytest

from studies.processors import ALIKE, answered, apart, named, used
from tests.short_sets import write_set

KERNELS = ("Haswell", "Sandybridge")  # with and without fused products, in blocks of other sizes


def test_answer_is_the_same_by_two_processors(tmp_path):
    """To a short case with friction; the whole table is in the appendix."""
    for kernel in KERNELS:
        if used(kernel) != [kernel]:
            pytest.skip(f"the linear algebra of {kernel} does not run on this processor")
    write_set(tmp_path / "set", healthy=0, rusty=1)
    first, second = (answered(tmp_path / "set" / "case_00", tmp_path, kernel) for kernel in KERNELS)
    assert [effect["id"] for effect in first["effects"]] == ["tendon.capstan_friction"]
    assert named(first) == named(second)
    assert apart([first, second]) < ALIKE


def test_answers_apart_are_measured_in_widths_of_the_interval():
    """Two values 0.3 apart, in intervals 2 and 3 wide, one of them in a channel."""
    one = {"value": 1.0, "low": 0.0, "high": 2.0}
    effect = {
        "id": "e",
        "role": "cause",
        "rivals": [],
        "wires": [],
        "joints": [],
        "parameters": {"k": one},
        "channels": {"k": {"AF": one}},
    }
    first = {"verdict": "NAMED", "where": {"block": "tendon"}, "effects": [effect], "equivalents": []}
    second = deepcopy(first)
    second["effects"][0]["channels"]["k"]["AF"] = {"value": 1.3, "low": 0.0, "high": 3.0}
    assert apart([first, deepcopy(first)]) == 0.0
    assert apart([first, second]) == pytest.approx(0.15)
    second["effects"][0]["wires"] = ["AF"]
    assert named(first) != named(second)
