"""The paper's page: the numbers that follow, those that do not, and Fig. 11's order of methods."""

import csv
import io
import re

import numpy as np
import pytest
from click.testing import CliRunner

from studies.paper import arms, equations
from studies.paper.claim import AGREES, DOES_NOT, QUICK, UNKNOWN, VERDICTS, count
from studies.paper.page import claims_csv, docs_page, page, reproduce
from studies.paper.study import DATA, HELD_OUT, MODEL


@pytest.fixture(scope="module")
def found():
    return reproduce(QUICK, seed=0)


@pytest.fixture(scope="module")
def html(found):
    return page(found)


def claim(found, what):
    (one,) = (c for c in found.claims if what in c.what)
    return one


def test_numbers_of_the_model_page_and_of_the_physics_page():
    """Arms, exact identities, printed half of them without a sign; overshoot by the sign of kd; the printed Eq. 9."""
    curves = arms.curves()
    flexor, large = (
        [1e3 * arms.read_arm(curves, name, d) for d in (0, 30, 60, 90)] for name in ("flexor", "extensor (L)")
    )
    assert flexor == pytest.approx([3.000, 4.192, 5.098, 5.657], abs=1e-3)
    assert large == pytest.approx([5.000, 3.536, 1.830, 0.0], abs=1e-3)
    assert np.rad2deg(arms.zero_of("extensor (S)")) == pytest.approx(61.928, abs=1e-3)
    assert 1e3 * arms.as_printed(arms.read_arm(curves, "extensor (S)", 90)) == pytest.approx(0.707, abs=1e-3)
    assert [equations.overshoot(kd) for kd in (0.0, 1.0)] == pytest.approx([0.20, 0.47], abs=0.01)
    assert equations.overshoot(-1.0) < 1e-3
    for degrees, off in ((5, 774), (30, 96), (89, 7)):
        assert 1e3 * equations.centre_error(degrees) == pytest.approx(off, abs=0.6)
        assert equations.residue(degrees, printed=False) < 1e-14 < equations.residue(degrees, printed=True)


def test_data_beats_model_on_sweeps_it_never_saw(found):
    """Fig. 11, on a robot with unmodelled friction and creep, and the page says by how much."""
    study = found.study
    assert study.sweeps == 48 and study.held.count == HELD_OUT
    assert study.ratio > 2.0
    assert np.all(study.worn.rmse[DATA] < study.worn.rmse[MODEL])
    assert claim(found, "data-driven").verdict == AGREES
    assert f"{study.error(DATA):.3f} against {study.error(MODEL):.3f} rad" in claim(found, "data-driven").ours


def test_factor_is_said_to_follow_the_assumed_friction(found, html):
    """The first line, the register and the documentation name the factor without friction beside the one with it."""
    with_friction, without = f"{found.study.ratio:.1f}", f"{found.study.clean_ratio:.1f}"
    page_of_docs = docs_page(found)
    assert f"{without} × without" in html and "of assumed size" in html
    assert "follows the assumed friction" in claim(found, "data-driven").reason
    assert f"{with_friction} times better" in page_of_docs and f"{without} times without" in page_of_docs
    assert "&#39;" not in page_of_docs and "&gt;" not in page_of_docs


@pytest.mark.parametrize(
    ("what", "ours", "verdict"),
    [
        ("resolution of the tension unit", "0.001 N", DOES_NOT),
        ("non-linearity", "0.05 N", DOES_NOT),
        ("encoder", "0.00569 rad", AGREES),
        ("control period", "20 ms, 10, 500 Hz", AGREES),
        ("A.M. / S.M.", "64.08", AGREES),
        ("K.M. area", "4297 fingertip", DOES_NOT),
        ("extensor (S)", "61.93°", AGREES),
        ("DIP alone", "> 0 in", DOES_NOT),
        ("PIP alone is possible", "MF 0.0", UNKNOWN),
        ("bend the PIP alone", "DIP -0.02", UNKNOWN),
        ("bends all joints", "at 7 N", AGREES),
        ("maximises the movement", "AF 1", UNKNOWN),
        ("+ kd dF/dt", "overshoot 0 % printed", UNKNOWN),
        ("‖Q‖ = ‖v‖/‖w‖", "35.36 mm", AGREES),
        ("one CAN bus", "2 to 6 ms", AGREES),
        ("linear in the angle", "R²", UNKNOWN),
        ("M.F. alone", "PIP +0.00", AGREES),
    ],
)
def test_register(found, what, ours, verdict):
    one = claim(found, what)
    assert ours in one.ours and one.verdict == verdict


def test_every_claim_is_complete_and_on_the_page(found, html):
    assert len(found.claims) > 30
    for one in found.claims:
        assert one.verdict in VERDICTS and one.what and one.printed and one.ours and one.reason
    assert html.count('<span class="mark') == len(found.claims) == sum(count(found.claims).values())
    rows = list(csv.reader(io.StringIO(claims_csv(found.claims))))
    assert len(rows) == len(found.claims) + 1 and all(len(row) == 6 for row in rows)


def test_page_is_offline_small_and_says_what_is_simulated(html):
    assert len(html.encode()) < 4_000_000
    assert not re.search(r'(?:src|href)="(?!#|data:)', html) and "@import" not in html and "url(http" not in html
    assert "Nothing on this page was measured" in html
    ids = re.findall(r'\sid="([^"]+)"', html)
    assert len(ids) == len(set(ids))
    for caption in re.findall(r"<figcaption>(.*?)</figcaption>", html):
        assert re.match("Simulated|Computed|Synthetic", caption), caption


def test_command_writes_both_files(found, tmp_path, monkeypatch):
    from studies.paper.__main__ import command

    monkeypatch.setattr("studies.paper.page.reproduce", lambda effort, seed: found)
    docs = tmp_path / "paper.md"
    run = CliRunner().invoke(command, ["--quick", "--out", str(tmp_path / "deep" / "out"), "--docs", str(docs)])
    assert run.exit_code == 0, run.output
    assert docs.read_text() == docs_page(found)
    assert {path.name for path in (tmp_path / "deep" / "out").iterdir()} == {"paper.html", "claims.csv"}
    assert "Fig. 11, simulated, whole sweeps held out" in run.output
