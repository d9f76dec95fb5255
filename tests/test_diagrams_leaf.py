"""The robot's parts as Drake systems: ports, feedthrough, logs, numbers in the Context, events, memory."""

import gc
import weakref
from collections import Counter

import numpy as np
import pytest
import yaml
from diagram_runs import nominal, wavy
from pydrake.systems.analysis import Simulator

from benchmarks.diagram import multibody_speed
from benchmarks.speed import Row, as_row
from exodrake.compiled.inputs import Reference
from exodrake.core.errors import InputError
from exodrake.diagrams.diagram import FINE_LOG, assemble, build_diagram, logged, set_parameters
from exodrake.diagrams.leaf import Leaf
from exodrake.diagrams.parts import NAMED, MotorDynamics, part_class
from exodrake.simulation.simulate import record
from exodrake.systems.gp_estimator import Weights, predict_rows

THROUGH = {  # every other output is state
    "finger": {("stroke", "tension"), ("stroke", "tension_spool")},
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
    assert set(nominal().machine.inputs) == {
        diagram.get_input_port(i).get_name() for i in range(diagram.num_input_ports())
    }
    assert not {pair for pair in through(diagram) if not pair[1].startswith("outside")}


def test_the_ports_are_named_by_part_and_wire():
    machine = nominal().machine
    diagram = build_diagram(nominal(), wavy(0.1))
    names = [diagram.get_output_port(i).get_name() for i in range(diagram.num_output_ports())]
    assert {"motor.stroke", "finger.angle", "sensor.tension_read", "outside.tension_ref"} <= set(names)
    assert sorted(name.split(".")[1] for name in names) == sorted(wire.name for wire in machine.signals)
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


def test_one_diagram_serves_many_robots():
    reference = wavy(1.0)
    diagram = build_diagram(nominal(), reference, seed=3)
    simulator = Simulator(diagram)
    other = nominal().with_parameters({"finger.kappa": 0.09, "finger.q0.PIP": 0.4}).splice("tendon.capstan_friction")
    for robot in (other, nominal()):
        context = diagram.CreateDefaultContext()
        set_parameters(robot, diagram, context)
        simulator.reset_context(context)
        simulator.AdvanceTo(1.0)
        rows = logged(robot.machine, diagram, context)
        wanted = record(robot, reference, seed=3).signals
        np.testing.assert_array_equal(rows, np.hstack([wanted[wire.name] for wire in robot.machine.signals]))


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
    shown = {"finger tension": 1000 + 1, "finger tension_spool": 1000 + 1, "sensor cell": 2 * 50 + 1}
    assert calls == {name: 2 * count for name, count in a_second.items()} | shown


def logged_after(simulator, diagram, seconds):
    """All signals after a further run."""
    simulator.AdvanceTo(simulator.get_context().get_time() + seconds)
    return logged(nominal().machine, diagram, simulator.get_context())


def test_a_copied_context_goes_on_by_itself():
    """The leaves bind to the memory of each Context: copies, new states and restored states act as they should."""
    diagram = build_diagram(nominal(), wavy(1.0), seed=4)
    simulator = Simulator(diagram)
    logged_after(simulator, diagram, 0.3)
    copy = simulator.get_context().Clone()
    wanted = logged_after(simulator, diagram, 0.4)
    second = Simulator(diagram, copy)
    rows = logged_after(second, diagram, 0.4)
    np.testing.assert_array_equal(rows[-20:], wanted[-20:])
    restored = diagram.CreateDefaultContext()
    third = Simulator(diagram, restored)
    logged_after(third, diagram, 0.1)
    start = diagram.CreateDefaultContext()
    third.get_mutable_context().SetTimeStateAndParametersFrom(start)
    third.Initialize()
    np.testing.assert_array_equal(logged_after(third, diagram, 0.7)[-20:], wanted[-20:])


def test_a_parameter_is_found_by_its_name_and_acts():
    diagram = build_diagram(nominal(), wavy(1.0), seed=4)
    simulator = Simulator(diagram)
    plain = logged_after(simulator, diagram, 0.3)
    finger = diagram.GetSubsystemByName("finger")
    context = finger.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    index = finger.parameter_index("finger.kappa.MCP")
    assert context.get_numeric_parameter(0).GetAtIndex(index) == nominal()["finger.kappa.MCP"]
    context.get_mutable_numeric_parameter(0).SetAtIndex(index, 0.2)
    changed = logged_after(simulator, diagram, 0.3)
    simulator.reset_context(diagram.CreateDefaultContext())
    again = logged_after(simulator, diagram, 0.6)
    np.testing.assert_array_equal(changed[:15], plain)
    assert np.abs(changed[15:] - again[15:]).max() > 1e-3
    with pytest.raises(InputError, match=r"did you mean finger\.kappa"):
        finger.parameter_index("finger.kapa.MCP")


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


def test_the_seed_decides_and_the_given_wires_can_be_ones_own():
    robot, tension = nominal(), wavy(0.5).tension
    given = dict(zip(robot.machine.inputs, (tension, *np.zeros((2, 25, 3)), np.ones((25, 3)))))
    diagram = assemble(robot, given)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.5)
    quiet = record(robot, Reference(tension), seed=None).signals
    rows = logged(robot.machine, diagram, simulator.get_context())
    np.testing.assert_array_equal(rows, np.hstack([quiet[wire.name] for wire in robot.machine.signals]))


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


def made_up_weights(points=30):
    """An estimator of random numbers: its arithmetic, not its sense, is at stake."""
    rng = np.random.default_rng(4)
    return Weights(
        center=rng.normal(size=6),
        rotation=rng.normal(size=(6, 6)),
        points=rng.normal(size=(6, points)),
        shrink=rng.uniform(0.1, 0.5, 6),
        variances=np.array([0.1, 1.0, 1e-3]),
        alpha=rng.normal(size=(points, 3)),
        factor=1e-3 * rng.normal(size=points * (points + 1) // 2),
        offset=rng.normal(size=3),
        gain=rng.normal(size=3),
        spread=rng.uniform(0.1, 1.0, 3),
    )


def test_the_estimator_listens():
    """In the Diagram, slot 8 shows to the last bit what a pass over the log gives."""
    robot, reference, weights = nominal(), wavy(0.5), made_up_weights()
    diagram = build_diagram(robot, reference, seed=5, estimator=weights)
    simulator = Simulator(diagram)
    wires = record(robot, reference, seed=5).signals
    mean, std, _ = predict_rows(wires["tension_read"], wires["stroke_read"], weights)
    assert np.isfinite(std).any()
    for frame in range(25):
        simulator.AdvanceTo(0.02 * frame + 0.0195)
        context = simulator.get_context()
        np.testing.assert_array_equal(diagram.GetOutputPort("estimator.angle_est").Eval(context), mean[frame])
        np.testing.assert_array_equal(diagram.GetOutputPort("estimator.angle_std").Eval(context), std[frame])


def test_bench_rows():
    row = as_row(("frame", 2.5, "s"))
    assert row.met and row.target == ""
    assert not as_row({"name": "x", "value": 0.5, "unit": "s", "most": 0.4}).met
    assert as_row(Row("ratio", 21.0, "-", least=20)).target == "≥ 20"
