"""The viewer: where wires run, and a page that stands alone."""

import re
from base64 import b64decode

import numpy as np
import pytest

import exodrake as exo
from exodrake.diagrams.meshcat import Motion, Thing, animated, beside, frames_of, recording_html
from exodrake.diagrams.meshcat.scene import along, skeleton, span

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
    assert skeleton(ROBOT).tip(np.array([np.pi / 2, 0, 0])) == pytest.approx([0.0, 0.0, -0.0815])
    assert drawn_length(tendon, np.zeros(3)) - drawn_length(tendon, angle) == pytest.approx(taken.sum(), abs=1e-12)


def test_page_stands_alone(log):
    page = recording_html(log, ROBOT, "caging <test>", Thing((0.02, -0.04), 0.01, 0.05))
    assert len(page) < 5e6
    assert "caging &lt;test&gt;" in page and "caging <test>" not in page
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=.https?://", page)
    assert "localhost" not in page.split("</script>")[-2]
    for name in ("exo-button", "exo-slider", "exo-speed", "exo-time"):
        assert f'id="{name}"' in page and f'getElementById("{name}")' in page
    limits = ROBOT.reference_limits()[1]
    assert f"<span>{limits.min():g} to {limits.max():g} N</span>" in page
    assert "caging" in recording_html(log.rows(slice(0, 1)), ROBOT)


def test_a_second_run_is_a_ghost_at_the_same_times(log):
    """Half as long a second log holds its end; the page has its angles and says whose they are."""
    late = log.rows(slice(0, len(log) // 2))
    time, angle, _ = frames_of(log, skeleton(ROBOT), "angle")
    ghost = beside(time, *frames_of(late, skeleton(ROBOT), "angle")[:2])
    cut = len(time) // 2 - 1
    np.testing.assert_allclose(ghost[:cut], angle[:cut], atol=1e-9)
    np.testing.assert_allclose(ghost[-1], ghost[len(time) // 2 + 1])
    page = recording_html(log, ROBOT, "caging", other=late, names=("rusty", "the nominal one"), details=["line <1>"])
    assert "grey: the nominal one" in page and "line &lt;1&gt;" in page and "exo-ghost" in page
    assert "grey: " not in recording_html(log, ROBOT)


def test_long_logs_stay_small():
    log = exo.simulate(ROBOT, exo.sweeps(ROBOT))
    assert len(frames_of(log, skeleton(ROBOT), "angle")[0]) <= 500
    assert len(recording_html(log, ROBOT)) < 5e6


def test_gaps_are_bridged_and_empty_columns_refused(log):
    gap = log["angle_PIP"].copy()
    gap[20:40] = np.nan
    assert np.isfinite(frames_of(log.with_signals({"angle_PIP": gap}), skeleton(ROBOT), "angle")[1]).all()
    with pytest.raises(exo.InputError, match="empty"):
        recording_html(log.with_signals({"angle_PIP": np.full(len(log), np.nan)}), ROBOT)
    with pytest.raises(exo.InputError, match="angle_est"):
        recording_html(log, ROBOT, angles="angle_est")
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
    motion = Motion(step * np.arange(count), angle, angle, np.ones(3), angle)
    packed = re.findall(r"base64,([A-Za-z0-9+/=]+)", animated(motion, skeleton(ROBOT), None))
    (animation,) = (text for text in map(b64decode, packed) if b"set_animation" in text)
    assert animation.count(b"\xa4time") == count * animation.count(b"\xa4keys") > 0  # in MessagePack
