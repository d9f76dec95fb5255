"""The page and the summary of a diagnosis made by hand: all that it says, nothing from outside, and it renders."""

import json
import re
import shutil
import subprocess
from base64 import b64decode
from dataclasses import replace
from html.parser import HTMLParser
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from report_synthetic import COLUMNS, IDS, VERDICTS, chosen, diagnosis, simulated_logs
from rich.console import Console

from exodrake.data.log import Log
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, PARTLY, RETUNE, UNKNOWN, Interval, Rival
from exodrake.model.display import find_display
from exodrake.report import wording
from exodrake.report.diagnosis_html import CURVE_LEVELS, MOST_SAMPLES, SimulatedLogs, curves, render_report, which
from exodrake.report.terminal import print_summary, print_table

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
ROBOTS = ("nominal", "improved")
VOID = {"meta", "br", "img", "i"}


@pytest.fixture(scope="module")
def pages():
    made: dict = {}

    def of(verdict):
        if verdict not in made:
            found = diagnosis(verdict)
            made[verdict] = render_report(found, simulated_logs(found.robots["nominal"], frames=600))
        return made[verdict]

    return of


def said(verdict, width=120):
    console = Console(record=True, width=width, file=StringIO())
    print_summary(diagnosis(verdict), console)
    return console.export_text()


def unpacked(curve):
    """The samples of a curve, as `curves.js` reads them; NaN where none was measured."""
    levels = np.frombuffer(b64decode(curve["levels"]), "<u2")
    return np.where(levels > CURVE_LEVELS, np.nan, curve["least"] + curve["height"] * levels)


def visible(html):
    """Text of a page without its drawings."""
    text = re.sub(r"<(svg|style|script)[^>]*>.*?</\1>", "", html, flags=re.DOTALL)
    return " ".join(re.sub(r"<[^>]+>", " ", text).split())


@pytest.mark.parametrize("verdict", [NAMED, NO_GAP, UNKNOWN])
def test_page_is_small_and_needs_nothing_from_outside(pages, verdict):
    html = pages(verdict)
    assert len(html.encode()) < 2_000_000
    assert "default-src 'none'" in html  # the browser itself then refuses whatever is not in the file
    assert not re.search(r"<link|@import|<iframe|fetch\(|XMLHttpRequest", html)
    sources = re.findall(r'(?:src|href)="([^"]*)"', html)
    assert all(s.startswith(("data:", "#")) for s in sources)
    assert {s[1:] for s in sources if s[0] == "#"} <= set(re.findall(r'\sid="([^"]*)"', html))


def test_page_says_the_answer(pages):
    text = visible(pages(NAMED))
    for wanted in (
        "Load-dependent friction (tendon.capstan_friction) at tendons AF and MF explains 91 % of the gap; 6 % remains",
        "0.280 to 0.340", "93 to 98 %",  # interval, closure
        "T_d = T_c - F", "exodrake effects tendon.capstan_friction",  # equation
        "Each of the 12 signals", "finger.kappa.MCP", "2 repeated rows dropped", "Evidence [nats]",
        "a cause takes up of the gap at least 10 %",  # a number of the decisions
        "1 refinement", "may be the error of a cause’s law",
        "2026-11-22 08:00:00 UTC", "exodrake diagnose case", "exo_index.yaml", "abc123",  # provenance
        "noise: repeats chirp.csv.gz", "222222222222",  # every log, and the hash of its file
    ):  # fmt: skip
        assert wanted in text, wanted
    assert "case &lt;7&gt; &amp; co" in text
    html = pages(NAMED)
    assert ">direction of motion<" in html and ">retuned robot<" in html  # the condition that was injected
    assert "Copyright (c) 2022 Leon Sorokin" in html and "MIT License" in html


def test_headline_names_cause_place_share_and_what_remains():
    said = {verdict: wording.headline(diagnosis(verdict)) for verdict in VERDICTS}
    cause = "oad-dependent friction (tendon.capstan_friction) at tendons AF and MF explains"
    assert said[NAMED] == f"L{cause} 91 % of the gap; 6 % remains."
    found = diagnosis(NAMED)
    small, signals = replace(found, remainder=replace(found.remainder, value=0.002)), found.closure.signals
    assert wording.headline(small).endswith("; nothing remains.")
    far = signals | {"tension_AF": replace(signals["tension_AF"], after=4.6 * signals["tension_AF"].noise_std)}
    said_of_far = wording.headline(replace(small, closure=replace(found.closure, signals=far)))
    assert said_of_far.endswith("; 4.6 noise standard deviations remain on tension_AF.")
    said_of_far = wording.headline(replace(found, closure=replace(found.closure, signals=far)))
    assert said_of_far.endswith("; 6 % remains, most on tension_AF (4.6 noise standard deviations).")
    vast = signals | {"tension_AF": replace(signals["tension_AF"], after=3.21, noise_std=1e-3)}
    said_of_vast = wording.headline(replace(small, closure=replace(found.closure, signals=vast)))
    assert said_of_vast.endswith("; 3.21 N remain on tension_AF.")
    most = "most on tension_AF (1.1 noise standard deviations)"
    assert said[PARTLY] == f"L{cause} 62 % of the gap; 38 % remains in the finger, mostly with speed, {most}."
    assert said[AMBIGUOUS] == (
        "The logs cannot tell capstan friction (tendon.capstan_friction) from coulomb friction "
        "(tendon.coulomb_friction) at tendons AF and MF, which explains 91 % of the gap; 6 % remains."
    )
    assert "finger.kappa.MCP 0.0800 N m/rad -> 0.0712 N m/rad" in said[RETUNE] and "negligible" in said[NO_GAP]
    best = "the best set, tendon.capstan_friction, would explain 41 % of it"
    assert best in said[UNKNOWN] and "in the tendon at tendons AF and MF" in said[UNKNOWN]


def test_errors_are_in_per_cent_of_the_nominal_robot_s_where_noise_is_no_measure():
    found = diagnosis()
    signals = {name: replace(gap, noise_std=1e-4 * gap.noise_std) for name, gap in found.closure.signals.items()}
    found = replace(found, closure=replace(found.closure, signals=signals), problem=(runs := simulated_logs()).problem)
    rms, console = found.closure.rms, Console(record=True, width=200, file=StringIO())
    left = f"{100.0 * rms['after'] / rms['before']:.0f} %"
    print_summary(found, console)
    assert f"improved robot {left} of the nominal robot's (RMS)" in console.export_text()
    html = render_report(found, runs)
    assert "in per cent of the nominal robot&#39;s" in html and f"<b>{left}</b>" in html and "noise alone" not in html


def test_of_an_answer_that_was_not_accepted_what_retuning_changed_is_said():
    found = diagnosis(UNKNOWN)
    robots = {name: found.robots["nominal"].with_parameters({"finger.kappa.MCP": 0.06}) for name in ("improved",)}
    found = replace(found, robots=found.robots | robots | {"retuned": found.robots["nominal"]})
    assert wording.retuned_words(found) == ""
    assert "finger.kappa.MCP" in wording.retuned_words(replace(found, verdict=PARTLY))


@pytest.mark.parametrize("verdict", [NO_GAP, RETUNE])
def test_a_gap_that_held_out_motion_alone_shows_is_said(verdict):
    found = replace(diagnosis(verdict), problem=SimpleNamespace(holdout=("far.csv",)))
    signals = found.closure.signals
    far = signals | {"tension_AF": replace(signals["tension_AF"], after=3.0 * signals["tension_AF"].noise_std)}
    text = wording.headline(replace(found, closure=replace(found.closure, signals=far)))
    assert text.endswith("; on held-out motion 3.0 noise standard deviations remain on tension_AF.")
    assert "held-out" not in wording.headline(found)


def test_rivals_belong_to_one_cause_and_the_others_stand_besides():
    found = diagnosis(AMBIGUOUS)
    base = replace(found.effects[0], wires=(), joints=("base",), id="servo.latency", kind="delay")
    base = replace(base, rivals=(replace(base.rivals[0], id="servo.lag"),), share=Interval(0.7, 0.6, 0.8))
    besides = replace(found.effects[1], joints=(), id="encoder.hysteresis", role="cause")
    text = wording.headline(replace(found, effects=(base, besides)))  # the largest first
    assert "cannot tell latency (servo.latency) from lag (servo.lag) at joint base, which explains 70 %" in text
    assert "; hysteresis (encoder.hysteresis) in the encoder besides explains 3 % of it; 6 % remains" in text
    larger = replace(besides, share=Interval(0.8, 0.7, 0.9))
    text = wording.headline(replace(found, effects=(larger, base)))
    assert text.startswith("Hysteresis (encoder.hysteresis) in the encoder explains 80 % of the gap; the logs cannot ")
    alone = wording.headline(replace(found, effects=(replace(base, joints=("joint",)),)))
    assert "from lag (servo.lag) at the joint, which" in alone, "whose name says no more"


def test_a_rival_is_shown_with_its_own_values():
    found = diagnosis(AMBIGUOUS)
    cause, other = found.effects
    robot = Rival((cause.rivals[0].id, other.id), {"tendon.coulomb_friction.force.AF": 0.25, "finger.kappa.MCP": 0.09})
    assert wording.rival_values(found, cause, cause.rivals[0].id) == []
    found = replace(found, rivals=(Rival((cause.id, other.id), {}), robot))
    console = Console(record=True, width=200, file=StringIO())
    print_summary(found, console)
    for text in (console.export_text(), visible(render_report(found, simulated_logs(frames=600)))):
        assert re.search(r"coulomb_friction\W.*force AF +0\.250 N", text)


def test_headline_states_values_by_channel_where_these_differ_and_no_share_where_there_is_none():
    found = diagnosis().effects[0]
    channels = {"AF": Interval(0.4, 0.37, 0.43), "MF": Interval(0.15, 0.12, 0.18), "AE": Interval(0.01, -0.1, 0.1)}
    text = wording.headline(replace(diagnosis(), effects=(replace(found, channels={"mu_phi": channels}),)))
    assert "(mu_phi 0.400 at AF, 0.150 at MF)" in text and "AE" not in text
    bare = replace(found, share=Interval(np.nan, np.nan, np.nan))
    assert "at tendons AF and MF was detected; 6 %" in wording.headline(replace(diagnosis(), effects=(bare,)))


def test_page_names_no_effect_where_none_is_found(pages):
    text = visible(pages(NO_GAP))
    assert "Where:" not in text and "Which:" not in text and "No gap" in text
    text = visible(pages(UNKNOWN))
    assert "no effect of the library" in text and "not accepted" in text and "Refined" not in text


def test_page_is_whole_with_few_columns_a_strange_effect_and_a_robot_that_diverges():
    found, runs = diagnosis(), simulated_logs(frames=300)
    runs.logs[1].simulated["nominal"][100:] = np.inf
    strange = replace(found, effects=(replace(found.effects[0], id="tendon.of_tomorrow", kind=""),))
    assert "Of tomorrow" in visible(
        render_report(strange, chosen(runs, [c for c in COLUMNS if not c.startswith("angle")]))
    )
    (log,) = curves(runs, ROBOTS)["logs"]
    assert np.isnan(unpacked(log["columns"][0]["nominal"])[100:]).all()
    bare = replace(found, closure=replace(found.closure, signals={}))
    assert "Load-dependent friction" in visible(render_report(bare, chosen(runs, [])))


def test_what_is_left_stands_beside_the_closure(pages):
    rms = diagnosis().closure.rms
    assert rms["after"] == pytest.approx(1.05) and rms["retuned"] == pytest.approx(0.8 * rms["before"])
    for text in (visible(pages(NAMED)), said(NAMED)):
        assert wording.digits(rms["before"]) in text and "1.05" in text and "noise standard deviations" in text


def test_page_is_well_formed_and_ids_do_not_clash(pages):
    open_tags, html = [], pages(NAMED)

    class Walk(HTMLParser):
        def handle_starttag(self, tag, attrs):
            if tag not in VOID:
                open_tags.append(tag)

        def handle_endtag(self, tag):
            if tag not in VOID:
                assert open_tags.pop() == tag

    Walk().feed(html)
    assert not open_tags
    ids = re.findall(r'\sid="([^"]*)"', html)
    assert len(ids) == len(set(ids))


def browsed(file, folder, *options):
    """What chromium says of a page."""
    common = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--window-size=1100,3000"]
    command = [str(CHROMIUM), *common, f"--user-data-dir={folder / 'user'}", *options, file.as_uri()]
    made = subprocess.run(command, capture_output=True, text=True, timeout=90)
    assert "CONSOLE" not in made.stderr, made.stderr
    return made.stdout


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
def test_page_renders_without_console_errors(pages, tmp_path):
    file, shot = tmp_path / "report.html", tmp_path / "page.png"
    file.write_text(pages(NAMED))
    browsed(file, tmp_path, f"--screenshot={shot}")
    from matplotlib.image import imread

    pixels = imread(shot)
    assert pixels.shape[:2] == (3000, 1100)
    assert (pixels[..., :3].min(axis=2) < 0.5).any(axis=1).mean() > 0.3  # most lines of pixels hold ink


PROBE = """<script>
const over = document.querySelector(".u-over"), box = over.getBoundingClientRect();
function at(share) {
  const place = {clientX: box.left + share * box.width, clientY: box.top + 20, bubbles: true};
  for (const kind of ["mouseenter", "mousemove"]) over.dispatchEvent(new MouseEvent(kind, place));
  return document.querySelector(".reading span").textContent;
}
const texts = [at(0.5)];
document.querySelector("[title=shorter]").click();
setTimeout(() => { texts.push(at(0)); document.title = texts.join(" | "); }, 200);
</script>"""


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
def test_curves_are_read_under_the_pointer_and_zoom(pages, tmp_path):
    """The middle of a log of 12 s, and the left end after zooming to its middle half."""
    file = tmp_path / "report.html"
    file.write_text(pages(NAMED).replace("</body>", f"{PROBE}</body>"))
    dom = browsed(file, tmp_path, "--virtual-time-budget=3000", "--dump-dom")
    found = re.search(r"<title>([^<]*)</title>", dom)
    assert found is not None
    log = simulated_logs(frames=600).closure_logs[0]
    for text, time in zip(found[1].split(" | "), (6.0, 3.0), strict=True):
        seconds, *values = (float(number) for number in re.findall(r"-?[\d.]+", text))
        assert seconds == pytest.approx(time, abs=0.1), found[1]
        frame = round(seconds / 0.02)
        near = slice(max(frame - 2, 0), frame + 3)
        wanted = [log.trial.measured[near, 0], log.simulated["nominal"][near, 0], log.simulated["improved"][near, 0]]
        assert all(w.min() - 0.01 <= v <= w.max() + 0.01 for v, w in zip(values, wanted, strict=True)), found[1]


@pytest.mark.parametrize("width", [80, 40])
def test_a_narrow_terminal_cuts_neither_ids_nor_numbers(width):
    console = Console(record=True, width=width, file=StringIO())
    rows = [("[bold]tendon.capstan_friction[/bold] refinement", "48 % (4-92 %)", "0.138 to 0.209", "-0.553 to -0.4")]
    print_table(console, (">effect", ">of the gap", "parameter AF", ">90 % interval"), rows * 2, wrapped=0)
    text = console.export_text()
    assert "…" not in text and max(map(len, text.splitlines())) <= width
    letters = sorted(text.replace(" ", "").replace("\n", ""))
    heads = "effectofthegapparameterAF90%interval"
    assert letters == sorted(heads + 2 * "tendon.capstan_frictionrefinement48%(4-92%)0.138to0.209-0.553to-0.4")


@pytest.mark.parametrize("verdict", VERDICTS)
def test_summary_is_short_and_says_the_verdict(verdict):
    text = said(verdict)
    assert verdict in text and "gap (RMS)" in text
    assert len(text.splitlines()) < 29


def test_parameters_that_the_improved_robot_changes_by_much_are_named():
    assert re.search(r"retuned finger.kappa.MCP \S+ N m/rad -> \S+ N m/rad \(its limit\)", said(RETUNE))
    assert "retuned finger" not in said(NO_GAP)


def test_summary_of_each_kind():
    assert "0.280 to 0.340" in said(NAMED) and "96 % (93 to 98 %)" in said(NAMED)
    assert "refined hysteresis (finger.hysteresis)" in said(NAMED) and "a refinement may be the error" in said(NAMED)
    assert "exodrake experiment" in said(AMBIGUOUS) and f"or {IDS[1]}" in said(AMBIGUOUS)
    assert "direction of motion 61 %" in said(UNKNOWN) and "direction of motion 61 %" in said(PARTLY)
    assert "closure" not in said(NO_GAP) and "of what retuning alone leaves" in said(NAMED)
    assert "within their tolerances" in said(RETUNE) and "one effect alone" in said(RETUNE)


def test_retuned_parameters_come_largest_first_in_tolerances():
    (table,) = which(diagnosis(), simulated_logs(frames=100))["retuned"]
    rows = {row[0].strip("`"): float(row[3].split()[0]) for row in table.rows}
    assert set(rows) == {"finger.kappa.MCP", "tendon.k.AF", "tendon.k.MF", "tendon.k.AE"}
    assert [abs(v) for v in rows.values()] == sorted(map(abs, rows.values()), reverse=True)
    assert all(value < 0.0 for value in rows.values())


def test_curves_are_read_back_to_half_a_level():
    runs = simulated_logs(frames=500)
    (log,) = curves(runs, ROBOTS)["logs"]
    for i, column in enumerate(log["columns"]):
        factor = find_display(column["kind"], runs.problem.robot.machine).factor
        measured = factor * runs.closure_logs[0].trial.measured[:, i]
        read = unpacked(column["measured"])
        assert np.array_equal(np.isnan(read), np.isnan(measured))
        assert np.nanmax(np.abs(read - measured)) <= 0.51 * column["measured"]["height"]


def test_long_logs_are_drawn_by_their_envelope_and_lose_no_peak():
    runs = simulated_logs(frames=60_000)
    runs.closure_logs[0].trial.measured[31_234, 0] = 99.0  # N, one sample
    (log,) = curves(runs, ROBOTS)["logs"]
    assert log["stretch"] > 1 and log["samples"] <= MOST_SAMPLES
    assert log["samples"] * log["step"] == pytest.approx(60_000 * runs.period, rel=0.01)
    names = ("measured", *ROBOTS, *(f"error_{robot}" for robot in ROBOTS))
    read = unpacked(log["columns"][0]["measured"])
    assert read.max() == pytest.approx(99.0) and abs(read.argmax() * log["step"] - 31_234 * runs.period) < 1.0
    assert all(len(unpacked(column[name])) == log["samples"] for column in log["columns"] for name in names)


def test_figure_of_a_long_log_shows_mean_and_range_of_each_channel():
    """90,000 rows of two channels, one of which a line would cover; a log of a minute is drawn as it is."""
    time = 0.02 * np.arange(90_000)
    waves = {"tension_AF": 2.0 + np.sin(5.0 * time), "tension_MF": 2.0 + 0.5 * np.sin(7.0 * time)}
    axes = Log(time, waves).plot().axes[0]
    assert [len(line.get_ydata()) for line in axes.lines] == [240, 240]
    for line, band, size in zip(axes.lines, axes.collections, (1.0, 0.5), strict=True):
        assert np.abs(line.get_ydata() - 2.0).max() < 0.1
        heights = band.get_paths()[0].vertices[:, 1]
        assert heights.min() == pytest.approx(2.0 - size, abs=0.01)
        assert heights.max() == pytest.approx(2.0 + size, abs=0.01)
    short = Log(time[:3000], {name: values[:3000] for name, values in waves.items()}).plot().axes[0]
    assert len(short.lines[0].get_ydata()) == 3000 and not short.collections


def test_quantities_have_a_unit_and_as_many_digits_as_they_deserve():
    assert wording.quantity(0.0123, "m") == "12.3 mm"
    assert wording.quantity(np.pi / 4, "rad") == "45.0°"
    assert wording.quantity(2700.0, "N/m") == "2.70 N/mm"
    assert wording.quantity(np.inf, "N/m") == "∞ N/mm"
    assert wording.interval(Interval(0.31234, 0.281, 0.3432)) == ("0.312", "0.281 to 0.343")
    assert wording.interval(Interval(8000.0, 4000.0, np.inf, "N/m"))[1] == "4.00 to ∞"
    assert wording.digits(np.nan) == "none"
    assert wording.percent(0.99953) == "99.9 %" and wording.percent(1.0) == "100 %" and wording.percent(0.5) == "50 %"


def test_gaps_count_in_noise_standard_deviations_under_the_label_and_unit_of_the_machine():
    robot = diagnosis().robots["nominal"]
    columns = tuple(replace(c, label="Pull", unit="mN") if c.kind == "tension" else c for c in robot.machine.columns)
    other = replace(robot, machine=replace(robot.machine, columns=columns))
    found = wording.kind_gaps(replace(diagnosis(), robots=dict.fromkeys(diagnosis().robots, other)))
    assert list(found) == ["tension", "stroke", "speed_cmd", "angle"]
    display, gap = found["tension"]
    assert gap.closure == pytest.approx(1 - (1.05**2 - 1) / ((gap.before / gap.noise_std) ** 2 - 1))
    assert display.axis == "Pull [mN]"
    assert wording.quantity(gap.noise_std, "N", display.unit) == "10.0 mN"


def test_answer_as_json_has_the_keys_of_its_page():
    answer = diagnosis(AMBIGUOUS).to_json()
    text = (Path(__file__).parent.parent / "docs" / "explain" / "answer.md").read_text()
    rows = {row[0]: set(row) for row in (re.findall(r"`(\w+)`", line) for line in text.splitlines()) if row}
    assert set(answer) <= {"simulated", "simulated_seconds", "date", *rows}
    for key in ("where", "closure", "provenance"):
        assert set(answer[key]) <= rows[key], key
    assert json.loads(json.dumps(answer, allow_nan=False)) == answer
    assert answer["effects"][0]["parameters"]["mu_phi"] == {"value": 0.3, "low": 0.27, "high": 0.33, "unit": "-"}


def test_page_of_a_case_without_held_out_log_says_so():
    found, runs = diagnosis(), simulated_logs(frames=300)
    runs = SimulatedLogs(replace(runs.problem, holdout=()), runs.logs[:1])
    text = visible(render_report(found, runs))
    assert "holds no log out" in text and "Held out:" not in text


GREW = Interval(-47018.64, -405258.23, -16610.85)  # closure of a robot's logs judged by logs of another robot


def test_an_error_that_grows_is_called_so_and_never_a_percentage():
    """Of a closure C the excess error is 1 - C of what it was."""
    assert wording.closure(GREW.value) == "grew by a factor of 47,000"
    assert wording.closure_span(GREW) == "grew by a factor of 17,000 to 410,000"
    assert wording.closure_span(Interval(-0.2, -1.5, 0.3)) == "grew by a factor of 2.5 to 30 % gone"
    assert wording.share(0.001) == "< 1 %" and wording.share(0.0) == "0 %"
    assert wording.share_span(Interval(0.003, 0.001, 0.02)) == "< 1 % (0-2)"
    assert wording.closure(-0.001) == "0 %" and wording.closure(0.962) == "96 %"
    assert wording.closure_span(Interval(0.96, 0.93, 0.98)) == "93 to 98 %"


def test_no_place_prints_a_percentage_below_minus_100():
    """Terminal and page of an answer each of whose closures is negative."""
    found = diagnosis()
    signals = {name: replace(gap, closure=-3.2e4) for name, gap in found.closure.signals.items()}
    closure = replace(found.closure, overall=GREW, retune=GREW, effect=GREW, signals=signals)
    closure = replace(closure, measured_on=("grasps",), motions={"sweeps": GREW})
    candidates = tuple(replace(c, share=-470.0) for c in found.candidates)
    runs = simulated_logs(frames=600)
    found = replace(found, closure=closure, candidates=candidates, problem=runs.problem)
    html = re.sub(r"<style.*?</style>|<svg.*?</svg>|<script.*?</script>", " ", render_report(found, runs), flags=re.S)
    console = Console(record=True, width=200, file=StringIO())
    print_summary(found, console)
    for text in (html, console.export_text()):
        assert not re.search(r"[-−][\d,]{3,} ?%", text) and "grew by a factor of 47,000" in text


def test_held_out_motion_that_contradicts_the_verdict_is_in_the_headline():
    problem = simulated_logs().problem
    steps = {
        Interval(-0.13, -0.67, -0.03): (False, "Held-out motion contradicts this: "),
        Interval(0.13, -0.2, 0.4): (False, "held-out motion does not confirm it"),
        Interval(0.95, 0.91, 0.97): (True, "6 % remains."),
    }
    found = replace(diagnosis(), problem=problem)
    for step, (confirmed, words) in steps.items():
        found = replace(found, closure=replace(found.closure, effect=step))
        assert found.to_json()["confirmed"] is confirmed
        assert words in wording.headline(found)
    assert replace(found, problem=replace(problem, holdout=())).confirmed is None
