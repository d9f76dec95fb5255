"""The viewer: where wires run, and a page that stands alone."""

import json
import re
from base64 import b64decode

import numpy as np
import pytest

import exodrake as exo
from exodrake.diagrams.meshcat import (
    STOPS,
    Thing,
    along,
    animate,
    average_frames,
    find_colours,
    recording_html,
    skeleton,
    span,
)

ROBOT = exo.load_robot()


@pytest.fixture(scope="module")
def log():
    return exo.simulate(ROBOT, exo.grasp("caging", ROBOT))


def drawn_length(tendon, angle):
    """Length of a tendon as drawn [m]."""
    bones = skeleton(ROBOT)
    return sum(along(*span(bones, p, angle))[2] for p in bones.pieces if p.tendon == tendon)


@pytest.mark.parametrize("tendon, joints, side", [("AF", 3, 1), ("MF", 1, 1), ("AE", 3, -1)])
def test_drawn_tendons_shorten_as_the_model_says(tendon, joints, side):
    a, h = 0.005, 0.003 if side > 0 else 0.005
    rho, alpha = np.hypot(a, h), np.arctan2(h, a)
    angle = np.array([0.4, 0.7, 0.3])
    taken = 2 * rho * (np.cos(alpha) - np.cos(alpha + side * angle[:joints] / 2))
    assert drawn_length(tendon, np.zeros(3)) - drawn_length(tendon, angle) == pytest.approx(taken.sum(), abs=1e-12)


def test_colours_run_from_grey_to_red():
    ends = find_colours(np.array([-1.0, 0.0, 1.0, 2.0]))
    assert ends[0] == pytest.approx(ends[1]) and ends[2] == pytest.approx(ends[3])
    assert ends[2, 0] > 5 * ends[2, 1] and ends[1] == pytest.approx(((np.array(STOPS[0][1]) + 0.055) / 1.055) ** 2.4)


def test_page_stands_alone(log):
    page = recording_html(log, ROBOT, "caging <test>", Thing((0.02, -0.04), 0.01, 0.05))
    assert len(page) < 5e6
    assert "caging &lt;test&gt;" in page and "caging <test>" not in page
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=.https?://", page)
    assert "localhost" not in page.split("</script>")[-2]


def test_a_second_run_is_a_ghost_at_the_same_times(log):
    """Half as long a second log holds its end; the page has its angles and says whose they are."""
    late = log.rows(slice(0, len(log) // 2))
    _, angle, _ = average_frames(log, skeleton(ROBOT), "angle")
    page = recording_html(log, ROBOT, "caging", other=late, names=("rusty", "the nominal one"), details=["line <1>"])
    ghost = np.array(json.loads(re.search(r'"ghost": (\[\[.*?\]\])', page)[1]))
    cut = len(angle) // 2 - 1
    np.testing.assert_allclose(ghost[:cut], angle[:cut], atol=1e-4)
    np.testing.assert_allclose(ghost[-1], ghost[len(angle) // 2 + 1])
    assert "grey: the nominal one" in page and "line &lt;1&gt;" in page and "exo-ghost" in page
    assert "grey: " not in recording_html(log, ROBOT)


def test_the_scale_of_the_loads_ends_at_the_limits_of_the_references(log):
    limits = ROBOT.reference_limits()[1]
    assert f"<span>{limits.min():g} to {limits.max():g} N</span>" in recording_html(log, ROBOT)


def test_the_page_has_visible_controls(log):
    page = recording_html(log, ROBOT)
    for name in ("exo-button", "exo-slider", "exo-speed", "exo-time"):
        assert f'id="{name}"' in page and f'getElementById("{name}")' in page


def test_long_logs_stay_small():
    log = exo.simulate(ROBOT, exo.sweeps(ROBOT))
    assert len(average_frames(log, skeleton(ROBOT), "angle")[0]) <= 500
    assert len(recording_html(log, ROBOT)) < 5e6


def test_gaps_are_bridged_and_empty_columns_refused(log):
    gap = log["angle_PIP"].copy()
    gap[20:40] = np.nan
    assert np.isfinite(average_frames(log.with_signals({"angle_PIP": gap}), skeleton(ROBOT), "angle")[1]).all()
    with pytest.raises(exo.InputError, match="empty"):
        recording_html(log.with_signals({"angle_PIP": np.full(len(log), np.nan)}), ROBOT)
    with pytest.raises(exo.InputError, match="angle_est"):
        recording_html(log, ROBOT, angles="angle_est")


def test_one_row(log):
    assert "caging" in recording_html(log.rows(slice(0, 1)), ROBOT)


def test_a_log_of_another_machine_is_refused(log):
    with pytest.raises(exo.InputError, match="position"):
        recording_html(log, exo.load_robot("emps"))


@pytest.mark.parametrize("name", ["emps", "so101"])
def test_axes_of_which_no_shape_is_known_stand_side_by_side(name):
    robot = exo.load_robot(name)
    log = exo.simulate(robot, f"steps:dwell={40 * robot.machine.frame:g}")
    page = recording_html(log, robot)
    sliding = [float(name == "emps")] * len(robot.machine.axes.joints)
    assert len(page) < 5e6 and "colour of a joint: its" in page and f'"sliding": {sliding}' in page


@pytest.mark.parametrize("step", [0.04, 0.02, 1.0 / 30.0])
def test_a_recording_has_a_key_for_each_frame(step):
    """In each track, be it of the robot or of the ghost."""
    count = 300
    angle = np.linspace(np.zeros(3), np.ones(3), count)
    packed = re.findall(r"base64,([A-Za-z0-9+/=]+)", animate(step, angle, angle, angle, skeleton(ROBOT)))
    (animation,) = (text for text in map(b64decode, packed) if b"set_animation" in text)
    assert animation.count(b"\xa4time") == count * animation.count(b"\xa4keys") > 0  # in MessagePack
