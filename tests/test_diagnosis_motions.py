"""Kinds of motion: the closure on a kind that was left out, against a fit without its logs."""

import json
from dataclasses import replace

import pytest
from diagnosis_cases import friction_case, friction_diagnosis

import exodrake as exo
from exodrake.diagnosis.motions import kind_of


@pytest.mark.parametrize(
    ("protocol", "kind"), [("sweeps_2", "sweeps"), ("chirp", "chirp"), ("random-10", "random"), ("12", "12")]
)
def test_runs_of_a_motion_are_one_kind(protocol, kind):
    assert kind_of(protocol) == kind


def test_closure_names_its_motion_and_that_of_each_kind_left_out():
    closure = friction_diagnosis().closure
    assert closure.measured_on == ("random",) and set(closure.motions) == {"sweeps", "holds"}
    for found in closure.motions.values():
        assert found.low <= found.value <= found.high and found.value > 0.8
    answer = json.loads(json.dumps(friction_diagnosis().to_json()))["closure"]
    assert (
        answer["measured_on"] == ["random"] and answer["motions"]["sweeps"]["value"] == closure.motions["sweeps"].value
    )


def test_one_kind_of_motion_says_nothing_of_another():
    case = friction_case()
    alone = replace(case, logs=tuple(item for item in case.logs if item.protocol != "holds"))
    assert exo.diagnose(alone).closure.motions == {}


def test_closure_on_a_kind_left_out_is_that_of_a_fit_without_it():
    """The one Gauss-Newton step away from the joint fit comes to the closure of a diagnosis that never saw the log."""
    case = friction_case()
    logs = [replace(item, role="holdout" if item.protocol == "holds" else "fit") for item in case.logs]
    never_seen = exo.diagnose(replace(case, logs=tuple(item for item in logs if item.protocol != "random")))
    assert friction_diagnosis().closure.motions["holds"].value == pytest.approx(
        never_seen.closure.overall.value, abs=0.03
    )
