"""Faults of joints of other sizes and rates than the models were made for, planted from outside."""

import pytest

from studies.sizes import SORTS, answer, is_right, list_cases

CASES = {name: (sort, SORTS[sort].sizes[size], fault) for name, sort, size, fault in list_cases()}


@pytest.mark.parametrize(
    "name",
    [
        "servo_500_Hz_delay",
        "motor_96_N_m_friction",
        "arm_voltage_dry_friction_and_offset",
        "arm_voltage_none",
        "loop_100_Hz_offset",
    ],
)
def test_planted_faults_are_named(name, tmp_path):
    sort, size, fault = CASES[name]
    found = answer(name, sort, size, fault, tmp_path)
    assert is_right(found, SORTS[sort].faults[fault][1]), found["effects"]
    planted, most = {"servo_500_Hz_delay": (25.0, 30.0), "loop_100_Hz_offset": (-0.06, -0.04)}.get(name, (0.0, 0.0))
    if planted:  # 50 ms are 25 rows
        (value,) = found["effects"][0]["parameters"].values()
        assert value["low"] < planted < value["high"] < most


def test_an_answer_with_another_cause_beside_is_not_right():
    causes = [{"id": f"servo.{kind}", "kind": kind, "role": "cause"} for kind in ("delay", "lag")]
    answers = [{"verdict": "NAMED", "effects": some} for some in (causes[:1], causes, [])]
    assert [is_right(one, ({"delay"},)) for one in answers] == [True, False, False]
    assert [is_right(one, ({"delay"}, {"lag"})) for one in answers] == [False, True, False]
    assert is_right({"verdict": "NO_GAP", "effects": []}, ()) and not is_right(
        {"verdict": "UNKNOWN", "effects": []}, ()
    )
