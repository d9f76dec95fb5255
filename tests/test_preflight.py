"""What a case could tell: clocks and channels with injected faults, effects against closed forms, and the command."""

import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from exodrake.cli.main import cli
from exodrake.data.case import Case, CaseLog, write_case
from exodrake.data.log import Log
from exodrake.diagnosis.checks.preflight import (
    CLEAR,
    SEEN,
    Sensor,
    find_band,
    find_problems,
    identifiability,
    judge_clock,
    preflight,
)
from exodrake.diagnosis.checks.suspicions import held_shares
from exodrake.diagnosis.likelihood import CORRELATION
from exodrake.diagnosis.linearise import PROBE
from exodrake.diagnosis.problem import make_problem
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import load_robot
from exodrake.simulation.protocols import protocol
from exodrake.simulation.simulate import simulate

ROBOT = load_robot("so101")
JOINTS = ROBOT.machine.axes.joints
FRAMES = 1500


def case_of(command: np.ndarray, robot=ROBOT) -> Case:
    """A log of commands (n, joints) [rad] to fit."""
    rows = np.hstack([command, np.tile(command[0], (len(command), 1))])
    log = simulate(robot, Reference(rows), seed=1)
    return Case("planned", {}, (CaseLog(log, "motion", "fit", None, "motion.csv"),), robot.machine.frame)


def sines(frequency: float, size: float = 0.3, frames: int = FRAMES) -> np.ndarray:
    """Commands of all joints, of whole periods and no common one."""
    time = 0.02 * np.arange(frames)
    return np.column_stack([size * np.sin(2 * np.pi * frequency * (1 + k) * time) for k in range(len(JOINTS))])


def found_of(case: Case) -> dict:
    """Directions by effect and channel."""
    return {(d.effect, d.channel): d for d in identifiability(make_problem(case, ROBOT)).directions}


@pytest.mark.parametrize("frames", [FRAMES, 4 * FRAMES])
def test_a_gain_of_a_sine_changes_the_log_by_its_closed_form(frames):
    """|d| = gain rms(command) sqrt(n / n_c) / noise, less what the ratio's tolerance takes up; n: of the whole log."""
    size, noise = 0.3, ROBOT["reading.repeatability"]
    direction = found_of(case_of(sines(0.1, size, frames)))["servo.gain", "Pitch"]
    gain, tolerance = PROBE * -0.1, 0.002
    samples = frames * 0.02 / CORRELATION
    unit = size / np.sqrt(2.0) * np.sqrt(samples) / noise  # change by a gain of 1
    wanted = abs(gain) * unit / np.sqrt(1.0 + (tolerance * unit) ** 2)
    assert direction.typical == pytest.approx(gain)
    assert direction.seen == pytest.approx(wanted, rel=0.01)
    assert direction.smallest == pytest.approx(gain * SEEN / wanted, rel=0.01)


def test_what_no_motion_shows_is_not_seen():
    command = sines(0.1)
    command[:, JOINTS.index("Elbow")] = 0.4
    found = found_of(case_of(command))
    for effect in ("servo.latency", "servo.lag"):
        assert found[effect, "Elbow"].seen < 1e-6 and not found[effect, "Elbow"].taken_for
        assert found[effect, "Pitch"].seen > SEEN
    assert "servo.gravity_sag" in found["servo.gain", "Elbow"].taken_for or found["servo.gain", "Elbow"].seen < SEEN


def test_a_delay_is_distinguished_from_a_lag_by_fast_motion_only():
    """Both turn the phase of a slow sine; a lag of T halves the amplitude where 2 pi f T is the root of 3."""
    slow, fast = (found_of(case_of(sines(f)))["servo.lag", "Rotation"] for f in (0.1, 3.0))
    assert slow.taken_for["servo.latency"] < 0.1
    assert fast.taken_for.get("servo.latency", 1.0) > 5.0 * slow.taken_for["servo.latency"]


def test_the_command_at_the_drive_tells_a_delay_from_a_lag():
    found = identifiability(make_problem(case_of(sines(0.1)), ROBOT, frozenset({"servo.latency", "servo.lag"})))
    assert found.sensors[0].signal.name == "command"
    assert len(found.sensors[0].left.select(CLEAR)) > len(found.select(CLEAR))


def test_a_clock_with_jitter_drift_and_holes():
    rng = np.random.default_rng(0)
    n = np.delete(np.arange(2000), [500, 501, 900])
    log = Log(0.02 * 1.0005 * n + 2e-3 * rng.standard_normal(len(n)), {"angle_a": np.zeros(len(n))})
    clock = judge_clock(log, "x.csv", 0.02)
    assert clock.missing == 3 and clock.rows == 1997
    assert clock.jitter == pytest.approx(0.1 * np.sqrt(2.0), rel=0.1)
    assert clock.drift == pytest.approx(5e-4, abs=0.1 / 1997)
    said = " ".join(find_problems([clock], (), ()))
    assert all(word in said for word in ("scatter", "ppm too slowly"))
    clean = judge_clock(Log(0.02 * np.arange(100.0), {}), "y.csv", 0.02)
    assert not [*find_problems([clean], (), ())] and clean.jitter < 1e-9


def test_clipped_samples_are_counted_and_a_smooth_top_is_not():
    wave = np.sin(np.linspace(0, 20 * np.pi, 5000))
    clipped = np.clip(wave, -0.8, 0.8)
    share = 1.0 - 2.0 * np.arcsin(0.8) / np.pi  # of a sine beyond 0.8 of its size
    assert held_shares(clipped)[0] == pytest.approx(share, abs=0.01)
    assert held_shares(wave)[0] < 0.002 and held_shares(np.ones(9)) == (0.0, 0.0)
    assert find_band(np.sin(2 * np.pi * 1.5 * 0.02 * np.arange(1000)), 0.02) == pytest.approx(1.5, abs=0.05)
    assert find_band(np.ones(100), 0.02) == 0.0


def test_the_command_prints_tables_and_draws_the_figure(tmp_path, monkeypatch):
    case = case_of(sines(0.1))
    log = case.logs[0].log
    clipped = log.with_signals({"angle_Jaw": np.clip(log["angle_Jaw"], -0.15, 0.15)})
    logs = CaseLog(clipped, "m", "fit", None, "m.csv"), CaseLog(log.rows(slice(0, 40)), "s", "fit", None, "short.csv")
    write_case(Case("c", {}, logs, 0.02), tmp_path / "case")
    words = ["check", str(tmp_path / "case"), "--robot", "so101", "--figure", str(tmp_path / "check.png")]
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == 0, result.output
    assert "servo.latency" in result.stdout and "would help most" in result.stdout
    assert "left out, since a diagnosis needs 50 (1 s) frames: short.csv" in " ".join(result.stdout.split())
    said = "angle_Jaw of m.csv again and again stay at one value at an end of their range"
    assert said in result.stdout and "no log is held out" in result.stdout
    assert not re.search(r"\d -\s", result.stdout), "a ratio has no unit"
    assert (tmp_path / "check.png").read_bytes().startswith(b"\x89PNG")
    said, bare = [], replace(ROBOT, machine=replace(ROBOT.machine, tolerances=()))
    found = preflight(tmp_path / "case", bare, frozenset({"servo.gain"}), progress=said.append)
    assert len(said) == 3 and "1 effect" in said[1] and any("no tolerances" in problem for problem in found.problems)
    nothing = CliRunner().invoke(cli, ["check", str(tmp_path / "none"), "--robot", "so101"])
    assert nothing.exit_code == 2 and "no such file or folder" in nothing.stderr
    angle = Sensor(ROBOT.machine.signal["angle"], 1e-3, found.identifiability)
    again = found._replace(identifiability=found.identifiability._replace(sensors=(angle,)))
    monkeypatch.setattr("exodrake.diagnosis.checks.preflight.preflight", lambda *_: again)
    assert "angle once more, by a second sensor, would help most" in CliRunner().invoke(cli, words).stdout


def test_what_a_sensor_less_would_tell_is_what_a_log_without_it_tells():
    robot = load_robot()
    log = simulate(robot, Reference(protocol("steps", robot).values[:300]), seed=1)
    case = Case("steps", {}, (CaseLog(log, "steps", "fit", None, "steps.csv"),), robot.machine.frame)
    signals = {k: v for k, v in log.signals.items() if not k.startswith("tension") or k.startswith("tension_ref")}
    poorer = replace(case, logs=(replace(case.logs[0], log=Log(log.time, signals)),))
    tried = frozenset({"tendon.slack", "sensor.gain"})
    found = identifiability(make_problem(case, robot, tried)).fewer
    assert len(found) == 6 and ("stroke", "speed_cmd") in found
    wanted = identifiability(make_problem(poorer, robot, tried)).directions
    got = found["stroke", "speed_cmd", "angle"].directions
    assert [(d.effect, d.channel) for d in got] == [(d.effect, d.channel) for d in wanted]
    assert [d.seen for d in got] == pytest.approx([d.seen for d in wanted], rel=1e-3)
