"""The robots of a diagnosis in the loop: stability, margins over amplitude, dead band, the weight that covers them."""

import json

import control
import numpy as np
import pytest
from command_line import run

import exodrake as exo
from exodrake.analysis import limit_cycles
from exodrake.analysis.robustness import assess_answer, fit_weight


def answer_of(identity, wires=("MF",), **intervals):
    parameters = {n: {"value": v, "low": a, "high": b, "unit": "-"} for n, (v, a, b) in intervals.items()}
    effect = {"id": identity, "wires": list(wires), "joints": [], "parameters": parameters, "channels": {}}
    return {"verdict": "NAMED", "where": {"block": "motor"}, "effects": [effect], "equivalents": [],
            "closure": {"overall": {"value": 1.0}}}  # fmt: skip


SENSOR_GAIN = answer_of("sensor.gain", gain=(0.10, 0.04, 0.16))
SCALE_GAIN = {"id": "scale.gain", "wires": [], "joints": ["carriage"], "channels": {},
              "parameters": {"gain": {"value": 0.1, "low": 0.04, "high": 0.16, "unit": "-"}}}  # fmt: skip


@pytest.mark.parametrize(("order", "zero", "pole"), [(1, 5.0, 60.0), (2, 4.0, 50.0)])
def test_a_weight_of_that_form_is_found_again_and_covers_any_deviation(order, zero, pole):
    f, s = np.geomspace(0.02, 25.0, 120), control.tf("s")
    planted = np.abs((0.03 * ((s / zero + 1.0) / (s / pole + 1.0)) ** order)(2j * np.pi * f))
    found = fit_weight(f, planted)
    assert len(found.poles()) == order and np.abs(found(2j * np.pi * f)) == pytest.approx(planted, rel=1e-3)
    deviation = 0.1 + 0.5 * np.exp(-(np.log(f / 3.0) ** 2))
    assert (np.abs(fit_weight(f, deviation)(2j * np.pi * f)) >= deviation * (1.0 - 1e-9)).all()


def test_with_a_dead_zone_it_gives_margins_over_amplitude_and_the_dead_band_at_the_upper_end(few_cycles):
    """Cycles that are simulated are that of other tests."""
    robot = exo.load_robot()
    found = assess_answer(
        robot, answer_of("motor.dead_zone", width=(4e-4, 3e-4, 6e-4), release=(1.0, 1.0, 1.0)), draws=2
    )
    assert found.dead_band["tension_MF"] == pytest.approx(6e-4 / robot["controller.kp"], rel=0.1)
    assert found.band.undecided == 2 and found.unstable == () and len(found.cycles) == 3
    assert found.gain_margin_db == pytest.approx(8.4, abs=1.0) and found.phase_margin_deg > 80.0


def test_a_robot_of_the_answer_that_is_unstable_is_named():
    """The nominal loop bears 4.9 frames of latency."""
    found = assess_answer(exo.load_robot(), answer_of("timing.command_latency", (), frames=(3.0, 1.0, 7.0)), draws=2)
    assert found.unstable == ("upper ends",) and found.peak > 0.9


def test_a_gain_of_the_sensor_is_an_uncertainty_of_that_size():
    """MF reads 10 % more, 4 to 16: its plant deviates by 0.06 / 1.10 but for the tension at rest."""
    found = assess_answer(exo.load_robot(), SENSOR_GAIN, draws=4)
    assert len(found.band.members) == 4 and found.unstable == () and found.band.undecided == 0 and found.cycles == ()
    assert found.deviation == pytest.approx(0.06 / 1.10 * np.ones(120), rel=0.15)
    assert found.peak < 0.07 and max(found.dead_band.values()) < 1e-6


def test_the_command_reads_a_folder_and_its_improved_robot(tmp_path, monkeypatch):
    """What the loop of the robot itself has beside, limit cycles above all, is that of other tests."""
    (tmp_path / "diagnosis.json").write_text(json.dumps(SENSOR_GAIN | {"effects": [SCALE_GAIN]}))
    exo.write_robot(exo.load_robot("emps").splice("scale.gain", {"gain": 0.1}), tmp_path / "improved.yaml")
    monkeypatch.setattr(limit_cycles, "limit_cycles", lambda *_, **__: ())
    found = run("analyse", "--diagnosis", tmp_path, "--draws", 2, "--json", tmp_path / "a.json")
    assert found.exit_code == 0, found.output
    assert "robots of the diagnosis: 2 of 2 stable" in found.output and "stable for all of them" in found.output
    saved = json.loads((tmp_path / "a.json").read_text())
    assert saved["effects"] and saved["uncertainty"]["weight"]["denominator"]
