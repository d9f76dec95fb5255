"""The controller: filters, integral, anti-windup, feed-forward against closed forms; on the robot, what they do."""

import numpy as np
import pytest
from scipy.signal import lfilter

import exodrake as exo
from exodrake.analysis.feedforward import LATEST, find_delay
from exodrake.analysis.linear_model import FrameMap, linearise_robot
from exodrake.analysis.responses import step_response
from exodrake.analysis.robustness import robustness
from exodrake.analysis.tuning import linearise_law, predict_performance
from exodrake.physics import controller

PERIOD, ZERO = 0.02, (0.0, 0.0, 0.0)
SIZE = 16  # of the state


def law(references, readings, **values):
    """Commands (frames, 3) of the plain functions for references and readings (frames, 3)."""
    fixed = {"kp": 0.0, "kd": 0.0, "v_max": 1e9, "period": PERIOD, "ki": 0.0, "tau_D": 0.0, "tau_R": 0.0, "feed": 0.0}
    columns = dict.fromkeys(("compliance_1", "compliance_2", "compliance_3"), ZERO)
    n = controller.Parameters(**{**fixed, **columns, **values})
    x, sent, command = np.zeros(SIZE), [], np.zeros(3)
    for r, y in zip(references, readings):
        controller.control(x, None, n, None, r, y)
        command[:] = x[controller.COMMAND : controller.COMMAND + 3]
        sent.append(command.copy())
    return np.array(sent)


@pytest.fixture(scope="module")
def signals():
    rng = np.random.default_rng(0)
    return rng.standard_normal((40, 3)), rng.standard_normal((40, 3))


def test_without_its_extensions_it_is_the_law_of_the_paper(signals):
    r, y = signals
    rate = np.diff(y, axis=0, prepend=y[:1]) / PERIOD
    assert np.array_equal(law(r, y, kp=6e-3, kd=1e-4), 6e-3 * (r - y) - 1e-4 * rate)


def test_the_integral_is_a_sum_over_frames(signals):
    r, y = signals
    assert law(r, y, ki=0.3) == pytest.approx(0.3 * PERIOD * np.cumsum(r - y, axis=0))


def test_the_derivative_passes_a_first_order_lag(signals):
    r, y = signals
    share = PERIOD / (PERIOD + 0.05)
    rate = np.diff(y, axis=0, prepend=y[:1]) / PERIOD
    assert law(r, y, kd=1.0, tau_D=0.05) == pytest.approx(-lfilter([share], [1.0, share - 1.0], rate, axis=0))


def test_the_feed_forward_turns_reference_rates_into_wire_speed(signals):
    """After all frames the wire taken in is C times the change of the filtered reference."""
    r, y = signals
    c = np.array([[1.7e-3, 0.2e-3, -1e-3], [0.3e-3, 0.6e-3, -0.2e-3], [-1.1e-3, -0.3e-3, 1.3e-3]])
    columns = {f"compliance_{k + 1}": tuple(c[:, k]) for k in range(3)}
    taken = PERIOD * law(r, y, feed=1.0, tau_R=0.1, **columns).sum(axis=0)
    share = PERIOD / (PERIOD + 0.1)
    final = lfilter([share], [1.0, share - 1.0], r - r[0], axis=0)[-1]
    assert taken == pytest.approx(c @ final)


def test_the_integral_rests_while_the_command_is_clipped():
    """One newton too little for 2 s at the limit: the command leaves it as soon as the error turns."""
    r, y = np.ones((200, 3)), np.zeros((200, 3))
    y[100:] = 2.0
    sent = law(r, y, kp=1.0, ki=1.0, v_max=0.5)
    assert sent[:100] == pytest.approx(0.5) and sent[100] == pytest.approx(-0.5)


VALUES = {"controller.ki": 0.02, "controller.tau_D": 0.01, "controller.tau_R": 0.1}


def test_a_candidate_on_the_linear_plant_is_the_robot_with_that_controller(plant):
    """Spectral radius, disk margin and noise from another controller's plant, and from the robot linearised anew."""
    model = linearise_robot(exo.load_robot().with_parameters(VALUES))
    there = robustness(model)
    found = predict_performance(plant, linearise_law(plant, VALUES))
    assert found.radius == pytest.approx(model.spectral_radius, abs=1e-7)
    assert found.disk_margin == pytest.approx(there.numbers["disk margin"], rel=5e-3)
    assert found.noise == pytest.approx(max(v for k, v in there.numbers.items() if k.startswith("noise")), rel=1e-4)
    steps = [step_response(model.loop, model.point, j) for j in range(3)]
    assert found.settling == pytest.approx(max(s.settling for s in steps), abs=0.12)
    assert found.overshoot == pytest.approx(max(s.overshoot for s in steps), abs=0.025)


def test_integral_action_holds_the_reference_in_spite_of_a_drive_that_is_off():
    """A dead zone of 1 mm/s leaves up to 1 mm/s / kp = 0.17 N without ki, and nothing like it with ki."""
    errors = []
    for ki in (0.0, 0.02):
        robot = exo.load_robot().splice("motor.dead_zone").with_parameters({"controller.ki": ki})
        loop = FrameMap.from_robot(robot)
        rows = np.tile([4.0, 3.0, 1.0], (1500, 1))
        tension = loop.run(loop.start(), rows)[1][-200:, loop.signals["tension"]]
        errors.append(np.abs(tension.mean(axis=0) - rows[0]).max())
    assert errors[0] > 0.05 and errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("frames", [0, 3, LATEST])
def test_the_delay_of_a_shifted_motion_is_its_shift(frames):
    wanted = np.random.default_rng(0).standard_normal(400)
    assert find_delay(wanted, 0.2 + np.concatenate([np.zeros(frames), wanted])[:400]) == frames
    assert find_delay(np.ones(2), np.ones(2)) == 0  # too short for one
