"""The robot's parts as Drake systems: ports, feedthrough, Contexts, memory; the sync pulse; bad wiring is refused."""

import gc
import weakref
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from diagram_runs import made_up_weights, nominal, wavy
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

import exodrake as exo
from benchmarks.diagram import multibody_speed
from benchmarks.speed import compiled_speed
from exodrake.cli.main import cli
from exodrake.core.errors import InputError
from exodrake.diagrams.block_diagram import part_shares, stream_order, wiring_svg
from exodrake.diagrams.diagram import build_diagram, read_signals
from exodrake.diagrams.posture_loop import PostureLoop
from exodrake.engine.inputs import Reference
from exodrake.identification.kinematics.markers import clock_from_pulses
from exodrake.machines.exo_index.machine import machine as exo_index
from exodrake.machines.robot_file import load_robot
from exodrake.model.part import Output, Task
from exodrake.simulation.simulate import record
from exodrake.systems.admittance_controller import AdmittanceController
from exodrake.systems.bus import Bus
from exodrake.systems.encoder import Encoder
from exodrake.systems.motion_capture import MotionCapture
from exodrake.systems.motor import MotorDynamics
from exodrake.systems.part import MachinePart, PartSystem
from exodrake.systems.posture_controller import PosturePlan
from exodrake.systems.sources import Noise, Playback, SyncPulse
from exodrake.systems.tendon_finger import TendonFinger
from exodrake.systems.tension_sensor import TensionSensor

PARTS = (TendonFinger, MotorDynamics, TensionSensor, Encoder, MotionCapture, AdmittanceController, Bus)
THROUGH = {  # every other output is state
    "TendonFinger": {("stroke", "tension"), ("stroke", "tension_spool")},
    "TensionSensor": {("tension", "cell")},
}
FAULTS = {
    "tendon.capstan_friction": {},
    "tendon.compliance": {},
    "motor.dead_zone": {"width": 0.002},
    "motor.friction": {"torque": 3e-4},
    "sensor.hysteresis": {},
    "encoder.homing_offset": {},
    "mocap.offset": {},
    "timing.dropped_commands": {},
}


def faulty():
    """A robot with an effect on every part but the controller, which has none."""
    robot = nominal()
    for identity, parameters in FAULTS.items():
        robot = robot.splice(identity, parameters)
    return robot


def fixed_inputs(system, context, rng=None):
    """Fixes every input port but `deviation` to a value of its own."""
    for i in range(system.num_input_ports()):
        port = system.get_input_port(i)
        if port.get_name() != "deviation":
            port.FixValue(context, 0.01 * np.arange(1, port.size() + 1) if rng is None else rng.random(port.size()))


def through(system):
    """Pairs of ports by name between which the system feeds directly through; deviations of parameters aside."""
    return {
        (system.get_input_port(i).get_name(), system.get_output_port(o).get_name())
        for i in range(system.num_input_ports())
        for o in range(system.num_output_ports())
        if system.HasDirectFeedthrough(i, o) and system.get_input_port(i).get_name() != "deviation"
    }


@pytest.mark.parametrize("cls", PARTS, ids=lambda cls: cls.__name__)
def test_a_part_shows_the_ports_of_its_figure(cls):
    leaf = cls()
    figure = yaml.safe_load(cls.__doc__.split(".. pydrake_system::")[1].split("\n\n")[1])
    assert isinstance(leaf, LeafSystem) and figure["name"] == cls.__name__
    assert figure["input_ports"] == [leaf.get_input_port(i).get_name() for i in range(leaf.num_input_ports())]
    assert figure["output_ports"] == [leaf.get_output_port(i).get_name() for i in range(leaf.num_output_ports())]
    assert through(leaf) == THROUGH.get(cls.__name__, set())
    leaf.ValidateContext(leaf.CreateDefaultContext())


def test_an_unknown_part_is_refused_by_name():
    with pytest.raises(InputError, match=r"motr.*did you mean motor"):
        MachinePart(nominal(), "motr")
    with pytest.raises(InputError, match=r"emps has no part 'motor'"):
        MotorDynamics(load_robot("emps"))


@pytest.mark.parametrize("cls", PARTS, ids=lambda cls: cls.__name__)
def test_a_class_of_its_own_is_the_generic_leaf_to_the_last_bit(cls):
    """Ports and values, with effects, from the declaration of the part."""
    systems = [cls(faulty()), MachinePart(faulty(), cls().get_name())]
    contexts = []
    for system in systems:
        simulator = Simulator(system)
        contexts.append(simulator.get_context())
        fixed_inputs(system, simulator.get_mutable_context())
        simulator.AdvanceTo(0.1)
    names = [{s.get_output_port(i).get_name() for i in range(s.num_output_ports())} for s in systems]
    assert names[0] == names[1]
    for name in names[0]:
        found, wanted = (s.GetOutputPort(name).Eval(c) for s, c in zip(systems, contexts))
        np.testing.assert_array_equal(found, wanted, name)


def test_parts_alone_joined_by_hand_are_the_diagram():
    """`add_exo_index` in a builder of one's own: a reference by Playback, noise by Noise, a log by Drake."""
    builder, reference = DiagramBuilder(), wavy(0.4)
    parts = exo.add_exo_index(builder, nominal())
    player = builder.AddSystem(Playback({"tension_ref": reference.values}, 0.02))
    noise = builder.AddSystem(Noise(nominal().machine, 3))
    builder.Connect(player.GetOutputPort("tension_ref"), parts.controller.GetInputPort("tension_ref"))
    builder.Connect(noise.GetOutputPort("noise_tension"), parts.sensor.GetInputPort("noise_tension"))
    builder.Connect(noise.GetOutputPort("noise_angle"), parts.mocap.GetInputPort("noise_angle"))
    builder.Connect(noise.GetOutputPort("packet_arrival"), parts.bus.GetInputPort("packet_arrival"))
    log = LogVectorOutput(parts.finger.GetOutputPort("angle"), builder, 0.02)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.4)
    found = log.FindLog(simulator.get_context()).data()[:, 1:].T
    np.testing.assert_array_equal(found, record(nominal(), reference, seed=3).signals["angle"])


def test_a_part_of_the_exo_index_that_is_none_is_refused():
    with pytest.raises(InputError, match=r"no part 'controler'; did you mean controller"):
        exo.add_exo_index(DiagramBuilder(), nominal(), controler=AdmittanceController())
    with pytest.raises(InputError, match=r"in place of controller has no output port 'speed_cmd'"):
        exo.add_exo_index(DiagramBuilder(), nominal(), controller=Encoder())


def test_a_fixed_value_acts_on_a_connected_port():
    """Strokes fixed to 0 leave the finger in its rest posture, against whatever the motors do."""
    diagram = build_diagram(nominal(), wavy(1.0), seed=None)
    simulator = Simulator(diagram)
    finger, context = diagram.GetSubsystemByName("finger"), simulator.get_mutable_context()
    own = finger.GetMyMutableContextFromRoot(context)
    finger.GetInputPort("stroke").FixValue(own, np.zeros(3))
    finger.GetInputPort("wire_speed").FixValue(own, np.zeros(3))
    simulator.AdvanceTo(1.0)
    alone = TendonFinger(nominal())
    other = Simulator(alone)
    alone.GetInputPort("stroke").FixValue(other.get_mutable_context(), np.zeros(3))
    alone.GetInputPort("wire_speed").FixValue(other.get_mutable_context(), np.zeros(3))
    other.AdvanceTo(1.0)
    found = diagram.GetOutputPort("finger.angle").Eval(context)
    np.testing.assert_array_equal(found, alone.GetOutputPort("angle").Eval(other.get_context()))
    free = record(nominal(), wavy(1.0), seed=None).signals["angle"][-1]
    assert np.abs(found - free).max() > 0.05


@pytest.mark.parametrize("cls", PARTS, ids=lambda cls: cls.__name__)
def test_an_output_is_a_function_of_the_context(cls):
    """Whatever is set in a Context, state or parameters, shows at once at the ports, as in a Context set so before."""
    leaf, rng = cls(faulty()), np.random.default_rng(1)
    state = 1e-3 * rng.random(leaf.CreateDefaultContext().get_discrete_state(0).size())
    values = leaf.CreateDefaultContext().get_numeric_parameter(0).value() * 1.01
    used, fresh = leaf.CreateDefaultContext(), leaf.CreateDefaultContext()
    fixed_inputs(leaf, used)
    fixed_inputs(leaf, fresh)
    changed = 0
    for i in range(leaf.num_output_ports()):
        before = np.array(leaf.get_output_port(i).Eval(used))
        changed += not np.array_equal(before, np.zeros(len(before)))
    for context in (fresh, used):
        context.SetDiscreteState(0, state)
        context.get_mutable_numeric_parameter(0).SetFromVector(values)
    for i in range(leaf.num_output_ports()):
        port = leaf.get_output_port(i)
        np.testing.assert_array_equal(port.Eval(used), port.Eval(fresh), port.get_name())


def test_clones_are_systems_of_the_same_robot():
    for system in (*(cls(faulty()) for cls in PARTS), MachinePart(load_robot("emps"), "carriage")):
        clone = system.Clone()
        assert type(clone) is type(system) and clone is not system
        values = [s.CreateDefaultContext().get_numeric_parameter(0).value() for s in (system, clone)]
        np.testing.assert_array_equal(*values)
    plan = PosturePlan(np.ones((1, 3)), np.zeros((1, 3)), np.eye(3), np.full(3, 0.3), np.full(3, 8.0), ki=0.5)
    for systems in ([], [PostureLoop(plan, made_up_weights())]):  # the loop drives the references
        diagram = build_diagram(faulty(), wavy(0.2), seed=4, systems=systems)
        clone, found = diagram.Clone(), []
        assert not {*diagram.GetSystems()} & {*clone.GetSystems()} and clone.get_name() == diagram.get_name()
        for one in (diagram, clone):
            simulator = Simulator(one)
            simulator.AdvanceTo(0.2)
            found.append(read_signals(one.robot.machine, one, simulator.get_context()))
        np.testing.assert_array_equal(*found)


def test_a_random_context_of_a_part_alone_draws_its_tolerances():
    motor = MotorDynamics()
    found = []
    for seed in (1, 1, 2):
        context = motor.CreateDefaultContext()
        motor.SetRandomContext(context, RandomGenerator(seed))
        found.append(motor.parameter("motor.r.AF").get(context)[0])
    assert found[0] == found[1] != found[2] and abs(found[2] / nominal()["motor.r.AF"] - 1.0) < 0.2


def test_a_motor_alone_reaches_its_speed():
    """Without load, the PI loop follows 20 mm/s without error."""
    motor = MotorDynamics()
    simulator = Simulator(motor)
    context = simulator.get_mutable_context()
    motor.GetInputPort("speed_applied").FixValue(context, [0.02, 0.0, -0.02])
    motor.GetInputPort("tension_spool").FixValue(context, np.zeros(3))
    before = motor.GetOutputPort("stroke").Eval(context).copy()
    simulator.AdvanceTo(2.0)
    np.testing.assert_allclose(motor.GetOutputPort("wire_speed").Eval(context), [0.02, 0.0, -0.02], atol=1e-9)
    assert motor.GetOutputPort("stroke").Eval(context)[0] - before[0] == pytest.approx(0.04, rel=0.05)


def test_the_ports_are_named_by_part_and_signal():
    machine = nominal().machine
    outside, diagram = build_diagram(nominal()), build_diagram(nominal(), wavy(0.1))
    names = [diagram.get_output_port(i).get_name() for i in range(diagram.num_output_ports())]
    assert [outside.get_input_port(i).get_name() for i in range(outside.num_input_ports())] == ["tension_ref"]
    assert not through(outside)
    assert {"motor.stroke", "finger.angle", "sensor.tension_read", "reference.tension_ref"} <= set(names)
    assert sorted(name.split(".")[1] for name in names) == sorted(signal.name for signal in machine.signals)
    context = diagram.CreateDefaultContext()
    angle = diagram.GetOutputPort("finger.angle").Eval(context)
    np.testing.assert_array_equal(angle, nominal().channels("finger.q0"))


def test_rebuilt_diagrams_leave_nothing_behind():
    alive = []
    for _ in range(50):
        diagram = build_diagram(nominal(), wavy(0.1))
        simulator = Simulator(diagram)
        simulator.AdvanceTo(0.1)
        alive += [weakref.ref(diagram), *(weakref.ref(s) for s in diagram.GetSystems() if isinstance(s, PartSystem))]
    del diagram, simulator
    gc.collect()
    assert not [item for item in alive if item() is not None]


@pytest.mark.parametrize("batch", [False, True])
def test_the_bench_runs_the_compiled_simulator(batch):
    assert compiled_speed(nominal(), wavy(0.1), 2, batch) > 0


@pytest.mark.parametrize("step", [0.002, 0.0])
def test_a_multibody_finger_moves_like_ours(step):
    """Another derivation and another integrator, on the strokes of our own run: angles within 0.3 mrad."""
    speed, apart = multibody_speed(nominal(), wavy(2.0), step, 1.5, 1)
    assert speed > 0 and apart < 3e-4


def test_a_mujoco_finger_moves_like_ours():
    """MuJoCo's own tendons under the nominal law settle where ours do: angles within 5 mrad, tensions within 0.05 N."""
    pytest.importorskip("mujoco")
    from benchmarks.mujoco_finger import mujoco_speed

    reference = Reference(np.tile([5.0, 3.0, 1.0], (250, 1)))
    speed, log = mujoco_speed(nominal(), reference, 5.0, 1)
    wanted = record(nominal(), reference, seed=None, quantisation=False).signals
    assert speed > 0
    np.testing.assert_allclose(log[-1, 9:], wanted["angle"][-1], atol=5e-3)
    np.testing.assert_allclose(log[-1, :3], wanted["tension"][-1], atol=0.05)


@pytest.mark.parametrize("fixed", [1, 8])
def test_a_motor_alone_follows_the_value_fixed_last(fixed):
    """However often a value was fixed before it: C++ puts later vectors where freed ones lay."""
    found = []
    for times in (1, fixed):
        motor, rng = MotorDynamics(), np.random.default_rng(3)
        simulator = Simulator(motor)
        context = simulator.get_mutable_context()
        motor.GetInputPort("tension_spool").FixValue(context, np.zeros(3))
        for step in range(100):
            for speed in [*np.full((times - 1, 3), 0.5), rng.uniform(-0.05, 0.05, 3)]:
                motor.GetInputPort("speed_applied").FixValue(context, speed)
            simulator.AdvanceTo(0.004 * (step + 1))
            found.append(motor.GetOutputPort("wire_speed").Eval(context).copy())
    np.testing.assert_array_equal(found[:100], found[100:])


def test_the_pulse_is_high_in_slot_0_of_every_frame_and_changes_no_signal():
    robot, angles = exo.load_robot(), []
    for pulsed in (True, False):
        builder = DiagramBuilder()
        hand = exo.add_exo_index(builder, robot)
        wanted = builder.AddSystem(ConstantVectorSource([5.0, 3.0, 1.0]))
        builder.Connect(wanted.get_output_port(), hand.controller.GetInputPort("tension_ref"))
        angle = LogVectorOutput(hand.finger.GetOutputPort("angle"), builder, 0.002)
        if pulsed:
            pulse = builder.AddSystem(SyncPulse(robot.machine))
            sync = LogVectorOutput(pulse.GetOutputPort("sync"), builder, 0.002)
        simulator = Simulator(builder.Build())
        simulator.AdvanceTo(0.4)
        angles.append(angle.FindLog(simulator.get_context()).data())
        if pulsed:
            log = sync.FindLog(simulator.get_context())
            time, level = log.sample_times(), log.data()[0]
            assert (level == (np.round(time / 0.002) % 10 == 0)).all() and level.sum() > 20
    assert np.array_equal(*angles)


def test_start_and_skew_of_the_clock():
    """Pulses of 2 ms every 20 ms (1 + 80 ppm) from 0.1234 s, recorded at 2 kHz, two of them missed."""
    time = np.arange(0.0, 30.0, 5e-4)
    count, place = np.divmod(time - 0.1234, 0.02 * (1.0 + 80e-6))
    level = 3.3 * ((place < 0.002) & (count >= 0) & (count != 7) & (count != 800))
    level += 0.05 * np.random.default_rng(0).standard_normal(len(time))
    start, skew = clock_from_pulses(time, level, 0.02)
    assert start == pytest.approx(0.1234, abs=5e-4)
    assert skew == pytest.approx(80e-6, abs=2e-6)


@pytest.mark.parametrize("level", [np.zeros(100), np.r_[np.zeros(50), np.ones(50)]])
def test_a_record_without_pulses_is_refused(level):
    with pytest.raises(InputError, match="rising edges"):
        clock_from_pulses(0.001 * np.arange(100), level, 0.02)
    with pytest.raises(InputError, match="time does not increase"):
        clock_from_pulses(np.zeros(100), level, 0.02)


def part(name):
    return next(b for b in exo_index().parts if b.name == name)


FINGER = (part("finger").outputs[0], Output("output_tension", ("tension", "tension_spool"), reads=("cell",)))


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("bus", {"outputs": (Output("output", ("speed_aplied",)),)}, "bus writes unknown signal 'speed_aplied'"),
        ("controller", {"tasks": (Task("control", ("tension_red",), slots=(4,)),)},
         "controller reads signal 'tension_red', which nothing writes"),
        ("encoder", {"outputs": (Output("output", ("tension_read",)),)},
         "signal 'tension_read' is written by sensor and by encoder"),
        ("mocap", {"tasks": (Task("sample", ("angle", "noise_angle"), slots=(4,)),)},
         r"slot 4 holds both .*mocap\.sample.*controller\.control"),
        ("controller", {"tasks": (Task("control", ("tension_ref", "tension_read"), slots=(10,)),)},
         r"controller\.control runs in slot 10, but a frame has 10"),
        ("finger", {"outputs": FINGER}, "algebraic loop through finger, sensor"),
    ],
)  # fmt: skip
def test_bad_wiring_is_refused_with_the_name_of_the_thing(name, changes, said):
    machine = exo_index()
    with pytest.raises(InputError, match=said):
        replace(machine, parts=tuple(replace(b, **changes) if b.name == name else b for b in machine.parts))


def texts(svg):
    """All texts of a drawing that parses."""
    return ["".join(item.itertext()) for item in ElementTree.fromstring(svg).iter("{http://www.w3.org/2000/svg}text")]


def test_the_drawing_shows_every_part_and_task():
    machine = exo_index()
    found = texts(wiring_svg(machine))
    for part in machine.parts:
        assert part.name in found
    assert {"speed_applied m/s", "stroke_read m", "write AE", "control"} <= set(found)
    assert {"slot 0", "slot 7", "slots 8–9", "17–19 ms"} <= set(found), "neighbours without tasks are one"
    order = stream_order(machine)  # the signal runs down the diagonal
    assert order.index("controller") < order.index("bus") < order.index("motor") < order.index("finger")
    shares = texts(wiring_svg(machine, {"finger": 0.5, "tendon": 0.12, "motor": 0.2}))
    assert {"62 %", "20 %", "0 %"} <= set(shares)
    timing = part_shares(machine, {"timing": 0.3})
    assert timing["bus"] > 0 and sum(timing.values()) == pytest.approx(0.3)


def test_draw_writes_an_svg(tmp_path):
    out = tmp_path / "wiring.svg"
    assert CliRunner().invoke(cli, ["draw", "--out", str(out)]).exit_code == 0
    ElementTree.parse(out)
    assert CliRunner().invoke(cli, ["draw", "--out", str(tmp_path / "wiring.png")]).exit_code == 2
