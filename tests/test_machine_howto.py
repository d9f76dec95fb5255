"""The page on a machine of one's own: every line of it is executed, in order, from an empty folder."""

import json
import re
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from command_line import ROOT, follow

from exodrake.data.formats import read_log

PAGE = ROOT / "docs" / "howto" / "machine.md"
PIECES = re.compile(r"^```(\w+)\n(.*?)^```|^    (exodrake [^\n]*)$", re.M | re.S)
NOMINAL_WATCH = "exodrake watch growing.csv --machine my_arm --until-idle 0"
REFUSED = [
    f"exodrake {line} --machine my_arm"
    for line in (
        "blind make --seed 1 --cases 1 --out x", "blind run x", "demo", "identify", "workspace", "train x", "warm-up",
        "estimate x", "grasp x --size 60",
    )
]  # fmt: skip
ANSWERS = {"exodrake diagnose case": " --json found.json", "exodrake diagnose held/log.csv": " --json arm.json"}


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """Folder after the page was followed in one process, and the result of each command."""
    folder = tmp_path_factory.mktemp("empty")
    pieces = [(language, block) for language, block, _ in PIECES.findall(PAGE.read_text())]
    lines = [line for _, _, line in PIECES.findall(PAGE.read_text())]
    steps = [
        (language, block) if language else ("command", line + ANSWERS.get(" ".join(line.split()[:3]), ""))
        for (language, block), line in zip(pieces, lines, strict=True)
        if language in ("", "python")
    ]
    steps += [("command", line) for line in (NOMINAL_WATCH, *REFUSED)]
    said = follow(steps, folder)
    for line, result in said.items():
        if line not in (NOMINAL_WATCH, *REFUSED):
            assert result.exit_code == 0, f"{line}: {result.stdout}{result.stderr}{result.broken}"
    return folder, said


def said_by(said, command: str):
    """The result of the first line of a command."""
    return next(result for line, result in said.items() if line.startswith(f"exodrake {command} "))


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
    real, improved = read_log(folder / "case" / "run3.csv.gz"), read_log(folder / "improved" / "log.csv")
    error = np.std(improved["angle_elbow"] - real["angle_elbow"])  # the improved robot follows the held-out run
    assert error < 0.05 * np.std(real["angle_ref_elbow"] - real["angle_elbow"])
    names = {path.name for path in (folder / "my_arm").iterdir()}
    assert {"machine.py", "robot.yaml", "mapping.yaml", "test_machine.py", "README.md", "alarm_limits.yaml"} <= names
    assert (folder / "my_arm.svg").read_text().startswith("<svg")


def test_the_payload_of_the_arm_is_named(done):
    folder, _ = done
    found = json.loads((folder / "arm.json").read_text())
    assert [effect["id"] for effect in found["effects"]] == ["arm.payload"]
    assert found["effects"][0]["parameters"]["mass"]["value"] == pytest.approx(0.5, rel=0.05)
    assert (folder / "held" / "arm.html").stat().st_size > 1e5


def test_the_page_shows_the_mapping_and_the_headline_that_are_there(done):
    folder, said = done
    blocks = {language: block for language, block, _ in PIECES.findall(PAGE.read_text())}
    assert yaml.safe_load(blocks["yaml"]) == yaml.safe_load((folder / "my_arm" / "mapping.yaml").read_text())
    assert "no alarm" in said_by(said, "watch").stdout  # beside the improved robot, not beside the nominal one
    assert said[NOMINAL_WATCH].exit_code == 1 and "alarm" in said[NOMINAL_WATCH].stdout


def test_commands_print_what_the_page_shows_below_them(done):
    """Each text block, but for spaces and frames, is part of what the command before it prints."""
    shown, line = [], ""
    for language, block, command in PIECES.findall(PAGE.read_text()):
        line = command + ANSWERS.get(" ".join(command.split()[:3]), "") if command else line
        if language == "text":
            printed, block = (" ".join(text.replace("│", " ").split()) for text in (done[1][line].stdout, block))
            assert block in printed, line
            shown.append(line.split()[1])
    assert shown == ["diagnose", "response", "fit", "diagnose", "analyse", "tune"]


def test_the_servos_get_gains_and_a_model_for_mujoco(done):
    folder, said = done
    assert "best: I, filtered reference, settles in " in said_by(said, "tune").stdout
    model = ElementTree.parse(folder / "found.xml").getroot()
    assert model.tag == "mujoco" and {j.get("name") for j in model.iter("joint")} >= {"shoulder", "elbow"}


@pytest.mark.parametrize("line", REFUSED)
def test_a_command_that_takes_no_machine_of_ones_own_says_why_in_one_sentence(done, line):
    result = done[1][line]
    assert result.exit_code == 2 and not result.broken
    assert len(result.stderr.strip().splitlines()) == 1 and result.stderr.startswith("error: "), result.stderr
