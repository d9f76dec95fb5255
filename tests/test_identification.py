"""Workspaces and the tension of the most movement, against Table 2, statics and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from command_line import run

import exodrake as exo
from exodrake.cli.main import cli
from exodrake.core.errors import InputError
from exodrake.identification.workspace import (
    DISTAL,
    FINGERTIP,
    LENGTHS,
    SPONTANEOUS,
    monte_carlo,
    reach,
    solve_assisted,
    tip,
)
from studies.paper.reach import table_2

MM2 = 1e-6


def test_areas_of_the_paper_s_lengths_and_ranges_and_by_rings():
    """The fingertip's ring at radius r is as wide as the MCP range plus the spread of its direction at MCP 0."""
    q2, q3 = np.meshgrid(np.linspace(0.08, 1.56, 1500), np.linspace(0.07, 0.92, 1500), indexing="ij")
    x, y = np.moveaxis(tip(LENGTHS, 0.0, q2, q3), -1, 0)
    radius, way = np.hypot(x, y).ravel(), np.arctan2(y, x).ravel()
    edges = np.linspace(radius.min(), radius.max(), 201)
    ring = np.clip(np.digitize(radius, edges) - 1, 0, 199)
    low, high = np.full(200, np.inf), np.full(200, -np.inf)
    np.minimum.at(low, ring, way)
    np.maximum.at(high, ring, way)
    area = np.sum((high - low + 1.69) * np.diff(edges**2) / 2)
    assert reach(LENGTHS, SPONTANEOUS).area == pytest.approx(area, rel=0.005)
    assert reach(LENGTHS, SPONTANEOUS).area == pytest.approx(4297 * MM2, rel=0.001)
    assert reach(LENGTHS, SPONTANEOUS, DISTAL, steps=30).area == pytest.approx(5041 * MM2, rel=0.002)
    for lengths, ranges in (((0.04, 0.0, 0.02), SPONTANEOUS), (LENGTHS, SPONTANEOUS._replace(PIP=(1.0, 0.5)))):
        with pytest.raises(InputError, match="PIP"):
            reach(lengths, ranges)


@pytest.mark.parametrize("what", [FINGERTIP, DISTAL])
def test_monte_carlo_agrees_within_its_own_error(what):
    exact = reach(LENGTHS, SPONTANEOUS, what, steps=30).area
    draws = [monte_carlo(LENGTHS, SPONTANEOUS, what, 2000, seed) for seed in range(6)]
    scores = [(value - exact) / error for value, error in draws]
    assert abs(np.mean(scores)) < 3 / np.sqrt(6) and max(np.abs(scores)) < 4


def test_monte_carlo_error_of_the_bounding_box():
    """physics.md: one sigma is 175, 56 mm2 for 1e3, 1e4 points over 11432 mm2."""
    small, large = (monte_carlo(LENGTHS, SPONTANEOUS, samples=n) for n in (1000, 10_000))
    assert small[1] == pytest.approx(175 * MM2, rel=0.05) and large[1] == pytest.approx(56 * MM2, rel=0.05)
    assert monte_carlo(LENGTHS, SPONTANEOUS, samples=1000) == small


def test_table_2_verdicts():
    rows = {claim.what: claim for claim in table_2(solve_assisted(exo.load_robot(), 3))}
    assert rows["K.M. area [mm²]"].ours.startswith("4297 fingertip")
    assert rows["A.M. / S.M. [%]"].ours == "64.08" and rows["A.M. / S.M. [%]"].verdict == "agrees"
    assert "4 of 6" in rows["A.M. range [rad]"].reason
    assert {rows[f"{m} area [mm²]"].verdict for m in ("K.M.", "S.M.")} == {"does not follow"}
    assert all(all(vars(claim).values()) for claim in rows.values())


def test_assisted_postures_balance_and_stay_near_the_range_of_motion():
    from exodrake.machines.robot_file import load_robot

    robot = load_robot()
    wired = solve_assisted(robot, 7)
    q, t = wired.angles, wired.tensions
    rho, alpha = np.hypot(5e-3, [3e-3, 5e-3]), np.arctan2([3e-3, 5e-3], 5e-3)
    flexor, extensor = rho[0] * np.sin(alpha[0] + q / 2), rho[1] * np.sin(alpha[1] - q / 2)
    pulled = flexor * t[..., :1] - extensor * t[..., 2:]
    pulled[..., 0] += (flexor * t[..., 1:2])[..., 0]
    inside = (q > [-0.3, 0, 0]) & (q < [1.3, 1.5, 0.95])
    passive = robot.channels("finger.kappa") * (q - robot.channels("finger.q0"))
    np.testing.assert_allclose(pulled[inside], passive[inside], atol=1e-9)
    for (low, high), (least, most) in zip(wired.ranges, SPONTANEOUS, strict=True):
        assert least - 0.4 < low < high < most + 0.4
    assert wired.region(LENGTHS).area < reach(LENGTHS, wired.ranges, steps=20).area


def test_command_writes_areas_table_and_figure(tmp_path):
    result = CliRunner().invoke(cli, ["workspace", "--out", str(tmp_path / "w"), "--samples", "500", "--steps", "5"])
    assert result.exit_code == 0, result.output
    assert {file.name for file in (tmp_path / "w").iterdir()} == {"workspace.csv", "workspace.png"}
    refused = CliRunner().invoke(cli, ["workspace", "--out", str(tmp_path / "v"), "--samples", "5"])
    assert refused.exit_code == 2 and not (tmp_path / "v").exists()


ROBOT = exo.load_robot()


def with_limits(robot, **highest):
    return replace(robot, limits={**robot.limits, "F_max": {**robot.limits["F_max"], **highest}})


def test_a_hard_end_stop_gives_the_tension_of_its_torque_balance():
    """MF bends the MCP alone: T R(q_f) = kappa (q_f - q0), with the arm R of physics.md."""
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
    """The nominal extensor: gain of movement per newton by bisection of the torque balance, no package code."""
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
