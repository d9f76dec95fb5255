"""Every example runs, stays short, and says something."""

import runpy
import sys
from pathlib import Path

import matplotlib
import pytest

from exodrake.analysis import tuning

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("*.py"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example(path, tmp_path, short_cases, monkeypatch, capsys):
    """As a program in this process; the case that is diagnosed is short, and so is the search for gains."""
    assert len(path.read_text().splitlines()) < 60 and path.read_text().startswith('"""')
    monkeypatch.setattr(tuning, "SEARCH", tuning.SEARCH | {"maxiter": 3})
    monkeypatch.setattr(sys, "argv", [str(path), str(tmp_path)])
    monkeypatch.chdir(tmp_path)
    with matplotlib.rc_context():
        runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out.strip()
    assert all(figure.read_bytes().startswith(b"\x89PNG") for figure in tmp_path.glob("*.png"))
