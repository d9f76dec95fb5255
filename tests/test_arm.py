"""Serial arms from URDF files: their dynamics against Drake's parser and MultibodyPlant."""

import os
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from arm_folders import CABLE, MIXED, PENDULUM, made, plant_of
from command_line import run
from pydrake.multibody.tree import MultibodyForces_
from scipy.interpolate import CubicSpline

import exodrake as exo
from exodrake.core import plugins
from exodrake.diagrams.multibody import multibody_arm
from exodrake.engine.inputs import Reference
from exodrake.machines.serial_arm import arm_machine, compute_dynamics, read_urdf
from exodrake.physics import arm
from exodrake.simulation.simulate import record


@pytest.fixture(scope="module")
def inverse(arm_folder):
    return made(arm_folder, "cable_arm", "--urdf", "cable_arm")


@pytest.fixture(scope="module")
def closed(arm_folder, tmp_path_factory):
    path = tmp_path_factory.mktemp("urdf") / "mixed.urdf"
    path.write_text(MIXED)
    return made(arm_folder, "mixed_loop", "--urdf", path, "--form", "closed-loop")


def test_turning_and_sliding_joints_may_have_cables(arm_folder, tmp_path):
    path = tmp_path / "mixed.urdf"
    path.write_text(MIXED)
    machine = made(arm_folder, "mixed_cables", "--urdf", path, "--form", "cable").machine
    assert machine.compared == ("joint_position", "motor_position", "motor_effort")
    assert [machine.signal[s].unit for s in ("position", "motor_position")] == ["-", "rad"]


def test_effects_behind_cables_are_stated_in_units_of_motors_or_of_joints(arm_folder):
    machine = made(arm_folder, "sliding_cable", "--urdf", "linear_axis", "--form", "cable").machine
    units = {"encoder.offset": "rad", "link_encoder.offset": "m", "cable.backlash": "m", "cable.lugre": "N m"}
    assert {i: machine.effect(i).parameters[0].unit for i in units} == units
    assert next(p.unit for p in machine.effect("cable.lugre").parameters if p.name == "presliding") == "rad"


def test_tolerances_of_centres_are_of_the_arms_size(arm_folder, tmp_path):
    """A ball on a rod is as long as the rod and its radius of gyration, sqrt(tr I / 2 m)."""
    for length, wanted in ((0.02, 0.0002), (0.1, 0.0008), (1.0, 0.002)):
        (tmp_path / "p.urdf").write_text(PENDULUM.format(length, 0.25 * length**2))
        made(arm_folder, name := f"pendulum_{round(100 * length)}", "--urdf", tmp_path / "p.urdf")
        _, centres = yaml.safe_load((arm_folder / name / "robot.yaml").read_text())["tolerances"]
        assert (centres["prior_std"], centres["max_deviation"]) == (wanted, pytest.approx(3.0 * wanted))


@pytest.mark.parametrize("length", [0.02, 1.0])
def test_what_an_arm_may_lack_is_of_its_size(length, arm_folder, tmp_path):
    """Rotors up to thrice the largest inertia about a joint, 1.25 l^2 here; a payload of half the mass."""
    (tmp_path / "p.urdf").write_text(PENDULUM.format(length, 0.25 * length**2))
    robot = made(arm_folder, f"bob_{round(100 * length)}", "--urdf", tmp_path / "p.urdf", "--form", "closed-loop")
    highest = [robot.machine.effect(f"arm.{name}").parameters[0].high
               for name in ("rotor_inertia", "payload", "joint_compliance")]  # fmt: skip
    assert highest == pytest.approx([3.0 * 1.25 * length**2, 0.5, 3e-3 / (1.25 * length**2)])


def dynamics(plant, q, rate, acceleration):
    """Efforts and mass matrix of a MultibodyPlant."""
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    plant.SetVelocities(context, rate)
    forces = MultibodyForces_[float](plant)
    plant.CalcForceElementsContribution(context, forces)
    return plant.CalcInverseDynamics(context, acceleration, forces), plant.CalcMassMatrixViaInverseDynamics(context)


def states(count, joints, seed=1):
    return np.random.default_rng(seed).uniform(-1.5, 1.5, (count, 3, joints))


@pytest.mark.parametrize("name", ["cable_arm", "mixed"])
def test_urdf_and_dynamics_agree_with_drakes_parser_and_plant(name, tmp_path):
    path = CABLE if name == "cable_arm" else tmp_path / "mixed.urdf"
    if name == "mixed":
        path.write_text(MIXED)
    chain, plant = read_urdf(path), plant_of(path)
    assert chain.names == (("turntable", "lift2", "J3") if name == "mixed" else tuple(f"J{i}" for i in range(1, 8)))
    for state in states(20, len(chain.names)):
        efforts, matrix = compute_dynamics(chain, *state)
        wanted, inertia = dynamics(plant, *state)
        assert efforts == pytest.approx(wanted, abs=1e-9) and matrix == pytest.approx(inertia, abs=1e-9)


def test_compiled_inverse_dynamics_agree_with_a_plant_of_the_same_robot(inverse):
    """Payload, link mass, rotor inertia, damping and a tilted base included."""
    robot = inverse.with_parameters({"arm.base_roll": 0.3, "arm.base_pitch": -0.7, "arm.damping": 0.2})
    robot = robot.splice("arm.payload", {"mass": 0.5}).splice("arm.link_mass", {"share": 0.3}, ["J4"])
    robot = robot.splice("arm.rotor_inertia", {"inertia": 0.05}, ["J2"])
    motion, plant = states(8, 7), multibody_arm(robot)
    found = record(robot, Reference(motion.reshape(8, 21)), seed=None).signals["effort"]
    for state, efforts in zip(motion, found, strict=True):
        assert efforts == pytest.approx(dynamics(plant, *state)[0], abs=1e-9)


def test_a_lighter_link_is_a_body_of_another_density(arm_folder, tmp_path):
    """Mass and inertia are those of a URDF file with 0.4 of both."""
    text, motion, efforts = PENDULUM.format(0.3, 0.02), states(8, 1), {}
    light = text.replace('<mass value="1"/>', '<mass value="0.4"/>').replace('"0.02"', '"0.008"')
    for name, written in (("stated", text), ("light", light)):
        (tmp_path / f"{name}.urdf").write_text(written)
        robot = made(arm_folder, f"{name}_bob", "--urdf", tmp_path / f"{name}.urdf")
        robot = robot.splice("arm.link_mass", {"share": -0.6}) if name == "stated" else robot
        efforts[name] = record(robot, Reference(motion.reshape(8, 3)), seed=None).signals["effort"]
    assert efforts["stated"] == pytest.approx(efforts["light"], abs=1e-12)


@pytest.mark.parametrize("frames", [-2.5, -1.0, 0.7])
def test_an_effort_is_logged_late_or_its_motion_is(inverse, frames):
    """In one joint, by a cubic spline through the efforts of a motion whose fastest line has 60 rows a period."""
    robot = inverse.with_parameters({"torque.sigma": 0.0, "torque.step": 0.0})
    t, phase = robot.machine.frame * np.arange(200), np.arange(7.0)
    w = 2.0 * np.pi / (60.0 * robot.machine.frame)
    angle = 0.3 * np.sin(w * t[:, None] + phase)
    motion = np.hstack([angle, 0.3 * w * np.cos(w * t[:, None] + phase), -(w**2) * angle])
    late = robot.splice("arm.delay", {"delay": frames * robot.machine.frame}, ["J4"])
    plain, found = (exo.simulate(r, Reference(motion), seed=None).array("effort", robot.machine.axes.joints)
                    for r in (robot, late))  # fmt: skip
    wanted = CubicSpline(t, plain[:, 3])(t - frames * robot.machine.frame)
    assert found[5:-5, 3] == pytest.approx(wanted[5:-5], abs=1e-3 * np.ptp(plain[:, 3]))
    assert np.delete(found, 3, axis=1) == pytest.approx(np.delete(plain, 3, axis=1), abs=1e-12)


def of_part(robot, part):
    """The parameters of a part by name, as its equations take them."""
    found = {f.name: robot.channels(f"{f.group}.{f.name}") for f in part.fields}
    return SimpleNamespace(**{k: v if len(v) > 1 else float(v[0]) for k, v in found.items()})


def ticks(robot, efforts, q, count=1, dt=1e-4, rotor=None):
    """State of the forward dynamics after some ticks from rest at q, by the equations themselves."""
    part, n = robot.machine.parts[0], len(q)
    x = np.zeros(sum(robot.machine.part_sizes[part.name]))
    parameters = of_part(robot, part)
    arm.stand(x, None, parameters, None, q)
    if rotor is not None:
        x[arm.find_place(n, arm.ROTOR, 0) : arm.find_place(n, arm.ROTOR, n)] = rotor
    for _ in range(count):
        arm.update(x, None, parameters, None, dt, np.asarray(efforts, dtype=float))
    return {
        name: x[arm.find_place(n, k, 0) : arm.find_place(n, k, n)]
        for k, name in enumerate(("angle", "speed", "rotor", "rotor_speed"))
    }


def test_forward_dynamics_agree_with_a_plant_of_the_same_robot(closed):
    robot = closed.with_parameters({"arm.rotor_inertia": 0.07, "arm.stop_low": -9.0, "arm.stop_high": 9.0})
    plant = multibody_arm(robot)
    for q, efforts, _ in states(5, 3):
        context = plant.CreateDefaultContext()
        plant.SetPositions(context, q)
        plant.get_actuation_input_port().FixValue(context, efforts)
        wanted = plant.EvalTimeDerivatives(context).get_generalized_velocity().CopyToVector()
        assert ticks(robot, efforts, q)["speed"] / 1e-4 == pytest.approx(wanted, abs=1e-9)


def test_dry_friction_above_gravity_holds_the_arm_and_below_it_does_not(closed):
    q = np.array([0.4, 0.1, 0.5])
    weight = compute_dynamics(read_urdf_of(closed), q, np.zeros(3), np.zeros(3))[0]
    for share, rests in ((1.05, True), (0.5, False)):
        robot = closed.with_parameters({f"arm.dry_friction.{j}": share * abs(w) + 1e-3 * rests
                                        for j, w in zip(closed.machine.axes.joints, weight, strict=True)})  # fmt: skip
        speed = ticks(robot, np.zeros(3), q, count=20)["speed"]
        assert (np.abs(speed).max() < 1e-4) == rests


def read_urdf_of(robot):
    return read_urdf(plugins.single_machines()[robot.machine.name] / "arm.urdf")


def test_an_elastic_joint_begins_where_its_spring_carries_the_link(closed):
    """Deflection is compliance times effort, so that the link stays at rest; with half of it the link sinks."""
    q, compliance = np.array([0.4, 0.1, 0.5]), 2e-3
    robot = closed.with_parameters({"arm.compliance": compliance, "arm.rotor_inertia": 0.1, "arm.dry_friction": 1e6})
    rests = ticks(robot, np.zeros(3), q, count=50)
    weight = compute_dynamics(read_urdf_of(closed), rests["angle"], np.zeros(3), np.zeros(3))[0]
    assert rests["speed"] == pytest.approx(np.zeros(3), abs=1e-9) and rests["rotor"] == pytest.approx(q, abs=1e-12)
    assert rests["rotor"] - rests["angle"] == pytest.approx(compliance * weight, abs=1e-12)
    assert np.abs(weight).max() > 1.0
    assert np.abs(ticks(robot, np.zeros(3), q, count=50, rotor=q - 0.5 * compliance * weight)["speed"]).max() > 1e-3


@pytest.mark.parametrize("end, sign", [(-1.0, 1.0), (2.0, -1.0)])
def test_a_link_rests_on_its_end_stop_where_the_spring_carries_it(closed, end, sign):
    """Limits of J3 are -1 and 2 in the URDF; with half the stiffness the link sinks."""
    chain, stiffness = read_urdf_of(closed), 5.0
    held = {"arm.dry_friction.turntable": 1e6, "arm.dry_friction.lift2": 1e6}

    def weight(q):
        return compute_dynamics(chain, q, np.zeros(3), np.zeros(3))[0][2]

    turned = (np.array([turn, 0.1, end]) for turn in np.linspace(0.0, 2.0 * np.pi, 24))
    q = next(q for q in turned if sign * weight(q) > 0.05)  # the weight presses the link on this stop
    for _ in range(50):
        q[2] = end - weight(q) / stiffness
    speeds = []
    for share in (1.0, 0.5):
        robot = closed.with_parameters({**held, "arm.stop_stiffness.J3": share * stiffness})
        speeds.append(ticks(robot, np.zeros(3), q, count=20)["speed"])
    assert speeds[0] == pytest.approx(np.zeros(3), abs=1e-9) and sign * speeds[1][2] < -1e-3


def test_an_end_stop_that_a_link_leaves_does_not_pull_it(closed):
    stops = {"arm.stop_stiffness": 1.0, "arm.stop_damping": 1e3}
    robot = closed.with_parameters(stops)
    part, n = robot.machine.parts[0], of_part(robot, robot.machine.parts[0])
    x = np.zeros(sum(robot.machine.part_sizes[part.name]))
    for speed, pushes in ((0.5, False), (-0.5, True)):
        x[arm.find_place(3, arm.ANGLE, 2)] = -1.1
        x[arm.find_place(3, arm.SPEED, 2)] = speed
        assert (arm.push_from_stops(x, n, 2, 3) > 0.0) == pushes


def test_both_engines_agree_to_the_last_bit(closed):
    compiled, drake = (exo.simulate(closed, "steps:dwell=0.3", engine=engine) for engine in ("compiled", "drake"))
    assert {"joint_position_J3", "joint_effort_J3"} <= set(compiled.columns) and compiled.equals(drake)


def test_a_controller_that_compensates_no_gravity_is_one_without_a_model(closed):
    """The effect takes away the share that the robot file states."""
    sagging = closed.splice("arm_drive.gravity_compensation", {"share": -1.0})
    bare = closed.with_parameters(dict.fromkeys((n for n in closed.machine.index if "drive.feedforward" in n), 0.0))
    one, other, plain = (exo.simulate(robot, "random-motion:duration=2,seed=1", 1) for robot in (sagging, bare, closed))
    assert all(np.array_equal(one[c], other[c]) for c in one.columns)
    assert any(np.abs(one[c] - plain[c]).max() > 0.01 for c in one.columns if c.startswith("joint_position"))


@pytest.mark.parametrize(("gain", "factor"), [("position", "drive.kp"), ("velocity", "drive.kd")])
def test_a_gain_that_is_off_is_another_gain_of_the_controller(closed, gain, factor):
    """In the simulation and in what an export writes."""
    off = closed.splice(f"arm_drive.{gain}_gain", {"share": 0.25})
    stated = closed.with_parameters({factor: 1.25 * closed[factor]})
    one, other = (exo.simulate(robot, "random-motion:duration=1,seed=1", None) for robot in (off, stated))
    for column in one.columns:
        np.testing.assert_allclose(one[column], other[column], rtol=1e-9, atol=1e-9)
    drives = (robot.machine.mechanism(robot).drives for robot in (off, stated))
    assert [(d.kp, d.kv) for d in next(drives)] == [pytest.approx((d.kp, d.kv)) for d in next(drives)]


def test_a_motors_lag_is_fitted_from_none_and_one_that_stays_there_is_said_to(closed):
    (name,) = (n for n in closed.machine.index if n.startswith("motor.time_constant.") and n.endswith("J3"))
    slow = exo.simulate(closed.with_parameters({name: 0.01}), "random-motion:duration=2,seed=1", 1)
    plain = exo.simulate(closed, "random-motion:duration=2,seed=1", None)
    (found,) = exo.fit(closed, slow, free=[name]).parameters
    assert found.low < 0.01 < found.high < 0.02
    assert f"{name} stayed where it began; state its range" in exo.fit(closed, plain, free=[name]).notes


def test_a_reference_that_arrives_late_is_one_of_the_frames_before(closed):
    """Two frames late, the arm does to the last bit what it does for a reference that begins two frames later."""
    frames, late = 2, closed.splice("arm_drive.latency", {"frames": 2.0})
    whole = exo.protocol("random-motion:duration=2,seed=1", closed)
    rows = np.concatenate([whole.values[:1]] * frames + [whole.values[:-frames]])
    joints = len(closed.machine.axes.joints)
    rows[:, joints:] = whole.values[:, joints:]
    one, other = exo.simulate(late, whole, seed=None), exo.simulate(closed, replace(whole, values=rows), seed=None)
    measured = [c for c in one.columns if "position_ref" not in c]
    assert all(np.array_equal(one[c], other[c]) for c in measured) and len(measured) > joints


def test_the_closed_loop_follows_its_references(closed):
    log = exo.simulate(closed, "random-motion:duration=6,fastest=0.2", seed=None)
    for joint in closed.machine.axes.joints:
        error = log[f"joint_position_{joint}"] - log[f"joint_position_ref_{joint}"]
        assert np.std(error[len(error) // 2 :]) < 0.2 * np.std(log[f"joint_position_ref_{joint}"])


WELD = '<joint name="b" type="fixed"><parent link="a"/><child link="a"/></joint>'
SPOILT = {
    "entities": ('<!DOCTYPE r [<!ENTITY a "b">]><robot name="x"/>', "document type"),
    "remote": ('<!DOCTYPE r SYSTEM "http://example.org/a.dtd"><robot name="x"/>', "document type"),
    "text": ("no XML", "not XML"),
    "other": ("<sdf/>", "wanted <robot>"),
    "empty": ('<robot name="x"/>', "no joint moves"),
    "mimic": (MIXED.replace('<axis xyz="0 0 -1"/>', '<mimic joint="lift_2"/>'), "mimics"),
    "kind": (MIXED.replace('"continuous"', '"floating"'), "floating"),
    "number": (MIXED.replace('xyz="1 2 3"', 'xyz="1 2 nan"'), "wanted 3 numbers"),
    "axis": (MIXED.replace('xyz="1 2 3"', 'xyz="0 0 0"'), "no length"),
    "far": (MIXED.replace('xyz="0 0 -0.4"', 'xyz="1e308 0 0"'), "xyz is '1e308 0 0', beyond any arm's"),
    "long axis": (MIXED.replace('xyz="1 2 3"', 'xyz="1e308 1e308 0"'), "beyond any arm's"),
    "heavy": (MIXED.replace('<mass value="0.5"/>', '<mass value="1e200"/>'), "beyond any arm's"),
    "no way back": (MIXED.replace('lower="-1" upper="2"', 'lower="1e308" upper="1.5e308"'), "exceeds"),
    "limits": (MIXED.replace('lower="-1" upper="2"', 'lower="2" upper="-1"'), "exceeds"),
    "mass": (MIXED.replace('<mass value="0.5"/>', '<mass value="-0.5"/>'), "no body"),
    "link": (MIXED.replace('<parent link="plate"/>', '<parent link="nowhere"/>'), "not there"),
    "branch": (MIXED.replace('<parent link="b"/>', '<parent link="a"/>'), "branch"),
    "ring": (MIXED.replace('<parent link="base"/>', '<parent link="c"/>'), "ring"),
    "many": (f'<robot name="x"><link name="a"/>{400 * WELD}</robot>', "more than 300"),
    "xacro": ('<robot name="x"><xacro:macro xmlns:xacro="x"/></robot>', "xacro"),
}  # fmt: skip


@pytest.mark.parametrize("name", SPOILT)
def test_a_spoilt_urdf_is_refused_in_one_sentence(name, tmp_path):
    text, reason = SPOILT[name]
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    with pytest.raises(exo.InputError, match=reason) as refused:
        read_urdf(path)
    assert "arm.urdf" in str(refused.value) and "\n" not in str(refused.value)


def test_branches_are_resolved_by_the_tip(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(MIXED.replace('<parent link="b"/>', '<parent link="a"/>'))
    assert read_urdf(path, "tool").names == ("turntable", "J3")
    with pytest.raises(exo.InputError, match="no link"):
        read_urdf(path, "d")


@pytest.mark.parametrize(
    "section, reason",
    [
        ({"urdf": "../arm.urdf"}, "outside"),
        ({"urdf": "/etc/hostname"}, "outside"),
        ({"urdf": "absent.urdf"}, "no such file"),
        ({"form": "inverse"}, "'urdf' is missing"),
        ({"urdf": "arm.urdf", "form": "both"}, "none of inverse"),
        ({"urdf": "arm.urdf", "frame": 0.0}, "above 0"),
        ({"urdf": "arm.urdf", "urfd": 1}, "unknown key"),
    ],
)
def test_a_wrong_section_is_refused(section, reason, tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    for place in (tmp_path, inside):
        (place / "arm.urdf").write_text(MIXED)
    with pytest.raises(exo.InputError, match=reason):
        arm_machine("x", section, inside, "x/robot.yaml")


def test_limits_that_a_program_writes_for_none_are_none(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(MIXED.replace('lower="-1" upper="2" effort="100"', 'lower="-1e16" upper="1e308" effort="1e30"'))
    last = read_urdf(path).joints[-1]
    assert (last.lower, last.upper, last.effort) == (-np.inf, np.inf, np.inf)


def test_names_of_arms_hide_no_module_of_the_machines(tmp_path):
    """A folder without code may be called like one, which still makes arms; a folder with code may not."""
    assert run("new-machine", tmp_path / "serial_arm", "--urdf", "cable_arm").exit_code == 0
    plain = {name: value for name, value in os.environ.items() if name != plugins.VARIABLE}
    command = [sys.executable, "-m", "exodrake", "robot", "--machine", "serial_arm"]
    found = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=plain, check=False)
    assert found.returncode == 0 and "arm." in found.stdout, found.stderr
    refused = run("new-machine", tmp_path / "robot_file")
    assert refused.exit_code == 2 and "module robot_file" in refused.stderr and not (tmp_path / "robot_file").exists()
