"""An effect and a sensor of one's own: a module each in a folder outside the package, used through the command line."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from exodrake.data.case import Case, CaseLog, write_case
from exodrake.data.formats import read_log
from exodrake.machines import library

ROOT = Path(__file__).parent.parent
SPEED, COEFFICIENT = 0.1, 500.0  # m/s, N s2/m2
# named like a part's module
EFFECT = '''
"""Drag that grows with the square of speed.

F_net = F - coefficient v |v|
"""

from exodrake.core.effect import Effect, EffectParameter


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
SENSOR = '''
"""Force gauge: reading = gain force, once a frame."""

import sys
from typing import Annotated, NamedTuple

from exodrake.core.part import Output, Part, State, Task, Unit


class Parameters(NamedTuple):
    """Scale of the gauge."""

    gain: Annotated[float, Unit("-")]


def read(x, z, n, e, force):
    """One reading; signals [N]."""
    x[0] = n.gain * force[0]


def output(x, z, n, e, force_read):
    """The last reading [N]."""
    force_read[0] = x[0]


def start(x, z, n, e, start_stroke):
    """Nothing read yet."""
    x[:] = 0.0


PART = Part(
    name="gauge",
    module=sys.modules[__name__],
    parameters=Parameters,
    states=(State("reading", unit="N"),),
    tasks=(Task("read", ("force",), slots=(15,)),),
    outputs=(Output("output", ("force_read",)),),
)
'''


SIMULATE = """
import sys
import numpy as np
from exodrake.core import plugins
plugins.add_plugin(sys.argv[1])
import exodrake as exo
from exodrake.data.formats import write_log
robot, effect, value, out = exo.load_robot(sys.argv[2]), sys.argv[3], float(sys.argv[4]), sys.argv[5]
time = 1e-3 * np.arange(600)
ramp = np.column_stack([float(sys.argv[6]) * time, 0.0 * time, 0.0 * time + float(sys.argv[6])])
write_log(exo.simulate(robot.splice(effect, {"coefficient": value}), exo.Reference(ramp), seed=1), out)
"""


def run(*words: object) -> str:
    """What a Python process of its own prints."""
    found = subprocess.run([sys.executable, *map(str, words)], capture_output=True, text=True, cwd=ROOT)
    assert "Traceback" not in found.stderr, found.stderr
    return found.stdout + found.stderr


def exodrake(*words: object) -> str:
    """What the command line prints."""
    return run("-m", "exodrake", *words)


@pytest.fixture
def plugin(tmp_path) -> Path:
    """A plugin folder."""
    (tmp_path / "plugin" / "effects").mkdir(parents=True)
    return tmp_path / "plugin"


def simulated(plugin: Path, robot: str, effect: str, coefficient: float, speed: float = SPEED) -> Path:
    """Log of a motion at constant speed, simulated with the plugin."""
    out = plugin.parent / f"{robot}_{speed}.csv"
    run("-c", SIMULATE, plugin, robot, effect, coefficient, out, speed)
    return out


def test_an_effect_in_one_module_acts(plugin):
    """At constant speed the drive pushes as hard as the drag holds back."""
    (plugin / "effects" / "carriage.py").write_text(EFFECT.replace("{AT}", '{"carriage.pushed": pushed}'))
    assert "grows with the square of speed" in exodrake("--plugin", plugin, "effects", "--robot", "emps")
    files = [simulated(plugin, "emps", "carriage.quadratic_drag", COEFFICIENT, speed) for speed in (SPEED, 2.0 * SPEED)]
    log = read_log(files[0])
    assert log["force_carriage"][-200:].mean() == pytest.approx(COEFFICIENT * SPEED**2, rel=0.02)
    items = [
        CaseLog(read_log(f), f.stem, role, None, f.name) for f, role in zip(files, ("fit", "holdout"), strict=True)
    ]
    write_case(Case("ramps", {}, tuple(items), 1e-3), plugin.parent / "case")
    choice = ("--robot", "emps", "--effects", "carriage.quadratic_drag")
    exodrake("--plugin", plugin, "diagnose", plugin.parent / "case", *choice, "--json", plugin.parent / "found.json")
    found = json.loads((plugin.parent / "found.json").read_text())
    assert [effect["id"] for effect in found["effects"]] == ["carriage.quadratic_drag"]


def test_an_effect_on_two_parts_is_refused_by_name(plugin):
    at = '{"carriage.pushed": pushed, "joint.aimed": pushed}'
    (plugin / "effects" / "both.py").write_text(EFFECT.replace("{AT}", at))
    (plugin / "machines" / "two").mkdir(parents=True)
    (plugin / "machines" / "two" / "machine.py").write_text(
        "from dataclasses import replace\nfrom exodrake.effects import LIBRARY\n"
        "from exodrake.machines.emps.machine import machine as emps\nfrom exodrake.physics import joint\n\n\n"
        "def machine():\n    extra = replace(joint.PART, tasks=(), outputs=())\n    return replace(emps(), name='two', "
        "parts=(*emps().parts, extra), effects=(LIBRARY['carriage.quadratic_drag'],))\n"
    )
    (plugin / "machines" / "two" / "robot.yaml").write_text("machine: two\nparameters: {}\n")
    said = exodrake("--plugin", plugin, "effects", "--robot", "two")
    assert "carriage.quadratic_drag acts on carriage and joint" in said


def test_a_sensor_is_one_module_its_signals_and_its_parameters(plugin):
    (plugin / "physics").mkdir()
    (plugin / "physics" / "force_gauge.py").write_text(SENSOR)
    folder, emps = plugin / "machines" / "gauged", library.machine_folders()["emps"]
    folder.mkdir(parents=True)
    text = (emps / "machine.py").read_text()
    for old, new in (
        ("import carriage,", "import carriage, force_gauge,"),
        ("PARTS = (", "PARTS = (force_gauge.PART, "),
        (
            '    Signal("force", "N", JOINTS),',
            '    Signal("force", "N", JOINTS),\n    Signal("force_read", "N", JOINTS),',
        ),
        ('    Column("force", "force"),', '    Column("force", "force"),\n    Column("gauge", "force_read"),'),
        ('name="emps"', 'name="gauged"'),
    ):
        assert old in text
        text = text.replace(old, new)
    (folder / "machine.py").write_text(text)
    text = (emps / "robot.yaml").read_text().replace("machine: emps", "machine: gauged")
    (folder / "robot.yaml").write_text(text.replace("parameters:\n", "parameters:\n  gauge: {gain: 1.5}\n", 1))
    assert "gauged" in exodrake("--plugin", plugin, "draw", "--robot", "gauged", "--out", folder / "gauged.svg")
    assert "gauge" in (folder / "gauged.svg").read_text()
    log = read_log(simulated(plugin, "gauged", "carriage.viscous_friction", 100.0))
    assert np.abs(log["force_carriage"]).max() > 1.0
    assert log["gauge_carriage"][10:] == pytest.approx(1.5 * log["force_carriage"][10:], rel=1e-6, abs=1e-6)
