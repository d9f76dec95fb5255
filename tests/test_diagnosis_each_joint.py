"""Causes beside each other, each joint its own: a small one is not hidden behind the wrong law of another joint."""

import numpy as np

import exodrake as exo
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.intervals import affected_channels

TRIED = frozenset({"servo.lag", "servo.dead_band", "servo.gain"})


def test_play_of_a_joint_is_named_beside_a_lag_that_stands_for_the_delay_of_another():
    nominal = exo.load_robot("so101")
    worn = nominal.splice("servo.latency", {"frames": 3.0}, ["Rotation"]).splice("servo.gain", {"gain": 0.1}, ["Elbow"])
    worn = worn.splice("servo.dead_band", {"half_width": 0.008}, ["Jaw"])
    logs = [exo.simulate(worn, exo.protocol(f"random-motion:duration=10,seed={k}", worn), seed=k) for k in range(2)]
    items = tuple(CaseLog(log, "motion", role, None, f"{role}.csv") for log, role in zip(logs, ("fit", "holdout")))
    found = exo.diagnose(Case("injected", {}, items, nominal.machine.frame), nominal, tried=TRIED)
    assert found.verdict == "NAMED", found.reasons
    named = {effect.id: effect.joints for effect in found.effects}
    assert named == {"servo.lag": ("Rotation",), "servo.gain": ("Elbow",), "servo.dead_band": ("Jaw",)}


def test_a_channel_whose_amplitude_ended_at_0_has_no_effect_however_little_the_motion_tells():
    x, std = np.array([0.05, 0.0, 0.05, 0.0]), np.array([0.003, 50.0, 0.003, 50.0])
    assert affected_channels(x, np.diag(std**2)).tolist() == [0, 2]
