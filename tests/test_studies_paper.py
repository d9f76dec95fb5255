"""The paper's page: the numbers that follow, those that do not, and Fig. 11's order of methods."""

import csv
import io
import re

import numpy as np
import pytest
from click.testing import CliRunner

from studies.paper import arms, equations, hardware, loop_sign
from studies.paper.claim import AGREES, DOES_NOT, QUICK, UNKNOWN, VERDICTS, count
from studies.paper.page import claims_csv, docs_page, page
from studies.paper.reproduce import reproduce
from studies.paper.study import CREEP_STIFFNESS, DATA, HELD_OUT, MODEL, MU_PHI, loading, worn_robot


@pytest.fixture(scope="module")
def found():
    return reproduce(QUICK, seed=0)


@pytest.fixture(scope="module")
def html(found):
    return page(found)


def claim(found, what):
    (one,) = (c for c in found.claims if what in c.what)
    return one


def test_moment_arms_are_those_of_the_model_page():
    """`model.md`, exact identities; printed: half of them and no sign."""
    curves = arms.curves()
    flexor = [1e3 * curves.at("flexor", degrees) for degrees in (0, 30, 60, 90)]
    large = [1e3 * curves.at("extensor (L)", degrees) for degrees in (0, 30, 60, 90)]
    assert flexor == pytest.approx([3.000, 4.192, 5.098, 5.657], abs=1e-3)
    assert large == pytest.approx([5.000, 3.536, 1.830, 0.0], abs=1e-3)
    assert np.rad2deg(arms.zero_of("extensor (S)")) == pytest.approx(61.928, abs=1e-3)
    assert 1e3 * arms.as_printed(curves.at("extensor (S)", 90)) == pytest.approx(0.707, abs=1e-3)


def test_sign_of_the_derivative():
    """`physics.md` 1.3: 20 % without damping, 47 % with the printed sign, none with the corrected one."""
    assert loop_sign.overshoot(0.0) == pytest.approx(0.20, abs=0.01)
    assert loop_sign.overshoot(1.0) == pytest.approx(0.47, abs=0.01)
    assert loop_sign.overshoot(-1.0) < 1e-3


@pytest.mark.parametrize(("degrees", "off"), [(5, 774), (10, 368), (30, 96), (60, 28), (89, 7)])
def test_printed_equation_9(degrees, off):
    """What is left over is (1/theta - 1/2) cot(theta/2) G [w]^2, whose norm is known; centres from `physics.md` 1.9."""
    theta = np.deg2rad(degrees)
    norm = abs(1 / theta - 0.5) / np.tan(theta / 2) * 2 * np.sqrt(2) * np.sin(theta / 2)
    assert equations.residue(degrees, printed=True) == pytest.approx(norm, rel=1e-9)
    assert 1e3 * equations.centre_error(degrees) == pytest.approx(off, abs=0.6)
    assert equations.residue(degrees, printed=False) < 1e-14


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


def test_loading_rows_end_at_the_largest_tension(found):
    from estimator_sweeps import as_sweeps, worn_sweeps

    sweeps = as_sweeps(worn_sweeps(3, seed=0, rows=60))
    mask = loading(sweeps)
    for number in range(3):
        assert np.count_nonzero(mask[sweeps.sweep == number]) == pytest.approx(30, abs=1)
    assert [one.method for one in found.study.recorded] == ["36 up and down", "12 up and down", "36 loading only"]


def test_drawn_estimates_are_those_that_were_judged(found):
    study = found.study
    for guess, method in ((study.mean, DATA), (study.model, MODEL)):
        rmse = np.sqrt(np.mean((guess - study.held.angle) ** 2, axis=0))
        np.testing.assert_allclose(rmse, study.worn.rmse[method], rtol=1e-9)


def test_worn_robot_is_worn():
    from exodrake.machines.robot_file import load_robot

    worn = worn_robot(load_robot())
    assert set(worn.effects()) == {"tendon.capstan_friction", "tendon.creep"}
    assert worn["tendon.capstan_friction.mu_phi.AF"] == MU_PHI
    assert worn["tendon.creep.stiffness.AE"] == CREEP_STIFFNESS


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


def test_simulated_readings_step_by_the_resolutions():
    from exodrake.machines.robot_file import load_robot

    fine = hardware.staircase(load_robot(), 0.001, 2 * np.pi / (16 * 69 * 4))
    assert fine.step_of(fine.tension) == pytest.approx(0.001, abs=1e-8)
    assert fine.step_of(fine.angle) == pytest.approx(0.001423, abs=1e-6)


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

    monkeypatch.setattr("studies.paper.reproduce.reproduce", lambda effort, seed: found)
    docs = tmp_path / "paper.md"
    run = CliRunner().invoke(command, ["--quick", "--out", str(tmp_path / "deep" / "out"), "--docs", str(docs)])
    assert run.exit_code == 0, run.output
    assert docs.read_text() == docs_page(found)
    assert {path.name for path in (tmp_path / "deep" / "out").iterdir()} == {"paper.html", "claims.csv"}
    assert "Fig. 11, simulated, whole sweeps held out" in run.output


def test_command_refuses_a_file_as_folder(tmp_path):
    from studies.paper.__main__ import command

    (tmp_path / "file").write_text("")
    run = CliRunner().invoke(command, ["--out", str(tmp_path / "file")])
    assert run.exit_code == 2 and "cannot be made" in run.output
