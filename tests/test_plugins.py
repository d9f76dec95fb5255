"""Plugins: a machine, a file format and a part from folders of one's own act through the command line."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from command_line import follow, run

from exodrake.core import plugins
from exodrake.core.errors import InputError
from exodrake.data.case import Case, CaseLog, write_case
from exodrake.data.formats import read_log, write_log
from exodrake.data.log import Log
from exodrake.machines.robot_file import load_robot, machine_folders

JOINTS = ("shoulder", "elbow")
MACHINE = """
from exodrake.effects import for_machine
from exodrake.machines.position_servos import joint_machine


def machine():
    play = for_machine("joint.play", "servo.play")
    return joint_machine("puppet", "servo", ("shoulder", "elbow"), (play,), frame=0.02, max_effects=1)
"""
DRAG = '''
"""Drag that grows with the square of speed.

F_net = F - coefficient v |v|
"""

from exodrake.model.effect import Effect, EffectParameter


def pushed(force, speed, coefficient):
    """Force on the mass [N]."""
    return force - coefficient * speed * abs(speed)


EFFECT = Effect(
    id="carriage.quadratic_drag",
    summary="drag that grows with the square of speed",
    signature="the drive needs more force, the more the faster",
    source="a test",
    at={AT},
    parameters=(EffectParameter("coefficient", "N s2/m2", null=0.0, low=10.0, high=1000.0),),
    family="friction",
)
'''
DETECTABLE = '''
"""Play of a servo, which a detector finds rather than a fit."""

from dataclasses import replace

from exodrake.effects import servo

PLAY = replace(servo.PLAY, id="servo.play", detector="dead_band")
'''
DETECTOR = '''
"""Dead band: a joint that stands still while its command moves."""

from dataclasses import replace

import numpy as np

from exodrake.diagnosis.problem import Detection
from exodrake.diagnosis.result import Interval
from exodrake.diagnosis.result import NamedEffect


def detect(problem, effect, values):
    """The problem with play whose half width is half the largest lag that reversals leave."""
    lag = max(float(np.nanmax(np.abs(t.reference[:, :2] - t.measured))) for t in problem.fit)
    name, joints = effect.parameters[0].name, problem.robot.machine.axes.joints
    found = {f"{effect.id}.{name}.{joint}": lag for joint in joints}
    named = NamedEffect(effect.id, (), joints, {name: Interval(lag, 0.9 * lag, 1.1 * lag, "rad")}, {}, "play")
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
        signals |= {f"angle_ref_{joint}": command, f"angle_start_{joint}": np.full(300, angle[0])}
        signals[f"angle_{joint}"] = angle
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


@pytest.fixture
def dragging(tmp_path) -> Path:
    """A plugin folder with an effect, in a file named like a part's module."""
    (tmp_path / "plugin" / "effects").mkdir(parents=True)
    (tmp_path / "plugin" / "effects" / "carriage.py").write_text(DRAG.replace("{AT}", '{"carriage.pushed": pushed}'))
    return tmp_path / "plugin"


def test_an_effect_in_one_module_acts_and_is_diagnosed(dragging, tmp_path):
    """Motions at constant speed: the drive pushes as hard as the drag holds back."""
    assert "carriage.quadratic" not in run("effects", "--robot", "emps").output
    acting = "--effect carriage.quadratic_drag:coefficient=500"
    lines = [f"simulate --reference {role}.csv {acting} --out {role}" for role in ("fit", "holdout")]
    lines += ["effects", "diagnose . --effects carriage.quadratic_drag --json found.json"]
    lines = [f"exodrake --plugin {dragging} {line} --robot emps" for line in lines]
    time = 1e-3 * np.arange(600)
    for speed, role in ((0.1, "fit"), (0.2, "holdout")):
        ramp = {"position_ref": speed * time, "position_start": 0.0 * time, "speed_start": 0.0 * time + speed}
        ramp = {f"{kind}_carriage": values for kind, values in ramp.items()}
        write_log(Log(time, ramp), tmp_path / f"{role}.csv")
    logs = [{"file": f"{role}/log.csv", "role": role} for role in ("fit", "holdout")]
    (tmp_path / "case.yaml").write_text(yaml.safe_dump({"logs": logs}))
    said = follow([("command", line) for line in lines], tmp_path)
    assert all(result.exit_code == 0 for result in said.values()), said
    assert "grows with the square of speed" in said[lines[2]].stdout
    force = read_log(tmp_path / "fit" / "log.csv")["force_carriage"]
    assert force[-200:].mean() == pytest.approx(500.0 * 0.1**2, rel=0.02)
    answer = json.loads((tmp_path / "found.json").read_text())
    assert [effect["id"] for effect in answer["effects"]] == ["carriage.quadratic_drag"]


def test_effects_on_two_parts_or_in_a_file_that_the_library_would_hide_are_refused_by_name(dragging):
    at = '{"carriage.pushed": pushed, "joint.aimed": pushed}'
    (dragging / "effects" / "carriage.py").write_text(DRAG.replace("{AT}", at))
    two = dragging / "machines" / "two"
    two.mkdir(parents=True)
    (two / "machine.py").write_text(
        "from dataclasses import replace\nfrom exodrake.effects import LIBRARY\n"
        "from exodrake.machines.emps.machine import machine as emps\nfrom exodrake.physics import joint\n\n\n"
        "def machine():\n    extra = replace(joint.PART, tasks=(), outputs=())\n    return replace(emps(), name='two', "
        "parts=(*emps().parts, extra), effects=(LIBRARY['carriage.quadratic_drag'],))\n"
    )
    (two / "robot.yaml").write_text("machine: two\nparameters: {}\n")
    said = exodrake("--plugin", dragging, "effects", "--robot", "two").stderr
    assert "carriage.quadratic_drag acts on carriage and joint" in said
    (dragging / "effects" / "sensor.py").write_text(DRAG)
    said = exodrake("--plugin", dragging, "effects")
    assert said.returncode == 2 and "sensor.py: the library has a file of this name; rename it" in said.stderr


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


def test_a_robot_file_imports_no_code(puppet, tmp_path, monkeypatch):
    """A machine of another package, even one on the path, is none; the message lists the machines."""
    (tmp_path / "evil.py").write_text("raise SystemExit('ran')")
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in ("evil", "puppet", "puppet.machine", "../puppet", str(puppet), "os"):
        (tmp_path / "robot.yaml").write_text(f"machine: {name}\n")
        with pytest.raises(InputError, match=r"unknown machine .*exo_index, so101"):
            load_robot(tmp_path / "robot.yaml")


def test_a_folder_that_is_no_plugin_or_is_named_like_a_built_in_machine_is_refused(puppet, tmp_path, monkeypatch):
    monkeypatch.setenv(plugins.VARIABLE, "")
    with pytest.raises(InputError, match="no such folder of a machine"):
        plugins.add_plugin(tmp_path / "none")
    with pytest.raises(InputError, match="no plugin"):
        plugins.add_plugin(tmp_path)
    (tmp_path / "effects").mkdir()
    refused = run("draw", "--machine", tmp_path)
    assert refused.exit_code == 2 and "machine.py" in refused.stderr
    puppet.rename(tmp_path / "emps")
    drawn = run("draw", "--machine", tmp_path / "emps", "--out", tmp_path / "emps.svg")
    assert drawn.exit_code == 2 and "emps" in drawn.stderr


WRONG_UNIT = f"""from dataclasses import replace
{MACHINE}

made = machine()
machine = replace(made, signals=tuple(replace(s, unit='N') if s.name == 'angle_read' else s for s in made.signals))
"""
BROKEN = {
    WRONG_UNIT: "column angle in [N], wanted [rad]",
    "import nothing_there\n": "machine.py, line 1: ModuleNotFoundError: No module named 'nothing_there'",
    "\ndef machine(:\n": "machine.py, line 2: SyntaxError",
    "def machine():\n    return 1 / 0\n": "machine.py, line 2: ZeroDivisionError",
    "machine = 3\n": "defines no function machine()",
}


@pytest.mark.parametrize("text", BROKEN)
def test_an_error_in_a_machine_is_shown_with_its_line(puppet, monkeypatch, text):
    own = puppet.rename(puppet.with_name(f"broken_{list(BROKEN).index(text)}"))  # of a module that was not imported yet
    (own / "machine.py").write_text(text.replace("puppet", own.name))
    (own / "robot.yaml").write_text((own / "robot.yaml").read_text().replace("puppet", own.name))
    monkeypatch.setenv(plugins.VARIABLE, "")
    drawn = run("draw", "--machine", own, "--out", own / "x.svg")
    assert drawn.exit_code == 2 and BROKEN[text] in drawn.stderr and "Traceback" not in drawn.stderr, drawn.stderr


def test_a_machine_of_an_installed_package_is_found_by_its_entry_point(puppet, tmp_path):
    package = tmp_path / "installed" / "my_package"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("raise SystemExit('imported')")
    puppet.rename(package / "puppet")
    info = tmp_path / "installed" / "my_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my_package\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[exodrake.plugins]\npuppet = my_package.puppet\n")
    load = "import exodrake; print(exodrake.load_robot('puppet'))"
    script = f"import sys; sys.path.insert(0, {str(info.parent)!r}); {load}"
    root = Path(__file__).parent.parent
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=root)
    assert "Robot(puppet" in found.stdout, found.stderr


PUMP = {
    "machine.py": """
from exodrake.model.machine import Column, Machine
from exodrake.model.machine import Segment
from exodrake.model.part import JOINTS, NORMAL, Axes, Signal
from exodrake.machines.pump import leak, meter


def machine():
    signals = ("demand", "m", JOINTS, ""), ("noise_flow", "-", JOINTS, NORMAL), ("flow_read", "m", JOINTS, "")
    return Machine(
        name="pump", axes=Axes((), ("main",)), signals=tuple(Signal(*s) for s in signals), parts=(meter.PART,),
        inputs=("demand", "noise_flow"), effects=(leak.EFFECT,), slots=2, noise=("meter.sigma",), max_effects=1,
        columns=(Column("flow_ref", "demand"), Column("flow", "flow_read")), compared=("flow",),
        noise_std=lambda parameter: {"flow": parameter("meter.sigma")}, segments=(Segment("meter", "flow"),),
        reference_limits=("low", "high"),
    )
""",
    "meter.py": """
import sys
from typing import Annotated, NamedTuple

from exodrake.model.part import Output, Part, Point, State, Task, Unit


class Parameters(NamedTuple):
    gain: Annotated[float, Unit("-")]
    sigma: Annotated[float, Unit("m")]


def passed(e, z, flow):
    return flow


def read(x, z, n, e, demand, noise_flow):
    x[0] = passed(e, z, n.gain * demand[0]) + n.sigma * noise_flow[0]


def output(x, z, n, e, flow_read):
    flow_read[0] = x[0]


def start(x, z, n, e, start_stroke):
    x[:] = 0.0


PART = Part(
    "meter", sys.modules[__name__], Parameters, (Task("read", ("demand", "noise_flow"), slots=(1,)),),
    (Output("output", ("flow_read",)),), (State("reading"),), (Point("passed"),),
)
""",
    "leak.py": """
from exodrake.model.effect import Effect, EffectParameter


def passed(flow, share):
    return flow - share * flow * flow


SHARE = EffectParameter("share", "1/m", 0.0, 0.01, 0.5, default=0.1)
EFFECT = Effect("meter.leak", "a leak", "less flow", "assumed", {"meter.passed": passed}, (SHARE,))
""",
    "robot.yaml": """
machine: pump
parameters: {meter: {gain: 1.0, sigma: 0.001}}
limits: {low: {main: 0.0}, high: {main: 1.0}}
""",
}


def test_a_machine_of_unknown_kinds_without_a_tick_or_tolerances_takes_every_command(tmp_path):
    """Its columns are of no kind in the table, no task runs on the plant's tick, and no parameter has a tolerance."""
    (tmp_path / "pump").mkdir()
    for name, text in PUMP.items():
        (tmp_path / "pump" / name).write_text(text)
    leaking = "random-motion:duration=20 --effect meter.leak:share=0.2"
    lines = [
        f"simulate {leaking} --out run", "check run/log.csv",
        "diagnose run/log.csv --report report.html --out-robot better.yaml", "effects", "draw --out pump.svg",
        "simulate --reference run/log.csv --robot better.yaml --out again", "watch run/log.csv --until-idle 0",
        "feedforward random-motion:duration=5 --robot better.yaml --out commands.csv",
        "import run/log.csv --out log.npz", "analyse", "show run/log.csv",
    ]  # fmt: skip
    lines = [f"exodrake {line} --machine pump" for line in lines]
    said = follow([("command", line) for line in lines], tmp_path)
    for line in lines[:-2]:
        assert said[line].exit_code == 0, said[line]
    for line in lines[-2:]:
        assert said[line].exit_code == 2 and "error: pump" in said[line].stderr and not said[line].broken, said[line]
    diagnosed = said[lines[2]].stdout + said[lines[2]].stderr
    assert "NAMED" in diagnosed and "states no tolerances" in diagnosed
    share = yaml.safe_load((tmp_path / "better.yaml").read_text())["effects"]["meter.leak"]["share"]
    assert share["source"].startswith("fitted to ") and share["value"] == pytest.approx(0.2, rel=0.02)
    assert "flow" in (tmp_path / "report.html").read_text()
