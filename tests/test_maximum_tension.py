"""First step of the paper's Section 2.3: the tension of each tendon that maximises the movement."""

from dataclasses import replace

import numpy as np
import pytest
from command_line import run

import exodrake as exo
from exodrake.core.errors import InputError

ROBOT = exo.load_robot()


def with_limits(robot, **highest):
    return replace(robot, limits={**robot.limits, "F_max": {**robot.limits["F_max"], **highest}})


def test_a_hard_end_stop_gives_the_tension_of_its_torque_balance():
    """MF bends the MCP alone: T R(q_f) = kappa (q_f - q0), with the arm R of model.md."""
    kappa, stop, rest = 0.03, 1.30, 0.20
    arm = np.hypot(5e-3, 3e-3) * np.sin(np.arctan2(3.0, 5.0) + stop / 2)
    wanted = kappa * (stop - rest) / arm
    assert 6.0 < wanted < 6.3
    hard = ROBOT.with_parameters({"finger.kappa.MCP": kappa, "finger.beta": 200.0, "finger.A": 0.002})
    log = exo.simulate(hard, exo.maximum_tension(hard), seed=1)
    found = {one.tendon: one for one in exo.find_maximum_tension(log, hard)}
    assert found["MF"].saturated
    assert found["MF"].tension == pytest.approx(wanted, abs=2 * 8.0 / 25)  # two bins
    assert found["MF"].travel["MCP"] == pytest.approx(stop - rest, abs=0.05)
    assert abs(found["MF"].travel["PIP"]) < 0.02


def test_soft_end_stops_agree_with_the_statics_of_each_joint():
    """The nominal extensor: gain of movement per newton by bisection of model.md's torque balance, no package code."""
    rest, stops = np.array([0.20, 0.30, 0.15]), np.array([-0.30, 0.0, 0.0])
    kappa = np.array([0.080, 0.060, 0.035])

    def straightened(tension):
        low, high = np.full(3, -1.2), rest.copy()
        for _ in range(60):
            q = (low + high) / 2
            pull = tension * np.hypot(5e-3, 5e-3) * np.sin(np.pi / 4 - q / 2)
            held = kappa * (rest - q) + 0.002 * np.expm1(12 * np.maximum(stops - q, 0.0))
            low, high = np.where(pull > held, low, q), np.where(pull > held, q, high)
        return np.abs(q - rest).sum()

    levels = np.arange(0.5, 16.0, 0.05)
    gain = np.gradient([straightened(t) for t in levels], levels)
    wanted = levels[np.flatnonzero(gain >= 0.2 * gain.max())[-1]]
    wide = with_limits(ROBOT, AE=16.0)
    log = exo.simulate(wide, exo.maximum_tension(wide, ramp=20.0), seed=3)
    found = exo.find_maximum_tension(log, wide)[2]
    assert found.saturated and found.tension == pytest.approx(wanted, abs=2 * 16.0 / 25)


def test_a_ramp_that_ends_before_the_joints_stop_says_so():
    found = exo.find_maximum_tension(exo.simulate(ROBOT, exo.maximum_tension(ROBOT)))
    assert [one.saturated for one in found] == [False, False, False]
    np.testing.assert_allclose([one.tension for one in found], [12.0, 8.0, 8.0], atol=0.3)


def test_a_log_without_such_ramps_is_refused():
    log = exo.simulate(ROBOT, "random-motion:duration=20")
    with pytest.raises(InputError, match="AF ramps up alone in 0 complete rows"):
        exo.find_maximum_tension(log)
    with pytest.raises(InputError, match="angle"):
        exo.find_maximum_tension(log.only([c for c in log.columns if not c.startswith("angle")]))


def test_the_command_prints_a_limit_for_the_robot_file(tmp_path):
    wide = with_limits(ROBOT, AE=16.0)
    exo.write_log(exo.simulate(wide, exo.maximum_tension(wide)), tmp_path / "log.csv")
    result = run("identify", "maximum-tension", tmp_path / "log.csv")
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[0].startswith("AF: 1") and lines[0].endswith("the joints still move there")
    assert lines[2].startswith("AE: 1") and not lines[2].endswith("there")
    assert lines[3].startswith("robot file: limits: {F_max: {AF: 1")
