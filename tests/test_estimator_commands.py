"""`exodrake train` and `exodrake estimate` end to end, and their refusals: status 2 and nothing half-written."""

import numpy as np
import pytest
from command_line import run
from estimator_sweeps import as_log, worn_sweeps

from exodrake.data.formats import read_log, write_log


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with two training logs, a fresh one, and the estimator trained on the first two with 120 points."""
    folder = tmp_path_factory.mktemp("estimator")
    for name, seed in (("a", 0), ("b", 1), ("fresh", 2)):
        write_log(as_log(worn_sweeps(12, seed, rows=60)), folder / f"{name}.csv.gz")
    logs, options = (folder / "a.csv.gz", folder / "b.csv.gz"), ("--points", 120, "--robot", "exo_index")
    result = run("train", *logs, "--out", folder / "e.npz", *options)
    assert result.exit_code == 0, result.output
    (folder / "table.txt").write_text(result.output)
    return folder


def test_training_prints_both_splits_side_by_side(folder):
    text = (folder / "table.txt").read_text()
    heading = next(line for line in text.splitlines() if "random rows" in line)
    assert "held-out sweeps" in heading
    assert "Gaussian process" in text and "quadratic ridge" in text and "24 sweeps" in text


def test_estimating_adds_columns_and_scores(folder):
    options = ("--estimator", folder / "e.npz", "--out", folder / "out.csv", "--robot", "exo_index")
    result = run("estimate", folder / "fresh.csv.gz", *options)
    assert result.exit_code == 0, result.output
    assert "unlike the training sweeps" in result.output and "DIP: RMSE" in result.output
    log = read_log(folder / "out.csv")
    assert log.array("angle_est").shape == log.array("angle_std").shape == (720, 3)
    assert np.all(log.array("angle_std") > 0)
    assert (folder / "out.png").read_bytes().startswith(b"\x89PNG") and "out.png" in result.output


def test_re_donning_is_reported_and_corrected(folder, tmp_path):
    log = read_log(folder / "fresh.csv.gz")
    worn = log.with_array("stroke", ("MF",), log.array("stroke", ("MF",)) + 1e-3)
    write_log(worn, tmp_path / "worn.csv")
    assert "not moved" in run("estimate", "--estimator", folder / "e.npz", folder / "fresh.csv.gz").output
    corrected = run("estimate", "--estimator", folder / "e.npz", tmp_path / "worn.csv").output
    kept = run("estimate", "--estimator", folder / "e.npz", tmp_path / "worn.csv", "--as-trained").output
    assert "moved, corrected. Re-donned?" in corrected and "not corrected, by --as-trained" in kept
    errors = [float(text.split("MCP: RMSE ")[1].split()[0]) for text in (corrected, kept)]
    assert errors[0] < errors[1] / 3


def test_a_log_without_angles_is_estimated_but_not_trained_on(folder, tmp_path):
    log = read_log(folder / "fresh.csv.gz")
    write_log(log.only([name for name in log.columns if not name.startswith("angle_")]), tmp_path / "blind.csv")
    assert "error unknown" in run("estimate", "--estimator", folder / "e.npz", tmp_path / "blind.csv").output
    result = run("train", tmp_path / "blind.csv", "--out", tmp_path / "e.npz")
    assert result.exit_code == 2 and "angle_... of none" in result.output
    assert not (tmp_path / "e.npz").exists()


def test_other_wires_missing_samples_and_other_robots_are_refused(folder, tmp_path):
    log = read_log(folder / "fresh.csv.gz")
    write_log(log.with_signals({"tension_AF": np.full(len(log), np.nan)}), tmp_path / "nan.csv")
    names = {name: log[name] for name in log.columns if not name.endswith("_AE")}
    write_log(type(log)(log.time, names), tmp_path / "two.csv")
    (tmp_path / "robot.yaml").write_text("base: exo_index\nparameters: {finger.kappa.MCP: 0.09}\n")
    for arguments, message in (
        ([tmp_path / "nan.csv"], "tension_AF"),
        ([tmp_path / "two.csv"], "of AF, MF"),
        ([folder / "fresh.csv.gz", "--robot", tmp_path / "robot.yaml"], "another robot"),
    ):
        result = run("estimate", "--estimator", folder / "e.npz", *arguments, "--out", tmp_path / "out.csv")
        assert result.exit_code == 2 and message in result.output, result.output
        assert not (tmp_path / "out.csv").exists()
