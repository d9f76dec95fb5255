"""Robots for other simulators: MuJoCo moves them as the own engine does, Drake reads the same numbers back."""

import sys
from types import ModuleType, SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from arm_folders import MIXED, made
from command_line import run
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

import exodrake as exo
from exodrake.machines.export import robot_as
from exodrake.simulation.simulate import record


@pytest.fixture(scope="module")
def arm(arm_folder, tmp_path_factory):
    """An arm under a controller so quick that MuJoCo's, which never holds a command, is nearly the same."""
    path = tmp_path_factory.mktemp("urdf") / "mixed.urdf"
    path.write_text(MIXED)
    robot = made(arm_folder, "quick_arm", "--urdf", path, "--form", "closed-loop", "--frame", 0.001)
    robot = robot.splice("arm.payload", {"mass": 0.4}).splice("arm.rotor_inertia", {"inertia": 0.05})
    return robot.splice("arm.coulomb_friction", {"force": 0.5}).splice("arm.viscous_friction", {"coefficient": 0.3})


@pytest.fixture(scope="module")
def mujoco():
    """Asked for first, or a machine is compiled for a test that is skipped."""
    return pytest.importorskip("mujoco", reason="MuJoCo, of the group bench, is not installed")


def moved(mujoco, robot, commands, start, share):
    """Positions (n, joints) of the exported robot in MuJoCo, `share` of a frame after each command.

    Empty histories of delayed commands hold 0, so that the robot is put where it starts once they are full.
    """
    model = mujoco.MjModel.from_xml_string(robot_as(robot, "mjcf"))
    data = mujoco.MjData(model)
    steps = round(robot.machine.frame / model.opt.timestep)
    until = round(share * steps)
    data.ctrl[:] = commands[0]
    mujoco.mj_step(model, data, 10 * steps if np.any(model.actuator_history) else 0)
    data.qvel[:] = 0.0
    for i in range(model.njnt):
        joint = model.joint(i)
        data.qpos[joint.qposadr[0]] = start[robot.machine.axes.joints.index(joint.name.removesuffix("_rotor"))]
    data.act[:] = commands[0] if model.na else ()
    found = []
    for command in commands:
        data.ctrl[:] = command
        mujoco.mj_step(model, data, until)
        found.append([data.joint(name).qpos[0] for name in robot.machine.axes.joints])
        mujoco.mj_step(model, data, steps - until)
    return np.array(found)


@pytest.mark.parametrize(
    ("effects", "most"),
    [
        ({}, 1e-6),
        ({"servo.latency": {"frames": 2.0}, "servo.gain": {"gain": -0.1}}, 1e-6),
        ({"servo.dead_band": {"half_width": 0.02}}, 1e-6),
        ({"servo.latency": {"frames": 3.0}, "servo.dead_band": {"half_width": 0.02}}, 1e-6),
        ({"servo.lag": {"time_constant": 0.06}}, 5e-4),
    ],
)
def test_servos_with_effects_move_in_mujoco_as_in_the_own_engine(mujoco, effects, most):
    robot = exo.load_robot("so101")
    for identity, parameters in effects.items():
        robot = robot.splice(identity, parameters)
    reference = exo.protocol("random-motion:duration=4", robot)
    wanted = record(robot, reference, seed=None, quantisation=False).signals
    found = moved(mujoco, robot, wanted["angle_ref"], wanted["angle_start"][0], 0.75)
    assert np.sqrt(np.mean((found - wanted["angle"]) ** 2)) < most < 0.03 * wanted["angle"].std(axis=0).max()


@pytest.mark.parametrize(
    "effects",
    [
        {},
        {"servo.gravity_moment": {"moment": 0.6, "lever": 0.2}, "servo.supply": {"share": -0.4}},
        {"servo.coulomb_friction": {"force": 0.25}, "servo.viscous_friction": {"coefficient": 0.3}},
        {"servo.latency": {"frames": 2.0}, "servo.lag": {"time_constant": 0.06}},
    ],
    ids=["plain", "weight and supply", "friction", "timing"],
)
def test_servos_with_motors_move_in_mujoco_as_in_the_own_engine(mujoco, arm_folder, request, effects):
    """Supply, back-EMF, inertia, weight, friction and timing at each frame's end: 1 mrad, of swings of a radian."""
    robot = made(arm_folder, request.node.callspec.id.replace(" ", "_"), "--servo", "motor")
    for identity, parameters in effects.items():
        robot = robot.splice(identity, parameters)
    commands = np.repeat([[0.0, 0.0], [1.0, -0.8], [-0.5, 0.4]], 50, axis=0)
    found = moved(mujoco, robot, commands, np.zeros(2), 1.0)
    wanted = record(robot, exo.Reference(np.hstack([commands, 0.0 * commands])), seed=None, quantisation=False).signals
    assert np.sqrt(np.mean((found - wanted["angle"]) ** 2)) < 1e-3 < 0.01 * wanted["angle"].std(axis=0).max()


def test_an_arm_with_effects_moves_in_mujoco_as_in_the_own_engine(mujoco, arm):
    """Payload, rotors, dry and viscous friction, controller that bears the nominal weight: 1 mrad, of 0.4 rad."""
    wanted = record(arm, exo.protocol("random-motion:duration=3,fastest=0.8", arm), seed=None).signals
    reference = wanted["position_ref"]
    kp = arm["drive.kp"] * arm.channels("drive.stiffness")
    kv = arm["drive.kd"] * arm.channels("drive.viscosity")
    commands = reference + kv / kp * np.gradient(reference, arm.machine.frame, axis=0)
    error = moved(mujoco, arm, commands, reference[0], 0.0) - wanted["link_position"]
    assert np.sqrt(np.mean(error**2, axis=0)).max() < 2e-3 < 0.01 * np.ptp(wanted["link_position"], axis=0).max()


def test_friction_and_latency_of_tendons_reach_mujoco(mujoco):
    robot = exo.load_robot()
    for effect, parameters in (("tendon.coulomb_friction", {"force": 0.2}), ("finger.stiffness", {"factor": 1.5}),
                               ("timing.command_latency", {"frames": 1.5})):  # fmt: skip
        robot = robot.splice(effect, parameters)
    model = mujoco.MjModel.from_xml_string(robot_as(robot, "mjcf"))
    assert model.tendon_frictionloss == pytest.approx([0.2] * 3) and model.actuator_delay == pytest.approx([0.03] * 3)
    stiffness = np.reshape(model.jnt_stiffness, (3, -1))[:, 0]  # the first coefficient, since MuJoCo 4
    assert stiffness == pytest.approx(1.5 * robot.channels("finger.kappa"))
    assert model.actuator_forcerange[0] == pytest.approx([0.0, 0.3 * 0.0115 * 69 / 0.0075])


def test_drake_reads_the_urdf_back(arm):
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(robot_as(arm, "urdf"), "urdf")
    plant.Finalize()
    for j in arm.machine.axes.joints:
        joint = plant.GetJointByName(j)
        axis = joint.revolute_axis() if j != "lift2" else joint.translation_axis()
        assert axis == pytest.approx([arm[f"arm.axis_{a}.{j}"] for a in "xyz"], abs=1e-15)
        assert joint.default_damping() == arm[f"arm.damping.{j}"] + 0.3
        low, high = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        assert (low == arm[f"arm.stop_low.{j}"] and high == arm[f"arm.stop_high.{j}"]) or j == "turntable"
        actuator = plant.GetJointActuatorByName(j)
        assert actuator.default_rotor_inertia() == pytest.approx(arm[f"arm.rotor_inertia.{j}"] + 0.05)
        assert actuator.effort_limit() == pytest.approx(arm[f"motor.current_max.{j}"])
    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == pytest.approx(arm.channels("arm.mass").sum() + 0.4)


def test_actuators_of_isaac_lab_have_the_robots_numbers(arm, monkeypatch):
    """The file runs where Isaac Lab's classes are; here they keep what they are given."""
    actuators = ModuleType("isaaclab.actuators")
    for name in ("DelayedPDActuatorCfg", "ImplicitActuatorCfg"):
        setattr(actuators, name, lambda name=name, **fields: SimpleNamespace(kind=name, **fields))
    monkeypatch.setitem(sys.modules, "isaaclab", ModuleType("isaaclab"))
    monkeypatch.setitem(sys.modules, "isaaclab.actuators", actuators)

    def configured(robot):
        found = {}
        exec(robot_as(robot, "isaac"), found)
        return found["PHYSICS_STEP"], list(found["ACTUATORS"].values())

    _, (prompt,) = configured(arm)
    joints = list(arm.machine.axes.joints)
    assert prompt.kind == "ImplicitActuatorCfg" and prompt.joint_names_expr == joints
    assert prompt.stiffness == pytest.approx(dict(zip(joints, arm.channels("drive.stiffness"), strict=True)))
    assert prompt.friction == 0.5 and prompt.viscous_friction == pytest.approx(0.3) and prompt.armature == 0.05
    servos = exo.load_robot("so101").splice("servo.latency", {"frames": 1.3}, ["Jaw"])
    step, groups = configured(servos)
    (late,) = [group for group in groups if group.kind == "DelayedPDActuatorCfg"]
    assert late.joint_names_expr == ["Jaw"]
    assert late.min_delay * step <= 1.3 * servos.machine.frame <= late.max_delay * step
    assert late.max_delay - late.min_delay == 1
    with pytest.raises(exo.InputError, match="tendons move it"):
        robot_as(exo.load_robot(), "isaac")


@pytest.mark.parametrize("form", ["mjcf", "urdf", "isaac"])
def test_what_a_format_does_not_state_stands_in_a_comment(form):
    robot = exo.load_robot("so101").splice("servo.hysteresis", {"error": 0.02}).splice("servo.lag", channels=["Jaw"])
    text = robot_as(robot, form)
    assert "effect servo.hysteresis: error" in text
    assert ("lag [s] Jaw 0.06" in text) == (form != "mjcf")
    if form != "isaac":
        ElementTree.fromstring(text)


@pytest.mark.parametrize("machine", ["exo_index", "emps", "dvrk_wrist", "tendon_sheath"])
def test_each_machine_is_exported_by_the_command(machine, tmp_path):
    for form in ("mjcf", "urdf"):
        result = run("export", machine, f"--{form}", "--out", tmp_path / f"robot.{form}")
        assert result.exit_code == 0, result.output
        assert ElementTree.parse(tmp_path / f"robot.{form}").getroot().tag in ("mujoco", "robot")
    result = run("export", machine, "--mjcf", "--out", tmp_path / "other.urdf")
    assert result.exit_code == 2 and ".mjcf" in result.stderr and not (tmp_path / "other.urdf").exists()
    result = run("export", machine, "--out", tmp_path / "robot.xml")
    assert result.exit_code == 2 and "--mjcf" in result.stderr
