"""Running and making a blind set: interrupted and taken up again, in one process and in two."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from exodrake.cli.main import cli
from exodrake.core.errors import InputError
from exodrake.data.case import read_case
from exodrake.diagnosis import many
from exodrake.diagnosis.many import diagnose_all, diagnose_one
from exodrake.reference import make
from exodrake.reference.answers import find_cases, read_committed
from exodrake.reference.cases import MIXES
from exodrake.reference.score import score
from tests.short_sets import RUN, answers, write_set

HEALTHY = (replace(MIXES["healthy"], duration=0.25),)
PACKAGE = Path(make.__file__).parents[2]


def run(folder, **options):
    return diagnose_all({case: case for case in find_cases(folder)}, **options)


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    """Answers to a set of three healthy cases and one with friction, found one after another."""
    folder = tmp_path_factory.mktemp("blind") / "set"
    write_set(folder, healthy=3, rusty=1)
    steps = []
    assert run(folder, progress=lambda *step: steps.append(step)) == {}
    assert steps[0] == (0, 0, 4) and steps[-1] == (4, 0, 4)
    found = answers(folder)
    assert [answer["verdict"] for _, answer in sorted(found.items())] == ["NO_GAP"] * 3 + ["NAMED"]
    return found


def command(*words):
    environment = os.environ | {"PYTHONPATH": str(PACKAGE), "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-m", "exodrake", "blind", *words], stderr=subprocess.PIPE, text=True, env=environment
    )


def written(folder):
    """Answer -> when it was written."""
    return {path: path.stat().st_mtime_ns for path in folder.glob("*/diagnosis.json")}


def test_killed_twice_and_taken_up_again_gives_the_same_answers(uninterrupted, tmp_path):
    """Once at once, alone, and once with time to say so, with a worker process."""
    write_set(tmp_path / "set", healthy=3, rusty=1)
    kept = {}
    for jobs, deadly in (("1", signal.SIGKILL), ("2", signal.SIGTERM)):
        process = command("run", str(tmp_path / "set"), "--jobs", jobs)
        while process.poll() is None and len(written(tmp_path / "set")) == len(kept):
            time.sleep(0.01)
        process.send_signal(deadly)
        said = process.communicate()[1]
        before, kept = kept, written(tmp_path / "set")
        assert len(before) < len(kept) < 4 and before.items() <= kept.items()
    assert process.returncode == 130 and f"interrupted; {len(kept)} of 4 done" in said and "Traceback" not in said
    assert run(tmp_path / "set") == {}
    assert answers(tmp_path / "set") == uninterrupted
    assert kept.items() <= written(tmp_path / "set").items()


def test_an_answer_written_as_the_interruption_comes_is_counted(tmp_path, monkeypatch):
    write_set(tmp_path / "set", healthy=2)
    counts, write = [], many.write_folder

    def interrupted(*arguments):
        write(*arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr(many, "write_folder", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "set", progress=lambda *count: counts.append(count))
    assert counts == [(0, 0, 2), (1, 0, 2)]


def test_a_case_that_fails_is_recorded_tried_again_and_counted(tmp_path):
    folder = tmp_path / "set"
    labels = write_set(folder, healthy=2)
    log = folder / "case_01" / "fit.csv"
    whole = log.read_text()
    log.write_text(whole[: len(whole) // 2].rsplit("\n", 1)[0] + "\n0.1,what,is,this\n")
    failed = run(folder)
    assert list(failed) == ["case_01"] and "fit.csv" in failed["case_01"]
    assert json.loads((folder / "case_01" / "failed.json").read_text())["reason"] == failed["case_01"]
    result = score(folder, labels)
    assert result.failed == ("case_01",) and result.missing == () and result.cases == 2
    alarms = result.mixes["standard"].shares["false alarm on healthy"]
    assert (alarms.hits, alarms.total) == (1, 2)
    log.write_text(whole)
    assert run(folder) == {}
    assert sorted(answers(folder)) == ["case_00", "case_01"] and not list(folder.glob("*/failed.json"))


def test_answers_of_another_configuration_are_refused_or_redone(tmp_path):
    folder = tmp_path / "set"
    labels = write_set(folder, healthy=2)
    run(folder)
    page = folder / "case_00" / "diagnosis.json"
    answer = json.loads(page.read_text())
    page.write_text(json.dumps(answer | {"configuration": answer["configuration"] | {"code": "of yesterday"}}))
    with pytest.raises(InputError, match=r"case_00: answered with .*code of yesterday.*1 of 2.*--redo"):
        run(folder)
    with pytest.raises(InputError, match="several configurations"):
        score(folder, labels)
    kept = (folder / "case_01" / "diagnosis.json").stat().st_mtime_ns
    run(folder, redo=True)
    assert answers(folder)["case_00"] == {key: value for key, value in answer.items() if key not in RUN}
    assert (folder / "case_01" / "diagnosis.json").stat().st_mtime_ns == kept


def test_a_worker_with_another_configuration_gives_no_answer(tmp_path):
    write_set(tmp_path / "set", healthy=1)
    with pytest.raises(RuntimeError, match=r"the run uses version of tomorrow"):
        diagnose_one(read_case(tmp_path / "set" / "case_00"), "", {"version": "of tomorrow"})


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.glob("case_*/*")}


def test_a_set_is_the_same_whatever_made_it_and_an_interrupted_one_is_completed(tmp_path):
    labels = make.make(tmp_path / "one", 5, 3, mixes=HEALTHY)
    in_two = make.make(tmp_path / "two", 5, 3, mixes=HEALTHY, jobs=2)

    def stop(done, failed, total):
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make.make(tmp_path / "cut", 5, 3, mixes=HEALTHY, progress=stop)
    assert len(list((tmp_path / "cut").glob("case_*"))) == 1 and not (tmp_path / "cut-labels.json").exists()
    (tmp_path / "cut" / ".case_02.123.part").mkdir()  # as a killed process leaves it
    with pytest.raises(InputError, match="started with another seed"):
        make.make(tmp_path / "cut", 6, 3, mixes=HEALTHY)
    completed = make.make(tmp_path / "cut", 5, 3, mixes=HEALTHY)
    assert contents(tmp_path / "one") == contents(tmp_path / "two") == contents(tmp_path / "cut")
    committed = [
        read_committed(path, tmp_path / name / "seal.txt")
        for path, name in ((labels, "one"), (in_two, "two"), (completed, "cut"))
    ]
    assert committed[0] == committed[1] == committed[2] and len(committed[0]) == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        name + end for name in ("one", "two", "cut") for end in ("", "-labels.json")
    )
    assert sorted(path.name for path in (tmp_path / "cut").iterdir()) == ["case_00", "case_01", "case_02", "seal.txt"]


def test_diagnose_takes_several_cases(uninterrupted, tmp_path):
    write_set(tmp_path / "set", healthy=2)
    cases = [str(tmp_path / "set" / name) for name in ("case_00", "case_01")]
    result = CliRunner().invoke(cli, ["diagnose", *cases, "--out", str(tmp_path / "out"), "--jobs", "1"])
    assert result.exit_code == 0 and result.output.count("NO_GAP") == 2, result.output
    assert answers(tmp_path / "out") == {name: uninterrupted[name] for name in ("case_00", "case_01")}
    assert not list((tmp_path / "set").glob("*/diagnosis.json"))
    page = (tmp_path / "out" / "fleet.html").read_text()
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "log.csv").write_text("time [s]\n")
    printed = CliRunner().invoke(
        cli, ["diagnose", *cases, str(tmp_path / "damaged"), "--out", str(tmp_path / "out"), "--json"]
    )
    listed = [(answer["case"], answer["verdict"]) for answer in json.loads(printed.stdout)]
    assert listed == [("case_00", "NO_GAP"), ("case_01", "NO_GAP"), ("damaged", "FAILED")] and printed.exit_code == 1
    for name in ("case_00", "case_01"):
        assert (tmp_path / "out" / name / "report.html").is_file() and f'href="{name}/report.html"' in page


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["a", "b", "--out", "o", "--report", "x.html"], "--report is for one case"),
        (["a", "--cluster", "nowhere"], "for several cases"),
        (["c/a", "d/c/a", "--out", "o"], "same name as c/a"),
        (["a", "gone", "--out", "o"], "gone: no such file or folder"),
    ],
)
def test_diagnose_refuses_what_does_not_fit_before_it_works(tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b", "c/a", "d/c/a"):
        (tmp_path / name).mkdir(parents=True)
    result = CliRunner().invoke(cli, ["diagnose", *words])
    assert result.exit_code == 2 and said in result.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "c", "d"]
