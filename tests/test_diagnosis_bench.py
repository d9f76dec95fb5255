"""The bench of the diagnosis: its three fits look for the same thing."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import diagnosis as bench
from benchmarks.speed import as_row
from exodrake.diagnosis.hypothesis import hypothesis
from exodrake.diagnosis.problem import make_problem
from exodrake.machines.robot_file import load_robot


@pytest.fixture(scope="module")
def asked():
    nominal = load_robot()
    machine = nominal.machine
    problem = make_problem(bench.rubbing(nominal, 4.0), nominal)
    return problem, hypothesis(machine, machine.effect(bench.EFFECT), tuple(bench.PLANTED))


def test_diagram_and_twin_leave_the_same_residual(asked):
    problem, wanted = asked
    one, other = (
        residual(problem, wanted, wanted.start) for residual in (bench.compiled_residual, bench.diagram_residual)
    )
    np.testing.assert_array_equal(one, other)


def test_own_fit_and_scipy_find_what_was_planted(asked):
    problem, wanted = asked
    truth = [bench.PLANTED[coordinate.channels[0]] for coordinate in wanted.coordinates]
    for u in (
        bench.ours(problem, wanted),
        bench.by_scipy(lambda u: bench.compiled_residual(problem, wanted, u), wanted),
    ):
        np.testing.assert_allclose(
            [coordinate.value(v) for coordinate, v in zip(wanted.coordinates, u)], truth, rtol=0.1
        )


def test_rows_are_the_bench_s(monkeypatch):
    monkeypatch.setattr(bench, "by_scipy", lambda residual, wanted: wanted.start)
    monkeypatch.setattr(bench, "ours", lambda problem, wanted: wanted.start)
    monkeypatch.setattr(bench, "diagnose", lambda case, robot: type("Answer", (), {"verdict": "NAMED"}))
    rows = [as_row(item) for item in bench.rows(2.0)]
    assert [row.unit for row in rows] == ["s", "-"] * 3 + ["-", "-", "s"] and "NAMED" in rows[-1].name


def test_scaling_cuts_logs_and_reads_exponents():
    from benchmarks.scaling import cut, growth

    case = bench.rubbing(load_robot(), 4.0)
    short = cut(case, 1.0)
    assert [len(item.log.time) for item in short.logs] == [51, 51]  # both ends of 1 s at 20 ms
    np.testing.assert_array_equal(short.logs[0].log["tension_AF"], case.logs[0].log["tension_AF"][:51])
    assert growth([1.0, 2.0, 4.0], [3.0, 12.0, 48.0]) == pytest.approx(2.0)


def test_scaling_has_a_diagnosis_try_fewer_effects():
    from benchmarks.scaling import FRICTION, trying
    from exodrake.diagnosis.fit import Fitter
    from exodrake.diagnosis.hypothesis import NOTHING
    from exodrake.diagnosis.screen import library

    problem = make_problem(bench.rubbing(load_robot(), 3.0), load_robot())
    fitter = Fitter(replace(problem, tried=trying(5)))
    start = fitter.at(NOTHING, np.zeros(0), np.zeros(len(fitter.coordinates)))
    assert len(found := library(fitter, start)) == 5 and FRICTION[1][0] in {effect.id for effect in found}
    fitter = Fitter(problem)
    assert len(library(fitter, start)) > 20
