"""Sweeps: each row is the run that `simulate` gives; grids, lists, tolerances, intervals, failures."""

import json
import sys

import numpy as np
import pytest
from command_line import run

import exodrake as exo
from exodrake.analysis.robustness import within_tolerances
from exodrake.analysis.sweep import plot_sweep

MU = "tendon.capstan_friction.mu_phi"
EFFECT = {
    "id": "tendon.capstan_friction", "wires": ["AF", "MF", "AE"], "joints": [], "channels": {},
    "parameters": {"mu_phi": {"value": 0.24, "low": 0.22, "high": 0.26, "unit": "-"}},
}  # fmt: skip


def test_grid_is_all_combinations_and_each_row_a_run(robot):
    table = exo.sweep(robot, {MU: [0.1, 0.3], "finger.kappa.MCP": ["80 mN m/rad", 0.1]}, "caging")
    assert table[MU].tolist() == [0.1, 0.1, 0.3, 0.3] and table["finger.kappa.MCP"].tolist() == [0.08, 0.1] * 2
    assert table.attrs["units"]["finger.kappa.MCP"] == "N m/rad" and table.attrs["units"]["angle_PIP rms"] == "rad"
    one = robot.splice("tendon.capstan_friction", {"mu_phi": 0.3}).with_parameters({"finger.kappa.MCP": 0.1})
    log, nominal = (exo.simulate(r, "caging", seed=None) for r in (one, robot))
    error = log["angle_PIP"] - nominal["angle_PIP"]
    assert table["angle_PIP rms"][3] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
    assert (
        table["angle_PIP peak"][3] == np.abs(log["angle_PIP"]).max()
        and table["angle_PIP final"][3] == log["angle_PIP"][-1]
    )
    figure = plot_sweep(table)
    assert len([axes for axes in figure.axes if axes.collections]) >= 12


def test_robots_within_the_tolerances_are_those_of_the_seed(robot):
    counts = []
    table = exo.sweep(robot, 10, "caging", noise=3, seed=4, progress=lambda *done: counts.append(done))
    robots = [one for _, one in within_tolerances(robot, 10, seed=4)]
    assert table["finger.kappa.MCP"].tolist() == [one["finger.kappa.MCP"] for one in robots]
    assert table["angle_DIP final"][9] == exo.simulate(robots[9], "caging", seed=3)["angle_DIP"][-1]
    assert counts[-1] == (10, 0, 10)


def test_robots_within_the_intervals_of_a_diagnosis_with_a_function_of_the_log(robot, monkeypatch):
    answer = {"verdict": "NAMED", "effects": [EFFECT]}
    table = exo.sweep(robot, answer, "caging", {"end": lambda log: log["angle_PIP"][-1]}, draws=12)
    assert table[f"{MU}.AF"].between(0.22, 0.26).all() and table[f"{MU}.AF"].nunique() == table["end"].nunique() == 12
    assert plot_sweep(table.rename(columns={"end": "tip final"})).axes[0].collections  # one of those left out
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(exo.InputError, match=r"pip install exodrake\[pandas\]"):
        exo.sweep(robot, 2, "caging")


def test_a_run_that_diverges_is_a_row_with_its_reason(robot):
    table = exo.sweep(robot, {"tendon.k": [2700.0, 1e308]}, "caging")
    assert np.isfinite(table["angle_PIP rms"][0])
    assert np.isnan(table["angle_PIP rms"][1]) and "diverges" in table["failed"][1]


@pytest.mark.parametrize(
    ("over", "reason"),
    [
        ({"finger.kapa": [1.0]}, "unknown parameter 'finger.kapa'"),
        ({"finger.kappa": ["1 N"]}, "finger.kappa"),
        ({}, "nothing to run"),
        (0, "nothing to run"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(robot, over, reason):
    with pytest.raises(exo.InputError, match=reason):
        exo.sweep(robot, over, "caging")


def test_command_writes_table_and_figure(tmp_path):
    found = run("sweep", "caging", "--over", f"{MU}=0.1:0.3:3", "--json", "-", "--out", tmp_path / "out")
    assert found.exit_code == 0, found.output
    answer = json.loads(found.stdout)
    assert [row[MU] for row in answer["rows"]] == pytest.approx([0.1, 0.2, 0.3])
    assert len((tmp_path / "out" / "sweep.csv").read_text().splitlines()) == 4
    refused = run("sweep", "caging")
    assert refused.exit_code == 2 and "one of --over, --robots and --diagnosis" in refused.stderr


def test_a_range_that_is_not_low_high_count_is_refused_by_its_form():
    found = run("sweep", "caging", "--over", f"{MU}=0.1:0.3")
    assert found.exit_code == 2 and "is not NAME=VALUE,VALUE nor NAME=LOW:HIGH:COUNT" in found.stderr
