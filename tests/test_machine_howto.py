"""The page on a machine of one's own: every line of it is executed, in order, from an empty folder."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import exodrake as exo
from exodrake.data.log_file import read_log

PAGE = Path(__file__).parent.parent / "docs" / "howto" / "machine.md"
PIECES = re.compile(r"^```(\w+)\n(.*?)^```|^    (exodrake [^\n]*)$", re.M | re.S)
EXTRA = {"diagnose": ["--json", "found.json"]}
ALARMS = {"watch": (0, 1)}


def run(folder: Path, words: list[str]) -> subprocess.CompletedProcess:
    """A command in a process of its own, in a folder."""
    command = [sys.executable, "-m", "exodrake", *words]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """Folder and output of each command after the page was followed."""
    folder, said, space = tmp_path_factory.mktemp("empty"), {}, {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("PYTHONPATH", str(PAGE.parent.parent.parent), prepend=":")
        for language, block, line in PIECES.findall(PAGE.read_text()):
            if language == "python":
                exec(compile(block, str(PAGE), "exec"), space)
            elif language == "yaml":
                assert yaml.safe_load(block) == yaml.safe_load((folder / "my_arm" / "mapping.yaml").read_text())
            elif line:
                words = shlex.split(line)[1:]
                result = run(folder, [*words, *EXTRA.get(words[0], [])])
                assert result.returncode in ALARMS.get(words[0], (0,)), f"{line}\n{result.stdout}{result.stderr}"
                said.setdefault(words[0], []).append(result)
    return folder, said


def test_the_verdict_is_what_the_recordings_hide(done):
    folder, _ = done
    found = json.loads((folder / "found.json").read_text())
    assert found["verdict"] == "NAMED"
    effects = {e["id"]: e["parameters"] for e in found["effects"]}
    assert set(effects) == {"servo.latency", "servo.play"}
    assert effects["servo.play"]["half_width"]["value"] == pytest.approx(np.radians(2.3), rel=0.05)
    assert effects["servo.latency"]["frames"]["value"] == pytest.approx(2.0, abs=0.2)
    assert found["closure"]["overall"]["value"] > 0.95
    assert (folder / "report.html").stat().st_size > 10_000


def test_the_page_shows_the_headline_that_is_printed(done):
    (shown,) = (text for name, text, _ in PIECES.findall(PAGE.read_text()) if name == "text")
    headline = " ".join(shown.strip("│ \n").split())
    assert headline.rstrip("│").rstrip(". ") in " ".join(done[1]["diagnose"][0].stdout.replace("│", " ").split())


def test_the_improved_robot_follows_the_held_out_run(done):
    folder, _ = done
    real, nominal = read_log(folder / "case" / "run3.csv.gz", required=()), "angle_ref_elbow"
    improved = read_log(folder / "improved" / "log.csv", required=())
    error = np.std(improved["angle_elbow"] - real["angle_elbow"])
    assert error < 0.05 * np.std(real[nominal] - real["angle_elbow"])


def test_the_watch_is_silent_beside_the_improved_robot_and_not_beside_the_nominal_one(done):
    folder, said = done
    assert said["watch"][0].returncode == 0 and "no alarm" in said["watch"][0].stdout
    nominal = run(folder, ["watch", "growing.csv", "--machine", "my_arm", "--until-idle", "0"])
    assert nominal.returncode == 1, nominal.stdout + nominal.stderr


def test_commands_that_take_no_machine_say_why_in_one_sentence(done):
    folder, _ = done
    lines = (
        "blind make --seed 1 --cases 1 --out x", "blind run x", "demo", "identify", "workspace", "train x",
        "estimate x", "grasp", "analyse", "show first/log.csv", "warm-up", "export first/log.csv --out y.npz",
    )  # fmt: skip
    for line in lines:
        result = run(folder, [*line.split(), "--machine", "my_arm"])
        assert result.returncode == 2 and len(result.stderr.strip().splitlines()) == 1, (line, result.stderr)
        assert "Error" not in result.stderr, line


def test_the_folder_holds_what_a_machine_needs(done):
    folder, _ = done
    exo.add_plugin(folder / "my_arm")
    robot = exo.load_robot("my_arm")
    assert robot.machine.axes.joints == ("shoulder", "elbow") and robot.machine.tolerances
    assert "my_arm" in (folder / "my_arm.svg").read_text()
