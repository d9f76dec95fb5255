"""The robot's parts as Drake systems: ports, feedthrough, logs, events, memory."""

import gc
import weakref
from collections import Counter

import numpy as np
import pytest
import yaml
from diagram_runs import nominal, wavy
from pydrake.systems.analysis import Simulator

from benchmarks.diagram import multibody_speed
from benchmarks.speed import Row
from exodrake.compiled.inputs import NoiseInputs, Reference
from exodrake.core.errors import InputError
from exodrake.diagrams.diagram import build_diagram, run_diagram
from exodrake.diagrams.leaf import Leaf
from exodrake.diagrams.parts import NAMED, MotorDynamics, part_class
from exodrake.diagrams.signal_log import FINE_LOG, logged, logged_signals
from exodrake.simulation.simulate import record

THROUGH = {  # every other output is state
    "finger": {("stroke", port) for port in ("tension", "tension_spool", "tension+tension_spool")},
    "sensor": {("tension", "cell")},
}


def through(system):
    """Pairs of ports by name between which the system feeds directly through."""
    return {
        (system.get_input_port(i).get_name(), system.get_output_port(o).get_name())
        for i in range(system.num_input_ports())
        for o in range(system.num_output_ports())
        if system.HasDirectFeedthrough(i, o)
    }


@pytest.mark.parametrize("cls", NAMED.values(), ids=lambda cls: cls.__name__)
def test_a_part_on_its_own(cls):
    leaf = cls()
    figure = yaml.safe_load(cls.__doc__.split(".. pydrake_system::")[1].split("\n\n")[1])
    assert figure["name"] == cls.__name__
    assert figure["input_ports"] == [leaf.get_input_port(i).get_name() for i in range(leaf.num_input_ports())]
    assert figure["output_ports"] == [leaf.get_output_port(i).get_name() for i in range(leaf.num_output_ports())]
    assert through(leaf) == THROUGH.get(cls.part, set())
    leaf.ValidateContext(leaf.CreateDefaultContext())


def test_every_part_of_the_machine_has_its_class():
    assert set(NAMED) <= {block.name for block in nominal().machine.parts}
    with pytest.raises(InputError, match=r"motr.*did you mean motor"):
        part_class(nominal().machine, "motr")()


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


def test_no_loop_of_feedthrough_from_outside():
    diagram = build_diagram(nominal())
    assert [diagram.get_input_port(i).get_name() for i in range(diagram.num_input_ports())] == ["tension_ref"]
    assert not through(diagram)


def test_the_ports_are_named_by_part_and_signal():
    machine = nominal().machine
    diagram = build_diagram(nominal(), wavy(0.1))
    names = [diagram.get_output_port(i).get_name() for i in range(diagram.num_output_ports())]
    assert {"motor.stroke", "finger.angle", "sensor.tension_read", "host.tension_ref"} <= set(names)
    assert sorted(name.split(".")[1] for name in names) == sorted(signal.name for signal in machine.signals)
    context = diagram.CreateDefaultContext()
    angle = diagram.GetOutputPort("finger.angle").Eval(context)
    np.testing.assert_array_equal(angle, nominal().channels("finger.q0"))


def test_the_fine_log_holds_the_frames():
    robot, reference = nominal(), wavy(1.0)
    diagram = build_diagram(robot, reference, seed=2, fine_log=True)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.0)
    rows = logged(robot.machine, diagram, simulator.get_context())
    fine = logged(robot.machine, diagram, simulator.get_context(), FINE_LOG)
    assert rows.shape[0] == 50 and fine.shape[0] == 500
    np.testing.assert_array_equal(fine[9::10], rows)
    time = logged_signals(diagram, simulator.get_context(), FINE_LOG)["time"]
    np.testing.assert_allclose(time, 0.002 * np.arange(500) + 0.0015, atol=1e-12)


def test_one_python_event_a_part_and_tick(monkeypatch):
    calls, plain = Counter(), Leaf._handler

    def counted(self, *arguments):
        handler, name = plain(self, *arguments), " ".join([self.spec.name, *arguments[3:]])

        def count(context, target):
            calls[name] += 1
            return handler(context, target)

        return count

    monkeypatch.setattr(Leaf, "_handler", counted)
    simulator = Simulator(build_diagram(nominal(), wavy(2.0)))
    simulator.AdvanceTo(2.0)
    a_second = {"finger": 500, "motor": 500, "sensor": 650, "encoder": 150, "mocap": 50, "controller": 50, "bus": 150}
    shown = {"finger tension+tension_spool": 1000 + 1, "sensor cell": 2 * 50 + 1, "finger start_stroke": 1}
    assert calls == {name: 2 * count for name, count in a_second.items()} | shown


def test_rebuilt_diagrams_leave_nothing_behind():
    alive = []
    for _ in range(50):
        diagram = build_diagram(nominal(), wavy(0.1))
        simulator = Simulator(diagram)
        simulator.AdvanceTo(0.1)
        alive += [weakref.ref(diagram), *(weakref.ref(s) for s in diagram.GetSystems() if isinstance(s, Leaf))]
    del diagram, simulator
    gc.collect()
    assert not [item for item in alive if item() is not None]


def test_exogenous_signals_can_be_ones_own():
    """Noise inputs of 0 and no lost packet are a run without noise."""
    robot, reference = nominal(), wavy(0.5)
    given = NoiseInputs(noise_tension=np.zeros((25, 3)), noise_angle=np.zeros((25, 3)), packet_arrival=np.ones((25, 3)))
    rows = run_diagram(robot, robot.values, reference, given, 1)
    noise_free = record(robot, reference, seed=None).signals
    np.testing.assert_array_equal(rows, np.hstack([noise_free[signal.name] for signal in robot.machine.signals]))


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


def test_bench_rows():
    row = Row("frame", 2.5, "s")
    assert row.met and row.target == ""
    assert not Row("x", 0.5, "s", most=0.4).met
    assert Row("ratio", 21.0, "-", least=20).target == "≥ 20"


@pytest.mark.parametrize("fixed", [1, 2, 4, 8])
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


def test_references_fixed_from_outside_act_as_those_of_a_reference():
    """A value fixed many times in a frame, and a vector that stays and changes, are the same run."""
    rows, found = wavy(0.4).values, []
    for edits in (False, True):
        diagram = build_diagram(nominal(), None, seed=1)
        simulator = Simulator(diagram)
        context, port = simulator.get_mutable_context(), diagram.GetInputPort("tension_ref")
        value = port.FixValue(context, rows[0])
        for tick in range(800):
            row = rows[tick // 40] if tick % 2 else rows[0]
            if edits:
                value.GetMutableData().get_mutable_value().SetFromVector(row)
            else:
                port.FixValue(context, row)
            simulator.AdvanceTo(0.0005 * (tick + 1))
        found.append(logged(nominal().machine, diagram, context))
    np.testing.assert_array_equal(*found)
