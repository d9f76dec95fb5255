"""The Drake Diagram and the compiled simulator: same bits, same log; both reproduce data/reference."""

import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from diagram_runs import both, nominal, wavy
from pydrake.systems.analysis import Simulator
from shared_data import data_folder, needs_data

import exodrake as exo
from exodrake.data.formats import read_log
from exodrake.engine.inputs import Reference
from exodrake.machines.exo_index.machine import machine as exo_index
from exodrake.simulation.simulate import record

EFFECTS = exo_index().effects
TIGHT = {"tension_read": 1e-3, "stroke_read": 0.5e-6, "angle_read": 5e-5}  # RMS [N], [m], [rad]
COLUMN = {"tension_read": "tension", "stroke_read": "stroke", "angle_read": "angle"}


@pytest.mark.parametrize(("seconds", "substeps"), [(60.0, 1), (2.0, 3)])
def test_runs_with_noise_and_rounding_and_sub_steps(seconds, substeps):
    compiled, drake = both(nominal(), wavy(seconds), substeps=substeps)
    assert len(compiled) == 50 * seconds
    np.testing.assert_array_equal(compiled, drake)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.id)
def test_an_effect_at_typical_values(effect):
    robot = nominal().splice(effect.id)
    compiled, drake = both(robot, wavy(3.0))
    assert np.isfinite(compiled).all()
    np.testing.assert_array_equal(compiled, drake)


PRINTED = """
import numpy as np
from diagram_runs import both, nominal, wavy
printed = nominal().with_part("controller_as_printed").with_part("routers_as_printed")
compiled, drake = both(printed, wavy(2.0))
np.testing.assert_array_equal(compiled, drake)
np.testing.assert_array_equal(compiled, both(printed, wavy(2.0))[1])
print(np.abs(compiled - both(nominal(), wavy(2.0))[0]).max())
"""


def test_parts_as_printed():
    """As plain Python, since compiling a second machine takes a minute."""
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(Path(__file__).parent)}
    run = subprocess.run([sys.executable, "-c", PRINTED], env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-2000:]
    assert float(run.stdout) > 0.1


@needs_data("reference")
@pytest.mark.parametrize("engine", ["compiled", "drake"])
@pytest.mark.parametrize("name", ["sweeps", "chirp", "holds", "grasps"])
def test_reproduces_the_reference(name, engine):
    log = read_log(data_folder("reference") / f"{name}.csv")
    run = record(nominal(), Reference(log.array("tension_ref")), seed=None, quantisation=False, engine=engine)
    for wire, bound in TIGHT.items():
        error = run.signals[wire] - log.array(COLUMN[wire])
        assert np.sqrt((error**2).mean()) < bound, wire


def test_first_order_in_the_sub_step():
    """The spool moves on at its speed during a tick and the motor sees the tension before it: first order."""
    runs = [record(nominal(), wavy(4.0), None, False, substeps=n).signals for n in (1, 2, 4, 8)]
    for name in ("angle", "tension"):
        steps = [np.sqrt(((a[name] - b[name]) ** 2).mean()) for a, b in pairwise(runs)]
        assert 1.6 < steps[0] / steps[1] < 2.6 and 1.6 < steps[1] / steps[2] < 2.6, (name, steps)


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
