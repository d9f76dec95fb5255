"""Retuning of healthy robots that the reference simulator wrote."""

from exodrake.diagnosis.isolation import isolate
from exodrake.diagnosis.problem import make_problem
from exodrake.machines.robot_file import load_robot
from exodrake.reference.cases import MIXES, CasePlan
from exodrake.reference.make import case_and_label


def test_a_robot_whose_finger_snaps_over_is_retuned_to_its_noise():
    """Fitted in closed loop alone it ended in another minimum, with reduced chi-squares of 16.3 and 3.6."""
    case, _ = case_and_label(CasePlan("case", (400123, 84), "healthy", (), False, MIXES["healthy"]))
    closed, prediction = isolate(make_problem(case, load_robot()).shorten(0.4)).retuned.chi2
    assert prediction < 1.1 and closed < 2.0
