"""One more effect: its p-value in noise, beside an effect that takes up much of a law's error, and least squares."""

import numpy as np
import pytest
from formula_case import explanation, likelihood_of, linearisation, nominal, probe

from exodrake.diagnosis.one_more import OneMore
from exodrake.diagnosis.projection import Projection

FRAMES, RICH, DRAWS, CASES = 400, 8, 99, 200


def project_of(probes):
    """The projection of one nominal parameter, with random directions, a row of each probe's."""
    rng = np.random.default_rng(0)
    likelihood = likelihood_of(lambda row: np.zeros(FRAMES))
    e = explanation(likelihood, nominal(1, 1.0), np.zeros(1), rng.standard_normal((1, FRAMES)))
    directions = rng.standard_normal((1 + max(k for p in probes for k in p.rows), FRAMES))
    return Projection(likelihood, e, linearisation(e, directions, probes))


@pytest.fixture(scope="module")
def project():
    """A rich effect of eight directions and a plain one of a ninth."""
    return project_of([probe("rich", range(RICH)), probe("plain", (RICH,))])


def errors(project, count, seed):
    """Rows (count, samples) of noise and of a law's error, which the rich effect takes up."""
    rng = np.random.default_rng(seed)
    law = 0.3 * rng.standard_normal((count, RICH)) @ project.directions[:RICH]
    return rng.standard_normal((count, FRAMES)) + law


def test_gains_are_what_least_squares_with_the_directions_takes_up():
    project = project_of([probe("one", (0,)), probe("two", (1, 2))])
    row, w = np.random.default_rng(5).standard_normal(FRAMES), project.weights
    base = np.concatenate([(project.columns * w).T, np.eye(1)])  # the prior of the nominal parameter as a sample

    def left(directions):
        columns = np.c_[base, np.concatenate([(directions * w).T, np.zeros((1, len(directions)))])]
        target = np.r_[row * w, 0.0]
        return float(np.sum((target - columns @ np.linalg.lstsq(columns, target)[0]) ** 2))

    expected = [left(np.zeros((0, FRAMES))) - left(project.directions[list(rows)]) for rows in ((0,), (1, 2))]
    np.testing.assert_allclose(project.gains(row[None])[:, 0], expected, rtol=1e-3)


def test_level_holds_where_no_effect_is_missing(project):
    found = OneMore(project, errors(project, DRAWS, 1))
    p = np.array([found.most(row).p for row in errors(project, CASES, 2)])
    for level in (0.1, 0.2):
        assert 0.4 * level < np.mean(p < level) < 1.8 * level


def test_effect_is_told_that_takes_up_less_than_a_rich_one_does_of_an_error(project):
    """The plain effect takes up 40 noise variances, the rich one 270 of the law's error in the mean."""
    found = OneMore(project, errors(project, DRAWS, 1))
    rows = errors(project, 40, 3) + 0.33 * project.directions[RICH]
    told = [found.most(row) for row in rows]
    gains = project.gains(rows)
    assert np.mean(gains[1] < gains[0]) > 0.9
    plain = [found.p_value({"plain"}, float(g)) for g in gains[1]]
    assert np.mean(np.array(plain) < 0.02) > 0.9
    assert np.mean([gain.effect == "plain" for gain in told]) > 0.9


def test_probes_of_one_effect_count_as_one(project):
    """Another probe of the plain effect beside the first changes no p-value: the better one counts."""
    again = project_of([probe("rich", range(RICH)), probe("plain", (RICH,)), probe("plain", (RICH,))])
    rows, once = errors(project, DRAWS, 1), OneMore(project, errors(project, DRAWS, 1))
    twice, row = OneMore(again, rows), rows[0] + 0.33 * project.directions[RICH]
    np.testing.assert_array_equal(twice.effects, ["rich", "plain"])
    assert twice.most(row).p == pytest.approx(once.most(row).p, rel=1e-6)
    assert twice.p_value({"plain"}, 30.0) == pytest.approx(once.p_value({"plain"}, 30.0), rel=1e-6)


def test_sets_of_effects_are_held_against_what_all_of_them_take_up(project):
    found = OneMore(project, errors(project, DRAWS, 1))
    assert found.p_value({"plain"}, 100.0) < found.p_value({"rich", "plain"}, 100.0)
    assert found.p_value({"another"}, 100.0) == found.p_value({"rich"}, 100.0)  # of unknown ones the most is allowed


def test_no_draw_tells_where_too_much_is_left_and_no_effect_may_be_missing(project):
    row = errors(project, 1, 4)[0]
    rejected = OneMore(project, None)
    assert rejected.most(row).p == 0.0
    assert rejected.most(row).power == pytest.approx(project.gains(row[None]).max())
    assert rejected.p_value({"plain"}, -1.0) == 1.0
    assert OneMore(project_of_none(), errors(project, DRAWS, 1)).most(row) == ("", 0.0, 1.0)


def project_of_none():
    likelihood = likelihood_of(lambda row: np.zeros(FRAMES))
    e = explanation(likelihood, nominal(1, 1.0), np.zeros(1), np.ones((1, FRAMES)))
    return Projection(likelihood, e, linearisation(e))
