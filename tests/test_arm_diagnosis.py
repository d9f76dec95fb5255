"""Faults injected in arms that Drake's MultibodyPlant moves are named by the diagnosis of exodrake's own model."""

from dataclasses import replace

import numpy as np
import pytest
from arm_folders import CABLE, MIXED, PENDULUM, made, plant_of
from pydrake.multibody.tree import MultibodyForces_
from pydrake.systems.analysis import Simulator
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, sosfiltfilt, sosfreqz

import exodrake as exo
from exodrake.core.errors import InputError
from exodrake.data.case import Case, CaseLog
from exodrake.data.log import Log
from exodrake.diagnosis import problem
from exodrake.diagnosis.checks.compare import compare
from exodrake.diagnosis.checks.suspicions import suspicions
from exodrake.diagnosis.isolation import affordable, isolate
from exodrake.diagnosis.localise import regime
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.result import CAUSE
from exodrake.report.diagnosis_html import report_html

ROLES = ("fit", "fit", "holdout")


def motion(seed, rows, robot):
    """Position, velocity, acceleration (rows, joints) of sums of four sines within the limits."""
    rng, (low, high) = np.random.default_rng(seed), robot.reference_limits()
    time, n = robot.machine.frame * np.arange(rows), len(low)
    pace, phase = 2 * np.pi * rng.uniform(0.1, 0.7, (n, 4)), rng.uniform(0, 2 * np.pi, (n, 4))
    size = rng.uniform(0.3, 1.0, (n, 4)) / pace
    size *= 0.45 * (high - low)[:, None] / size.sum(axis=1, keepdims=True)
    turns = pace[:, :, None] * time + phase[:, :, None]
    waves = (np.sin(turns), pace[:, :, None] * np.cos(turns), -(pace[:, :, None] ** 2) * np.sin(turns))
    q, v, a = ((size[:, :, None] * wave).sum(axis=1).T for wave in waves)
    return 0.5 * (low + high) + q, v, a


def case_of(robot, logs):
    """A case of logs: kind -> (rows, joints)."""
    items = []
    for k, (role, kinds) in enumerate(zip(ROLES[-len(logs) :], logs, strict=True)):
        joints = robot.machine.axes.joints
        signals = {f"{kind}_{j}": rows[:, i] for kind, rows in kinds.items() for i, j in enumerate(joints)}
        column = {c.kind: robot.machine.signal[c.signal].unit for c in robot.machine.columns}
        units = {name: column[name.rsplit("_", 1)[0]] for name in signals}
        time = robot.machine.frame * np.arange(len(next(iter(signals.values()))))
        items.append(CaseLog(Log(time, signals, units, str(k)), f"motion{k}", role, None, f"{k}.csv"))
    return Case("injected", {}, tuple(items), robot.machine.frame)


def inverse_case(robot, payload=0.0, friction=(), gain=(), rows=800):
    """Measured motions and the efforts that Drake finds for them; friction [N m], gain [-]: (joint, size)."""
    plant, logs = plant_of(CABLE, payload), []
    context, rng = plant.CreateDefaultContext(), np.random.default_rng(7)
    for seed in range(3):
        q, v, a = motion(seed, rows, robot)
        efforts = np.empty_like(q)
        for k in range(rows):
            plant.SetPositions(context, q[k])
            plant.SetVelocities(context, v[k])
            forces = MultibodyForces_[float](plant)
            plant.CalcForceElementsContribution(context, forces)
            efforts[k] = plant.CalcInverseDynamics(context, a[k], forces)
        for joint, size in friction:
            efforts[:, joint] += size * np.sign(v[:, joint])
        for joint, size in gain:
            efforts[:, joint] *= 1.0 + size
        efforts += robot.channels("torque.sigma") * rng.standard_normal(efforts.shape)
        logs.append({"position": q, "velocity": v, "acceleration": a, "effort": efforts})
    return case_of(robot, logs)


@pytest.fixture(scope="module")
def cable_arm(arm_folder):
    return made(arm_folder, "cable_arm", "--urdf", "cable_arm")


@pytest.mark.parametrize(
    "fault, effect, joints, value",
    [
        ({"payload": 0.5}, "arm.payload", (), 0.5),
        ({"friction": [(3, 1.0)]}, "arm.coulomb_friction", ("J4",), 1.0),
        ({"gain": [(1, -0.08)]}, "torque.gain", ("J2",), -0.08),
    ],
    ids=["payload", "friction", "gain"],
)
def test_a_fault_of_an_arm_of_seven_joints_is_named_from_its_efforts(fault, effect, joints, value, cable_arm):
    found = exo.diagnose(inverse_case(cable_arm, **fault), cable_arm)
    assert found.verdict == "NAMED", found.reasons
    assert [(one.id, tuple(one.joints)) for one in found.effects] == [(effect, joints)]
    interval = next(iter(found.effects[0].parameters.values()))
    assert interval.value == pytest.approx(value, rel=0.1) and interval.low < value < interval.high
    assert found.closure.overall.value > 0.9


@pytest.fixture(scope="module")
def rubbing(arm_folder, tmp_path_factory):
    """The same with dry friction of 2 N m in one joint."""
    path = tmp_path_factory.mktemp("rubbing") / "rubbing.urdf"
    joint = CABLE.read_text().partition('<joint name="J4"')
    path.write_text("".join([*joint[:2], joint[2].replace("<limit", '<dynamics friction="2"/><limit', 1)]))
    return made(arm_folder, "rubbing", "--urdf", path)


def test_friction_that_a_urdf_file_states_too_high_is_retuned(rubbing):
    """Not named as a gain; joints without friction have none to retune, and the report says what was."""
    found = exo.diagnose(inverse_case(rubbing, friction=[(3, 1.7)]), rubbing)
    assert found.verdict == "RETUNE" and [one.name for one in found.retune.moved] == ["arm.dry_friction.J4"]
    assert found.retune.moved[0].value == pytest.approx(1.7, abs=0.05)
    assert "arm.dry_friction.J4" in report_html(found, found.problem)


def test_each_fitted_set_leaves_what_its_robot_does(cable_arm):
    """The mass of a link shows in the efforts of the joints before it: steps of single joints do not add up."""
    found = isolate(make_problem(inverse_case(cable_arm, gain=[(1, -0.08)]), cable_arm))
    sets = [f.explanation for f in found.search.sets.values()]
    simulated = found.likelihood.residual(np.array([e.robot for e in sets]))
    np.testing.assert_allclose([e.residual for e in sets], simulated, atol=1e-9)


def test_dry_friction_is_a_gap_by_the_direction_of_the_recorded_motion(cable_arm):
    found = make_problem(inverse_case(cable_arm, friction=[(3, 1.0)]), cable_arm)
    first, share = next(iter(regime(found, found.silent()).items()))
    assert first == "direction of motion" and share > 0.7


def test_an_arm_as_its_model_says_has_no_gap(cable_arm):
    assert exo.diagnose(inverse_case(cable_arm), cable_arm).verdict == "NO_GAP"


def test_what_friction_holds_at_rest_is_no_gap(cable_arm):
    """Without motion an effort within the dry friction tells nothing of the model."""
    case, logs = inverse_case(cable_arm), []
    for item in case.logs:
        signals = dict(item.log.signals)
        for joint in cable_arm.machine.axes.joints:
            speed = np.abs(signals[f"velocity_{joint}"])
            signals[f"effort_{joint}"] = signals[f"effort_{joint}"] + 0.5 * (speed < 0.01 * speed.max())
        logs.append(replace(item, log=replace(item.log, signals=signals)))
    assert exo.diagnose(replace(case, logs=tuple(logs)), cable_arm).verdict == "NO_GAP"


def test_how_friction_turns_round_is_no_gap(rubbing, monkeypatch):
    """It may take 0.08 s, by presliding or a low-pass; where those samples count, they show a gap."""
    case, logs = inverse_case(rubbing, friction=[(3, 2.0)]), []
    for item in case.logs:
        signals = dict(item.log.signals)
        direction = np.sign(signals["velocity_J4"])
        blurred = uniform_filter1d(direction, round(0.08 / rubbing.machine.frame), mode="nearest")
        signals["effort_J4"] = signals["effort_J4"] + 2.0 * (blurred - direction)
        logs.append(replace(item, log=replace(item.log, signals=signals)))
    case = replace(case, logs=tuple(logs))
    assert exo.diagnose(case, rubbing).verdict == "NO_GAP"
    monkeypatch.setattr(problem, "TURN", 0.0)
    assert exo.diagnose(case, rubbing).verdict != "NO_GAP"


def pendulum_effort(q, v, a, friction):
    """Efforts [N m] of the bob on a rod of 0.3 m, 0.1 kg m2 about its pin, with dry friction [N m]."""
    return 0.1 * a + 0.3 * 9.81 * np.sin(q) + friction * np.tanh(v / 0.01)


def coarse_case(robot, step, cut, friction=0.0):
    """A pendulum whose position is read in steps [rad] and filtered without phase [Hz], as its efforts are."""
    frame, logs, rng = robot.machine.frame, [], np.random.default_rng(3)
    low_pass = butter(4, cut, fs=1.0 / frame, output="sos")
    for seed in range(3):
        q, v, a = motion(seed, 1600, robot)
        efforts = pendulum_effort(q, v, a, friction)
        seen = step * np.round(q / step)
        velocity = sosfiltfilt(low_pass, np.gradient(seen, frame, axis=0), axis=0)
        signals = {"position": seen, "velocity": velocity, "acceleration": np.gradient(velocity, frame, axis=0)}
        noisy = efforts + 0.01 * rng.standard_normal(efforts.shape)
        logs.append(signals | {"effort": sosfiltfilt(low_pass, noisy, axis=0)})
    return case_of(robot, logs)


def test_noise_of_recorded_accelerations_counts(arm_folder, tmp_path):
    """Steps of 5 mrad through a filter and two differences move 0.1 kg m2: closed form, and no gap beyond that."""
    (tmp_path / "pendulum.urdf").write_text(PENDULUM.format(0.3, 0.01))
    robot = made(arm_folder, "coarse", "--urdf", tmp_path / "pendulum.urdf").with_parameters({"torque.sigma.pin": 0.01})
    step, cut, frame = 5e-3, 15.0, robot.machine.frame
    found = exo.diagnose(coarse_case(robot, step, cut), robot)
    turn, passed = sosfreqz(butter(4, cut, fs=1.0 / frame, output="sos"))
    response = np.abs(passed) ** 2 * (np.sin(turn) / frame) ** 2
    noise = 0.1 * step / np.sqrt(12.0) * np.sqrt(np.mean(response**2))
    assert found.problem.noisier and found.problem.robot["torque.sigma.pin"] == pytest.approx(noise, rel=0.1)
    assert found.verdict == "NO_GAP" and any("a lower cut-off leaves less" in note for note in found.notes)
    rubs = exo.diagnose(coarse_case(robot, step, cut, friction=1.0), robot)
    assert [e.id for e in rubs.effects if e.role == CAUSE] == ["arm.coulomb_friction"]
    force = rubs.effects[0].parameters["force"]
    assert force.low < 1.0 < force.high


def test_a_rival_takes_up_as_much_as_its_cause(arm_folder):
    """In a motion one way, viscous friction and its difference by direction, and dry friction and an offset."""
    robot = made(arm_folder, "one_way", "--urdf", "rotary_axis")
    logs, rng = [], np.random.default_rng(5)
    for seed in range(2):
        time = robot.machine.frame * np.arange(1200)[:, None]
        v, a = (1.0 + 0.8 * np.sin((3.0 + seed) * time), 0.8 * (3.0 + seed) * np.cos((3.0 + seed) * time))
        effort = 0.08 * a + 2.0 * v + 0.5 + robot.channels("torque.sigma") * rng.standard_normal(v.shape)
        q = np.cumsum(v, axis=0) * robot.machine.frame
        logs.append({"position": q, "velocity": v, "acceleration": a, "effort": effort})
    causes = {e.id: e for e in exo.diagnose(case_of(robot, logs), robot).effects if e.role == CAUSE}
    viscous, dry = causes["arm.viscous_friction"], causes["arm.coulomb_friction"]
    assert viscous.parameters["coefficient"].value == pytest.approx(2.0, rel=0.05)
    assert dry.parameters["force"].value == pytest.approx(0.5, rel=0.1)
    for cause, other in ((viscous, "arm.direction"), (dry, "torque.offset")):
        (rival,) = (r for r in cause.rivals if r.id == other)
        assert rival.share.value == pytest.approx(cause.share.value, abs=0.01)


def test_an_axis_whose_efforts_are_volts_is_as_large_as_its_recording_says(arm_folder):
    """The file's inertia of 1e-6 kg m2 makes ranges, and a noise of less than 1e-5 of the recorded efforts."""
    arm_folder.joinpath("volts.urdf").write_text(PENDULUM.format(0.0, 1e-6))
    robot, logs = made(arm_folder, "volts", "--urdf", str(arm_folder / "volts.urdf")), []
    for seed in range(3):
        q, v, a = motion(seed, 1500, robot)
        effort = 0.05 * a + 0.25 * v + 1.6 * np.sign(v)
        noise = robot.channels("torque.sigma") * np.random.default_rng(seed).standard_normal(v.shape)
        logs.append({"position": q, "velocity": v, "acceleration": a, "effort": effort + noise})
    assert np.max(np.abs(effort)) > 1e5 * robot.channels("torque.sigma")
    effects = exo.diagnose(case_of(robot, logs), robot).effects
    truth = {"arm.coulomb_friction": 1.6, "arm.viscous_friction": 0.25, "arm.rotor_inertia": 0.05}
    assert {e.id for e in effects} == truth.keys() and effects[0].id == "arm.coulomb_friction"
    for effect in effects:
        (value,) = effect.parameters.values()
        assert value.low < truth[effect.id] < value.high


def test_laws_that_would_mispredict_the_other_way_round_are_not_named(arm_folder):
    """A bend of the friction, which no effect is, looks like an asymmetry where each log goes one way, at its speed."""
    arm_folder.joinpath("bend.urdf").write_text(PENDULUM.format(0.0, 0.04))
    robot, logs = made(arm_folder, "bend", "--urdf", str(arm_folder / "bend.urdf"), "--frame", "0.01"), []
    time, rng = 0.01 * np.arange(600), np.random.default_rng(0)
    slow, fast, both = 2.0 + 8.0 * time / 6.0, -18.0 - 3.0 * np.sin(1.3 * time), -6.0 - 5.0 * np.sin(1.6 * time)
    for v in (slow, fast, both):
        a = np.gradient(v, 0.01)
        effort = 5.0 * np.sign(v) + 0.3 * v - 0.006 * v * abs(v) + 0.04 * a + 0.02 * rng.standard_normal(len(v))
        kinds = {"position": np.cumsum(v) * 0.01, "velocity": v, "acceleration": a, "effort": effort}
        logs.append({kind: values[:, None] for kind, values in kinds.items()})
    case = case_of(robot, logs)
    names = zip(case.logs, ("slow", "fast", "both"), strict=True)
    found = exo.diagnose(replace(case, logs=tuple(replace(item, protocol=name) for item, name in names)), robot)
    assert {e.id for e in found.effects if e.role == CAUSE} == {"arm.coulomb_friction", "arm.viscous_friction"}
    one, other, held = (np.column_stack([np.sign(v), v, v * abs(v)]) for v in (slow, fast, both))
    simple = np.linalg.lstsq(np.vstack([one, other])[:, :2], np.vstack([one, other]) @ [5.0, 0.3, -0.006])[0]
    error = held @ [5.0, 0.3, -0.006] - held[:, :2] @ simple
    assert found.closure.signals["effort_pin"].after < 1.5 * np.sqrt(np.mean(error**2))


@pytest.mark.parametrize("seed", [0, 1])
def test_equal_efforts_on_another_motion_are_no_copy(seed, arm_folder):
    """The duty of one step moves a motor otherwise with a load; the same motion with it is a copy."""
    robot, duty = (
        made(arm_folder, f"duty{seed}", "--urdf", "rotary_axis"),
        np.random.default_rng(0).normal(size=(600, 1)),
    )
    motions = [dict(zip(("position", "velocity", "acceleration"), motion(k, 600, robot))) for k in (0, seed)]
    case = case_of(robot, [one | {"effort": duty} for one in motions])
    assert any("holds the samples of" in said for said in suspicions(compare(case, robot))) == (seed == 0)


def test_a_log_in_which_the_joint_only_turns_round_is_left_out_and_said(arm_folder):
    robot, logs = made(arm_folder, "turns", "--urdf", "rotary_axis"), []
    for seed in range(3):
        q, v, a = motion(seed, 600, robot)
        v[:, 0] *= 1e-3 if seed == 1 else 1.0  # far slower than in other logs
        logs.append({"position": q, "velocity": v, "acceleration": a, "effort": 2.0 * np.sign(v)})
    found = make_problem(case_of(robot, logs), robot)
    assert [trial.name for trial in found.fit] == ["0.csv"] and found.case.notes[-1].endswith(": 1.csv")
    with pytest.raises(InputError, match="no fitted log is left"):
        make_problem(case_of(robot, [logs[1] | {"velocity": 0.0 * logs[1]["velocity"]}, logs[0]]), robot)


LATE = 1e-3  # s from a reading to the effort that answers it, as in the model's schedule


def loop_case(robot, path, payload, rows=300):
    """An arm that Drake moves with its own integrator, under the robot file's PD law and gravity of the bare arm."""
    believed, logs, rng = plant_of(path), [], np.random.default_rng(7)
    at = believed.CreateDefaultContext()
    stiffness, viscosity = robot.channels("drive.stiffness"), robot.channels("drive.viscosity")
    limit, frame = robot.channels("motor.current_max"), robot.machine.frame
    for seed in range(3):
        plant = plant_of(path, payload)
        reference = motion(seed, rows, robot)[0]
        simulator = Simulator(plant)
        context = simulator.get_mutable_context()
        plant.SetPositions(context, reference[0])
        force, before = np.zeros(len(limit)), np.zeros(len(limit))
        shown, efforts = np.empty_like(reference), np.empty_like(reference)
        for k in range(rows):
            plant.get_applied_generalized_force_input_port().FixValue(context, force)
            simulator.AdvanceTo(k * frame + LATE)
            shown[k] = plant.GetPositions(context) + robot.channels("encoder.sigma") * rng.standard_normal(len(limit))
            error = reference[k] - shown[k]
            believed.SetPositions(at, shown[k])
            weight = -believed.CalcGravityGeneralizedForces(at)
            rate = (error - before) / frame if k else np.zeros(len(limit))
            simulator.AdvanceTo(k * frame + 2.0 * LATE)
            force, before = np.clip(stiffness * error + viscosity * rate + weight, -limit, limit), error
            plant.get_applied_generalized_force_input_port().FixValue(context, force)
            simulator.AdvanceTo((k + 1) * frame)
            efforts[k] = force + robot.channels("torque.sigma") * rng.standard_normal(len(limit))
        logs.append({
            "joint_position_ref": reference, "joint_position_start": np.tile(reference[0], (rows, 1)),
            "joint_position": shown, "joint_effort": efforts,
        })  # fmt: skip
    return case_of(robot, logs)


def test_two_faults_that_hide_each_other_are_found_together(arm_folder, tmp_path):
    """In 3 s either leaves half of the gap, as noise as long as the motion: neither alone has evidence."""
    (tmp_path / "pendulum.urdf").write_text(PENDULUM.format(0.3, 0.01))
    robot = made(arm_folder, "hidden", "--urdf", tmp_path / "pendulum.urdf")
    logs, rng = [], np.random.default_rng(0)
    for seed in range(3):
        q, v, a = motion(seed, 600, robot)
        efforts = pendulum_effort(q, v, a, 0.6) + 0.5
        noisy = efforts + 0.01 * rng.standard_normal(efforts.shape)
        logs.append({"position": q, "velocity": v, "acceleration": a, "effort": noisy})
    found = exo.diagnose(case_of(robot, logs[:1] + logs[2:]), robot)
    causes = {e.id: e for e in found.effects if e.role == CAUSE}
    assert causes.keys() == {"arm.coulomb_friction", "torque.offset"}
    for effect, parameter, planted in (("arm.coulomb_friction", "force", 0.6), ("torque.offset", "offset", 0.5)):
        value = causes[effect].parameters[parameter]
        assert value.low <= planted <= value.high


def test_a_payload_is_named_in_closed_loop(arm_folder, tmp_path):
    path = tmp_path / "mixed.urdf"
    path.write_text(MIXED)
    robot = made(arm_folder, "mixed_loop", "--urdf", path, "--form", "closed-loop")
    case = loop_case(robot, path, 0.3)
    problem = make_problem(case, robot)
    short = problem.shorten(affordable(problem, 600))  # its first 0.5 s do not count
    assert sum(np.isfinite(trial.measured).sum() for trial in short.fit) == pytest.approx(600, abs=12)
    found = exo.diagnose(case, robot)
    assert found.verdict == "NAMED", found.reasons
    assert [one.id for one in found.effects if one.role == "cause"] == ["arm.payload"]
    assert found.effects[0].parameters["mass"].value == pytest.approx(0.3, rel=0.05)
