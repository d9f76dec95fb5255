"""Stable, unstable, marginal, conditionally stable and resting loops, against python-control and closed forms."""

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.optimize import brentq

import exodrake as exo
from exodrake.analysis.closed_loop import list_remarks
from exodrake.analysis.limit_cycles import limit_cycles
from exodrake.analysis.linear_model import linearise_robot, spectral_radius
from exodrake.analysis.margins import break_loop, close, margins, open_loop
from exodrake.analysis.responses import returns

PERIOD = 0.02


def opened_from(a, b, c, gain=1.0):
    """The loop v = gain (r - c x), x' = a x + b v, put together closed and then opened again."""
    n = len(a)
    closed = a - gain * np.outer(b, c)
    system = control.ss(closed, gain * b[:, None], np.vstack([c, -gain * c]), [[0.0], [gain]], PERIOD)
    return break_loop(system, np.zeros(n, bool), [1], [0])


def from_control(numerator, denominator, gain=1.0):
    """The same for a continuous transfer function, sampled with a hold, by python-control."""
    plant = control.ss(control.c2d(control.tf(numerator, denominator), PERIOD, "zoh"))
    return opened_from(plant.A, plant.B[:, 0], plant.C[0], gain), gain * control.tf(plant)


# numerator, denominator, gain, unstable poles of the closed loop, unstable poles of the open loop
CASES = {
    "stable lag": ([1.0], [0.1, 1.0], 5.0, 0, 0),
    "integrator with lag": ([1.0], [0.05, 1.0, 0.0], 3.0, 0, 0),
    "too much gain": ([1.0], [0.05, 1.0, 0.0], 300.0, 2, 0),
    "conditionally stable": ([1.0, 2.0, 1.0], [1.0, 0.03, 2e-4, 0.0], 6.0, 0, 0),
    "conditionally stable, too little gain": ([1.0, 2.0, 1.0], [1.0, 0.03, 2e-4, 0.0], 0.3, 2, 0),
    "unstable plant, held": ([1.0], [0.5, -1.0], 3.0, 0, 1),
    "unstable plant, not held": ([1.0], [0.5, -1.0], 0.5, 1, 1),
}


@pytest.mark.parametrize("case", CASES)
def test_counts_and_margins_of_a_table_of_cases(case):
    numerator, denominator, gain, unstable, of_plant = CASES[case]
    whole, transfer = from_control(numerator, denominator, gain)
    found = margins(whole, 0)
    assert (found.closed_unstable, found.open_unstable) == (unstable, of_plant)
    turns = control.nyquist_response(transfer, warn_encirclements=False, warn_nyquist=False).count
    assert found.encirclements == of_plant - unstable == -turns
    assert int((np.abs(control.feedback(transfer).poles()) > 1.0 + 1e-6).sum()) == unstable
    if unstable:
        numbers = (
            found.gain_margin_db,
            found.phase_margin_deg,
            found.delay_margin,
            found.disk_margin,
            found.gain_low_db,
        )
        assert np.isnan(numbers).all()
        return
    _, phases, _, _, crossovers, _ = control.stability_margins(transfer, returnall=True)

    def radius(factor):
        return np.abs(control.feedback(factor * transfer).poles()).max()

    high, low = (10.0 ** (g / 20.0) for g in (found.gain_margin_db, found.gain_low_db))
    assert radius(0.99 * high) < 1.0 < radius(1.01 * high)
    assert radius(max(1.01 * low, 1e-6)) < 1.0 + 1e-6
    assert (low > 0.0) == (case in ("conditionally stable", "unstable plant, held"))
    if low > 0.0:
        assert radius(0.99 * low) > 1.0
    if len(crossovers):
        delays = np.radians(np.asarray(phases) % 360.0) / crossovers
        k = int(np.argmin(delays))
        assert found.phase_margin_deg == pytest.approx(phases[k] % 360.0, rel=5e-3)
        assert found.delay_margin == pytest.approx(delays[k], rel=5e-3)


def test_a_conditionally_stable_loop_is_reported(model):
    whole, _ = from_control(*CASES["conditionally stable"][:3])
    assert any("conditionally stable" in note for note in list_remarks(model, (), (margins(whole, 0),)))


def test_a_pole_on_the_unit_circle_is_marginal(model):
    """y' = y + 2 (r - y): the pole of the closed loop is -1."""
    whole = opened_from(np.eye(1), np.ones(1), np.ones(1), 2.0)
    assert spectral_radius(close(whole)) == pytest.approx(1.0)
    assert replace(model, system=control.ss(close(whole), whole.B, whole.C, 0.0, PERIOD)).marginal


def test_an_unstable_robot_has_no_margins_and_says_so():
    model = linearise_robot(exo.load_robot().with_parameters({"controller.kp": 0.025}))
    assert model.spectral_radius == pytest.approx(1.099, abs=5e-3)
    whole = open_loop(model)
    for channel in range(3):
        found = margins(whole, channel)
        assert found.closed_unstable > 0
        assert np.isnan([found.gain_margin_db, found.phase_margin_deg, found.delay_margin]).all()
    assert any("no margins" in note for note in list_remarks(model))
    assert not returns(model.loop, model.point) and limit_cycles(model.loop.robot) == ()


def test_a_dead_zone_rests_without_warnings(recwarn):
    model = linearise_robot(exo.load_robot().splice("motor.dead_zone"))
    assert model.marginal and returns(model.loop, model.point)
    notes = list_remarks(model, (), (margins(open_loop(model), 0),))
    assert any("unit circle" in note for note in notes) and any("does not act" in note for note in notes)
    assert not any("growing" in note for note in notes)
    assert not recwarn.list


def test_the_loop_of_another_machine_has_the_margins_of_its_law():
    """EMPS: L(s) = k (kp + s e^(-s h)) e^(-s late) / s^2, the speed over two frames h, a reading a slot before the law,
    a force held for a frame."""
    robot = exo.load_robot("emps")
    found = margins(open_loop(linearise_robot(robot)), 0)
    h, kp, k = robot.machine.frame, robot["drive.kp"], robot["drive.gain"] * robot["drive.kv"] / robot["carriage.M"]
    late = 0.5 * h + robot.machine.slot

    def law(w):
        return k * (kp + 1j * w * np.exp(-1j * w * h)) * np.exp(-1j * w * late) / (1j * w) ** 2

    w = brentq(lambda w: abs(law(w)) - 1.0, 50.0, 500.0)
    assert 2.0 * np.pi * found.crossover == pytest.approx(w, rel=0.01)
    assert found.phase_margin_deg == pytest.approx(np.degrees(np.angle(-law(w))), abs=0.6)
    assert found.open_unstable == 0 and np.isneginf(found.gain_low_db)
