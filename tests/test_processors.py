"""An answer is the same whatever code linear algebra takes for the processor."""

import json
from copy import deepcopy

import pytest
from kernels import skip_without
from shared_data import data_folder, needs_data

from studies.processors import ALIKE, answered, apart, named

KERNELS = ("Haswell", "Sandybridge")  # with and without fused products, in blocks of other sizes


@needs_data("practice")
@pytest.mark.parametrize("case", ["case_00", "case_05"])
def test_answer_to_a_practice_case_is_the_same_by_two_processors(case, tmp_path):
    """One is retuned, one has a command that is late; the whole table is on the page of the diagnosis."""
    skip_without(*KERNELS)
    first, second = (answered(data_folder("practice") / case, tmp_path, kernel) for kernel in KERNELS)
    assert named(first) == named(second)
    assert apart([first, second]) < ALIKE
    known = json.loads((data_folder("practice") / "labels.json").read_text())[case]
    assert {effect["id"] for effect in known} == {effect["id"] for effect in first["effects"]}


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
