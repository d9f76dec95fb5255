"""Making, running and scoring a blind set."""

import json

import pytest
from click.testing import CliRunner

from exodrake.blind import make as making
from exodrake.blind.case_mix import CaseMix
from exodrake.blind.commitment import read_committed, write_committed
from exodrake.blind.matching import covered
from exodrake.blind.score import binomial_interval, score
from exodrake.blind.score_table import as_json, as_markdown, as_table
from exodrake.core.errors import InputError


def truth(effect_id, gap=10.0, exact=True, **parameters):
    block = effect_id.split(".")[0]
    return {
        "id": effect_id,
        "block": block,
        "wires": [],
        "joints": [],
        "parameters": parameters,
        "exact": exact,
        "gap": gap,
    }


def answer(verdict, block=None, effects=(), equivalents=(), closure=(0.97, 0.9), seconds=20.0, baselines=None):
    parts = []
    for name, bounds in effects:
        parameters = {key: {"value": (low + high) / 2, "low": low, "high": high} for key, (low, high) in bounds.items()}
        parts.append({"id": name, "parameters": parameters})
    overall = {"value": closure[0], "low": closure[1], "high": 0.99}
    return {
        "verdict": verdict, "where": {"block": block}, "effects": parts, "equivalents": list(equivalents),
        "closure": {"overall": overall}, "seconds": seconds, "baselines": baselines or {},
    }  # fmt: skip


NONE, GAIN, SLACK, HOMING = ("sensor.gain", {}), "sensor.gain", "tendon.slack", "encoder.homing_offset"
SET = {
    "case_0": ("healthy", [], answer("RETUNE")),
    "case_1": ("healthy", [], answer("NAMED", "sensor", [NONE])),
    "case_2": (
        "single",
        [truth(GAIN, gain=0.05)],
        answer("NAMED", "sensor", [(GAIN, {"gain": (0.04, 0.06)})], baselines={"bic": GAIN}),
    ),
    "case_3": ("single", [truth(SLACK, length=1e-3)], answer("AMBIGUOUS", "encoder", [(HOMING, {})], [HOMING, SLACK])),
    "case_4": (
        "single",
        [truth(GAIN, gain=0.05)],
        answer("NAMED", "tendon", [("tendon.creep", {})], closure=(0.8, 0.5), seconds=90.0),
    ),
    "case_5": ("single", [truth("mocap.gain", gap=1.0, gain=0.01)], answer("NO_GAP")),
    "case_6": (
        "pair",
        [truth(GAIN, gain=0.1), truth("finger.gravity", pitch=0.0)],
        answer("NAMED", "finger", [("finger.gravity", {}), NONE]),
    ),
    "case_7": ("unknown", [truth("outside.wire_snag", exact=False)], answer("UNKNOWN", "tendon")),
    "case_8": ("single", [truth(GAIN, gain=0.2)], answer("NAMED", "sensor", [(GAIN, {"gain": (0.1, 0.15)})])),
}


@pytest.fixture
def tiny(tmp_path):
    folder, labels = tmp_path / "set", tmp_path / "set-labels.json"
    for name, (_, _, diagnosis) in SET.items():
        (folder / name).mkdir(parents=True)
        (folder / name / "case.yaml").write_text("logs: []\n")
        (folder / name / "diagnosis.json").write_text(json.dumps(diagnosis))
    cases = {name: {"kind": kind, "effects": truths} for name, (kind, truths, _) in SET.items()}
    write_committed(cases, labels, folder / "seal.txt")
    return folder, labels


def test_score_of_a_set_done_by_hand(tiny):
    result = score(*tiny)
    found = {item.name: (item.hits, item.total) for item in result.shares}
    assert found == {
        "right block first": (3, 4),
        "right effect first or in its class": (3, 4),
        "both effects of a pair": (1, 1),
        "false alarm on healthy": (1, 2),
        "UNKNOWN on outside effects": (1, 1),
        "wrongly UNKNOWN": (0, 7),
        "missed (NO_GAP or RETUNE) though visible": (0, 5),
        "another effect named, or one too many": (1, 4),
        "lower bound of closure > 0.8 when named": (3, 4),
        "90 % interval covers, same parameter": (1, 2),
        "90 % interval covers, other functional form": (0, 0),
        "done within 60 s": (8, 9),
    }
    baselines = {item.name: (item.hits, item.total) for item in result.baselines}
    assert baselines["always the commonest effect"] == (3, 4)
    assert baselines["bic: right effect"] == (1, 4)
    assert result.quantities["closure when named, median (wanted >= 0.95)"] == pytest.approx(0.97)
    assert result.confusion["sensor.gain", "tendon.creep"] == 1


def test_lanes_count_one_by_one_where_the_truth_sits():
    stated = {"low": 0.04, "high": 0.06}, {"low": 0.07, "high": 0.08}, {"low": -0.01, "high": 0.01}
    effect = {
        "id": GAIN,
        "parameters": {"gain": stated[0]},
        "channels": {"gain": dict(zip(("AF", "MF", "AE"), stated))},
    }
    here = truth(GAIN, gain=0.05) | {"wires": ["AF", "MF"]}
    assert covered(here, {"effects": [effect]}, exact=True) == [True, False]
    assert covered(here, {"effects": [effect]}, exact=False) == []
    assert covered(here, {"effects": [effect | {"channels": {}}]}, exact=True) == [True]


def test_score_prints_everywhere(tiny, tmp_path):
    result = score(*tiny)
    assert as_table(result).row_count == 12 + 6 + 3
    assert json.loads(json.dumps(as_json(result)))["shares"]["right block first"]["hits"] == 3
    assert "| right block first | >= 95 % | 75.0 % |" in as_markdown(result)


def test_command_scores_and_refuses(tiny, tmp_path):
    from exodrake.cli.main import cli

    folder, labels = tiny
    arguments = ["blind", "score", str(folder), "--labels", str(labels), "--markdown", str(tmp_path / "s.md")]
    assert CliRunner().invoke(cli, arguments).exit_code == 0
    assert (tmp_path / "s.md").is_file()
    labels.write_text(labels.read_text().replace("tendon.slack", "tendon.creep"))
    result = CliRunner().invoke(cli, arguments)
    assert result.exit_code == 2
    assert "committed" in result.output


def test_tampered_labels_are_detected(tiny):
    folder, labels = tiny
    page = json.loads(labels.read_text())
    page["cases"]["case_0"]["kind"] = "single"
    labels.write_text(json.dumps(page))
    with pytest.raises(InputError, match="not those committed"):
        read_committed(labels, folder / "seal.txt")


def test_interval_is_clopper_pearson():
    assert binomial_interval(0, 10) == pytest.approx((0.0, 0.3085), abs=1e-4)
    assert binomial_interval(8, 10) == pytest.approx((0.4439, 0.9748), abs=1e-4)


def test_missing_diagnoses_are_counted(tiny):
    folder, labels = tiny
    (folder / "case_0" / "diagnosis.json").unlink()
    result = score(folder, labels)
    assert result.missing == ("case_0",)
    assert result.cases == 8


def test_made_cases_are_read_back_and_labels_stay_outside(tmp_path):
    from exodrake.data.case_folder import read_case

    mix = CaseMix(healthy=0.0, single=0.0, pair=0.0, unknown=1.0)
    labels = making.make(tmp_path / "set", seed=1, cases=1, mix=mix)
    case = read_case(tmp_path / "set" / "case_00")
    assert [item.role for item in case.logs] == ["fit"] * 4 + ["holdout"]
    assert case.repeat_groups[0][1].file == "sweeps_2.csv.gz"
    label = read_committed(labels, tmp_path / "set" / "seal.txt")["case_00"]
    assert label["kind"] == "unknown" and label["gap"] >= 2.0
    assert not any("outside" in path.read_text() for path in (tmp_path / "set").rglob("*.yaml"))
    with pytest.raises(InputError, match="already there"):
        making.make(tmp_path / "set", seed=1, cases=1)
    with pytest.raises(InputError, match="already committed"):
        making.make(tmp_path / "set", seed=1, cases=1, labels=tmp_path / "elsewhere.json")
    with pytest.raises(InputError, match="inside the cases"):
        making.make(tmp_path / "other", seed=1, cases=1, labels=tmp_path / "other" / "labels.json")
