"""A fleet: answers of many cases as one table and one page, with onsets, failures and spoilt files that are known."""

import json
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial

import command_line
import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest
from click.testing import CliRunner
from report_synthetic import diagnosis
from scipy.stats import binom

from exodrake.cli.diagnose import NO_ANSWER
from exodrake.cli.main import cli
from exodrake.core.confidence import ALPHA
from exodrake.core.errors import InputError
from exodrake.diagnosis.change_point import RAMP, STEP
from exodrake.diagnosis.fleet import (
    FAILURE,
    Amount,
    Row,
    find_trends,
    read_answers,
    read_row,
    read_table,
    sort_rows,
    table_bytes,
)
from exodrake.diagnosis.many import read_stored
from exodrake.diagnosis.result import CAUSE, NAMED, NO_GAP, REFINEMENT, RETUNE, UNKNOWN
from exodrake.report.fleet import fleet_html, members, strip

START = datetime(2026, 1, 5, tzinfo=UTC)
EFFECT = "tendon.capstan_friction"


def robot(serial, size, days=60, seed=0):
    """Cases of one robot, one a day; size: day -> amplitude, 0 for none."""
    rng, rows = np.random.default_rng(seed), []
    for day in range(days):
        value = size(day) + 0.01 * rng.standard_normal()
        amounts = (Amount(EFFECT, "mu_phi", "AF", value, 0.8 * value, 1.2 * value, "-"),) if size(day) else ()
        verdict, effects = (NAMED, (EFFECT,)) if size(day) else (RETUNE, ())
        date = START + timedelta(days=day)
        rows.append(Row(f"{serial}-{day:03d}", serial, "exo_index", date, verdict, effects=effects, amounts=amounts))
    return rows


FLEET = sort_rows([
    *robot("steady", lambda day: 0.3, seed=1),
    *robot("healthy", lambda day: 0.0, seed=2),
    *robot("loosened", lambda day: 0.25 * (day >= 33), seed=3, days=150),
    *robot("worn", lambda day: 0.2 + 0.01 * max(day - 20, 0), seed=4),
])  # fmt: skip


def test_injected_onsets_are_dated_and_steady_robots_are_not():
    found = {m.serial: m for m in members(FLEET)}
    assert not found["steady"].changes and not find_trends(found["healthy"].rows)
    (loosened,), (worn,) = found["loosened"].changes, found["worn"].changes
    assert loosened.change.shape == STEP and loosened.change.began[1] <= 32.5 <= loosened.change.began[2]
    assert loosened.change.after[0] == pytest.approx(0.25, abs=0.01)
    assert worn.change.shape == RAMP and worn.change.began[1] <= 20.0 <= worn.change.began[2]
    assert worn.change.rate[0] == pytest.approx(0.01, abs=5e-4)
    assert worn.moment(worn.change.began[0])[:7] == "2026-01"
    rows = robot("worn", lambda day: 0.2 + 0.01 * max(day - 20, 0), seed=4)  # cases without a name say nothing of it
    hidden = [replace(r, verdict=UNKNOWN, effects=(), amounts=()) if k % 3 == 0 else r for k, r in enumerate(rows)]
    (trend,) = find_trends(hidden)
    assert trend.values.min() > 0.15 and trend.change.began[1] <= 20.0 <= trend.change.began[2]


def cases_of(values, effect=EFFECT, parameter="mu_phi", unit="-"):
    """Weekly cases of one robot that name an effect with these amplitudes; None for a case without a gap."""
    rows = []
    for k, value in enumerate(values):
        amounts = () if value is None else (Amount(effect, parameter, "AF", value, 0.8 * value, 1.2 * value, unit),)
        date, verdict = START + timedelta(weeks=k), NO_GAP if value is None else NAMED
        rows.append(Row(f"c{k:02d}", "r", "exo_index", date, verdict, amounts=amounts))
    return rows


@pytest.mark.parametrize("count", [5, 12])
def test_effects_that_are_named_now_and_then_are_no_change(count):
    """Each case names the effect with the same probability, so any change is a false one: 2 % of robots at most."""
    rng, changed, robots = np.random.default_rng(count), 0, 100
    for _ in range(robots):
        named = rng.random(count) < 0.15
        found = find_trends(cases_of([float(rng.normal(0.3, 0.03)) if one else None for one in named]))
        changed += any(trend.change is not None for trend in found)
    assert changed <= binom.ppf(0.999, robots, ALPHA)


def test_an_effect_that_is_not_named_counts_as_its_null_value():
    """The stiffness of a healthy finger has the factor 1; a garment that does not yield is rigid."""
    (trend,) = find_trends(cases_of([None] * 8 + [1.6] * 8, "finger.stiffness", "factor"))
    assert trend.change.before[0] == pytest.approx(1.0) and trend.change.after[0] == pytest.approx(1.6)
    (trend,) = find_trends(cases_of([None] * 8 + [2000.0] * 8, "tendon.compliance", "stiffness", "N/m"))
    assert (trend.parameter, trend.unit) == ("1 / stiffness", "1/(N/m)")
    assert trend.change.before[0] == 0.0 and trend.change.after[0] == pytest.approx(1.0 / 2000.0)


def test_the_table_gives_the_rows_back(tmp_path):
    rows = [*FLEET, Row("x", "x", reason="lost")]
    (tmp_path / "t.parquet").write_bytes(table_bytes(rows))
    back = read_table(tmp_path / "t.parquet")
    assert [repr(row) for row in back] == [repr(row) for row in sort_rows(rows)]


def test_tables_that_are_damaged_or_of_other_columns_are_refused_by_name(tmp_path):
    path = tmp_path / "t.parquet"

    def refused(said):
        with pytest.raises(InputError, match=said):
            read_table(path)

    for spoilt in (b"", b"PAR1", b"PAR1" + bytes(200) + b"PAR1"):
        path.write_bytes(spoilt)
        refused(r"t\.parquet")
    parquet.write_table(arrow.table({"case": ["a"]}), path)
    refused("column 'serial' is missing")
    path.write_bytes(table_bytes(FLEET[:1]))
    whole = parquet.read_table(path)
    for column, cells in (("serial", [None]), ("verdict", [b"\xff\xfe"]), ("effects", [[b"\xff\xfe"]])):
        parquet.write_table(whole.set_column(whole.column_names.index(column), column, arrow.array(cells)), path)
        refused(r"t\.parquet")


def test_the_page_says_robots_causes_dates_and_failures():
    html = fleet_html([*FLEET, Row("lost-1", "lost", reason="KilledWorker: <gone>")], "answers")
    text = re.sub(r"<[^>]+>", " ", html.split("<main>")[1])
    for said in ("steady", "worn", EFFECT, "2026-01-05 to 2026-06-03", "331", "KilledWorker: &lt;gone&gt;"):
        assert said in text
    assert "://" not in html.split("<script>")[0]
    assert len(json.loads(re.search(r'id="timelines">(.*?)</script>', html)[1])) == 2
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", fleet_html(FLEET[:1], "answers").split("<main>")[1]))
    assert "1 robot " in text and "1 case " in text and "0 robots with a dated change" in text
    cells = strip(robot("r", lambda day: 0.3 * (day >= 60), days=120))  # the most frequent verdict of consecutive cases
    assert [verdict for verdict, _ in cells] == [RETUNE] * 30 + [NAMED] * 30 and "2 RETUNE" in cells[0][1]


def test_answers_of_a_diagnosis_make_a_row():
    found = diagnosis(NAMED)
    row = read_row(json.loads(json.dumps(found.to_json())), "mine")
    assert row.verdict == NAMED and row.effects == tuple(e.id for e in found.effects if e.role == CAUSE)
    assert row.amounts[0].value == next(iter(next(iter(found.effects[0].channels.values())).values())).value
    with pytest.raises(InputError, match="mine"):
        read_row({"verdict": NAMED}, "mine")


def test_command_reads_a_folder_writes_table_and_page_and_refuses_what_is_none(tmp_path):
    answers = tmp_path / "answers"
    for k in range(2):
        (answers / f"c{k}").mkdir(parents=True)
        (answers / f"c{k}" / "diagnosis.json").write_text(json.dumps(diagnosis(NAMED).to_json()))
    (answers / "bad").mkdir()
    (answers / "bad" / "failed.json").write_text('{"reason": "no log"}')
    for name, text in (("torn", '{"verdict": "NAMED"'), ("half", '{"verdict": "NAMED"}')):
        (answers / name).mkdir()
        (answers / name / "diagnosis.json").write_text(text)
    assert read_stored(answers / "half") is None and read_stored(answers / "c0")["verdict"] == NAMED
    (answers / "lost").mkdir()
    (answers / "lost" / "failed.json").write_text('["no log"]')

    run = partial(command_line.run, "fleet")
    page, table = tmp_path / "fleet.html", tmp_path / "fleet.parquet"
    result = run(answers, "--out", page, "--table", table)
    assert result.exit_code == 0 and "NAMED" in result.output and page.is_file()
    assert [r.verdict for r in read_table(table)].count(FAILURE) == 4
    again = run(table, "--out", tmp_path / "again.html")
    assert again.exit_code == 0 and len((tmp_path / "again.html").read_text()) == pytest.approx(
        len(page.read_text()), abs=200
    )
    loose = tmp_path / "loose"
    loose.mkdir()
    for name in ("a", "b"):
        (loose / f"{name}.json").write_text(json.dumps(diagnosis(NAMED).to_json()))
    (loose / "labels.json").write_text("{}")
    for given in ([loose], [loose / "a.json", loose / "b.json"], [answers / "c0", loose / "b.json"]):
        assert len(read_answers(*given)) == 2 and run(*given).exit_code == 0
    listed, empty = tmp_path / "list" / "answers.json", tmp_path / "list" / "empty.json"
    listed.parent.mkdir()
    failure = {"case": "gone", "verdict": FAILURE, "reasons": ["no log"], **NO_ANSWER}
    listed.write_text(json.dumps([diagnosis(NAMED).to_json() | {"case": "one"}, failure]))
    empty.write_text("[]")
    rows = json.loads(run(listed, loose / "b.json", "--json").stdout)
    assert [(row["case"], row["verdict"], row["reason"][:6]) for row in rows if row["case"] != "b"] == [
        ("gone", FAILURE, "no log"), ("one", NAMED, rows[-1]["reason"][:6])]  # fmt: skip
    for wrong in (tmp_path / "none", tmp_path, tmp_path / "again.html", empty):
        refused = run(wrong)
        assert refused.exit_code == 2 and "Traceback" not in refused.output and len(refused.stderr.splitlines()) == 1
    assert run(answers, "--out", tmp_path / "no" / "x.html").exit_code == 2


def written(folder, name, answer):
    """A folder of an answer."""
    (folder / name).mkdir(parents=True)
    (folder / name / "diagnosis.json").write_text(json.dumps(answer))


def test_answers_without_a_serial_are_different_robots_and_refinements_are_no_causes(tmp_path):
    """Each case is called `case`, as `import --out case` calls it; the folders of the answers are alike, too."""
    found = diagnosis(NAMED)
    refinement = replace(found.effects[0], id="sensor.gain", role=REFINEMENT)
    answer = json.loads(json.dumps(replace(found, case="case", effects=(*found.effects, refinement)).to_json()))
    for place in ("loop", "hob"):
        written(tmp_path / place, "answer", answer)
    (tmp_path / "hob" / "answer" / "report.html").write_text("")
    rows = read_answers(tmp_path / "loop" / "answer", tmp_path / "hob" / "answer")
    assert {row.serial for row in rows} == {"loop/answer", "hob/answer"} and len(members(rows)) == 2
    assert all("sensor.gain" not in row.effects and len(row.amounts) == len(rows[0].amounts) for row in rows)
    words = ["fleet", str(tmp_path / "loop" / "answer"), str(tmp_path / "hob" / "answer")]
    result = CliRunner().invoke(cli, [*words, "--out", str(tmp_path / "f.html")])
    assert "sensor.gain" not in result.output
    page = (tmp_path / "f.html").read_text()
    assert 'href="hob/answer/report.html"' in page and 'href="loop/answer/diagnosis.json"' in page
    written(tmp_path / "week1", "answer", answer | {"serial": "exo-7"})
    written(tmp_path / "week2", "answer", answer | {"serial": "exo-7"})
    assert len(members(read_answers(tmp_path / "week1", tmp_path / "week2"))) == 1


def test_a_fleet_whose_robots_were_repaired_has_a_page():
    """One cause in January, none in February: no robot has a cause in its last case."""
    rows = [
        replace(row, serial="r1")
        for row in (robot("a", lambda day: 0.3, days=1)[0], robot("b", lambda day: 0.0, days=1)[0])
    ]
    rows[1] = replace(rows[1], date=START + timedelta(days=30))
    text = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", fleet_html(rows, "answers").split("<main>")[1]))
    assert "0 robots, 1 case" in text and "0 robots with a gap in the last case" in text


def test_a_verdict_of_a_newer_version_is_shown_as_it_is(tmp_path):
    answer = json.loads(json.dumps(diagnosis(NAMED).to_json()))
    written(tmp_path / "answers", "new", answer | {"verdict": "PARTLY", "serial": "exo-9", "remainder": {"value": 0.3}})
    written(tmp_path / "answers", "old", answer | {"serial": "[/exo-1]"})
    result = CliRunner().invoke(cli, ["fleet", str(tmp_path / "answers"), "--out", str(tmp_path / "f.html")])
    assert result.exit_code == 0, result.output
    assert "PARTLY" in result.output and "[/exo-1]" in result.output
    rows = [replace(robot("a", lambda day: 0.3, days=1)[0], closure=-47018.64)]
    assert "grew by a factor of 47,000" in fleet_html(rows, "answers")
    page = (tmp_path / "f.html").read_text()
    assert "PARTLY" in page and 'href="answers/new/diagnosis.json"' in page
    assert "mu_phi AF 0." in page and f"{100 * answer['closure']['overall']['value']:.0f}\u00a0%" in page


def test_a_cause_that_held_out_logs_do_not_confirm_is_shown_so(tmp_path):
    answer = json.loads(json.dumps(diagnosis(NAMED).to_json()))
    for k, confirmed in enumerate((True, False, None)):
        written(tmp_path / "answers", f"c{k}", answer | {"serial": f"exo-{k}", "confirmed": confirmed})
    options = ("--out", tmp_path / "f.html", "--table", tmp_path / "f.parquet")
    result = CliRunner().invoke(cli, ["fleet", *map(str, (tmp_path / "answers", *options))])
    lines = [line for line in result.output.splitlines() if "exo-" in line]
    assert ["not confirmed" in line for line in lines] == [False, True, False]
    assert (tmp_path / "f.html").read_text().count("NAMED (not confirmed)") == 1
    whole = parquet.read_table(tmp_path / "f.parquet")
    assert [row.confirmed for row in read_table(tmp_path / "f.parquet")] == [True, False, None]
    # a table of a version that did not know the column
    parquet.write_table(whole.drop_columns(["confirmed"]), tmp_path / "f.parquet")
    assert [row.confirmed for row in read_table(tmp_path / "f.parquet")] == [None] * 3
