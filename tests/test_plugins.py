"""Plugins: a machine, a file format and a part from folders of one's own act through the command line."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from exodrake.core import plugins
from exodrake.core.errors import InputError
from exodrake.data.case import Case, CaseLog
from exodrake.data.case_folder import write_case
from exodrake.data.log import Log
from exodrake.data.log_file import write_log
from exodrake.machines.library import machine_folders
from exodrake.machines.robot_file import load_robot

JOINTS = ("shoulder", "elbow")
MACHINE = """
from exodrake.effects import for_machine
from exodrake.machines.position_servos import joint_machine


def machine():
    play = for_machine("joint.play", "servo.play")
    return joint_machine("puppet", "servo", ("shoulder", "elbow"), (play,), frame=0.02, max_effects=1)
"""
EFFECT = '''
"""Bias: what the load cell reads is off by a constant."""

from dataclasses import replace

from exodrake.effects.signal import sensor_offset

BIAS = replace(sensor_offset.EFFECT, id="sensor.bias")
'''
DETECTABLE = '''
"""Play of a servo, which a detector finds rather than a fit."""

from dataclasses import replace

from exodrake.effects.signal import joint_play

PLAY = replace(joint_play.EFFECT, id="servo.play", detector="dead_band")
'''
DETECTOR = '''
"""Dead band: a joint that stands still while its command moves."""

from dataclasses import replace

import numpy as np

from exodrake.diagnosis.detection import Detection
from exodrake.diagnosis.result import Interval, NamedEffect


def detect(problem, effect, values):
    """The problem with play whose half width is half the largest lag that reversals leave."""
    lag = max(float(np.max(np.abs(t.reference[:, :2] - t.measured))) for t in problem.fit)
    name, joints = effect.parameters[0].name, problem.robot.machine.axes.joints
    found = {f"{effect.id}.{name}.{joint}": lag for joint in joints}
    named = NamedEffect(effect.id, (), joints, {name: Interval(lag, 0.9 * lag, 1.1 * lag, "rad")}, {}, 1.0)
    detection = Detection(named, found, "the joints stand still after each reversal")
    return replace(problem, tried=problem.tried - {effect.id}, detected=(*problem.detected, detection))
'''
FORMAT = '''
"""TSV: cells separated by tabs."""

from exodrake.data.formats import csv

ENDINGS = (".tsv",)


def read(data, source):
    """As CSV."""
    return csv.read(data.replace(b"\\t", b","), source)


def write(log):
    """As CSV."""
    return csv.write(log).replace(b",", b"\\t")
'''


def exodrake(*words: object) -> subprocess.CompletedProcess:
    """A run of the command line in a process of its own."""
    command = [sys.executable, "-m", "exodrake", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parent.parent)


@pytest.fixture
def puppet(tmp_path) -> Path:
    """A machine folder outside the package: two servos with the numbers of the SO-101's."""
    folder = tmp_path / "puppet"
    folder.mkdir()
    (folder / "machine.py").write_text(MACHINE)
    text = (machine_folders()["so101"] / "robot.yaml").read_text()
    (folder / "robot.yaml").write_text(text.replace("machine: so101", "machine: puppet"))
    return folder


@pytest.fixture
def plugin(tmp_path) -> Path:
    """A plugin folder with a file format."""
    folder = tmp_path / "plugin"
    (folder / "data" / "formats").mkdir(parents=True)
    (folder / "data" / "formats" / "tsv.py").write_text(FORMAT)
    return folder


def servo_log(seed: int, play: float) -> Log:
    """Two servos that follow sines with backlash of half width `play` [rad], rounded to the encoder's step."""
    time = 0.02 * np.arange(300)
    signals = {}
    for k, joint in enumerate(JOINTS):
        command = 0.4 * np.sin(2 * np.pi * (0.3 + 0.1 * k) * time + seed)
        angle = np.empty_like(command)
        held = command[0]
        for n, value in enumerate(command):
            held = min(max(held, value - play), value + play)
            angle[n] = held
        angle = 0.0015339807878856412 * np.round(angle / 0.0015339807878856412)
        signals |= {
            f"angle_ref_{joint}": command,
            f"angle_start_{joint}": np.full(300, angle[0]),
            f"angle_{joint}": angle,
        }
    return Log(time, signals)


def puppet_case(play: float) -> Case:
    """Two logs to fit and one held out."""
    logs = tuple(
        CaseLog(servo_log(seed, play), f"motion {seed}", role, None, f"{seed}.csv")
        for seed, role in ((1, "fit"), (2, "fit"), (3, "holdout"))
    )
    return Case("puppet", {}, logs, 0.02)


def test_a_machine_from_a_folder_is_drawn_and_diagnosed(puppet, tmp_path):
    drawn = exodrake("draw", "--machine", puppet, "--out", tmp_path / "puppet.svg")
    assert drawn.returncode == 0, drawn.stderr
    assert "puppet" in (tmp_path / "puppet.svg").read_text()
    write_case(puppet_case(0.03), tmp_path / "case")
    found = exodrake("diagnose", tmp_path / "case", "--machine", puppet, "--json", tmp_path / "found.json")
    assert found.returncode == 0, found.stderr
    assert "servo.play" in (tmp_path / "found.json").read_text()


def test_a_file_format_from_a_plugin_is_written_and_read(plugin, tmp_path):
    log = servo_log(1, 0.0)
    write_log(log, tmp_path / "log.csv")
    there = exodrake("--plugin", plugin, "export", tmp_path / "log.csv", "--out", tmp_path / "log.tsv")
    assert there.returncode == 0, there.stderr
    assert (tmp_path / "log.tsv").read_text().startswith("time [s]\t")
    back = exodrake("--plugin", plugin, "export", tmp_path / "log.tsv", "--out", tmp_path / "back.csv")
    assert back.returncode == 0, back.stderr
    assert (tmp_path / "back.csv").read_bytes() == (tmp_path / "log.csv").read_bytes()
    without = exodrake("export", tmp_path / "log.csv", "--out", tmp_path / "other.tsv")
    assert without.returncode == 2 and "ending is none of .csv" in without.stderr


def test_an_effect_from_a_plugin_is_in_the_library(tmp_path):
    (tmp_path / "effects").mkdir()
    (tmp_path / "effects" / "sensor_bias.py").write_text(EFFECT)
    there = exodrake("--plugin", tmp_path, "effects", "sensor.bias")
    assert there.returncode == 0 and "sensor.bias" in there.stdout, there.stderr
    assert "sensor.bias" not in exodrake("effects").stdout


def test_a_detector_and_its_effect_from_a_plugin_decide_a_diagnosis(puppet, tmp_path):
    folder = tmp_path / "plugin"
    for place, text in (("effects/servo_play.py", DETECTABLE), ("diagnosis/detect/dead_band.py", DETECTOR)):
        (folder / place).parent.mkdir(parents=True)
        (folder / place).write_text(text)
    library = MACHINE.replace("from exodrake.effects import for_machine", "from exodrake.effects import LIBRARY")
    (puppet / "machine.py").write_text(
        library.replace('for_machine("joint.play", "servo.play")', 'LIBRARY["servo.play"]')
    )
    write_case(puppet_case(0.03), tmp_path / "case")
    found = exodrake(
        *("--plugin", folder, "diagnose", tmp_path / "case", "--machine", puppet, "--json", tmp_path / "found.json")
    )
    assert found.returncode == 0, found.stderr
    answer = json.loads((tmp_path / "found.json").read_text())
    assert answer["verdict"] == "NAMED" and [e["id"] for e in answer["effects"]] == ["servo.play"]
    assert answer["reasons"][0] == "the joints stand still after each reversal"
    assert answer["effects"][0]["parameters"]["half_width"]["value"] == pytest.approx(0.03, abs=0.002)
    assert answer["closure"]["overall"]["value"] > 0.9


def test_an_effect_whose_detector_does_not_exist_is_refused(puppet, tmp_path):
    lost = MACHINE.replace(
        'for_machine("joint.play", "servo.play")', 'replace(for_machine("joint.play", "servo.play"), detector="none")'
    )
    (puppet / "machine.py").write_text("from dataclasses import replace\n" + lost)
    write_case(puppet_case(0.03), tmp_path / "case")
    found = exodrake("diagnose", tmp_path / "case", "--machine", puppet)
    assert found.returncode == 2 and "servo.play: no detector 'none'" in found.stderr


def test_a_robot_file_imports_no_code(puppet, tmp_path, monkeypatch):
    """A machine of another package, even one on the path, is none; the message lists the machines."""
    (tmp_path / "evil.py").write_text("raise SystemExit('ran')")
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in ("evil", "puppet", "puppet.machine", "../puppet", str(puppet), "os"):
        (tmp_path / "robot.yaml").write_text(f"machine: {name}\n")
        with pytest.raises(InputError, match=r"unknown machine .*exo_index, so101"):
            load_robot(tmp_path / "robot.yaml")


def test_a_folder_that_is_no_plugin_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such plugin folder"):
        plugins.add_plugin(tmp_path / "none")
    with pytest.raises(InputError, match="no plugin"):
        plugins.add_plugin(tmp_path)
    (tmp_path / "effects").mkdir()
    refused = exodrake("draw", "--machine", tmp_path)
    assert refused.returncode == 2 and "machine.py" in refused.stderr


def test_a_plugin_does_not_replace_a_built_in_machine(puppet, tmp_path):
    puppet.rename(tmp_path / "emps")
    drawn = exodrake("draw", "--machine", tmp_path / "emps", "--out", tmp_path / "emps.svg")
    assert drawn.returncode == 2 and "emps" in drawn.stderr
