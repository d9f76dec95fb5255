"""The log of a Diagram's run is that of the simulator: time, delayed samples, names and units."""

import numpy as np
import pytest
from diagram_runs import nominal, wavy
from pydrake.systems.analysis import Simulator

import exodrake as exo

DELAYED = nominal().splice("timing.mocap_delay", {"delay": 0.06})
SKEWED = nominal().splice("timing.mocap_clock_skew")


def log_of_run(diagram, seconds=2.0, edits=()):
    context = diagram.CreateDefaultContext()
    for name, value in edits:
        exo.find_parameter(diagram, name).set(context, value)
    Simulator(diagram, context).AdvanceTo(seconds)
    return exo.diagram_log(diagram, context)


@pytest.mark.parametrize("robot", [nominal(), DELAYED, SKEWED], ids=["nominal", "delayed", "skewed"])
@pytest.mark.parametrize("seed", [None, 1])
def test_the_log_of_a_diagram_is_that_of_the_simulator(robot, seed):
    reference = wavy(2.0)
    log, wanted = log_of_run(exo.build_diagram(robot, reference, seed)), exo.simulate(robot, reference, seed)
    assert log.equals(wanted) and (log.label, log.units) == (wanted.label, wanted.units)
    if robot is not nominal():
        assert np.abs(log.array("angle") - exo.simulate(nominal(), reference, seed).array("angle")).max() > 1e-3


def test_a_delay_set_in_the_context_acts_in_the_log():
    """With the noise that the Context has, too."""
    robot, reference = DELAYED.with_parameters({"mocap.sigma_q": 0.02}), wavy(2.0)
    edits = [("timing.mocap_delay.delay", 0.06), ("mocap.sigma_q", 0.02)]
    assert log_of_run(exo.build_diagram(nominal(), reference, 1), 2.0, edits).equals(exo.simulate(robot, reference, 1))


def test_references_that_come_from_outside_are_not_in_the_log():
    diagram = exo.build_diagram(nominal(), seed=1)
    context = diagram.CreateDefaultContext()
    diagram.GetInputPort("tension_ref").FixValue(context, [5.0, 3.0, 1.0])
    Simulator(diagram, context).AdvanceTo(0.4)
    log = exo.diagram_log(diagram, context)
    assert len(log) == 20 and "angle_MCP" in log.columns and "tension_ref_AF" not in log.columns
