"""Scoring a blind set: synthetic answers whose counts are known by hand, and statistics against closed forms."""

import json
from contextlib import suppress

import pytest
from command_line import run
from fuzzing import bounded, json_bytes, spoilt_page
from hypothesis import given, strategies as st

from exodrake.core.errors import InputError
from exodrake.core.plain import to_dict
from exodrake.reference import make
from exodrake.reference.answers import Answered, read_committed, write_committed
from exodrake.reference.cases import CaseMix
from exodrake.reference.score import (
    Paired,
    compute_shares,
    count_share,
    interval_score,
    is_in_class,
    is_kind_right,
    is_named_exactly,
    is_truth,
    list_intervals,
    markdown,
    pair_shares,
    score,
    tables,
)


def truth(effect_id, gap=10.0, exact=True, blocks=(), wires=(), joints=(), **parameters):
    block = effect_id.split(".")[0]
    return {
        "id": effect_id, "block": block, "blocks": list(blocks or (block,)), "wires": list(wires),
        "joints": list(joints), "parameters": parameters, "exact": exact, "gap": gap,
    }  # fmt: skip


def answer(verdict, block=None, effects=(), wires=(), joints=(), run_time=20.0, closed=None, rivals=(), **rest):
    parts = []
    for name, bounds in dict(effects).items():
        parameters = {key: {"value": (low + high) / 2, "low": low, "high": high} for key, (low, high) in bounds.items()}
        parts.append({"id": name, "parameters": parameters, "rivals": [{"id": rival} for rival in rivals]})
    closure = {"overall": {"value": 0.97, "low": 0.9, "high": 0.99}}
    if closed is not None:
        closure["effect"] = {"value": closed + 0.05, "low": closed, "high": closed + 0.1}
    where = {"block": block, "wires": list(wires), "joints": list(joints)}
    return {"verdict": verdict, "where": where, "effects": parts, "closure": closure, "seconds": run_time} | rest


GAIN, SLACK, HOMING, CREEP = "sensor.gain", "tendon.slack", "encoder.homing_offset", "tendon.creep"
SNAG = truth("outside.wire_snag", exact=False, blocks=["tendon"], wires=["AF"])
JUMP = truth("outside.marker_jump", exact=False, blocks=["mocap"], joints=["PIP"])
SLOW_STRETCH = truth(CREEP, exact=False, stiffness=8000.0, time_constant=5.0)
SET = {
    "case_00": ("healthy", [], answer("RETUNE", "none")),
    "case_01": ("healthy", [], answer("NAMED", "sensor", {GAIN: {}})),
    "case_02": (
        "single", [truth(GAIN, gain=0.05, wires=["AF"])],
        answer(
            "NAMED", "sensor", {GAIN: {"gain": (0.04, 0.06)}}, ["AF"], closed=0.85, simulated_seconds=50e3,
        ),
    ),
    "case_03": (
        "single", [truth(SLACK, length=1e-3, wires=["MF"])],
        answer("AMBIGUOUS", "encoder", {HOMING: {}}, ["MF"], rivals=[SLACK], simulated_seconds=70e3),
    ),
    "case_04": (
        "single", [truth(GAIN, gain=0.05)],
        answer("NAMED", "tendon", {CREEP: {}}, run_time=90.0, closed=0.5),
    ),
    "case_05": ("single", [truth("mocap.gain", gap=1.0, gain=0.01)], answer("NO_GAP", "none")),
    "case_06": (
        "pair", [truth(GAIN, gain=0.1), truth("finger.gravity", pitch=0.0)],
        answer("NAMED", "finger", {"finger.gravity": {}, GAIN: {}}),
    ),
    "case_07": ("unknown", [SNAG], answer("UNKNOWN", "tendon", wires=["AF", "MF"])),
    "case_08": ("single", [truth(GAIN, gain=0.2)], answer("NAMED", "sensor", {GAIN: {"gain": (0.1, 0.15)}})),
    "case_09": (
        "pair", [truth(GAIN, gain=0.1), truth("mocap.gain", gain=0.1, joints=["DIP"])],
        answer("NAMED", "sensor", {GAIN: {}, "mocap.gain": {}, CREEP: {}}, joints=["PIP", "DIP"]),
    ),
    "case_10": (
        "three", [truth(SLACK, length=1e-3), truth(GAIN, gain=0.1), SLOW_STRETCH],
        answer("NAMED", "tendon", {HOMING: {}, CREEP: {"stiffness": (9e3, 1e4), "time_constant": (4, 6)}, GAIN: {}}),
    ),
    "case_11": ("single", [truth(HOMING, offset=1e-3)], answer("NAMED", "tendon", {SLACK: {}})),
    "case_12": ("unknown", [JUMP], answer("NAMED", "tendon", {CREEP: {}}, joints=["PIP"])),
    "case_13": ("single", [truth(GAIN, gain=0.1)], answer("UNKNOWN", "sensor", candidates=[{"id": GAIN}])),
    "case_14": ("same-block", [truth(CREEP), truth(SLACK)], answer("RETUNE", "none")),
}  # fmt: skip


def written(folder, answers):
    """Write answers, each into the folder of its case."""
    for name, diagnosis in answers.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / name / "case.yaml").write_text("logs: []\n")
        (folder / name / "diagnosis.json").write_text(json.dumps(diagnosis))
    return folder


@pytest.fixture
def tiny(tmp_path):
    folder = written(tmp_path / "set", {name: diagnosis for name, (_, _, diagnosis) in SET.items()})
    labels = tmp_path / "set-labels.json"
    cases = {name: {"kind": kind, "effects": truths} for name, (kind, truths, _) in SET.items()}
    write_committed(cases, labels, folder / "seal.txt")
    return folder, labels


def test_score_of_a_set_done_by_hand(tiny):
    result = score(*tiny)
    (mix,) = result.mixes.values()
    assert {name: (item.hits, item.total) for name, item in mix.shares.items()} == {
        "exactly named, single": (3, 6),
        "exactly named, pair": (1, 2),
        "exactly named, same-block": (0, 1),
        "exactly named, three": (1, 1),
        "truth named or in its class, single": (3, 6),
        "truth named or in its class, pair": (2, 2),
        "truth named or in its class, same-block": (0, 1),
        "truth named or in its class, three": (1, 1),
        "kind and block right, single": (2, 6),
        "kind and block right, pair": (1, 2),
        "kind and block right, same-block": (0, 1),
        "kind and block right, three": (1, 1),
        "PARTLY, and its causes hold the truth": (0, 0),
        "truth first": (6, 10),
        "UNKNOWN outside the library": (1, 2),
        "not named outside the library": (1, 2),
        "wrongly UNKNOWN": (1, 12),
        "false alarm on healthy": (1, 2),
        "missed (NO_GAP or RETUNE) though visible": (1, 10),
        "another effect named, or one too many": (3, 7),
        "block right": (8, 12),
        "tendons right": (2, 3),
        "joints right": (1, 2),
        "C(effect given retune), lower bound > 0.8": (1, 2),
        "90 % interval covers, same meaning": (1, 2),
        "90 % interval covers, other law": (1, 2),
    }
    assert {(GAIN, CREEP, False, 1), ("healthy", "RETUNE", True, 1)} <= set(result.confusion)


def test_answers_without_an_entry_or_missing_are_not_counted_and_a_failed_case_is_wrong(tiny):
    folder, labels = tiny
    page = folder / "case_02" / "diagnosis.json"
    page.write_text(json.dumps({"verdict": "NAMED", "effects": [{"id": GAIN}]}))

    def counted():
        return {name: (one.hits, one.total) for name, one in score(folder, labels).mixes["standard"].shares.items()}

    bare = counted()
    assert (
        bare["block right"] == (7, 11) and bare["tendons right"] == (1, 2) and bare["exactly named, single"] == (3, 6)
    )
    assert bare["C(effect given retune), lower bound > 0.8"] == (0, 1)
    page.rename(page.with_name("failed.json"))
    failed = counted()
    assert failed["block right"] == (7, 12) and failed["exactly named, single"] == (2, 6)
    (folder / "case_00" / "diagnosis.json").unlink()
    result = score(folder, labels)
    assert result.missing == ("case_00",) and result.cases == 14


def test_quantities_of_a_set_done_by_hand(tiny):
    quantities = score(*tiny).mixes["standard"].quantities
    found = {name: (pytest.approx(item.value, nan_ok=True), item.cases) for name, item in quantities.items()}
    assert found["size of an AMBIGUOUS class, mean"] == (2.0, 1)
    assert found["C(overall) when named, median"] == (0.97, 7)
    assert found["C(effect given retune) when named, median"] == (0.725, 2)
    assert found["C(retune) when named, median"][1] == 0
    assert found["relative half width, same meaning, median"] == ((0.2 + 0.125) / 2, 2)
    assert found["relative half width, other law, median"] == ((0.2 + 0.0625) / 2, 2)
    assert found["relative interval score, same meaning, mean"] == ((0.4 + 5.25) / 2, 2)
    assert found["relative interval score, other law, mean"] == ((0.4 + 2.625) / 2, 2)
    assert found["simulated seconds a case, median"] == (60e3, 2)
    assert found["simulated seconds a case, 95 %"] == (69e3, 2)
    assert found["seconds a case, median"] == (20.0, 15)
    assert found["seconds a case, 95 %"] == (20.0 + 0.3 * 70.0, 15)


def test_two_methods_are_compared_on_the_cases_that_both_answered(tiny, tmp_path):
    others = {name: diagnosis for name, (_, _, diagnosis) in SET.items() if name != "case_03"}
    others["case_02"] = answer("UNKNOWN", "sensor")
    others["case_04"] = answer("NAMED", "sensor", {GAIN: {}})
    others["case_11"] = answer("NAMED", "encoder", {HOMING: {}})
    folder, labels = tiny
    found = score(folder, labels, written(tmp_path / "other", others)).mixes["standard"].paired
    assert found["exactly named, single"] == Paired(both=1, first=1, second=2, neither=1, p=pytest.approx(1.0))
    assert found["block right"] == Paired(both=7, first=0, second=2, neither=2, p=0.5)


def test_mcnemar_is_the_sign_test_of_a_textbook():
    """Fore and hind leg lengths of ten deer (Zar, Biostatistical Analysis, sign test)."""
    first = count_share({deer: deer < 8 for deer in range(10)})
    second = count_share({deer: deer >= 8 for deer in range(10)})
    assert pair_shares(first, second) == Paired(0, 8, 2, 0, p=pytest.approx(0.109375))
    assert pair_shares(first, first) == Paired(8, 0, 0, 2, p=1.0)


@pytest.mark.parametrize(("true", "penalty"), [(0.5, 0.0), (-0.1, 2.0), (1.3, 6.0)])
def test_interval_score_is_width_plus_a_penalty_of_two_over_alpha(true, penalty):
    assert interval_score(0.0, 1.0, true) == pytest.approx(1.0 + penalty)


def cause(name, *rivals, role="cause"):
    return {"id": name, "role": role, "rivals": [{"id": rival} for rival in rivals]}


def judged(truths, **answered):
    return Answered("case", "single", [truth(name) for name in truths], answered)


def test_effects_that_no_log_tells_apart_count_as_one_name():
    pair = [truth(SLACK), truth(HOMING, offset=-1e-3)]
    assert is_truth(pair, (HOMING, SLACK)) and not is_truth(pair, (HOMING,)) and not is_truth(pair, (SLACK, CREEP))
    assert not is_truth([truth(SLACK), truth(CREEP)], (CREEP, GAIN)) and not is_truth([truth(GAIN)], (GAIN, CREEP))
    for others, exact in (([SLACK], True), ([], True), ([SLACK, CREEP], False), ([GAIN], False)):
        verdict = answer("AMBIGUOUS", "encoder", {HOMING: {}}, rivals=others)
        assert is_named_exactly(judged([SLACK], **verdict)) == exact


def test_each_cause_has_rivals_of_its_own_and_refinements_do_not_count():
    """Of one cause and two truths at most one is in the class; kind and block count before the law."""
    latency, coulomb, stribeck = "timing.command_latency", "tendon.coulomb_friction", "tendon.stribeck_friction"
    assert is_in_class([truth(latency), truth(GAIN)], {"effects": [cause(CREEP, latency), cause(GAIN)]})
    assert not is_in_class([truth(latency), truth(GAIN)], {"effects": [cause(CREEP, latency, GAIN)]})
    refined = judged([GAIN], verdict="NAMED", effects=[cause(GAIN), cause(CREEP, role="refinement")])
    assert is_named_exactly(refined)
    for right in (cause(stribeck), cause(coulomb, stribeck)):
        assert is_kind_right([truth(coulomb)], {"effects": [right]})
    for wrong in ([cause(GAIN)], [cause(coulomb, GAIN)], [cause(coulomb), cause(GAIN)], []):
        assert not is_kind_right([truth(coulomb)], {"effects": wrong})
    partly = judged([GAIN], verdict="PARTLY", effects=[cause(GAIN)])
    assert not is_named_exactly(partly) and is_in_class(partly.truths, partly.diagnosis)
    rows = {name: item.hits for name, item in compute_shares([partly]).items()}
    assert rows["PARTLY, and its causes hold the truth"] == 1 and rows["exactly named, single"] == 0


def test_channels_count_one_by_one_where_the_truth_sits():
    stated = {"low": 0.04, "high": 0.06}, {"low": 0.07, "high": 0.08}, {"low": -0.01, "high": 0.01}
    effect = {
        "id": GAIN,
        "parameters": {"gain": stated[0]},
        "channels": {"gain": dict(zip(("AF", "MF", "AE"), stated))},
    }
    truths = [truth(GAIN, gain=0.05, wires=["AF", "MF"])]

    def covers(effect):
        answered = Answered("case", "single", truths, {"verdict": "NAMED", "effects": [effect]})
        return [interval.covers for interval in list_intervals(answered)]

    assert covers(effect) == [True, False]
    assert covers(effect | {"channels": {}}) == [True]
    assert covers(effect | {"id": CREEP}) == []


def test_score_prints_each_mix_and_leaves_out_rows_without_cases(tiny):
    folder, labels = tiny
    cases = read_committed(labels, folder / "seal.txt")
    cases["case_13"]["mix"] = "small"
    write_committed(cases, labels, folder / "seal.txt")
    result = score(folder, labels)
    assert {name: mix.cases for name, mix in result.mixes.items()} == {"standard": 14, "small": 1}
    titles = ["standard, 14 cases", "small, 1 case", "truth and answer, 15 cases"]
    assert [title for title, _, _ in tables(result)] == titles
    page = markdown(tables(result))
    assert "| exactly named, single | >= 92 % | 60.0 % |" in page and "| wrongly UNKNOWN | <= 3 % | 100.0 % |" in page
    assert page.count("| truth first |") == 2 and page.count("| false alarm on healthy |") == 1
    words = ("blind", "score", folder, "--labels", labels, "--markdown", folder / "s.md", "--against", folder)
    assert run(*words).exit_code == 0 and page[:40] in (folder / "s.md").read_text()
    small = json.loads(json.dumps(to_dict(result)))["mixes"]["small"]
    assert small["shares"]["truth first"]["hits"] == 1 and small["shares"]["false alarm on healthy"]["value"] is None


@bounded(4)
@given(data=st.data(), what=st.sampled_from(["answer", "labels"]))
def test_damaged_answers_and_labels_are_scored_or_refused_by_name(tiny, data, what):
    """Some spoilt files are whole enough to be scored; none may end in another error."""
    folder, labels = tiny
    page, whole = folder / "case_02" / "diagnosis.json", json.loads(json.dumps(SET["case_02"][2]))
    cases = {name: {"kind": kind, "effects": truths} for name, (kind, truths, _) in SET.items()}
    page.write_bytes(data.draw(spoilt_page(whole, json_bytes)) if what == "answer" else json_bytes(whole))
    with suppress(AttributeError, TypeError, ValueError):  # of what is no JSON and cannot be committed
        spoilt = json.loads(data.draw(spoilt_page(cases, json_bytes))) if what == "labels" else cases
        write_committed(spoilt, labels, folder / "seal.txt")
    try:
        markdown(tables(score(folder, labels)))
    except InputError as error:
        assert (page.name if what == "answer" else labels.name) in str(error) or "configurations" in str(error)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "\x00", '{"salt": 1, "cases": {}}', "[]", '{"salt": "a"}'])
def test_files_that_are_no_labels_or_no_answers_are_refused_in_one_line(tiny, text):
    folder, labels = tiny
    for path in (folder / "case_03" / "diagnosis.json", labels):
        whole = path.read_text()
        path.write_text(text)
        result = run("blind", "score", folder, "--labels", labels)
        assert result.exit_code == 2 and path.name in result.stderr and len(result.stderr.splitlines()) == 1
        path.write_text(whole)


def test_made_cases_are_read_back_and_labels_stay_outside(tmp_path):
    from exodrake.data.case import read_case

    labels = make.make(tmp_path / "set", seed=1, cases=1, mixes=[CaseMix(weights={"unknown": 1.0})])
    case = read_case(tmp_path / "set" / "case_00")
    assert [item.role for item in case.logs] == ["fit"] * 4 + ["holdout"]
    assert case.repeat_groups[0][1].file == "sweeps_2.csv.gz"
    label = read_committed(labels, tmp_path / "set" / "seal.txt")["case_00"]
    assert label["kind"] == "unknown" and label["gap"] >= 2.0
    assert not any("outside" in path.read_text() for path in (tmp_path / "set").rglob("*.yaml"))
    with pytest.raises(InputError, match="already there"):
        make.make(tmp_path / "set", seed=1, cases=1)
    with pytest.raises(InputError, match="already committed"):
        make.make(tmp_path / "set", seed=1, cases=1, labels=tmp_path / "elsewhere.json")
    with pytest.raises(InputError, match="inside the cases"):
        make.make(tmp_path / "other", seed=1, cases=1, labels=tmp_path / "other" / "labels.json")
