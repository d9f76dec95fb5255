"""Contexts of the Diagram: edited parameters act as in a rebuilt one; copies, restored states, random Contexts."""

from dataclasses import replace

import numpy as np
import pytest
from diagram_runs import nominal, wavy
from effects_motion import motion_of
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import MonteCarloSimulation, Simulator

from exodrake.core.errors import InputError
from exodrake.diagrams.diagram import build_diagram, find_parameter, logged_signals, read_signals, set_parameters
from exodrake.engine.compose import compile_machine
from exodrake.engine.inputs import NoiseInputs, Reference, prepare_values
from exodrake.engine.run import run_compiled
from exodrake.machines.robot_file import load_robot
from exodrake.model.machine import state_size
from exodrake.simulation.simulate import record

MACHINES = ("exo_index", "emps", "tendon_sheath", "so101", "dvrk_wrist")
FRAMES = 3


def edited(robot):
    """(name, value) for each parameter: 5 % more, or the value from which a fit of its effect starts."""
    spliced = robot
    for effect in robot.machine.effects:
        spliced = spliced.splice(effect.id)
    for name, value, start in zip(robot.machine.index, prepare_values(robot), spliced.values, strict=True):
        yield name, start if start != value else 1.05 * value if value else 0.01


def reference_of(name):
    return wavy(1.0) if name == "exo_index" else Reference(motion_of(name, 1)[:50])


@pytest.mark.parametrize("name", MACHINES)
def test_an_edited_parameter_acts_as_in_a_rebuilt_diagram(name):
    """Every parameter of every machine: state at the start, and the run, to the last bit."""
    robot, reference = load_robot(name), reference_of(name)
    machine, short = robot.machine, Reference(reference.values[:FRAMES])
    diagram, noise = build_diagram(robot, reference, seed=1), NoiseInputs.draw(FRAMES, 1, robot.machine)
    moved, plain = 0, run_compiled(machine, prepare_values(robot), short, noise, 1)
    for parameter, value in edited(robot):
        values = prepare_values(robot)
        values[machine.index[parameter]] = value
        context = diagram.CreateDefaultContext()
        find_parameter(diagram, parameter).set(context, value)
        simulator = Simulator(diagram, context)
        simulator.Initialize()
        leaves = (diagram.GetSubsystemByName(part.name) for part in machine.parts)
        begun = [leaf.GetMyContextFromRoot(context).get_discrete_state(0).value() for leaf in leaves]
        state = np.zeros(state_size(machine))
        compile_machine(machine).begin(values, state)
        np.testing.assert_array_equal(np.hstack(begun), state, parameter)
        simulator.AdvanceTo(machine.frame * FRAMES)
        rows, wanted = read_signals(machine, diagram, context), run_compiled(machine, values, short, noise, 1)
        np.testing.assert_array_equal(rows, wanted, parameter)
        moved += not np.array_equal(wanted, plain)
    assert moved >= 0.2 * len(machine.parameters)


def test_initial_state_and_held_ports_follow_the_parameters():
    """Closed forms: the finger starts in q0, the spools where the tendons are just taut there."""
    diagram = build_diagram(nominal())
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    find_parameter(diagram, "finger.q0").set(context, [0.3, 0.4, 0.1])
    find_parameter(diagram, "motor.r.MF").set(context, 0.009)
    simulator.Initialize()
    np.testing.assert_array_equal(diagram.GetOutputPort("finger.angle").Eval(context), [0.3, 0.4, 0.1])
    rho, alpha = np.hypot(0.005, 0.003), np.arctan2(0.003, 0.005)
    taken = 2 * rho * (np.cos(alpha) - np.cos(alpha + 0.15))
    assert diagram.GetOutputPort("motor.stroke").Eval(context)[1] == pytest.approx(taken, abs=1e-15)
    assert diagram.GetOutputPort("motor.spool_angle").Eval(context)[1] == pytest.approx(taken / 0.009, rel=1e-12)
    np.testing.assert_allclose(diagram.GetOutputPort("finger.tension").Eval(context), 0.0, atol=1e-9)


def test_a_state_that_was_set_stays_and_its_held_ports_follow():
    diagram = build_diagram(nominal())
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    finger = diagram.GetSubsystemByName("finger")
    own = finger.GetMyMutableContextFromRoot(context)
    memory = np.array(own.get_discrete_state(0).value())
    memory[:3] = [0.5, 0.6, 0.2]
    own.SetDiscreteState(0, memory)
    diagram.GetInputPort("tension_ref").FixValue(context, [5.0, 3.0, 1.0])
    simulator.Initialize()
    np.testing.assert_array_equal(diagram.GetOutputPort("finger.angle").Eval(context), [0.5, 0.6, 0.2])
    simulator.AdvanceTo(0.1)
    before = np.array(own.get_discrete_state(0).value())
    simulator.Initialize()
    np.testing.assert_array_equal(own.get_discrete_state(0).value(), before)


def test_one_diagram_serves_many_robots():
    reference = wavy(1.0)
    diagram = build_diagram(nominal(), reference, seed=3)
    simulator = Simulator(diagram)
    other = nominal().with_parameters({"finger.kappa": 0.09, "finger.q0.PIP": 0.4}).splice("tendon.capstan_friction")
    for robot in (other, nominal(), other):
        context = simulator.get_mutable_context()
        set_parameters(robot, diagram, context)
        simulator.Initialize()
        simulator.AdvanceTo(1.0)
        wanted = record(robot, reference, seed=3).signals
        rows = read_signals(robot.machine, diagram, context)
        np.testing.assert_array_equal(rows, np.hstack([wanted[signal.name] for signal in robot.machine.signals]))


def logged_after(simulator, diagram, seconds):
    """All signals after a further run."""
    simulator.AdvanceTo(simulator.get_context().get_time() + seconds)
    return read_signals(nominal().machine, diagram, simulator.get_context())


def test_a_copied_context_goes_on_by_itself():
    """Copies, new states and restored states act as they should."""
    diagram = build_diagram(nominal(), wavy(1.0), seed=4)
    simulator = Simulator(diagram)
    logged_after(simulator, diagram, 0.3)
    copy = simulator.get_context().Clone()
    wanted = logged_after(simulator, diagram, 0.4)
    np.testing.assert_array_equal(logged_after(Simulator(diagram, copy), diagram, 0.4), wanted)
    third = Simulator(diagram, diagram.CreateDefaultContext())
    logged_after(third, diagram, 0.1)
    third.get_mutable_context().SetTimeStateAndParametersFrom(diagram.CreateDefaultContext())
    third.Initialize()
    np.testing.assert_array_equal(logged_after(third, diagram, 0.7), wanted)


@pytest.mark.parametrize("anew", [False, True])
@pytest.mark.parametrize("at", [0.0, 0.6])
def test_a_run_goes_on_wherever_in_a_frame_it_stopped(anew, at):
    """In each slot, by another Simulator or by `Initialize`: state and log are those of one run, to the last bit."""
    machine, reference = nominal().machine, wavy(0.4)
    diagram = build_diagram(nominal().splice("timing.dropped_commands"), reference, seed=4)
    whole = diagram.CreateDefaultContext()
    Simulator(diagram, whole).AdvanceTo(0.3)
    for slot in range(machine.slots):
        context = diagram.CreateDefaultContext()
        simulator = Simulator(diagram, context)
        simulator.AdvanceTo(5 * machine.frame + (slot + at) * machine.slot)
        simulator = Simulator(diagram, context) if anew else simulator
        simulator.Initialize()
        simulator.AdvanceTo(0.3)
        for found, wanted in zip(states(context), states(whole), strict=True):
            np.testing.assert_array_equal(found, wanted, f"slot {slot}")
        found, wanted = (logged_signals(diagram, c) for c in (context, whole))
        for name, rows in wanted.items():
            np.testing.assert_array_equal(found[name], rows, f"{name}, slot {slot}")


def states(context):
    """All groups of discrete state."""
    return [context.get_discrete_state(i).value() for i in range(context.num_discrete_state_groups())]


def test_a_parameter_is_found_by_its_name_and_acts():
    diagram = build_diagram(nominal(), wavy(1.0), seed=4)
    simulator = Simulator(diagram)
    plain = logged_after(simulator, diagram, 0.3)
    finger, context = diagram.GetSubsystemByName("finger"), simulator.get_mutable_context()
    kappa = finger.parameter("finger.kappa.MCP")
    assert kappa.get(context) == kappa.get(finger.GetMyContextFromRoot(context)) == nominal()["finger.kappa.MCP"]
    np.testing.assert_array_equal(finger.parameter("finger.kappa").get(context), nominal().channels("finger.kappa"))
    kappa.set(context, 0.2)
    changed = logged_after(simulator, diagram, 0.3)
    simulator.reset_context(diagram.CreateDefaultContext())
    again = logged_after(simulator, diagram, 0.6)
    np.testing.assert_array_equal(changed[:15], plain)
    assert np.abs(changed[15:] - again[15:]).max() > 1e-3
    for holder in (finger.parameter, lambda name: find_parameter(diagram, name)):
        with pytest.raises(InputError, match=r"did you mean finger\.kappa"):
            holder("finger.kapa.MCP")


def tension_read(diagram, context):
    """Readings of a short run (frames, tendons) [N]."""
    Simulator(diagram, context).AdvanceTo(0.5)
    return logged_signals(diagram, context)["tension_read"]


def test_a_random_context_has_noise_of_its_own():
    """`SetRandomContext` draws anew, the same for the same generator; a default Context has the noise of the seed."""
    robot, reference = nominal().with_parameters({"sensor.q_F": 0.0, "encoder.q_theta": 0.0}), wavy(0.5)
    robot = replace(robot, machine=replace(robot.machine, tolerances=()))  # the same robot each time
    diagram = build_diagram(robot, reference, seed=5)
    usual = tension_read(diagram, diagram.CreateDefaultContext())
    np.testing.assert_array_equal(usual, record(robot, reference, seed=5).signals["tension_read"])
    found = []
    for seed in (1, 1, *range(2, 12)):
        context = diagram.CreateDefaultContext()
        diagram.SetRandomContext(context, RandomGenerator(seed))
        found.append(tension_read(diagram, context))
    np.testing.assert_array_equal(found[0], found[1])
    spread = np.std([usual, *found[1:]], axis=0, ddof=1)
    assert 0.008 < np.median(spread) < 0.012  # sensor.sigma_F is 0.01 N
    edited = diagram.CreateDefaultContext()
    diagram.GetSubsystemByName("noise").GetMyMutableContextFromRoot(edited).get_mutable_numeric_parameter(0)[0] = 9.0
    np.testing.assert_array_equal(
        tension_read(diagram, edited), record(robot, reference, seed=9).signals["tension_read"]
    )


@pytest.mark.parametrize("begun", [False, True])
def test_a_monte_carlo_simulation_has_other_robots(begun):
    """Each sample has parameters within the tolerances of the robot file; the Simulator may be initialized before."""
    robot, samples = nominal(), []
    names = ("finger.kappa.MCP", "motor.r.AF", "finger.kappa.PIP")
    diagram = build_diagram(robot, wavy(0.4), seed=5)

    def make(generator):
        simulator = Simulator(diagram)
        if begun:
            simulator.Initialize()
        return simulator

    def output(system, context):
        samples.append(np.hstack([find_parameter(system, name).get(context) for name in names]))
        return float(logged_signals(system, context)["angle"][-1][0])

    found = MonteCarloSimulation(
        make_simulator=make, output=output, final_time=0.4, num_samples=6, generator=RandomGenerator(2)
    )
    assert len({item.output for item in found}) == 6
    drawn = np.array(samples) / [robot[name] for name in names]
    assert (drawn.std(axis=0) > 0.002).all() and (np.abs(drawn - 1.0) < 0.5).all()


def test_a_robot_drawn_at_random_is_that_robot():
    """A run of a random Context is that of the compiled simulator with the parameters that its ports have."""
    robot, reference = nominal().splice("tendon.capstan_friction"), wavy(0.4)
    diagram = build_diagram(robot, reference, seed=None)
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(7))
    values = np.array([find_parameter(diagram, name).get(context)[0] for name in robot.machine.index])
    Simulator(diagram, context).AdvanceTo(0.4)
    other = replace(robot, values=values)
    wanted = run_compiled(robot.machine, values, reference, NoiseInputs.draw(20, None, robot.machine), 1)
    np.testing.assert_array_equal(read_signals(robot.machine, diagram, context), wanted)
    assert (values != robot.values).sum() >= 30 and other.effects() == robot.effects()
    find_parameter(diagram, "finger.kappa.MCP").set(context, 0.123)
    assert find_parameter(diagram, "finger.kappa.MCP").get(context) == pytest.approx(0.123, rel=1e-15)


def test_noise_goes_on_where_the_reference_ends():
    reference = Reference(np.tile([5.0, 3.0, 1.0], (5, 1)))
    diagram = build_diagram(nominal(), reference, seed=1)
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.4)
    found = logged_signals(diagram, simulator.get_context())
    np.testing.assert_array_equal(found["tension_ref"], np.tile([5.0, 3.0, 1.0], (20, 1)))
    np.testing.assert_array_equal(found["noise_tension"], NoiseInputs.draw(20, 1, nominal().machine)["noise_tension"])
    assert len(np.unique(found["noise_tension"])) == 60
