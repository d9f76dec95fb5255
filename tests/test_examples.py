"""Every example runs, stays short, and says something."""

import runpy
import sys
from pathlib import Path

import matplotlib
import pytest

from exodrake.diagnosis import pipeline
from exodrake.diagnosis.problem import make_problem
from exodrake.identification.kinematics import markers

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("*.py"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example(path, tmp_path, short_cases, few_cycles, hasty, monkeypatch, capsys):
    """As a program in this process; cases, recordings and searches are short, and a diagnosis tries few effects."""
    assert len(path.read_text().splitlines()) < 60 and path.read_text().startswith('"""')
    few = {"tendon.viscous_friction", "servo.latency", "servo.gravity_moment"}
    monkeypatch.setattr(pipeline, "make_problem", lambda case, robot, *_: make_problem(case, robot, frozenset(few)))
    slow = markers.synthesise
    monkeypatch.setattr(markers, "synthesise", lambda *what, **given: slow(*what, **given | {"rate": 25.0}))
    monkeypatch.setattr(sys, "argv", [str(path), str(tmp_path)])
    monkeypatch.chdir(tmp_path)
    with matplotlib.rc_context():
        runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out.strip()
    assert all(figure.read_bytes().startswith(b"\x89PNG") for figure in tmp_path.glob("*.png"))
