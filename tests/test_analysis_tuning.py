"""Tuning: requirements held, structures compared, files written, bad input refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from arm_folders import made
from command_line import run

import exodrake as exo
from exodrake.analysis import tuning
from exodrake.analysis.linear_model import linearise_robot
from exodrake.analysis.responses import AFTER, BENT, linear_error, list_departures, step_response
from exodrake.analysis.tuning import (
    Performance,
    Requirements,
    assess,
    compliance,
    compute_cost,
    linearise_law,
    linearise_plant,
    list_missed,
    predict_performance,
    tune,
)
from exodrake.core.errors import InputError
from exodrake.simulation import protocols
from exodrake.simulation.simulate import simulate


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tune")
    found = run("tune", "--robot", "emps", "--disk-margin", 0.7, "--overshoot", 20, "--draws", 2, "--out", folder)
    return folder, found


def test_the_command_writes_figure_numbers_and_a_robot_that_holds_them(tuned):
    folder, found = tuned
    assert found.exit_code == 0, found.output
    assert (folder / "tune.png").read_bytes().startswith(b"\x89PNG")
    numbers = json.loads((folder / "tune.json").read_text())
    best = numbers["compared"][numbers["best"]]
    assert numbers["limit"]["settling"] <= numbers["limit"]["tuned"] <= best["settling [s]"] + 1e-9
    assert "bound: " in found.output and "LQG of " in found.output
    loop = exo.analyse(exo.load_robot(folder / "tuned.yaml"))
    size = loop.model.loop.loop.step
    assert numbers["limit"]["command_peak"] == pytest.approx(loop.steps[0].command_peak / size, rel=1e-3)  # its own
    assert numbers["limit"]["crosstalk"] == pytest.approx(max(s.crosstalk for s in loop.steps), abs=1e-6)
    assert f"no controller with the commands of {numbers['best']} settles in less than" in found.output
    assert f"it settles in {numbers['limit']['tuned']:.3g} s on the nominal robot" in found.output
    assert best["disk_margin"] >= 0.7 and best["overshoot"] <= 0.2 and best["misses"] == []
    assert loop.robot["drive.kp"] == pytest.approx(best["gains"]["drive.kp"])
    assert loop.robust.numbers["disk margin"] >= best["disk_margin"] - 1e-6
    assert loop.steps[0].settling <= best["settling [s]"] + 1e-6


def test_the_tuned_loop_settles_no_later_than_one_that_holds_the_same(tuned):
    """A grid of gains, each by its own analysis of the plain loop, has none that is much better."""
    folder, _ = tuned
    numbers = json.loads((folder / "tune.json").read_text())
    best, most = numbers["compared"][numbers["best"]], numbers["required"]["noise [N]"]
    plant = linearise_plant(exo.load_robot("emps"))
    grid = [(a, b) for a in np.geomspace(20.0, 400.0, 9) for b in np.geomspace(50.0, 1000.0, 9)]
    found = [predict_performance(plant, linearise_law(plant, {"drive.kp": a, "drive.kv": b})) for a, b in grid]
    held = [p.settling for p in found if p.disk_margin >= 0.75 and p.overshoot <= 0.18 and p.noise <= 0.9 * most]
    assert best["settling [s]"] <= 1.15 * min(held)


def test_compliance_is_the_inverse_of_the_tension_jacobian():
    """1 mm of wire taken in slowly at one tendon, by the nonlinear simulation of the tendons' tension."""
    robot = exo.load_robot()
    plant = linearise_plant(robot)
    c = np.column_stack(list(compliance(plant, robot.machine.loop.controllers[-1]).values()))
    assert np.linalg.eigvals(c).real.min() > 1.0 / (1.2 * 2700.0)  # no stiffer than the tendon itself
    assert c == pytest.approx(c.T, abs=2e-5)  # elastic: forces have a potential
    loop, start = plant.model.loop, plant.model.point
    rows = np.tile(start.references + np.array([0.05, 0.0, 0.0]), (600, 1))
    moved = loop.run(start.state, rows)[1][-1, loop.signals["stroke"]] - start.readings["stroke"]
    assert moved == pytest.approx(0.05 * c[:, 0], rel=0.02, abs=1e-6)


def test_a_controller_with_feed_forward_runs_on_both_engines():
    robot = exo.load_robot()
    values = {**compliance(linearise_plant(robot), robot.machine.loop.controllers[-1])}
    full = {f"{n}.{t}": float(v) for n, col in values.items() for t, v in zip(robot.machine.axes.tendons, col)}
    more = {"controller.ki": 0.01, "controller.tau_D": 0.01, "controller.tau_R": 0.1, "controller.feed": 1.0}
    changed = robot.with_parameters({**full, **more})
    reference = protocols.steps(changed)
    reference = type(reference)(reference.values[:100], "steps")
    logs = [simulate(changed, reference, seed=1, engine=engine) for engine in ("compiled", "drake")]
    for column in logs[0].columns:
        assert np.array_equal(logs[0][column], logs[1][column]), column


def test_missed_requirements_are_phrases():
    wanted, none = Requirements(0.5, 0.05, 0.6, 1e-4), (np.nan,) * 5
    assert list_missed(wanted, Performance(0.9, 0.4, 0.04, 0.7, 1e-5), "m/s") == ()
    assert len(list_missed(wanted, Performance(0.9, 0.6, 0.06, 0.5, 2e-4), "m/s")) == 4
    assert list_missed(wanted, Performance(*none), "m/s") == ("does not settle",)


def test_what_cannot_be_held_writes_no_robot(tmp_path, hasty):
    found = run("tune", "--robot", "emps", "--disk-margin", 1.99, "--draws", 0, "--out-robot", tmp_path / "r.yaml")
    assert found.exit_code == 2 and "no controller holds all requirements" in found.output
    assert not (tmp_path / "r.yaml").exists()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [(["--controller", "PDD"], "did you mean PD"), (["--controller", "pi"], "did you mean PI, "),
     (["--robot", "absent.yaml"], "absent"), (["--disk-margin", "3"], "disk-margin"),
     (["--noise", "-1"], "noise"), (["--overshoot", "x"], "overshoot")],
)  # fmt: skip
def test_bad_input_is_refused(arguments, word):
    found = run("tune", *arguments)
    assert found.exit_code == 2 and word in found.output


def test_gains_of_an_outer_loop_are_no_robot_file(tmp_path):
    found = run("tune", "--robot", "so101", "--out-robot", tmp_path / "r.yaml")
    assert found.exit_code == 2 and "outer loop" in found.output and not (tmp_path / "r.yaml").exists()


@pytest.mark.parametrize("effects", [{}, {"servo.lag": {"time_constant": 0.1}, "servo.latency": {"frames": 2.8}}])
def test_servos_are_tuned_on_the_plant_that_is_analysed(arm_folder, hasty, effects):
    """Plant and law apart have the poles of the whole loop; ideal servos settle in a frame."""
    robot = made(arm_folder, f"tuned_{len(effects)}", "--joints", "J1")
    for name, values in effects.items():
        robot = robot.splice(name, values, ["J1"])
    plant = linearise_plant(robot)
    assert predict_performance(plant, linearise_law(plant, {})).radius == pytest.approx(plant.model.spectral_radius)
    found = tune(robot, draws=1, judges=1)
    assert found.best and found.best.settling <= found.compared[0].settling
    assert found.compared[0].name == "assumed gains" and "(assumed gains: " in repr(found)
    assert found.limit.settling <= found.limit.tuned


def test_a_step_that_reaches_a_limit_is_noted():
    """A joint that turns at one step a second is never above that ramp; the linear model is there in a frame."""
    robot = exo.load_robot("so101")
    step = robot.machine.loop.step
    model = linearise_robot(robot.splice("servo.speed_limit", {"speed": step}, ["Rotation"]))
    slow, free = (step_response(model.loop, model.point, j) for j in (0, 1))
    time = model.system.dt * np.arange(1, AFTER + 1)
    assert linear_error(model, slow) >= np.sqrt(np.mean((1.0 - np.minimum(time, 1.0)) ** 2)) > BENT
    assert linear_error(model, free) < 1e-9
    (note,) = list_departures(model, (slow, free))
    assert note.startswith(f"a step of {step:g} rad on Rotation differs from that of the linear model by ")


def test_a_structure_with_which_the_robot_comes_to_rest_nowhere_is_left_out_and_noted(hasty, monkeypatch):
    def assess_own(name, *rest):
        if name == "cascade":
            raise InputError("emps: no state of rest")
        return assess(name, *rest)

    monkeypatch.setattr(tuning, "assess", assess_own)
    found = tune(exo.load_robot("emps"), draws=0, judges=1)
    assert [one.name for one in found.compared] == ["as it is"]
    assert any(note.startswith("'cascade' is left out, with ") and "no state of rest" in note for note in found.notes)


@pytest.mark.parametrize("wanted", [{"overshoot": float("nan")}, {"settling": -1.0}, {"noise": float("nan")}])
def test_what_is_no_requirement_is_refused(wanted):
    with pytest.raises(exo.InputError, match=f"{next(iter(wanted))} is .*, wanted a number from 0"):
        exo.Requirements(**wanted)


def test_the_search_prefers_stable_then_held_then_fast():
    """Cost is settling in frames where all is held; of noise that may not be, less is better."""
    wanted = Requirements(None, 0.05, 0.6, 1e-4)
    found = [
        Performance(0.9, 0.5, 0.0, 0.8, 5e-5), Performance(0.9, 1.0, 0.0, 0.8, 5e-5),
        Performance(0.9, 0.5, 0.0, 0.5, 5e-5), Performance(1.01, np.inf, np.inf, 0.0, np.inf),
    ]  # fmt: skip
    costs = [compute_cost(p, wanted, 0.02) for p in found]
    assert costs == sorted(costs)
    assert compute_cost(found[0], Requirements(disk_margin=0.0, noise=1.0), 0.02) == pytest.approx(25.0)
    better, worse = (compute_cost(replace(found[0], noise=x), Requirements(noise=0.0), 0.02) for x in (1e-5, 2e-5))
    assert better < worse < np.inf
