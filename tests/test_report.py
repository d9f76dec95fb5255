"""The page and the summary of a diagnosis made by hand: all that it says, nothing from outside, and it renders."""

import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from io import StringIO

import numpy as np
import pytest
from report_synthetic import COLUMNS, IDS, VERDICTS, diagnosis, held_out_runs
from rich.console import Console

from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, RETUNE, UNKNOWN, Interval
from exodrake.report import number_format, wording
from exodrake.report.diagnosis_page import page
from exodrake.report.held_out_runs import binned, changed_parameters, spectra, top_condition
from exodrake.report.terminal import print_summary

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
VOID = {"meta", "br", "img", "i"}


@pytest.fixture(scope="module")
def pages():
    made: dict = {}

    def of(verdict):
        if verdict not in made:
            found = diagnosis(verdict)
            made[verdict] = page(found, held_out_runs(found.robots["nominal"], frames=600))
        return made[verdict]

    return of


def said(verdict, width=120):
    console = Console(record=True, width=width, file=StringIO())
    print_summary(diagnosis(verdict), console)
    return console.export_text()


def visible(html):
    """Text of a page without its drawings."""
    text = re.sub(r"<(svg|style)[^>]*>.*?</\1>", "", html, flags=re.DOTALL)
    return " ".join(re.sub(r"<[^>]+>", " ", text).split())


@pytest.mark.parametrize("verdict", [NAMED, NO_GAP, UNKNOWN])
def test_page_is_small_and_needs_nothing_from_outside(pages, verdict):
    html = pages(verdict)
    assert len(html.encode()) < 3_000_000
    assert not re.search(r"https?:|//cdn|@import|<script|<link", html)
    sources = re.findall(r'(?:src|href)="([^"]*)"', html)
    assert sources and all(s.startswith(("data:", "#")) for s in sources)


def test_page_says_the_answer(pages):
    text = visible(pages(NAMED))
    for wanted in ("Capstan friction on tendons AF and MF", "tendon.capstan_friction", "0.280 to 0.340", "93 to 98 %",
                   "finger.kappa.MCP", "-11.0 %", "2 repeated rows dropped", "level of each test",
                   "raw BIC"):  # fmt: skip
        assert wanted in text, wanted
    assert "case &lt;7&gt; &amp; co" in text


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


def test_page_of_no_gap_has_no_place_and_no_effect(pages):
    text = visible(pages(NO_GAP))
    assert "Where:" not in text and "Which:" not in text and "No gap" in text


def test_unknown_page_names_no_effect(pages):
    text = visible(pages(UNKNOWN))
    assert "no effect of the library" in text and "not accepted" in text and "Probability" not in text


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium")
def test_page_renders_without_console_errors(pages, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(pages(NAMED))
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--window-size=1100,3000"]
    shot = tmp_path / "page.png"
    made = subprocess.run(
        [str(CHROMIUM), *options, f"--user-data-dir={tmp_path / 'user'}", f"--screenshot={shot}", file.as_uri()],
        capture_output=True, text=True, timeout=50,
    )  # fmt: skip
    assert "CONSOLE" not in made.stderr, made.stderr
    from matplotlib.image import imread

    pixels = imread(shot)
    assert pixels.shape[:2] == (3000, 1100)
    assert (pixels[..., :3].min(axis=2) < 0.5).any(axis=1).mean() > 0.3  # most lines of pixels hold ink


@pytest.mark.parametrize("verdict", VERDICTS)
def test_summary_is_short_and_says_the_verdict(verdict):
    text = said(verdict)
    assert verdict in text and "gap (RMS)" in text
    assert len(text.splitlines()) < 26


def test_summary_of_each_kind():
    assert "0.280 to 0.340" in said(NAMED) and "96 % (93 to 98 %)" in said(NAMED)
    ambiguous = said(AMBIGUOUS)
    assert "capstan friction or coulomb friction" in ambiguous and "steps" in ambiguous and IDS[1] in ambiguous
    assert "direction of motion 61 %" in said(UNKNOWN)
    assert "closure" not in said(NO_GAP) and "of what retuning alone leaves" in said(NAMED)
    assert "within their tolerances" in said(RETUNE) and "finger.kappa.MCP 0.0800 -> 0.0712" in said(RETUNE)


def test_top_condition_is_the_injected_one():
    found = top_condition(diagnosis(), held_out_runs())
    assert found is not None and found.name == "direction of motion"
    assert found.before.std() > 5 * found.after.std()


def test_spectrum_of_white_noise_is_that_of_unit_variance():
    runs = held_out_runs(frames=6000)
    _, power = spectra(runs, "improved", "tension")
    assert power[2:].mean() == pytest.approx(2 * runs.period, rel=0.1)


def test_changed_parameters_come_largest_first():
    names = [row[0] for row in changed_parameters(diagnosis())]
    assert names == ["finger.kappa.MCP", "tendon.k.AF", "tendon.k.MF", "tendon.k.AE"]


def test_binned_means():
    at, mean = binned(np.array([0.0, 1, 0, 1]), np.array([1.0, 2, 3, 4]))
    assert list(at) == [0, 1] and list(mean) == [2, 3]
    at, mean = binned(np.arange(1000.0), np.arange(1000.0), 10)
    assert len(at) == 10 and np.allclose(at, mean)


def test_quantities_have_a_unit_and_as_many_digits_as_they_deserve():
    assert number_format.quantity(0.0123, "m") == "12.3 mm"
    assert number_format.quantity(np.pi / 4, "rad") == "45.0°"
    assert number_format.quantity(2700.0, "N/m") == "2.70 N/mm"
    assert number_format.quantity(np.inf, "N/m") == "∞ N/mm"
    assert number_format.interval(Interval(0.31234, 0.281, 0.3432)) == ("0.312", "0.281 to 0.343")
    assert number_format.interval(Interval(8000.0, 4000.0, np.inf, "N/m"))[1] == "4.00 to ∞"
    assert number_format.digits(np.nan) == "none"
    assert (
        number_format.percent(0.99953) == "99.9 %"
        and number_format.percent(1.0) == "100 %"
        and number_format.percent(0.5) == "50 %"
    )


def test_closure_per_kind_counts_in_noise_standard_deviations():
    gaps = {g.kind: g.gap for g in wording.kind_gaps(diagnosis())}
    assert list(gaps) == ["tension", "stroke", "speed_cmd", "angle"]
    tension = gaps["tension"]
    assert tension.closure == pytest.approx(1 - (1.05**2 - 1) / ((tension.before / tension.floor) ** 2 - 1))


def test_page_without_motion_capture_and_with_an_effect_outside_the_library():
    found, runs = diagnosis(), held_out_runs(frames=300)
    keep = [i for i, c in enumerate(COLUMNS) if not c.startswith("angle")]
    held = tuple(replace(t, measured=t.measured[:, keep]) for t in runs.problem.holdout)
    problem = replace(
        runs.problem,
        columns=tuple(COLUMNS[i] for i in keep),
        noise_std=runs.problem.noise_std[keep],
        holdout=held,
        fit=held,
    )
    runs = replace(runs, problem=problem, simulated=({n: rows[:, keep] for n, rows in runs.simulated[0].items()},))
    strange = replace(found, effects=(replace(found.effects[0], id="tendon.of_tomorrow"),))
    assert "Of tomorrow" in visible(page(strange, runs))


def test_page_and_summary_of_a_diagnosis_without_columns():
    found, runs = diagnosis(), held_out_runs(frames=300)
    nothing = tuple(replace(t, measured=t.measured[:, :0]) for t in runs.problem.holdout)
    problem = replace(runs.problem, columns=(), noise_std=np.zeros(0), holdout=nothing, fit=nothing)
    runs = replace(runs, problem=problem, simulated=({n: rows[:, :0] for n, rows in runs.simulated[0].items()},))
    found = replace(found, closure=replace(found.closure, signals={}))
    assert "Capstan friction" in visible(page(found, runs))
    print_summary(found, Console(file=StringIO()))


def test_machine_says_label_and_unit_of_its_columns():
    robot = diagnosis().robots["nominal"]
    columns = tuple(replace(c, label="Pull", unit="mN") if c.kind == "tension" else c for c in robot.machine.columns)
    other = replace(robot, machine=replace(robot.machine, columns=columns))
    found = replace(diagnosis(), robots=dict.fromkeys(diagnosis().robots, other))
    tension = wording.kind_gaps(found)[0]
    assert tension.display.axis == "Pull [mN]"
    assert number_format.quantity(tension.gap.floor, "N", tension.display.unit) == "10.0 mN"


def test_column_names_split_into_kind_and_channel():
    machine = diagnosis().robots["nominal"].machine
    assert wording.split_column("speed_cmd_AF", machine) == ("speed_cmd", "AF")
    assert wording.split_column("angle_shoulder_pan", machine) == ("angle", "shoulder_pan")


def test_page_of_a_case_without_held_out_log_says_so():
    found, runs = diagnosis(), held_out_runs(frames=300)
    runs = replace(runs, problem=replace(runs.problem, holdout=runs.problem.fit))
    text = visible(page(found, runs))
    assert "holds no log out" in text and "Held out:" not in text
