"""The whole diagnosis on short simulated cases: names, what the answer may depend on, its form and its cost."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import case_of, friction_case, friction_diagnosis, healthy_diagnosis, robot_with
from effects_motion import motion_of

import exodrake as exo
from exodrake.core.parallel import one_blas_thread
from exodrake.core.progress import Stage
from exodrake.data.case import Case, CaseLog, gather_logs
from exodrake.diagnosis import isolation, pipeline
from exodrake.diagnosis.intervals import ROUNDING, fitted_effects
from exodrake.diagnosis.likelihood import NOISE_RUNS, duration
from exodrake.diagnosis.many import check_answer
from exodrake.diagnosis.pipeline import write_notes
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.result import CAUSE, NAMED, NO_GAP, RETUNE, UNKNOWN
from exodrake.engine.inputs import Reference
from exodrake.simulation import protocols
from exodrake.simulation.simulate import simulate

TREMBLES = frozenset({"finger.tremor", "mocap.gain", "mocap.offset", "finger.stiffness", "sensor.gain"})
RIVALS = frozenset({"tendon.capstan_friction", "tendon.coulomb_friction", "finger.hysteresis", "sensor.gain"})
AFFORDABLE = 1_400  # robots simulated in both views


def test_injected_friction_is_named_with_its_coefficient():
    found = friction_diagnosis()
    (friction,) = (effect for effect in found.effects if effect.role == CAUSE)
    assert found.verdict == NAMED and friction.id == "tendon.capstan_friction"
    assert friction.kind == "load-dependent friction"
    coefficient = friction.parameters["mu_phi"]
    assert coefficient.low < 0.3 < coefficient.high and coefficient.value == pytest.approx(0.3, rel=0.05)
    assert friction.wires == ("AF", "MF", "AE") and found.where.block == "tendon"
    assert next(iter(found.where.shares)) == "tendon"
    assert found.remainder.value < 0.1 and found.remainder.low <= found.remainder.value <= found.remainder.high
    robot, nominal = found.robots["improved"], exo.load_robot()
    assert robot.channels("tendon.capstan_friction.mu_phi") == pytest.approx([0.3] * 3, abs=0.02)
    assert all(robot[name] == nominal[name] for name in (*nominal.machine.noise, *nominal.machine.resolution))


def test_candidates_are_the_most_likely_first():
    found = friction_diagnosis()
    evidence = [c.evidence for c in found.candidates]
    assert evidence == sorted(evidence, reverse=True) and "tendon.capstan_friction" in found.candidates[0].id


def test_two_steps_of_the_closure_multiply_to_the_whole_and_each_motion_has_its_own():
    found = friction_diagnosis()
    closure = found.closure
    assert 1.0 - closure.overall.value == pytest.approx((1.0 - closure.retune.value) * (1.0 - closure.effect.value))
    assert closure.effect.value > 0.8
    assert closure.measured_on == ("random",) and set(closure.motions) == {"sweeps", "holds"}
    assert all(one.low <= one.value <= one.high and one.value > 0.8 for one in closure.motions.values())
    answer = json.loads(json.dumps(found.to_json()))["closure"]
    assert answer["measured_on"] == ["random"]
    assert answer["motions"]["sweeps"]["value"] == closure.motions["sweeps"].value


def test_values_are_fitted_to_more_of_the_logs_than_the_search():
    """The planted coefficient lies in its interval; the posterior is narrower than that of the search."""
    problem = make_problem(friction_case(), exo.load_robot(), RIVALS)
    with one_blas_thread():
        found = isolation.isolate(problem, most=0.4 * isolation.count_samples(problem))
        retuned, best = isolation.fit_on(found, found.best)
    whole = fitted_effects(best).of("tendon.capstan_friction")
    assert np.all(np.abs(whole.x - 0.3) < 3.0 * np.hypot(whole.std, ROUNDING * 0.3))
    part, more = (np.diag(one.model.posterior().covariance)[one.explanation.nominal :] for one in (found.best, best))
    assert np.all(more < part)
    assert best.model.samples.sum() > found.best.model.samples.sum()
    assert retuned.model.samples.sum() == best.model.samples.sum() and retuned.chi2[0] > best.chi2[0]


def test_a_set_that_explains_the_fitted_part_is_fitted_on_before_more_is_sought():
    """Its values are as exact as that part: a longer part, and not a lag of 2 ms, explains the rest of the log."""
    worn = exo.load_robot().splice("tendon.capstan_friction", {"mu_phi": {"AF": 0.3}})
    case = gather_logs(simulate(worn, protocols.protocol("short-sweeps", worn), seed=3))
    problem = make_problem(case, exo.load_robot(), frozenset({"tendon.capstan_friction", "sensor.lag"}))
    with one_blas_thread():
        found = isolation.isolate(problem)
        _, precise = isolation.fit_on(found, found.best)
    assert found.best.effects == {"tendon.capstan_friction"}
    left = found.search.excess(found.best.explanation.robot)
    assert left.fitted < 0.0 <= left.whole and found.excess(precise.explanation.robot) < 0.0


def test_nominal_parameters_come_back_from_where_retuning_led_without_traces_elsewhere():
    """Retuning moves what imitates friction, by 1.3 tolerances (RMS).

    With the Jacobian of the retuned robot alone the fit ended on the way back, and left 3.6 of the held-out noise.
    """
    worn = exo.load_robot().splice("tendon.capstan_friction", {"mu_phi": {"AF": 0.3}})
    found = exo.diagnose(case_of(worn, 4), tried=RIVALS)
    friction = found.effects[0]
    assert found.verdict == NAMED and friction.id == "tendon.capstan_friction"
    assert found.closure.rms["retuned"] > 20.0 and found.closure.rms["after"] < 1.2
    assert friction.wires == ("AF",)
    robot = found.robots["improved"]
    coefficients = {tendon: robot[f"tendon.capstan_friction.mu_phi.{tendon}"] for tendon in ("AF", "MF", "AE")}
    assert coefficients == {"AF": friction.parameters["mu_phi"].value, "MF": 0.0, "AE": 0.0}


def test_a_gain_is_told_from_tolerances_that_are_factors_beside_it():
    """The gain of one reading beside ratios within 3 %: each comes back where it was planted.

    Where a gain can stand for a ratio, a fit gives it to all joints and takes no ratio, and it creeps along the valley
    of two factors with one product.
    """
    wrist = exo.load_robot("dvrk_wrist")
    ratios = {"q4": 0.99, "q5": 1.01, "q6": 1.0}
    worn = wrist.with_parameters({f"cable.ratio.{joint}": value for joint, value in ratios.items()})
    worn = worn.splice("reading.gain", {"gain": -0.107}, ["q6"])
    logs = [exo.simulate(worn, f"random-motion:duration=300,seed={k}", seed=k) for k in (1, 2, 3)]
    found = exo.diagnose(logs, wrist, tried=frozenset({"reading.gain", "cable.play", "cable.offset"}))
    (gain,) = found.effects
    assert (found.verdict, gain.id, gain.joints) == (NAMED, "reading.gain", ("q6",))
    interval, improved = gain.parameters["gain"], found.robots["improved"]
    assert interval.low < -0.107 < interval.high < 0.0
    assert {joint: improved[f"cable.ratio.{joint}"] for joint in ratios} == pytest.approx(ratios, abs=2e-3)
    assert found.closure.rms["after"] < 1.0 < found.closure.rms["retuned"]


def test_healthy_robot_raises_no_alarm():
    """It meets an end stop in its held-out log only, which no retuning could know."""
    found = healthy_diagnosis()
    assert found.verdict in (NO_GAP, RETUNE) and not found.effects and found.where.block == "none"
    assert np.isnan(found.remainder.value) and found.remainder.noise_std < 0.5


def test_nominal_robot_has_no_gap():
    assert exo.diagnose(case_of(exo.load_robot(), 5, frames=450)).verdict == NO_GAP


def test_a_sensor_that_is_noisier_than_its_file_says_is_no_gap_but_a_note():
    robot = exo.load_robot()
    noisy = robot.with_parameters({"mocap.sigma_q": 3.0 * robot["mocap.sigma_q"]})
    found = exo.diagnose(case_of(noisy, 6), robot)
    assert found.verdict in (NO_GAP, RETUNE) and not found.effects
    assert any("noise of the logs counts: mocap.sigma_q" in note for note in found.notes)
    assert found.robots["improved"]["mocap.sigma_q"] == pytest.approx(noisy["mocap.sigma_q"], rel=0.05)


@pytest.mark.parametrize("found", [friction_diagnosis, healthy_diagnosis])
def test_answer_is_strict_json_with_the_keys_that_programs_of_others_read(found):
    """Of `docs/explain/answer.md`, as first published; more may come, none may go."""
    answer = found().to_json()
    text = json.dumps(answer, allow_nan=False)
    assert json.loads(text) == answer and answer["verdict"] == found().verdict
    assert check_answer(json.loads(text), "answer")["remainder"] == json.loads(text)["remainder"]
    keys = "verdict where effects equivalents closure next_experiment notes candidates seconds simulated_seconds"
    assert set(keys.split()) <= set(answer)
    assert {"block", "wires", "joints", "shares"} <= set(answer["where"])
    assert {"overall", "retune", "effect", "signals"} <= set(answer["closure"])
    assert {"before", "after", "floor", "closure"} <= set(next(iter(answer["closure"]["signals"].values())))
    assert all({"id", "share"} <= set(row) for row in answer["candidates"])
    assert {"value", "low", "high", "noise_std", "block", "regime"} == set(answer["remainder"])
    assert all({"id", "kind", "role", "share", "rivals", "wires", "joints"} <= set(row) for row in answer["effects"])


def test_simulated_time_is_affordable_and_adds_up():
    """The runs with noise count: written in closed loop, then followed in closed loop and as prediction error."""
    found = friction_diagnosis()
    used = duration(found.problem.shorten(isolation.affordable(found.problem, isolation.USED)))
    assert found.simulated_time == pytest.approx(sum(found.simulated.values()))
    assert 0.0 < found.simulated_time <= 2.0 * AFFORDABLE * used
    assert found.simulated["noise"] == pytest.approx(3.0 * NOISE_RUNS * used, rel=1e-3)


def test_isolation_uses_no_more_than_is_affordable_and_the_answer_says_so(monkeypatch):
    problem = make_problem(friction_case(), exo.load_robot(), frozenset({"tendon.capstan_friction"}))
    size = sum(trial.measured.size for trial in problem.fit)
    monkeypatch.setattr(isolation, "affordable", lambda problem, most=0.3 * size: min(1.0, 0.3))
    monkeypatch.setattr(pipeline, "affordable", isolation.affordable)
    found = isolation.isolate(problem)
    assert found.likelihood.views[0].samples == pytest.approx(0.3 * size, rel=0.01)
    assert found.best.effects == {"tendon.capstan_friction"}
    assert "the logs are long: the first 30 % of each was fitted" in write_notes(found, found.best, problem.robot)


def test_more_of_a_log_is_fitted_where_an_effect_begins_after_the_part_that_would_be():
    robot = exo.load_robot()
    motion = 0.3 * protocols.random_motion(robot, seed=2).values[:500]
    motion[330:] *= 3.0  # the current is limited from here on
    limited = robot.splice("motor.current_limit", {"limit": 0.06})
    case = gather_logs([simulate(limited, Reference(motion), seed=2)], (), robot.machine.frame)
    problem = make_problem(case, robot, frozenset({"motor.current_limit", "tendon.capstan_friction", "sensor.gain"}))
    size = sum(trial.measured.size for trial in problem.fit)
    found = isolation.isolate(problem, most=0.4 * size)
    assert "motor.current_limit" in found.best.effects
    assert found.likelihood.views[0].samples > 0.66 * size


def bend_slowly(robot):
    """Times (4000,) [s], and two sines of a tendon in a bent sheath, as its reference has them (4000, 3)."""
    time, turn = robot.machine.frame * np.arange(4000), 2.0 * np.pi
    angle = 0.6 * np.sin(0.11 * turn * time) + 0.25 * np.sin(0.37 * turn * time)
    return time, np.column_stack([angle, np.gradient(angle, robot.machine.frame), np.ones_like(angle)])


def test_effect_that_shows_after_the_fitted_part_is_taken_by_its_evidence():
    """A clock that gains 0.2 ms a second, beside play: play alone leaves no more than the stated noise at first."""
    robot = exo.load_robot("tendon_sheath")
    time, motion = bend_slowly(robot)
    quiet = robot.with_parameters({"reading.sigma.bending": 0.8 * robot["reading.sigma.bending"]})
    worn = quiet.splice("sheath.play", {"half_width": 0.1}).splice("reading.clock_skew", {"skew": 2e-4})
    case = gather_logs([simulate(worn, Reference(motion), seed=1)], (), robot.machine.frame)
    tried = frozenset({"sheath.play", "sheath.gain", "sheath.offset", "reading.clock_skew"})
    with one_blas_thread():
        found = isolation.isolate(make_problem(case, robot, tried), most=0.35 * len(time))
    assert found.best.effects == {"sheath.play", "reading.clock_skew"}
    assert found.search.sets[frozenset({"sheath.play"})].excess < 1e-3


def test_more_of_a_log_is_fitted_where_a_set_leaves_what_grows_after_the_part_that_would_be():
    """A drift beside play, which explains more than 95 % of the gap."""
    robot = exo.load_robot("tendon_sheath")
    time, motion = bend_slowly(robot)
    drift = 4.0 * robot["reading.repeatability"] / time[-1]
    worn = robot.splice("sheath.play", {"half_width": 0.1}).splice("reading.drift", {"rate": drift})
    case = gather_logs([simulate(worn, Reference(motion), seed=1)], (), robot.machine.frame)
    tried = frozenset({"sheath.play", "sheath.gain", "sheath.offset", "reading.drift"})
    with one_blas_thread():
        found = isolation.isolate(make_problem(case, robot, tried), most=0.06 * len(time))
    assert found.best.effects == {"sheath.play", "reading.drift"}
    assert found.likelihood.views[0].samples > 0.5 * len(time)
    assert found.search.measure_left(found.search.sets[frozenset({"sheath.play"})]) < 0.05


def test_effect_beside_a_tremor_is_named_with_it():
    trembling = exo.load_robot().splice("finger.tremor", {"torque": 4e-3, "frequency": 7.3}, channels=["MCP"])
    found = exo.diagnose(case_of(trembling.splice("mocap.gain", {"gain": 0.15}, channels=["PIP"]), 3), tried=TREMBLES)
    named = {effect.id: effect.joints for effect in found.effects}
    assert found.verdict == NAMED and named == {"finger.tremor": ("MCP",), "mocap.gain": ("PIP",)}
    assert all(effect.role == CAUSE for effect in found.effects)
    shares = [effect.share.value for effect in found.effects]  # of one gap, what remains beside them
    assert min(shares) > 0.0 and sum(shares) + found.remainder.value == pytest.approx(1.0, abs=0.05)


def test_tremor_alone_is_named():
    """A certain detection is a cause, though nothing is left for a fit."""
    trembling = exo.load_robot().splice("finger.tremor", {"torque": 4e-3, "frequency": 7.3}, channels=["MCP"])
    found = exo.diagnose(case_of(trembling, 3), tried=TREMBLES)
    (tremor,) = found.effects
    assert found.verdict == NAMED and tremor.id == "finger.tremor" and tremor.joints == ("MCP",)
    assert tremor.role == CAUSE and found.where.block == "finger" and "spectral peak" in found.reasons[0]


def emps_case(robot, *roles, frames=3000):
    """Logs of a carriage with Coulomb friction, each of a motion of its own."""
    injected, items = robot.splice("carriage.coulomb_friction", {"force": 15.0}), []
    for k, role in enumerate(roles):
        log = exo.simulate(injected, Reference(motion_of("emps", k)[:frames], "motion"), seed=k)
        items.append(CaseLog(log, f"motion{'abc'[k]}", role, None, f"{k}.csv"))
    return Case("emps", {}, tuple(items), robot.machine.frame)


def test_held_out_logs_decide_the_closure_and_its_word_alone():
    """Noise in place of every measured column of the held-out log: nothing else of the answer changes."""
    robot, rng = exo.load_robot("emps"), np.random.default_rng(0)
    case = emps_case(robot, "fit", "holdout")
    log = case.logs[1].log
    signals = {n: v if "_ref" in n else rng.standard_normal(len(v)) * v.std() for n, v in log.signals.items()}
    spoilt = replace(case, logs=(case.logs[0], replace(case.logs[1], log=replace(log, signals=signals))))
    stages: list[Stage] = []
    found = exo.diagnose(case, robot, lambda stage, detail: stages.append(stage))
    assert list(dict.fromkeys(stages)) == [s for s in Stage if s in stages] and stages[-1] == Stage.LOCALISE
    answers = [found.to_json(), exo.diagnose(spoilt, robot).to_json()]
    assert answers[0]["closure"] != answers[1]["closure"]
    assert [answer["confirmed"] for answer in answers] == [True, False]  # a word for the closure
    for answer in answers:  # notes are on the logs as they came
        del answer["closure"], answer["confirmed"], answer["seconds"], answer["notes"], answer["provenance"]["date"]
    assert answers[0] == answers[1]


def test_closure_on_a_kind_left_out_is_that_of_a_fit_without_it():
    """The one Gauss-Newton step away from the joint fit comes to the closure of a diagnosis that never saw the log."""
    robot = exo.load_robot("emps")
    case = emps_case(robot, "fit", "fit", "holdout")
    joint = exo.diagnose(case, robot).closure.motions
    never_seen = replace(case, logs=(case.logs[0], replace(case.logs[1], role="holdout")))
    found = exo.diagnose(never_seen, robot).closure
    assert set(joint) == {"motiona", "motionb"} and found.motions == {}  # one kind says nothing of another
    assert joint["motionb"].value == pytest.approx(found.overall.value, abs=0.03)


def test_a_gap_that_its_user_calls_negligible_is_none():
    """A hum in the readings of a sheath, of less than their noise, which no effect that is tried makes."""
    robot = exo.load_robot("tendon_sheath")
    log, hum = exo.simulate(robot, "steps:dwell=2", seed=1), 0.9 * robot["reading.sigma.bending"]
    angle = log["angle_bending"] + hum * np.sin(0.9 * np.arange(len(log)))
    humming = replace(log, signals=log.signals | {"angle_bending": angle})
    found = exo.diagnose(humming, robot, tried=frozenset({"sheath.gain"}))
    (note,) = (note for note in found.notes if "--negligible" in note)
    assert found.verdict == UNKNOWN
    least = float(re.search(r"--negligible ([\d.]+) ", note)[1])
    assert 0.3 < least < 0.9 / np.sqrt(2.0)
    assert exo.diagnose(humming, robot, tried=frozenset({"sheath.gain"}), negligible=least).verdict == NO_GAP


def test_machine_without_tolerances_and_without_held_out_logs_is_diagnosed():
    robot = exo.load_robot("emps")
    robot = replace(robot, machine=replace(robot.machine, tolerances=()))
    found = exo.diagnose(emps_case(robot, "fit", "fit"), robot)
    assert "carriage.coulomb_friction" in {effect.id for effect in found.effects} | set(found.equivalents)
    assert found.closure.overall.value > 0.99 and found.robots["retuned"].values == pytest.approx(robot.values)


def test_true_effect_that_is_not_tried_is_not_named():
    tried = frozenset({"mocap.gain", "finger.stiffness"})
    found = exo.diagnose(case_of(robot_with("tendon.capstan_friction", 1, mu_phi=0.3), 1, frames=450), tried=tried)
    assert found.verdict == "UNKNOWN" and not found.effects
    assert {i for c in found.candidates for i in c.id.split(" + ")} <= tried


def test_play_of_a_joint_is_named_beside_a_lag_that_stands_for_the_delay_of_another():
    nominal = exo.load_robot("so101")
    worn = nominal.splice("servo.latency", {"frames": 3.0}, ["Rotation"]).splice("servo.gain", {"gain": 0.1}, ["Elbow"])
    worn = worn.splice("servo.dead_band", {"half_width": 0.008}, ["Jaw"])
    logs = [exo.simulate(worn, exo.protocol(f"random-motion:duration=10,seed={k}", worn), seed=k) for k in range(2)]
    items = tuple(CaseLog(log, "motion", role, None, f"{role}.csv") for log, role in zip(logs, ("fit", "holdout")))
    case = Case("injected", {}, items, nominal.machine.frame)
    found = exo.diagnose(case, nominal, tried=frozenset({"servo.lag", "servo.dead_band", "servo.gain"}))
    assert found.verdict == "NAMED", found.reasons
    named = {effect.id: effect.joints for effect in found.effects}
    assert named == {"servo.lag": ("Rotation",), "servo.gain": ("Elbow",), "servo.dead_band": ("Jaw",)}
