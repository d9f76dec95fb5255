"""Servos with motor, gear and supply: closed forms, an integrator of scipy's, energy, and friction that is found."""

import warnings
from math import cos, exp, pi, sin, sqrt

import numpy as np
import pytest
from arm_folders import made
from command_line import run
from scipy.integrate import solve_ivp

import exodrake as exo
from exodrake.analysis.figures import draw_figures
from exodrake.analysis.linear_model import add_controller
from exodrake.analysis.robustness import assess_answer
from exodrake.analysis.tuning import find_rough
from exodrake.data.case import Case, CaseLog, gather_logs
from exodrake.diagnosis.problem import make_problem, with_recorded_ranges
from exodrake.effects import LIBRARY
from exodrake.physics import servo

KT, R, VOLTS = 1.3, 2.75, 7.4  # N m/A, V/A, V
PLAIN = {"kt": KT, "R": R, "supply": VOLTS, "kp": 5.3, "kd": 0.0, "armature": 0.02, "damping": 0.0, "dry_friction": 0.0,
         "compliance": 0.0, "inertia": 0.03, "moment": 0.0, "hanging": 0.0}  # fmt: skip
STIFFNESS = PLAIN["kp"] * KT * VOLTS / R  # N m/rad
DRAG = KT**2 / R  # N m s/rad


def simulate_joint(command, time, tick=5e-4, start=0.0, **changes):
    """States (ticks, 4) of a servo after each tick: angle, speed, rotor's angle and speed; command: of the time."""
    n = servo.Parameters(**{name: (value,) for name, value in (PLAIN | changes).items()})
    x, rows = np.zeros(6), []
    for k in range(round(time / tick)):
        servo.update(x, (), n, (), tick, np.array([command(k * tick)]), np.array([start]), np.ones(1))
        rows.append(x[:4].copy())
    return np.array(rows)


@pytest.mark.parametrize("kd", [0.0, 0.05])
def test_a_small_step_is_that_of_a_second_order_loop(kd):
    """J q'' + (kt^2/R + kd kt V/R + d) q' + kp kt V/R q = kp kt V/R q_ref, up to Euler's error of first order."""
    inertia, drag = 0.05, DRAG + kd * KT * VOLTS / R + 0.01
    own, decay = sqrt(STIFFNESS / inertia), 0.5 * drag / inertia
    ringing = sqrt(own**2 - decay**2)
    errors = []
    for tick in (5e-4, 2.5e-4):
        t = tick * np.arange(1, round(0.5 / tick) + 1)
        wanted = 0.1 * (1.0 - np.exp(-decay * t) * (np.cos(ringing * t) + decay / ringing * np.sin(ringing * t)))
        errors.append(np.abs(simulate_joint(lambda t: 0.1, 0.5, tick, kd=kd, damping=0.01)[:, 0] - wanted).max())
    assert errors[0] < 1e-3 and errors[1] == pytest.approx(0.5 * errors[0], rel=0.1)


@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_the_supply_limits_speed(damping):
    """kt (V - kt w) / R = d w; a full duty cycle is held as long as the error is large."""
    speed = simulate_joint(lambda t: 100.0, 1.0, damping=damping)[-1, 1]
    assert speed == pytest.approx(KT * VOLTS / R / (DRAG + damping), rel=1e-4)
    assert damping > 0.0 or speed == pytest.approx(VOLTS / KT, rel=1e-4)


def test_a_weight_at_rest_sags_by_its_moment_over_the_stiffness():
    angle = simulate_joint(lambda t: 0.5 * pi, 2.5, moment=0.5)[-1, 0]
    assert STIFFNESS * (0.5 * pi - angle) == pytest.approx(0.5 * sin(angle), rel=1e-3)
    hanging = simulate_joint(lambda t: 0.5 * pi, 1.5, moment=0.5, hanging=0.5 * pi)[-1, 0]
    assert hanging == pytest.approx(0.5 * pi, abs=1e-3)


@pytest.mark.parametrize("compliance", [0.0, 0.02])
def test_a_large_motion_is_that_of_an_integrator_of_scipys(compliance):
    """Steps that saturate the duty cycle, weight, viscous friction, and an elastic gear with its damping."""
    values = PLAIN | {"moment": 0.8, "damping": 0.05, "kp": 2.0, "compliance": compliance}

    def command(t):
        return 1.5 if t < 0.7 else -1.0

    def slope(t, y):
        q, v, rotor, w = y
        duty = np.clip(2.0 * (command(t) - q), -1.0, 1.0)
        torque, weight = KT / R * (duty * VOLTS - KT * w) - 0.05 * w, 0.8 * sin(q)
        if not compliance:
            return [v, (torque - weight) / 0.05, v, (torque - weight) / 0.05]
        reduced = 0.02 * 0.03 / 0.05
        spring = (rotor - q) / compliance + 2.0 * servo.LOSS * sqrt(reduced / compliance) * (w - v)
        return [v, (spring - weight) / 0.03, w, (torque - spring) / 0.02]

    wanted = solve_ivp(slope, (0.0, 1.4), np.zeros(4), rtol=1e-8, atol=1e-10, max_step=1e-3, dense_output=True)
    for tick, most in ((5e-4, 4e-3), (1.25e-4, 1e-3)):
        found = simulate_joint(command, 1.4, tick, **values)
        t = tick * np.arange(1, len(found) + 1)
        assert np.abs(found[:, 0] - wanted.sol(t)[0]).max() < most


@pytest.mark.parametrize("compliance", [0.0, 0.05])
def test_energy_of_a_falling_load_is_what_the_back_emf_takes(compliance):
    """No duty cycle: energy of motion, gear and weight falls by the work of kt^2 / R w, up to Euler's error."""
    q, v, rotor, w = simulate_joint(lambda t: 0.0, 2.0, start=2.0, kp=0.0, moment=0.5, compliance=compliance).T
    energy = 0.5 * (0.03 * v**2 + 0.02 * w**2) + 0.5 * (1.0 - np.cos(q))
    energy += 0.5 * (rotor - q) ** 2 / compliance if compliance else 0.0
    taken = DRAG * 5e-4 * np.cumsum(w**2)
    assert energy + taken == pytest.approx(np.full(len(q), 0.5 * (1.0 - cos(2.0))), rel=0.02)
    assert energy[-1] < 0.2 * energy[0]


def test_dry_friction_holds_what_is_smaller():
    """At rest under weight and error as long as their sum stays below the friction, then on at the surplus."""
    held = simulate_joint(lambda t: 0.0, 0.2, start=0.01, dry_friction=0.3)
    assert np.all(held[:, 0] == 0.01) and STIFFNESS * 0.01 < 0.3
    speed = simulate_joint(lambda t: 100.0, 1.0, dry_friction=0.3)[-1, 1]
    assert speed == pytest.approx((VOLTS - 0.3 * R / KT) / KT, rel=1e-4)


def test_friction_by_load_holds_a_weight_between_what_lifts_and_what_lowers_it(monkeypatch):
    """Friction c |motor - weight|, both of one sign in what the gear carries: M3 of Duclusaud et al., ICRA 2025.

    A motor that lifts a weight W carries W (1 + c) / (1 - c) where it comes to rest, one that lowers it the inverse.
    """
    c, law = 0.2, LIBRARY["sliding.load_friction"].at["sliding.braked"]
    monkeypatch.setattr(servo, "brake_rotor", lambda e, z, j, v, per, load, opposed: law(v, per, load, c))
    for start, factor in ((0.2, (1.0 + c) / (1.0 - c)), (1.4, (1.0 - c) / (1.0 + c))):
        slow = simulate_joint(lambda t, start=start: 0.8 + (start - 0.8) * exp(-2.0 * t), 6.0, start=start, moment=0.5)
        angle = slow[-1, 0]
        assert STIFFNESS * (0.8 - angle) == pytest.approx(0.5 * sin(angle) * factor, rel=0.01)


def test_play_of_the_gear_lets_the_load_hang_at_its_edge(monkeypatch):
    """The rotor bears the weight at the edge of the play, and passes the play when the weight changes sides."""
    monkeypatch.setattr(servo, "gear_play", lambda e, z, j, half_width: 0.05)
    for side in (1.0, -1.0):
        q, _, rotor, _ = simulate_joint(lambda t, aim=0.5 * side: aim, 1.5, moment=0.5)[-1]
        assert rotor - q == pytest.approx(side * 0.05, rel=0.01)


@pytest.fixture(scope="module")
def nominal(arm_folder):
    """Two servos with motors, as the command makes them."""
    return made(arm_folder, "geared", "--servo", "motor")


def test_every_effect_is_absent_at_its_null_value_and_bounded_over_its_range(nominal):
    light = nominal.with_parameters({"servo.armature": 1e-3, "servo.inertia": 1e-4, "servo.moment": 0.05})
    plain = exo.simulate(light, "steps:dwell=0.5", seed=1)
    for effect in nominal.machine.effects:
        first, *rest = effect.parameters
        for values in [
            [first.null, *(p.high for p in rest)],
            [p.low for p in (first, *rest)],
            [p.high for p in (first, *rest)],
        ]:
            robot = light.splice(effect.id, dict(zip([p.name for p in effect.parameters], values, strict=True)))
            log = exo.simulate(robot, "steps:dwell=0.5", seed=1)
            angles = np.column_stack([log[f"angle_{j}"] for j in nominal.machine.axes.joints])
            assert np.abs(angles).max() < 4.0, (effect.id, values)
            if values[0] == first.null:
                assert all(np.array_equal(log[c], plain[c]) for c in plain.columns), effect.id


def test_a_payload_is_a_mass_at_its_lever(nominal):
    """As a load of that much more inertia, m l^2, and moment, m g l; without a lever it is moment alone."""
    mass, lever, motion = 0.3, 0.2, "random-motion:duration=3,seed=1"
    payload = nominal.splice("servo.gravity_moment", {"moment": mass * 9.81 * lever, "lever": lever})
    inertia, moment = nominal.channels("servo.inertia"), nominal.channels("servo.moment")
    joints, more = nominal.machine.axes.joints, {"inertia": mass * lever**2, "moment": mass * 9.81 * lever}
    stated = {
        f"servo.{name}.{j}": own + more[name]
        for name, values in (("inertia", inertia), ("moment", moment)) for j, own in zip(joints, values)
    }  # fmt: skip
    logs = [exo.simulate(robot, motion, seed=None) for robot in (payload, nominal.with_parameters(stated))]
    for name in (f"angle_{j}" for j in joints):
        assert logs[0][name] == pytest.approx(logs[1][name], abs=1e-9) and np.ptp(logs[0][name]) > 0.5


@pytest.mark.parametrize("late", [0, 3, 43])
def test_a_late_command_reaches_a_servo_within_the_frame(nominal, late):
    """As a servo that is stepped alone, its command older by a number of ticks. A reading is taken in the fourth."""
    slots, robot = nominal.machine.slots, nominal.with_parameters({"reading.sigma": 0.0, "reading.step": 0.0})
    plain = exo.simulate(robot, "random-motion:duration=2,seed=1", seed=None)
    log = exo.simulate(robot.splice("servo.latency", {"frames": late / slots}), exo.from_log(plain, robot), seed=None)
    command, stated = log["angle_ref_elbow"], {name: nominal[f"servo.{name}.elbow"] for name in PLAIN}
    ticks = simulate_joint(
        lambda t: command[max(round(t / robot.machine.slot) - late, 0) // slots], len(command) * robot.machine.frame,
        robot.machine.slot, log["angle_start_elbow"][0], **stated,
    )  # fmt: skip
    assert np.ptp(log["angle_elbow"]) > 0.5
    assert log["angle_elbow"] == pytest.approx(ticks[2::slots, 0], abs=1e-9)


def test_ranges_grow_with_the_motor(nominal):
    """Stall torque kt V / R, damping by the back-EMF kt^2 / R, all of it of one of two joints."""
    strong = nominal.with_parameters({"servo.kt.elbow": 10.0 * nominal["servo.kt.elbow"]})
    logs = [exo.simulate(nominal, "random-motion:duration=2", seed=1)]
    ranges = [{e.id: e.parameters[0] for e in with_recorded_ranges(robot, gather_logs(logs)).machine.effects}
              for robot in (nominal, strong)]  # fmt: skip
    for effect, factor in (("coulomb_friction", 10.0), ("gravity_moment", 10.0), ("viscous_friction", 100.0),
                           ("gear_compliance", 0.1), ("torque_constant", 1.0), ("gear_play", 1.0)):  # fmt: skip
        own, more = (each[f"servo.{effect}"] for each in ranges)
        assert (more.high, more.initial) == pytest.approx((factor * own.high, factor * own.initial)), effect
    assert ranges[0]["servo.coulomb_friction"].high == pytest.approx(
        {e.id: e for e in nominal.machine.effects}["servo.coulomb_friction"].parameters[0].high, rel=0.01
    )


def diagnose_planted(nominal, effect, **parameters):
    """The diagnosis of a robot with an effect in one joint."""
    worn = nominal.splice(f"servo.{effect}", parameters, ["elbow"])
    logs = [exo.simulate(worn, exo.protocol(f"random-motion:duration=12,seed={k}", worn), seed=k) for k in range(2)]
    items = [CaseLog(log, "motion", role, None, f"{role}.csv") for log, role in zip(logs, ("fit", "holdout"))]
    return exo.diagnose(Case("planted", {}, tuple(items), nominal.machine.frame), nominal)


@pytest.mark.parametrize(
    ("effect", "parameter", "value"),
    [("coulomb_friction", "force", 0.1), ("lag", "time_constant", 0.06), ("duty_limit", "limit", 0.15)],
)
def test_a_planted_effect_is_named_with_its_size(nominal, effect, parameter, value):
    found = diagnose_planted(nominal, effect, **{parameter: value})
    assert found.verdict == "NAMED", found.reasons
    assert [e.id for e in found.effects] == [f"servo.{effect}"]
    assert found.robots["improved"][f"servo.{effect}.{parameter}.elbow"] == pytest.approx(value, rel=0.1)


@pytest.mark.parametrize("jump", [0.0, 1.0])
def test_the_first_cause_is_a_dead_band_whether_or_not_the_error_jumps_at_its_edge(nominal, jump):
    """Beside it an effect of little share may stand in for the jump, at which a residual is not smooth."""
    found = diagnose_planted(nominal, "dead_band", width=0.03, jump=jump)
    assert found.effects[0].id == "servo.dead_band" and found.effects[0].share.value > 0.8
    assert found.robots["improved"]["servo.dead_band.width.elbow"] == pytest.approx(0.03, rel=0.1)


def test_where_a_joint_stands_at_first_is_not_what_an_offset_reading_says(nominal):
    """A log that begins in motion, of joints that stand elsewhere than they are read."""
    shifted = nominal.splice("reading.offset", {"offset": 0.04})
    log = exo.simulate(shifted, "random-motion:duration=12,seed=2", seed=2).between(3.0, 12.0)
    log = log.with_signals({f"angle_start_{j}": np.full(len(log), log[f"angle_{j}"][0]) for j in ("shoulder", "elbow")})
    case = Case("moving", {}, (CaseLog(log, "motion", "fit", None, "moving.csv"),), nominal.machine.frame)
    problem = make_problem(case, nominal)
    (residual,) = problem.residual(problem.silent(shifted)[None], problem.fit)
    assert np.mean(residual**2) < 1.5


def test_a_log_needs_frames_beyond_those_in_which_a_joint_settles(nominal):
    log = exo.simulate(nominal, "random-motion:duration=2.5,seed=1", seed=1)
    cases = [
        Case("brief", {}, (CaseLog(log.rows(slice(0, n)), "motion", "fit", None, "brief.csv"),), nominal.machine.frame)
        for n in (74, 75)
    ]
    with pytest.raises(exo.InputError, match=r"brief.csv: 74 frames, a diagnosis needs 75 \(1.5 s\)"):
        make_problem(cases[0], nominal)
    (trial,) = make_problem(cases[1], nominal).fit
    assert np.isfinite(trial.measured).sum(axis=0).tolist() == [50, 50]


def test_a_loop_whose_joint_friction_holds_is_analysed_and_tuned(nominal, few_cycles, hasty):
    """Small steps do not move it: no margins, and a note says how to see it in motion; nothing raises."""
    stuck = add_controller(nominal.splice("servo.coulomb_friction", {"force": 0.25}))
    found = exo.analyse(stuck)
    assert found.returns and np.isnan(found.responses[0].bandwidth) and not found.margins[0].loop.any()
    assert any("--set servo.coulomb_friction.force=0 shows the loop in motion" in note for note in found.notes)
    with warnings.catch_warnings(action="error"):
        assert {"steps.png", "bode.png"} <= set(draw_figures(found)) and "nyquist.png" not in draw_figures(found)
        parameters = {"force": {"value": 0.25, "low": 0.2, "high": 0.3, "unit": "N m"}}
        effect = {"id": "servo.coulomb_friction", "wires": [], "joints": ["elbow"], "parameters": parameters}
        answer = {"verdict": "NAMED", "effects": [effect | {"channels": {}}], "equivalents": []}
        assert np.isfinite(assess_answer(stuck, answer, draws=2).deviation).all()
    late = nominal.splice("servo.lag", {"time_constant": 0.03}).splice("servo.coulomb_friction", {"force": 0.25})
    assert find_rough(add_controller(late)) == ["servo.coulomb_friction"]
    tuned = exo.tune(stuck, only=("I, filtered reference",), draws=0, judges=1)
    assert tuned.best and tuned.best.robot.effects() == stuck.effects()
    assert tuned.notes[0].startswith("tuned without servo.coulomb_friction") and "a kick dies out" in tuned.notes[0]


def test_a_kind_of_servo_is_refused_for_an_arm(tmp_path):
    said = run("new-machine", tmp_path / "a", "--urdf", "linear_axis", "--servo", "motor")
    assert said.exit_code == 2 and "--servo is of a machine of position servos" in said.stderr
