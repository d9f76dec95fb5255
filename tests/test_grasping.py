"""Grasp plans: geometry checked apart from the planner, statics against the simulated robot, bad input at the door."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from diagram_runs import made_up_weights

import exodrake as exo
from exodrake.cli.finger import parse_size
from exodrake.cli.main import cli
from exodrake.core.errors import InputError
from exodrake.grasping.plan import MODES, at_hold, find_mode, run_plan, tensions_for
from exodrake.physics.finger_statics import read_parameters

SIZES = [size / 1e3 for size in range(20, 95, 5)]
LENGTHS, RADII = np.array([0.04264, 0.02014, 0.01872]), np.array([0.009, 0.008, 0.007])  # m, robot.yaml
FEASIBLE = {  # mm, measured: what a change of planner or robot may not take away unseen
    "narrow-pinch": range(25, 70, 5),
    "wide-pinch": range(55, 65, 5),
    "caging": range(25, 65, 5),
}
REST = np.array([0.20, 0.30, 0.15])  # rad, robot.yaml
# Paper, Section 2.2.2, by robot and grasp: least and largest bend of MCP, PIP, DIP from rest [rad].
POSTURES = {
    ("exo_index", "caging"): ((0.3, 0.4, 0.4), (0.9, 1.2, 1.0)),
    ("exo_index", "narrow-pinch"): ((0.3, -0.05, -0.05), (0.9, 0.05, 0.05)),
    ("exo_index", "wide-pinch"): ((-0.05, 0.1, -0.05), (0.05, 0.2, 0.05)),
    ("exo_index/wide_pinch", "caging"): ((0.3, 0.4, 0.4), (0.9, 1.2, 1.0)),
    ("exo_index/wide_pinch", "narrow-pinch"): ((0.3, -0.05, -0.05), (0.9, 0.05, 0.05)),
    ("exo_index/wide_pinch", "wide-pinch"): ((-0.05, 0.4, -0.05), (0.05, 0.9, 0.05)),
}


@cache
def robot():
    return exo.load_robot()


@cache
def plan(mode, size):
    return exo.plan_grasp(mode, size, robot())


def clearance(q, centre):
    """Distance of a point (2,) from each phalanx's surface (3,) [m], by sampling the bones."""
    turned = np.cumsum(q)
    steps = np.cumsum(LENGTHS[:, None] * np.column_stack([np.cos(turned), np.sin(turned)]), axis=0)
    ends = np.vstack([[0.0, 0.0], steps])
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    bones = [ends[i] + share * (ends[i + 1] - ends[i]) for i in range(3)]
    return np.array([np.linalg.norm(bone - centre, axis=1).min() for bone in bones]) - RADII


@pytest.mark.parametrize("mode", MODES)
def test_feasible_plans_reach_their_posture(mode):
    found = []
    for size in SIZES:
        made = plan(mode, size)
        log = exo.simulate(robot(), made.reference(robot()))
        reached = at_hold(log, "angle", made.joints)
        low, high = 0.3, np.array([12.0, 8.0, 8.0])
        assert ((np.array(made.tensions) >= low) & (np.array(made.tensions) <= high)).all()
        np.testing.assert_allclose(np.subtract(made.wanted, made.planned), made.shortfall, atol=1e-12)
        np.testing.assert_allclose(reached, made.planned, atol=0.05)
        if made.feasible:
            found.append(round(1e3 * size))
            np.testing.assert_allclose(reached, made.wanted, atol=0.05)
        else:
            assert "out of" in made.reason and f"{1e3 * size:g} mm" in made.reason
    assert found == list(FEASIBLE[mode])


@pytest.mark.parametrize("mode", MODES)
def test_wanted_posture_touches_the_object(mode):
    for size in [s / 1e3 for s in FEASIBLE[mode]]:
        made = plan(mode, size)
        away = clearance(np.array(made.wanted), made.centre) - size / 2.0
        assert away[2] == pytest.approx(0.0, abs=1e-5)  # the distal phalanx always
        assert (away > -2.6e-3).all()
        if mode == "caging":
            np.testing.assert_allclose(away, 0.0, atol=1e-5)
        thumb = np.hypot(*np.subtract(made.centre, made.hand.thumb)) - made.hand.thumb_radius - size / 2.0
        assert thumb > -1e-9
        if mode == "caging":  # held loosely, but the way out between fingertip and thumb is too narrow
            assert np.hypot(*np.subtract(made.target, made.hand.thumb)) - 0.009 - 0.007 < size
        else:
            assert thumb < 1e-9


def equilibrium(tension, kappa):
    """Angles (3,) [rad] at tensions AF, MF, AE [N] and their stiffness (3,) [N m/rad], by equations alone.

    Each joint follows its torque from rest, as a slow finger does.
    """
    flexor, extensor = np.hypot(5e-3, 3e-3), np.hypot(5e-3, 5e-3)
    pull = np.array([tension[0] + tension[1], tension[0], tension[0]])

    def torque(q):
        arms = flexor * np.sin(np.arctan2(3, 5) + q / 2), extensor * np.sin(np.arctan2(5, 5) - q / 2)
        ends = np.exp(12 * np.maximum(q - [1.3, 1.5, 0.95], 0)) - np.exp(12 * np.maximum([-0.3, 0, 0] - q, 0))
        return pull * arms[0] - tension[2] * arms[1] - kappa * (q - REST) - 0.002 * ends

    q = REST.copy()
    for _ in range(20000):
        q = q + np.clip(0.5 * torque(q), -1e-3, 1e-3)
    return q, (torque(q - 1e-5) - torque(q + 1e-5)) / 2e-5


@pytest.mark.parametrize("name, mode", POSTURES)
def test_each_grasp_bends_the_joints_that_the_paper_names_and_no_other(name, mode):
    one = exo.load_robot(name)
    low, high = POSTURES[name, mode]
    log = exo.simulate(one, exo.grasp(mode, one, hold=8.0), seed=None, quantisation=False)
    bend = at_hold(log, "angle", ("MCP", "PIP", "DIP")) - REST  # at 3.5 to 4.0 s, as without the longer hold
    assert (bend > low).all() and (bend < high).all()
    kappa = np.array([0.080, 0.060, 0.035] if name == "exo_index" else [0.080, 0.045, 0.060])
    wanted, firm = equilibrium([one.grasps[mode][w] for w in ("AF", "MF", "AE")], kappa)
    np.testing.assert_allclose(log.array("angle")[470], wanted, atol=0.005)  # rad, at 9.4 s of 9.5
    assert (firm > 0.2 * kappa).all()


def test_the_robot_for_the_wide_pinch_holds_objects_in_all_three_modes():
    one = exo.load_robot("exo_index/wide_pinch")
    changed = {n for n, v in one.parameters().items() if v != robot().parameters()[n]}
    assert changed == {"finger.kappa.PIP", "finger.kappa.DIP"}
    for mode, size in (("narrow-pinch", 0.03), ("wide-pinch", 0.05), ("caging", 0.03)):
        made = exo.plan_grasp(mode, size, one)
        reached = at_hold(exo.simulate(one, made.reference(one)), "angle", made.joints)
        assert made.feasible
        np.testing.assert_allclose(reached, made.wanted, atol=0.05)


def test_tensions_balance_the_passive_torque():
    q, n = np.array([[0.5, 0.7, 0.4]]), read_parameters(robot())
    tension = tensions_for(q, n)[0]
    flex, extend = 5.0 * np.sin(q[0] / 2) + 3.0 * np.cos(q[0] / 2), 5.0 * np.cos(q[0] / 2) - 5.0 * np.sin(q[0] / 2)
    wires = 1e-3 * np.array([flex[0], flex[1], flex[2]]) * tension[0] - 1e-3 * extend * tension[2]
    wires[0] += 1e-3 * flex[0] * tension[1]
    np.testing.assert_allclose(wires, [0.08 * 0.3, 0.06 * 0.4, 0.035 * 0.25], rtol=1e-9)
    assert np.isnan(tensions_for(np.array([[0.5, 0.6, 0.6]]), n)).all()  # physics.md 1.21: singular on q2 = q3


def test_effects_do_not_change_the_plan_and_plans_repeat():
    rough = robot().splice("tendon.capstan_friction")
    assert exo.plan_grasp("caging", 0.06, rough) == plan("caging", 0.06)
    stiffer = robot().with_parameters({"finger.kappa": 0.12})
    assert exo.plan_grasp("caging", 0.06, stiffer).tensions != plan("caging", 0.06).tensions


@pytest.mark.parametrize("size", [0.0, -0.01, 5.0, float("nan"), float("inf"), "60mm", True, None])
def test_sizes_that_are_none(size):
    with pytest.raises(InputError, match="object size"):
        exo.plan_grasp("caging", size, robot())


def test_names_and_units():
    assert find_mode("Wide pinch").name == "wide-pinch" and find_mode("narrow_pinch").name == "narrow-pinch"
    with pytest.raises(InputError, match="caging"):
        find_mode("cagign")
    assert parse_size("60mm") == parse_size("6 cm") == parse_size(" 0.06 m") == 0.06
    for text in ("60", "mm", "", "60 furlongs", "60 N", "1e400mm", "nan mm"):
        if text == "1e400mm":
            assert parse_size(text) == float("inf")
            continue
        with pytest.raises(InputError, match="--size"):
            parse_size(text)


@pytest.mark.parametrize("words", [("caging", "--size", "5m"), ("caging", "--size", "soft"), ("hug", "--size", "60mm")])
def test_bad_words_write_nothing(tmp_path, words):
    result = CliRunner().invoke(cli, ["grasp", *words, "--out", str(tmp_path / "out")])
    assert result.exit_code == 2 and len(result.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_plan_in_the_diagram_has_late_samples_as_in_simulate():
    made, late = plan("caging", 0.06), robot().splice("timing.mocap_delay", {"delay": 0.06})
    listening = SimpleNamespace(wires=("AF", "MF", "AE"), joints=made.joints, weights=made_up_weights())
    log = run_plan(made, late, listening, seed=1)
    same = exo.simulate(late, made.reference(late), seed=1)
    assert log.only(same.columns).equals(same) and "angle_est_MCP" in log.columns


def test_command_writes_everything_and_keeps_its_estimator(tmp_path):
    words = ["grasp", "caging", "--size", "60mm", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == 0, result.output
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        "log.csv",
        "plan.json",
        "figure.png",
        "estimator.npz",
        "recording.html",
        "estimated.html",
        "planned.html",
    }
    log = exo.read_log(tmp_path / "out" / "log.csv")
    made = plan("caging", 0.06)
    same = exo.simulate(robot(), made.reference(robot()))
    np.testing.assert_allclose(log.array("angle"), same.array("angle"), atol=1e-9)
    estimated = at_hold(log, "angle_est", made.joints)
    np.testing.assert_allclose(estimated, at_hold(log, "angle", made.joints), atol=0.05)
    kept = tmp_path / "out" / "estimator.npz"
    words = ["grasp", "wide-pinch", "--size", "85mm", "--estimator", str(kept), "--out", str(tmp_path / "wide")]
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == 0 and "not feasible" in result.output
    assert "estimator.npz" not in {path.name for path in (tmp_path / "wide").iterdir()}
