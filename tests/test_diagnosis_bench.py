"""The bench of the diagnosis: its three fits look for the same thing."""

from functools import partial

import numpy as np
import pytest

from benchmarks import diagnosis as bench
from exodrake.diagnosis.problem import make_problem
from exodrake.machines.robot_file import load_robot


@pytest.fixture(scope="module")
def problem():
    nominal = load_robot()
    return make_problem(bench.rubbing(nominal, 4.0), nominal)


@pytest.fixture(scope="module")
def parameters(problem):
    return bench.injected_parameters(problem.robot.machine)


def test_diagram_and_compiled_simulator_leave_the_same_residual(problem, parameters):
    start = np.array([p.start for p in parameters])
    np.testing.assert_array_equal(
        *(f(problem, parameters, start) for f in (bench.compiled_residual, bench.diagram_residual))
    )


def test_own_fit_and_scipy_find_what_was_injected(problem, parameters):
    truth = [bench.INJECTED[p.channels[0]] for p in parameters]
    residual = partial(bench.compiled_residual, problem, parameters)
    for x in (bench.ours(problem), bench.by_scipy(residual, parameters)):
        np.testing.assert_allclose([p.value(c) for p, c in zip(parameters, x)], truth, rtol=0.1)


def test_scaling_cuts_logs_and_reads_exponents():
    from benchmarks.scaling import cut, growth

    case = bench.rubbing(load_robot(), 4.0)
    short = cut(case, 1.0)
    assert [len(item.log.time) for item in short.logs] == [51, 51]  # both ends of 1 s at 20 ms
    np.testing.assert_array_equal(short.logs[0].log["tension_AF"], case.logs[0].log["tension_AF"][:51])
    assert growth([1.0, 2.0, 4.0], [3.0, 12.0, 48.0]) == pytest.approx(2.0)
