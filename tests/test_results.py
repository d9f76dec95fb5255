"""Results as plain data and files: JSON, NPZ without pickles, pandas; a log by kind; a simulation by name."""

import json

import numpy as np
import pytest
from report_synthetic import diagnosis

import exodrake as exo
from exodrake.core.plain import plain
from exodrake.diagnosis.result import NAMED
from exodrake.estimator.validate import Score

ROBOT = exo.load_robot()
REFERENCE = exo.grasp("caging", ROBOT, rest=0.1, approach=0.2, hold=0.1, release=0.1)
LOG = exo.simulate(ROBOT, REFERENCE)
RESULTS = {
    "Log": lambda: LOG,
    "Case": lambda: exo.Case("a", {}, (exo.CaseLog(LOG, "caging", "fit", None, "a.csv"),)),
    "Robot": lambda: ROBOT.splice("tendon.slack", {"length": 1e-3}),
    "Recording": lambda: exo.record(ROBOT, REFERENCE),
    "Reference": lambda: REFERENCE,
    "Diagnosis": lambda: diagnosis(NAMED),
    "Score": lambda: Score("gp", "sweeps", np.ones(3), np.full(3, np.nan), 0.0),
    "parameters": ROBOT.parameters,
}


@pytest.mark.parametrize("name", RESULTS)
def test_every_result_is_saved_as_json_and_without_pickles(name, tmp_path):
    result = RESULTS[name]()
    exo.save(result, tmp_path / "a.json")
    assert json.loads((tmp_path / "a.json").read_text()) == exo.to_dict(result)
    exo.save(result, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as stored:
        assert isinstance(json.loads(str(stored["json"])), dict)
        assert all(stored[key].dtype.kind in "biuf" for key in stored.files if key != "json")
        for signal, values in result.signals.items() if name == "Recording" else ():
            np.testing.assert_array_equal(stored[f"signals.{signal}"], values)
    for path in ("a.pkl", "a", "nowhere/a.json"):
        with pytest.raises(exo.InputError, match="a"):
            exo.save(result, tmp_path / "none" / path)


def test_what_json_lacks_becomes_null_pairs_and_lists():
    values = [np.float64(2), float("nan"), np.inf, 1 - 2j, np.array([1.0, np.nan]), np.array(3), (1, True), None, min]
    assert plain(values)[:-1] == [2.0, None, None, [1.0, -2.0], [1.0, None], 3, [1, True], None]
    assert exo.to_dict([1])["value"] == [1] and "function" not in exo.to_dict({"function": min, "a": 1})


def test_a_simulation_takes_the_name_of_a_protocol():
    assert exo.simulate(ROBOT, "caging:hold=0.5 s").equals(exo.simulate(ROBOT, exo.grasp("caging", ROBOT, hold=0.5)))
    with pytest.raises(exo.InputError, match="did you mean caging"):
        exo.simulate(ROBOT, "cagin")
    np.testing.assert_array_equal(LOG["tension"], LOG.array("tension", ("AF", "MF", "AE")))
    with pytest.raises(exo.InputError, match="tensions"):
        LOG["tensions"]


def test_pandas_gives_a_log_back_to_the_last_bit():
    pandas = pytest.importorskip("pandas")
    frame = LOG.to_pandas()
    assert frame.index.name == "time" and frame.attrs["units"]["stroke_AF"] == "m"
    assert exo.Log.from_pandas(frame).equals(LOG) and exo.Log.from_pandas(frame.reset_index()).equals(LOG)
    table = pandas.DataFrame({"time [ms]": [0, 20], "tension_AF": [1000.0, 2000.0], "angle_MCP [deg]": [90, 180]})
    log = exo.Log.from_pandas(table, units={"tension_AF": "mN"}, source="mine")
    np.testing.assert_allclose(log.time, [0.0, 0.02])
    np.testing.assert_allclose(log["tension_AF"], [1.0, 2.0])
    np.testing.assert_allclose(log["angle"][:, 0], [np.pi / 2, np.pi])
    late = pandas.DataFrame({"tension_AF": [1, 2]}, index=pandas.to_timedelta([0, 20], unit="ms"))
    np.testing.assert_allclose(exo.Log.from_pandas(late).time, [0.0, 0.02])


@pytest.mark.parametrize(
    ("columns", "word"),
    [
        ({"tension_AF": ["a", "b"]}, "not numeric"),
        ({"heat": [1, 2]}, "kind unknown"),
        ({"tension_AF [m]": [1, 2]}, "[m]"),
        ({"time": [1, 1], "tension_AF": [1, 2]}, "does not come after"),
        ({"angle_PIP": [1, 2], "angle_PIP [deg]": [1, 2]}, "twice"),
    ],
)
def test_frames_that_are_no_log_are_refused_by_column(columns, word):
    pandas = pytest.importorskip("pandas")
    with pytest.raises(exo.InputError) as caught:
        exo.Log.from_pandas(pandas.DataFrame(columns))
    assert word in str(caught.value) and next(iter(columns)).split(" ")[0] in str(caught.value)


def test_without_pandas_one_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(exo.InputError, match=r"exodrake\[pandas\]"):
        LOG.to_pandas()
