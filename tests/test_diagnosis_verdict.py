"""Decisions: on sets whose shares are given, and on healthy robots that retuning or a law stands for."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from arm_folders import made
from diagnosis_cases import case_of, robot_with

from exodrake.data.case import gather_logs
from exodrake.data.log import Log
from exodrake.diagnosis import verdict
from exodrake.diagnosis.fit import Explanation
from exodrake.diagnosis.isolation import isolate
from exodrake.diagnosis.parameter import Parameter
from exodrake.diagnosis.pipeline import diagnose
from exodrake.diagnosis.problem import make_problem, with_recorded_ranges
from exodrake.diagnosis.result import CAUSE, REFINEMENT, TOO_LITTLE
from exodrake.diagnosis.search import Search
from exodrake.machines.robot_file import load_robot
from exodrake.reference.cases import MIXES, CasePlan
from exodrake.reference.make import case_and_label
from exodrake.report import wording
from exodrake.simulation.simulate import simulate

BOTH, FRICTION, DRIFT = (frozenset(some) for some in (("friction", "drift"), ("friction",), ("drift",)))


def decide(monkeypatch, find, usable=lambda fitted: True, family="friction", errors=None, rivals=()):
    """Effects and roles that are left of two; find: set -> effect -> role and share.

    errors: set -> error on motion that is left out. rivals: sets with another effect in the place of one.
    """
    errors = errors or {}
    monkeypatch.setattr(verdict, "predict_left_out", lambda problem, one: errors.get(one.effects, 1.0))
    others = {f"rival {k}": SimpleNamespace(effects=key) for k, key in enumerate(rivals)}
    monkeypatch.setattr(verdict, "list_rivals", lambda found, best, *_: others if best.effects == BOTH else {})
    monkeypatch.setattr(verdict, "find_roles", lambda found, best: {i: role for i, (role, _) in find(best).items()})
    gains = lambda found, best: {i: np.array([share]) for i, (_, share) in find(best).items()}  # noqa: E731
    monkeypatch.setattr(verdict, "measure_gains", gains)
    smaller = [key - {i} for key in rivals for i in key]
    sets = {key: SimpleNamespace(effects=key) for key in (BOTH, FRICTION, DRIFT, frozenset(), *smaller)}
    effects = [SimpleNamespace(id="drift", family=family)]
    search = SimpleNamespace(sets=sets, usable=usable, reduce=lambda effects: None, effects=effects)
    found = SimpleNamespace(search=search, best=sets[BOTH], problem=None)
    best, roles = verdict.drop_misleading(found)
    assert roles.keys() == best.effects
    return best.effects, [*roles.values()]


@pytest.mark.parametrize(
    ("share", "usable", "family", "kept"),
    [
        (0.02, True, "load", True),
        (-0.02, True, "load", False),
        (-0.02, False, "load", True),
        (0.02, True, "drift", False),
    ],
)
def test_a_refinement_goes_if_whole_logs_are_worse_with_it_or_it_is_of_time_alone_and_the_rest_is_within_its_ranges(
    monkeypatch, share, usable, family, kept
):
    def find(best):
        shares = {"friction": (CAUSE, 0.9), "drift": (REFINEMENT, share)}
        return {i: shares[i] for i in sorted(best.effects)[::-1]}

    effects, _ = decide(monkeypatch, find, lambda fitted: usable, family)
    assert effects == (BOTH if kept else FRICTION)


@pytest.mark.parametrize(
    ("errors", "rivals", "left"),
    [
        ({BOTH: 1.9}, (), BOTH),
        ({BOTH: 2.1, DRIFT: 1.5}, (), FRICTION),
        ({BOTH: 2.1, FRICTION: 1.5, DRIFT: 1.2}, (), BOTH),
        ({BOTH: 2.1, FRICTION: 1.5, DRIFT: 1.5, frozenset("ab"): 1.0}, (frozenset("ab"),), frozenset("ab")),
    ],
)
def test_a_set_gives_way_to_one_that_leaves_half_as_much_on_motion_that_is_left_out(monkeypatch, errors, rivals, left):
    def find(best):
        return dict.fromkeys(sorted(best.effects)[::-1], (CAUSE, 0.5))

    effects, _ = decide(monkeypatch, find, errors=errors, rivals=rivals)
    assert effects == left


def test_a_rival_does_not_double_the_error_on_motion_that_is_left_out(monkeypatch):
    errors = {"best": 1.0, "as good": 1.9, "worse": 2.1}
    monkeypatch.setattr(verdict, "predict_left_out", lambda problem, one: errors[one])
    search = SimpleNamespace(list_rivals=lambda best, effect, gain: {"lag": "as good", "play": "worse"})
    found = SimpleNamespace(search=search, problem=None, beside_detections=1.0)
    assert verdict.list_rivals(found, "best", "latency", 0.9) == {"lag": "as good"}


@pytest.mark.parametrize("values", [[-0.01, -0.02, 0.0], [0.99, 0.9, 1.1], [1.2, 1.2, 1.2], [0.5]])
def test_a_share_lies_between_its_ends_and_these_between_none_and_all(values):
    share = verdict.jackknife_share(np.array(values))
    assert 0.0 <= share.low <= share.value <= share.high <= 1.0
    assert share.value == min(max(values[0], 0.0), 1.0)


DRY, LOAD, SENSOR = "carriage.coulomb_friction", "carriage.load_friction", "scale.low_pass"


@pytest.mark.parametrize(
    ("alone", "cause"),
    [
        ({"": 1.0, DRY: 0.06, LOAD: 0.05}, [LOAD]),  # either of two leaves little without the other
        ({"": 0.09, DRY: 0.06, LOAD: 0.05}, []),  # both together are small
        ({"": 1.0, DRY: 0.06, SENSOR: 0.05}, [DRY]),  # a sensor's memory comes last
    ],
)
def test_of_refinements_that_stand_in_for_each_other_one_is_a_cause(alone, cause):
    """Shares of the gap that each leaves alone, and none; both leave 1 %."""
    first, second = list(alone)[1:]
    sets = {frozenset(filter(None, [i])): share for i, share in alone.items()} | {frozenset([first, second]): 0.01}
    search = SimpleNamespace(
        sets=sets, best_within=sets.__getitem__, left_by_joint=np.atleast_1d, fit_parts=lambda key, parts: None,
        effects=load_robot("emps").machine.effects,
    )  # fmt: skip
    best, found = SimpleNamespace(effects=max(sets, key=len)), SimpleNamespace(search=search, beside_detections=1.0)
    roles = verdict.promote_refinements(found, best, {first: REFINEMENT, second: REFINEMENT})
    assert [i for i, role in roles.items() if role == CAUSE] == cause


def test_an_answer_says_where_logs_tell_too_little_of_a_set_that_explains_the_gap(arm_folder):
    """Play and an offset in hardly more than one period, beside a slow error as large, of which no effect is."""
    robot, time, rng = made(arm_folder, "brief", "--joints", "tip"), 0.02 * np.arange(100), np.random.default_rng(0)
    command, held = 0.5 * np.sin(2.0 * np.pi * time / 1.6), [0.0]
    for aim in command + 0.08:
        held.append(min(max(held[-1], aim - 0.1), aim + 0.1))
    slow = 0.15 * np.sin(2.0 * np.pi * time / 3.4)
    angle = np.array(held[1:]) + slow + 5e-4 * rng.standard_normal(len(time))
    log = {"time": time, "angle_ref_tip": command, "angle_start_tip": angle[0], "angle_tip": angle}
    found = diagnose(pd.DataFrame(log), robot)
    assert found.verdict == "UNKNOWN" and TOO_LITTLE in found.reasons[-1]
    assert found.reasons[-1] in wording.headline(found)


def test_what_a_set_leaves_is_no_more_than_what_a_part_of_it_does():
    """Mass and gain, whose fit ended at a bound, leave no more than mass alone: the offset beside them is no cause."""
    left = {frozenset(): 1.0, frozenset({"mass"}): 0.01, frozenset({"mass", "gain"}): 0.3, frozenset({"gain"}): 0.9}
    search = SimpleNamespace(sets={key: key for key in left}, measure_left=left.__getitem__)
    assert Search.best_within(search, frozenset({"mass", "gain"})) == {"mass"}
    assert Search.best_within(search, frozenset({"gain"})) == {"gain"}


@pytest.mark.parametrize("now", [{"latency": 3.0, "dead_band": 0.01}, {"latency": 2.0, "dead_band": 0.03}, {}])
def test_what_has_changed_of_an_effect_that_the_nominal_robot_has_is_named(now):
    """More of one of two effects, or neither of them any more: the values are those of today."""
    laws = {"latency": "frames", "dead_band": "half_width"}

    def servo(values):
        robot = load_robot("so101")
        for law, value in values.items():
            robot = robot.splice(f"servo.{law}", {laws[law]: value})
        return robot

    before, today = {"latency": 2.0, "dead_band": 0.01}, servo(now)
    logs = [simulate(today, f"random-motion:seed={k},duration=15", seed=k) for k in (1, 2, 3)]
    found = diagnose(logs, servo(before))
    assert found.verdict == "NAMED"
    stated = {e.id.removeprefix("servo."): next(iter(e.parameters.values())) for e in found.effects if e.role == CAUSE}
    assert stated.keys() == {law for law in laws if now.get(law, 0.0) != before[law]}
    for law, value in stated.items():
        assert value.low <= now.get(law, 0.0) <= value.high


def test_a_small_cause_of_one_joint_is_not_hidden_by_a_larger_gap_of_the_others():
    robot = load_robot("so101")
    far = robot.splice("servo.latency", {"frames": 3.0}).splice(
        "servo.gravity_sag", {"sag": 0.0035}, channels=["Pitch"]
    )
    found = diagnose([simulate(far, f"random-motion:seed={k},duration=20", seed=k) for k in (1, 2)], robot)
    sag = next(e for e in found.effects if e.id == "servo.gravity_sag")
    assert (sag.role, sag.joints) == (CAUSE, ("Pitch",)) and sag.share.value < 0.02  # of the gap of six joints


@pytest.mark.parametrize("taken", ["clear", "part of a law", "retuned", "moved"])
def test_what_an_error_of_another_law_or_retuning_may_be_is_no_cause(taken):
    """Five noise standard deviations where the large effect is silent, a tenth of what that one does, or not its own.

    The latter are what retuned parameters leave without an effect that by itself does nothing in that channel, or next
    to nothing while a parameter was moved for the sake of what the large effect does elsewhere.
    """
    rng, robot, large, small = np.random.default_rng(0), load_robot(), "tendon.capstan_friction", "sensor.offset"
    moves = np.repeat([1.0, 0.0], 1000)
    gap = 5.0 * (moves if taken == "part of a law" else 1.0 - moves)
    does = {large: 50.0 * moves, small: gap * {"retuned": 0.0, "moved": 0.1}.get(taken, 1.0)}
    indices = {
        i: next(iter(robot.machine.effect_indices(i, robot.machine.effect(i).parameters[0].name).values()))
        for i in does
    }
    present, noise = robot.values.copy(), rng.normal(size=len(moves))
    present[list(indices.values())] = 0.01
    nominal, shape = Parameter("p", (0,), "additive", 0.0, 5.0, (-15.0, 15.0)), np.tile([1.0, -1.0], 1000)

    def residual(rows, trials=()):
        done = [sum(x * (row[indices[i]] == 0.0) for i, x in does.items()) for row in rows]
        return np.array([noise + one + shape * (row[0] - present[0]) for row, one in zip(rows, done, strict=True)])

    likelihood = SimpleNamespace(
        residual=residual, stretches=[(0, 0, slice(0, len(moves)))], memory=1.0,
        views=[SimpleNamespace(squares=np.ones((2, 1)))], scaled_to=lambda residual: likelihood,
        derivatives=lambda rows, base, steps: np.zeros((0, len(base))),
    )  # fmt: skip

    def fitted(values, x=0.0):
        e = Explanation((), (nominal,), np.array([x]), values, np.zeros(0), shape[None])
        return SimpleNamespace(explanation=replace(e, residual=residual([e.robot])[0]))

    without = {i: np.where(np.arange(len(present)) == k, 0.0, present) for i, k in indices.items()}
    smaller = {large: fitted(without[large]), small: fitted(without[small], 5.0 * (taken in ("retuned", "moved")))}
    whole = SimpleNamespace(robot=robot, residual=residual, fit=(), columns=("tension_AF",), counted={})
    found = SimpleNamespace(whole=whole, likelihood=likelihood)
    clear = verdict.find_clear(found, fitted(present), smaller)
    assert clear[large].all() and clear[small].all() == (taken == "clear")


def test_a_robot_whose_finger_snaps_over_is_retuned_to_its_noise():
    """Fitted in closed loop alone it ended in another minimum, with reduced chi-squares of 16.3 and 3.6."""
    case, _ = case_and_label(CasePlan("case", (400123, 84), "healthy", (), False, MIXES["healthy"]))
    closed, prediction = isolate(make_problem(case, load_robot()).shorten(0.4)).retuned.chi2
    assert prediction < 1.1 and closed < 2.0


def test_routers_that_sit_lower_are_named_where_tolerances_could_stand_for_them():
    """Three standard deviations of three tolerances leave nothing, either."""
    robot = load_robot().splice("finger.router_height", {"height": -4e-4})
    logs = [simulate(robot, "short-sweeps:period=2", seed) for seed in (1, 2)]
    found = isolate(make_problem(gather_logs(logs), load_robot()))
    assert found.excess(found.retuned.explanation.robot) < 0.0
    (cause,) = verdict.decide(found).causes
    assert cause.effect == "finger.router_height" and cause.share.value > 0.9  # of the nominal robot's gap


def test_recordings_widen_only_ranges_that_the_library_does_not_state():
    for name, widened in (("exo_index", set()), ("emps", {"carriage.coulomb_friction"})):
        robot = load_robot(name)
        log = simulate(robot, "random-motion" if name == "exo_index" else "multisine", 0)
        far = replace(log, signals={column: 100.0 * values for column, values in log.signals.items()})
        wide = with_recorded_ranges(robot, gather_logs([far])).machine.effects
        changed = {a.id for a, b in zip(robot.machine.effects, wide, strict=True) if a.parameters != b.parameters}
        assert changed >= widened and bool(changed) == bool(widened)


def test_a_speed_limit_is_sought_where_the_joints_are_fastest_and_a_drift_takes_a_minute():
    """Joints that turn at 8 rad/s, whatever is commanded, and jump once."""
    time = 0.02 * np.arange(500)
    turning = 8.0 * time
    turning[250:] += 3.0
    joints = ("Rotation", "Pitch", "Elbow", "WristPitch", "WristRoll", "Jaw")
    measured = {f"angle_{j}": turning if j == "Elbow" else np.zeros(500) for j in joints}
    commanded = {f"angle_{kind}_{j}": 8.0 * time for kind in ("ref", "start") for j in joints}
    case = gather_logs([Log(time, measured | commanded, source="turning")])
    wide = {e.id: e.parameters[0] for e in with_recorded_ranges(load_robot("so101"), case).machine.effects}
    limit, drift = wide["servo.speed_limit"], wide["reading.drift"]
    assert limit.high == limit.initial == pytest.approx(8.0) and limit.low == pytest.approx(0.4)
    assert drift.high == pytest.approx(0.3 * turning[-1] / 60.0)


def test_gaps_that_differ_from_run_to_run_are_no_gaps_of_tolerances():
    """Most of the nominal robot's gap in each column is a disturbance that counts as noise, as repeats show it."""
    found = isolate(make_problem(case_of(robot_with(seed=3), 3, 400), load_robot()))
    assert verdict.decide(found).verdict == "RETUNE"
    whole, rng = found.whole, np.random.default_rng(0)
    residual = whole.residual(found.nominal.robot[None], whole.fit).reshape(-1, len(whole.columns))
    noise = 1.2 * np.sqrt(np.maximum(np.mean(residual**2, axis=0), 1.0)) * whole.noise_std
    runs = [whole.predict(found.retuned.explanation.robot[None], trial)[0] for trial in whole.fit]
    fit = [replace(t, measured=y + noise * rng.standard_normal(y.shape)) for t, y in zip(whole.fit, runs, strict=True)]
    first = whole.case.logs[0]
    case = replace(whole.case, logs=(*whole.case.logs, replace(first, file="again.csv", repeats=first.file)))
    random = replace(found, whole=replace(whole, case=case, noise_std=noise, fit=tuple(fit)))
    decision = verdict.decide(random)
    assert decision.verdict == "UNKNOWN" and "run to run" in decision.reasons[0]
