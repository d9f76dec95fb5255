"""Systems that stand in a part's place or beside the parts: MultibodyPlant finger, view, estimator, posture loop."""

from dataclasses import replace

import msgpack
import numpy as np
import pytest
from diagram_runs import made_up_weights, nominal, wavy
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem

from exodrake.core.errors import InputError
from exodrake.diagrams.diagram import build_diagram, logged_signals
from exodrake.diagrams.meshcat import FingerView, find_colours
from exodrake.diagrams.multibody import MultibodyFinger
from exodrake.diagrams.posture_loop import PostureLoop
from exodrake.engine.compose import compile_machine
from exodrake.engine.inputs import ALONE, NoiseInputs, Reference, input_rows, prepare_values
from exodrake.machines.robot_file import load_robot
from exodrake.model.machine import signal_count, state_size
from exodrake.physics.gp_estimator import Weights, predict_rows
from exodrake.simulation.simulate import record
from exodrake.systems.gp_estimator import GPEstimator
from exodrake.systems.posture_controller import PostureController, PosturePlan, correct_tensions, damped_inverse
from exodrake.systems.sources import Playback


def run(diagram, seconds):
    """Logged signals of a run, and its Simulator."""
    simulator = Simulator(diagram)
    simulator.AdvanceTo(seconds)
    return logged_signals(diagram, simulator.get_context()), simulator


def test_a_multibody_finger_stands_in_the_plants_place():
    """In the closed loop, Drake's continuous plant and our implicit 2 ms step differ by less than the sensors' noise.

    Stated: RMS below 1.5 mrad (motion capture: 5 mrad), 6 mN (load cell: 10 mN) and 15 um (encoder step: 43 um).
    """
    reference = wavy(1.5)
    found, _ = run(build_diagram(nominal(), reference, None, False, systems=[MultibodyFinger(nominal())]), 1.5)
    ours = record(nominal(), reference, seed=None, quantisation=False).signals
    for name, most in (("angle_read", 1.5e-3), ("tension_read", 6e-3), ("stroke_read", 15e-6)):
        assert np.sqrt(((found[name] - ours[name]) ** 2).mean()) < most, name


def test_a_multibody_finger_refuses_what_it_does_not_know():
    with pytest.raises(InputError, match="emps: no finger"):
        MultibodyFinger(load_robot("emps"))
    with pytest.raises(InputError, match=r"does not know the effect tendon\.capstan_friction"):
        MultibodyFinger(nominal().splice("tendon.capstan_friction"))
    MultibodyFinger(nominal().splice("motor.dead_zone"))


def shown(meshcat, path):
    """Transform (4, 4) of a Meshcat path."""
    return np.array(msgpack.unpackb(meshcat._GetPackedTransform(path))["matrix"]).reshape(4, 4).T


def test_the_diagram_moves_its_view():
    """Fingertip and colours of the tendons in Meshcat, by the Diagram's angles and tensions at the last picture."""
    meshcat = Meshcat()
    diagram = build_diagram(nominal(), wavy(0.4), systems=[FingerView(nominal(), meshcat, rate=10.0)])
    _, simulator = run(diagram, 0.4)
    context = simulator.get_context()
    diagram.ForcedPublish(context)
    angle = diagram.GetOutputPort("finger.angle").Eval(context)
    joints = [shown(meshcat, path) for path in ("/robot/MCP", "/robot/MCP/PIP", "/robot/MCP/PIP/DIP")]
    tip = np.linalg.multi_dot(joints) @ [nominal()["finger.length.DIP"], 0.0, 0.0, 1.0]
    lengths, direction = nominal().channels("finger.length"), np.cumsum(angle)
    expected = [lengths @ np.cos(direction), 0.0, -lengths @ np.sin(direction)]
    np.testing.assert_allclose(tip[:3], expected, atol=1e-12)
    share = diagram.GetOutputPort("finger.tension").Eval(context) / nominal().reference_limits()[1]
    path = "/robot/AF_on_0"
    colour = msgpack.unpackb(meshcat._GetPackedProperty(path, "color"))["value"]
    np.testing.assert_allclose(colour, [*find_colours(share)[0], 1.0], atol=1e-12)


def test_a_view_needs_a_finger_and_no_tension():
    meshcat = Meshcat()
    view = FingerView(nominal(), meshcat)
    context = view.CreateDefaultContext()
    view.GetInputPort("angle").FixValue(context, np.array([0.4, 0.7, 0.3]))
    view.ForcedPublish(context)
    assert shown(meshcat, "/robot/MCP")[0, 0] == pytest.approx(np.cos(0.4))
    with pytest.raises(InputError, match="nothing to draw"):
        FingerView(load_robot("emps"), Meshcat())


class Ported(LeafSystem):
    """A system with ports of given names and width 3."""

    def __init__(self, name, inputs, outputs):
        super().__init__()
        self.set_name(name)
        for port in inputs:
            self.DeclareVectorInputPort(port, 3)
        for port in outputs:
            self.DeclareVectorOutputPort(port, 3, lambda context, out: out.SetFromVector([1.0, 2.0, 3.0]))


def test_a_system_that_does_not_fit_in_is_refused_by_name():
    with pytest.raises(InputError, match=r"reads 'angel_read', which nothing writes.*did you mean angle_read"):
        build_diagram(nominal(), wavy(0.1), systems=[Ported("mine", ["angel_read"], [])])
    with pytest.raises(InputError, match="in place of encoder has no output port 'stroke_read'"):
        build_diagram(nominal(), wavy(0.1), systems=[Ported("encoder", [], [])])
    with pytest.raises(InputError, match=r"mine reads 'motor\.stroke', which nothing writes; did you mean stroke"):
        build_diagram(nominal(), wavy(0.1), systems=[Ported("mine", ["motor.stroke"], [])])


def test_a_signal_has_one_writer():
    """Neither a part nor a system of one's own is passed over; a reference is the exception."""
    for systems, named in (
        ([Ported("mine", [], ["speed_cmd"])], "controller and mine both write speed_cmd"),
        ([Ported("mine", [], ["other"]), Ported("yours", [], ["other"])], "mine and yours both write other"),
        ([Ported("encoder", [], ["stroke_read", "stroke"])], "motor and encoder both write stroke"),
    ):
        with pytest.raises(InputError, match=named + r"; a system takes a part's place by bearing its name"):
            build_diagram(nominal(), wavy(0.1), systems=systems)
    with pytest.raises(InputError, match="two systems are named 'mine'"):
        build_diagram(nominal(), wavy(0.1), systems=[Ported("mine", [], ["one"]), Ported("mine", [], ["other"])])
    build_diagram(nominal(), wavy(0.1), systems=[Ported("encoder", [], ["stroke_read", "output"])])


def test_a_system_of_ones_own_drives_the_references():
    """An own system beside the parts equals a reference of the same values."""
    diagram = build_diagram(nominal(), seed=2, systems=[Ported("mine", ["angle_read"], ["tension_ref", "other"])])
    found, _ = run(diagram, 0.4)
    same = record(nominal(), Reference(np.tile([1.0, 2.0, 3.0], (20, 1))), seed=2).signals
    np.testing.assert_array_equal(found["angle"], same["angle"])
    np.testing.assert_array_equal(found["other"], found["tension_ref"])
    assert diagram.GetOutputPort("mine.other") is not None


def test_the_estimator_listens():
    """In the Diagram, slot 8 and the log show to the last bit what a pass over the log gives."""
    robot, reference, weights = nominal(), wavy(0.5), made_up_weights()
    diagram = build_diagram(robot, reference, seed=5, systems=[GPEstimator(weights, robot.machine)])
    found, simulator = run(diagram, 0.5)
    signals = record(robot, reference, seed=5).signals
    mean, std, _ = predict_rows(signals["tension_read"], signals["stroke_read"], weights)
    assert np.isfinite(std).any()
    np.testing.assert_array_equal(found["angle_est"], mean)
    np.testing.assert_array_equal(found["angle_std"], std)
    np.testing.assert_array_equal(diagram.GetOutputPort("estimator.angle_est").Eval(simulator.get_context()), mean[-1])


def test_the_weights_of_the_estimator_are_parameters():
    """Each field, edited in a Context, acts as in an estimator built with it."""
    robot, reference, weights = nominal(), wavy(0.1), made_up_weights()
    estimator = GPEstimator(weights, robot.machine)
    diagram = build_diagram(robot, reference, seed=5, systems=[estimator])
    plain, _ = run(diagram, 0.1)
    for name in Weights._fields:
        other = weights._replace(**{name: 1.3 * getattr(weights, name)})
        context = diagram.CreateDefaultContext()
        estimator.parameter(name).set(context, np.ravel(getattr(other, name)))
        Simulator(diagram, context).AdvanceTo(0.1)
        found = logged_signals(diagram, context)
        mean, std, _ = predict_rows(plain["tension_read"], plain["stroke_read"], other)
        np.testing.assert_array_equal(found["angle_est"], mean, name)
        np.testing.assert_array_equal(found["angle_std"], std, name)
    with pytest.raises(InputError, match="did you mean alpha"):
        estimator.parameter("alfa")


def stepwise(robot, plan, weights, frames, seed):
    """The loop around the compiled simulator, frame by frame: signals and estimates, (frames, channels) each."""
    machine, module, at = robot.machine, compile_machine(robot.machine), robot.machine.offsets
    noise = NoiseInputs.draw(frames, seed, machine)
    values, state, w = prepare_values(robot), np.zeros(state_size(machine)), np.zeros(signal_count(machine))
    module.begin(values, state)
    rows, estimates = np.zeros((frames, len(w))), np.full((frames, 3), np.nan)
    correction, estimate = np.zeros(3), np.full(3, np.nan)
    for k in range(frames):
        error = plan.angle[k] - estimate
        step = plan.ki * machine.frame
        tension, correction = correct_tensions(correction, plan.tension[k], error, plan.gain, step, plan.low, plan.high)
        now = NoiseInputs({name: draws[k : k + 1] for name, draws in noise.items()})
        given = input_rows(machine, tension[None], now).values()
        module.run(values, state, w, *given, machine.slot, 1, rows[k : k + 1], *ALONE)
        estimate = predict_rows(rows[[k], at["tension_read"]], rows[[k], at["stroke_read"]], weights)[0][0]
        estimates[k] = estimate
    return {name: rows[:, place] for name, place in at.items()} | {"angle_est": estimates}


def posture_plan(reference, ki):
    """A plan whose angles are those of the nominal robot."""
    angle = record(nominal(), reference, seed=None, quantisation=False).signals["angle"]
    gain = damped_inverse(np.array([[0.04, 0.04, -0.06], [0.07, 0.0, -0.07], [0.16, 0.0, -0.12]]))
    return PosturePlan(reference.values, angle, gain, np.full(3, 0.3), np.array([12.0, 8.0, 8.0]), ki)


def test_the_posture_loop_is_the_same_around_both_engines():
    """Estimator and posture controller in the Diagram, and the compiled simulator frame by frame: equal bits."""
    robot, weights, plan = (
        nominal().with_parameters({"finger.kappa.MCP": 0.1}),
        made_up_weights(),
        posture_plan(wavy(0.6), 2.0),
    )
    systems = [GPEstimator(weights, robot.machine), PostureController(plan, robot.machine)]
    found, _ = run(build_diagram(robot, seed=7, systems=systems), 0.6)
    wanted = stepwise(robot, plan, weights, 30, 7)
    for name, rows in wanted.items():
        np.testing.assert_array_equal(found[name], rows, name)
    assert np.abs(found["tension_ref"] - plan.tension).max() > 0.1
    np.testing.assert_array_equal(found["angle_ref"], plan.angle)


def test_the_posture_loop_is_a_diagram_of_its_own():
    """With estimator and controller wired within, and with a planner at its ports: the same bits as apart."""
    robot, weights, plan = nominal(), made_up_weights(), posture_plan(wavy(0.4), 2.0)
    apart = [GPEstimator(weights, robot.machine), PostureController(plan, robot.machine)]
    wanted, _ = run(build_diagram(robot, seed=7, systems=apart), 0.4)
    planner = Playback({"tension_planned": plan.tension, "angle_planned": plan.angle}, robot.machine.frame)
    planner.set_name("planner")
    still = replace(plan, tension=np.ones((1, 3)), angle=np.zeros((1, 3)))
    for systems in ([PostureLoop(plan, weights)], [PostureLoop(still, weights), planner]):
        found, _ = run(build_diagram(robot, seed=7, systems=systems), 0.4)
        for name, rows in wanted.items():
            np.testing.assert_array_equal(found[name], rows, name)


def test_the_correction_ends_at_the_angle_and_within_the_limits():
    """On a linear finger q = J F the law settles where q = q_ref, or at a limit, from which it comes back at once."""
    compliance = np.array([[0.04, 0.04, -0.06], [0.07, 0.0, -0.07], [0.16, 0.0, -0.12]])
    planned, low, high = np.array([5.0, 2.0, 3.0]), np.full(3, 0.3), np.array([12.0, 8.0, 8.0])
    gain, correction = damped_inverse(compliance), np.zeros(3)
    tension, wanted = planned, 1.1 * compliance @ planned
    for _ in range(4000):
        tension, correction = correct_tensions(
            correction, planned, wanted - compliance @ tension, gain, 0.01, low, high
        )
    np.testing.assert_allclose(compliance @ tension, wanted, atol=1e-4)
    for _ in range(4000):
        tension, correction = correct_tensions(correction, planned, np.array([0.0, 0.0, 1.0]), gain, 0.01, low, high)
    assert ((tension == low) | (tension == high)).any() and ((tension >= low) & (tension <= high)).all()
    back, _ = correct_tensions(correction, planned, np.array([0.0, 0.0, -1.0]), gain, 0.01, low, high)
    assert (back[(tension == low) | (tension == high)] != tension[(tension == low) | (tension == high)]).any()
