"""How much of long logs a diagnosis uses, and what it says of the rest."""

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import friction_case, friction_problem

from exodrake.diagnosis import part_used
from exodrake.diagnosis.pipeline import isolated
from exodrake.diagnosis.problem import make_problem
from exodrake.machines.robot_file import load_robot


def longer(problem, times):
    """The problem with its log so many times over."""
    trial = problem.fit[0]
    many = replace(trial, reference=np.tile(trial.reference, (times, 1)), measured=np.tile(trial.measured, (times, 1)))
    return replace(problem, fit=(many, *problem.fit[1:]))


def test_a_usual_log_is_affordable_in_full_and_a_long_one_as_far_as_its_samples_allow():
    problem = friction_problem()
    assert part_used.affordable(problem) == 1.0
    for times in (60, 600):
        long = longer(problem, times)
        share = part_used.affordable(long)
        used = sum(trial.measured.size for trial in long.shortened(share).fit)
        assert used == pytest.approx(part_used.MOST, rel=0.01)


def test_isolation_uses_no_more_than_is_affordable_and_the_answer_says_so(monkeypatch):
    problem = make_problem(friction_case(), load_robot(), frozenset({"tendon.capstan_friction"}))
    size = sum(trial.measured.size for trial in problem.fit)
    monkeypatch.setattr(part_used, "MOST", round(0.3 * size))
    whole, found = isolated(problem)
    assert found.likelihood.views[0].samples == pytest.approx(0.3 * size, rel=0.01)
    assert found.left[0].explanation.effects == ("tendon.capstan_friction",)
    assert part_used.notes_on_length(whole, found.best) == ("the logs are long: the first 30% of each was fitted",)


def test_a_gap_in_the_rest_of_a_long_log_is_said(monkeypatch):
    problem = make_problem(friction_case(), load_robot(), frozenset())
    trial = problem.fit[0]
    part = 0.3
    unchanged = int(part * len(trial.measured))
    silent = replace(problem, fit=(replace(trial, measured=predicted(problem, trial, unchanged)),))
    monkeypatch.setattr(part_used, "MOST", round(part * trial.measured.size))
    _, found = isolated(silent)
    assert "the rest shows a gap that this part does not" in part_used.notes_on_length(silent, found.retuned)[0]


def predicted(problem, trial, frames):
    """Measured samples of a trial, the first frames of which are those of the nominal robot."""
    measured = trial.measured.copy()
    measured[:frames] = problem.predict(problem.silent()[None], trial)[0][:frames]
    return measured
