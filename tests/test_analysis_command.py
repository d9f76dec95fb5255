"""`exodrake analyse`: files, tables, and bad input."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from exodrake.cli.main import cli


def run(*arguments):
    return CliRunner().invoke(cli, ["analyse", *map(str, arguments)])


def test_it_writes_figures_numbers_and_the_model(tmp_path):
    found = run("--out", tmp_path / "a", "--json", tmp_path / "b.json", "--to-control", tmp_path / "m.npz")
    assert found.exit_code == 0, found.output
    assert "spectral radius 0.96" in found.output and "stable up to" in found.output
    names = {path.name for path in (tmp_path / "a").iterdir()}
    assert names == {"steps.png", "poles.png", "stability.png", "bode.png", "margins.png", "analysis.json"}
    assert (tmp_path / "a" / "bode.png").read_bytes().startswith(b"\x89PNG")
    parameters = json.loads((tmp_path / "b.json").read_text())
    assert parameters["stable"] and parameters["margins"]["MF"]["gain_margin"] > 2.0
    assert parameters["steps"]["AF"]["overshoot"] < 0.02 and abs(parameters["steps"]["AF"]["steady_error [N]"]) < 1e-3
    limit = dict(zip(parameters["stability_map"]["kd [m/N]"], parameters["stability_map"]["kp_limit [m/(s N)]"]))
    assert max(v for v in limit.values() if v) == pytest.approx(0.0209, abs=0.001)
    with np.load(tmp_path / "m.npz") as model:
        assert float(model["dt"]) == 0.02 and model["A"].shape[0] == len(model["states"])


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--at", "AF=4"], "MF"), (["--at", "AF:4"], "AF:4"), (["--at", "AF=4,AF=3"], "AF=3"),
        (["--set", "controller.kpp=1"], "kpp"), (["--effect", "no.such"], "no.such"), (["--part", "x"], "'x'"),
        (["--robot", "absent.yaml"], "absent.yaml"), (["--set", "controller.kp=0"], "kp = 0"),
        (["--at", "AF=nan,MF=1,AE=1"], "AF"),
    ],
)  # fmt: skip
def test_bad_input_is_a_line_and_leaves_nothing(tmp_path, arguments, word):
    found = run(*arguments, "--out", tmp_path / "a")
    assert found.exit_code == 2
    assert word in found.output and len(found.output.strip().splitlines()) == 1
    assert not (tmp_path / "a").exists()


def test_a_machine_without_tension_loop_is_refused_in_one_sentence():
    result = CliRunner().invoke(cli, ["analyse", "--robot", "emps"])
    assert result.exit_code == 2
    assert "emps: no tension loop to analyse (it lacks tension_ref" in result.output
