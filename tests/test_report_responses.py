"""The figure of frequency responses in the report: of each block, finite, and only where the estimate makes sense."""

import re
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import friction_case
from report_synthetic import diagnosis, simulated_logs

import exodrake as exo
from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.result import Where
from exodrake.report.diagnosis_html import SimulatedLogs, render_report, response_figure


def servo_case():
    """Random motion of a servo arm whose joints answer late."""
    robot = exo.load_robot("so101")
    real = robot.splice("servo.lag")
    log = exo.simulate(real, "random-motion", seed=3)
    return robot, real, Case("servos", {}, (CaseLog(log, "random", "fit", None, "random.csv"),), robot.machine.frame)


def exo_index_case():
    robot = exo.load_robot()
    return robot, robot.splice("tendon.capstan_friction", {"mu_phi": 0.3}), friction_case()


@pytest.mark.parametrize(
    ("made", "blocks", "panels"), [(exo_index_case, ("motor", "tendon", "finger"), 3), (servo_case, ("servo",), 3)]
)
def test_page_shows_measured_nominal_and_improved_response_of_each_block(made, blocks, panels):
    robot, improved, case = made()
    found = replace(diagnosis(), robots={"nominal": robot, "retuned": robot, "improved": improved})
    drawing = response_figure(found, SimulatedLogs(make_problem(case, robot), ()))
    assert drawing is not None and drawing.wide
    assert all(f"{name} (" in drawing.caption for name in blocks)
    text = re.findall(r"<text[^>]*>([^<]*)</text>", drawing.svg)
    assert {"measured", "nominal", "improved"} <= set(text) and sum("→" in line for line in text) == panels
    numbers = [float(x) for path in re.findall(r' d="([^"]*)"', drawing.svg) for x in re.findall(r"-?[\d.]+", path)]
    assert len(numbers) > 1000 and np.isfinite(numbers).all() and "nan" not in drawing.svg


def test_page_is_whole_without_references_in_the_logs():
    found = diagnosis()
    runs = simulated_logs(found.robots["nominal"], frames=600)
    assert found.where != Where("none") and response_figure(found, runs) is None
    assert "Frequency responses of the blocks" not in render_report(found, runs)
