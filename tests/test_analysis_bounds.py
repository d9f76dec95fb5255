"""Bounds on settling and LQG: closed forms, python-control's Riccati solutions, and the nonlinear simulation."""

from dataclasses import replace

import control
import numpy as np
import pytest

from exodrake.analysis.responses import step_response
from exodrake.analysis.robustness import points_band
from exodrake.analysis.tuning import (
    Requirements,
    Tuned,
    Tuning,
    bound_settling,
    design_lqg,
    linearise_plant,
    predict_performance,
    schedule_gains,
)

T = 0.1


def test_settling_of_an_integrator_is_bounded_by_its_largest_command_and_its_delay():
    """y' = y + T v: 0.98 <= frames T peak; three frames of delay are added, and what is too far is not reached."""
    integrator = control.ss(1.0, T, 1.0, 0.0, T)
    for peak, frames in ((1.0, 10), (0.49, 20), (10.0, 1)):
        assert bound_settling(integrator, 0, peak, 0.05, 0.0, 30) == pytest.approx(frames * T)
    late = integrator * control.ss(control.tf([1.0], [1.0, 0.0, 0.0, 0.0], T))
    assert bound_settling(late, 0, 1.0, 0.05, 0.0, 40) == pytest.approx(13 * T)
    assert np.isnan(bound_settling(late, 0, 0.01, 0.05, 0.0, 40))


def test_a_double_integrator_is_moved_by_bang_bang():
    """It enters the band of 2 % with the speed 0.2 that it can still brake off there: 1 s up, 0.8 s down."""
    plant = control.c2d(control.ss([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], 0.0), 0.02)
    assert bound_settling(plant, 0, 1.0, 0.0, 0.0, 150) == pytest.approx(1.8, abs=0.021)


def test_a_coupled_channel_that_must_stay_takes_commands_of_its_own():
    plant = control.ss(np.eye(2), T * np.array([[1.0, 0.0], [0.9, 1.0]]), np.eye(2), np.zeros((2, 2)), T)
    free, held = (bound_settling(plant, 0, 1.0, 0.05, crosstalk, 30) for crosstalk in (2.0, 1e-3))
    assert free == pytest.approx(1.0) and held == pytest.approx(1.0)
    assert np.isnan(bound_settling(plant, 1, 0.01, 0.05, 0.0, 30))


def test_lqg_of_an_integrator_has_the_gains_of_its_riccati_equations():
    """Without integral weight K solves T^2 K^2 effort + K T = ... by python-control; the filter likewise."""
    plant, noise = control.ss(1.0, T, 1.0, 0.0, T), (np.zeros((1, 1)), np.full((1, 1), 0.1))
    law = design_lqg(plant, noise, effort=0.5, integral=1e-12, disturbance=0.3)
    gain = control.dlqr(1.0, T, 1.0, 0.5)[0][0, 0]
    kalman = control.dlqe(1.0, 1.0, 1.0, (0.3 * T) ** 2, 0.01)[0][0, 0]
    assert law.C[0, 0] == pytest.approx(-gain, rel=1e-4) and law.B[0, 0] == pytest.approx(kalman)
    assert law.D[0] == pytest.approx([0.0, gain], rel=1e-4)


def test_no_loop_of_the_robot_beats_the_bound_with_its_commands(plant):
    """The nominal loop on the nonlinear robot settles in 1.8 s, and the best with such commands in some tenths."""
    for channel in range(3):
        step = step_response(plant.model.loop, plant.model.point, channel)
        least = bound_settling(plant.system, channel, step.command_peak, 0.05, step.crosstalk, 60)
        assert 0.02 <= least <= step.settling


def test_lqg_holds_a_step_and_rejects_a_constant_disturbance(plant):
    law = design_lqg(plant.system, (plant.N, plant.M), 1e4, 1e-3, 1e-4)
    found = predict_performance(plant, law)
    assert found.radius < 1.0 and found.settling < 3.0 and found.disk_margin > 0.5
    assert np.abs(law.poles() - 1.0).min() < 1e-6  # integral action


def test_gains_are_scheduled_where_margins_move_by_half(plant):
    """MF's margin moves from 8.0 to 9.5 dB over the points of the nominal robot, AE's from 8 to 14."""
    robot = plant.model.loop.robot
    points = list(plant.model.loop.loop.points)
    plants = [plant, *(linearise_plant(robot, at) for at in points[1:])]
    members = points_band(robot)
    tuned = Tuned("PD", robot, {"controller.kp": 6e-3, "controller.kd": 1e-4}, (), (members,), 1.0, 0.0, 1.0, 1.0, ())
    tuning = Tuning(robot, Requirements(noise=1.0), (replace(tuned, name="as it is", settling=2.0), tuned))
    found = schedule_gains(plants, tuning)
    assert list(found) == points
    for gains, settling in found.values():
        assert gains["controller.kp"] > 6e-3 and settling < 2.0
    assert schedule_gains(plants[:1], tuning) == {}
    assert schedule_gains(plants, replace(tuning, compared=(tuned,))) == {}  # its own gains are the best
