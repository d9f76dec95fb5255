"""Frequency response, margins, python-control: one way of finding each number against another."""

import control
import numpy as np
import pytest

import exodrake as exo
from exodrake.analysis.limit_cycles import CommandedLoop
from exodrake.analysis.linear_model import evaluate, spectral_radius
from exodrake.analysis.margins import close, margins, open_channel, open_loop
from exodrake.analysis.responses import LINES, bandwidth, frequency_response, multisine

TENDONS = ("AF", "MF", "AE")


def grows(plant, state, factor, frames=400):
    """Whether a small motion grows in the nonlinear simulation with the loop gain of a channel times a factor."""
    poke = 1e-4 * abs(plant.direct[plant.channel, plant.channel]) * plant.loop.loop.step
    size = np.abs(plant.run(state, frames, lambda n, v: factor * v + (poke if n == 0 else 0.0))[0])
    quarter = frames // 4
    return size[-quarter:].max() > size[quarter : 2 * quarter].max()


def test_multisine_is_odd_flat_and_periodic():
    signal = multisine(0.05, LINES, 500, np.random.default_rng(0))
    power = np.abs(np.fft.rfft(signal))
    assert np.sqrt(np.mean(signal**2)) == pytest.approx(0.05)
    assert power[::2].max() < 1e-12
    assert power[1::2] == pytest.approx(power[1] * np.ones(125))


@pytest.mark.parametrize("wire", range(3))
def test_multisine_and_frame_map_agree(model, wire):
    found = frequency_response(model, wire)
    assert np.abs(found.measured - found.linear).max() < 1e-4
    assert found.spread.max() < 1e-4 and found.coherence.min() > 1.0 - 1e-6
    assert found.bandwidth_measured == pytest.approx(found.bandwidth, rel=0.03)


def test_noise_spreads_the_measured_response(model):
    found = frequency_response(model, 1, seed=1)
    low = found.frequency < 2.0
    assert found.spread[low].mean() > 1e-3
    assert found.measured[low] == pytest.approx(found.linear[low], abs=0.15)
    assert found.coherence[low].min() > 0.9


@pytest.mark.parametrize("wire", range(3))
def test_margins_agree_with_poles_and_simulation(loop, point, model, wire):
    whole = open_loop(model)
    found = margins(whole, wire)
    limit = 10.0 ** (found.gain_margin_db / 20.0)
    assert spectral_radius(close(open_channel(whole, wire), 0.999 * limit)) < 1.0
    assert spectral_radius(close(open_channel(whole, wire), 1.001 * limit)) > 1.0
    assert found.encirclements == 0
    commanded = CommandedLoop(loop, point.references, model.system.D[model.rows("speed_cmd")], wire)
    assert not grows(commanded, point.state, 0.97 * limit)
    assert grows(commanded, point.state, 1.03 * limit)


@pytest.fixture(scope="module")
def analysed():
    return exo.analyse(exo.load_robot())


def test_python_control_has_the_loop_between_any_two_signals(analysed):
    """Sensitivity S = 1 / (1 + L) of one command, the others closed; margins of L by python-control alone."""
    closed, opened = analysed.loop("speed_cmd_MF", "speed_cmd_MF"), analysed.open_loop("speed_cmd_MF")
    z = np.exp(2j * np.pi * 1.5 * 0.02)
    assert 1.0 + closed(z) == pytest.approx(1.0 / (1.0 + opened(z)), rel=1e-6)
    gain, phase, *_ = control.stability_margins(opened, method="frd")
    assert 20.0 * np.log10(gain) == pytest.approx(analysed.margins[1].gain_margin_db, abs=0.01)
    assert phase == pytest.approx(analysed.margins[1].phase_margin_deg, abs=0.1)
    assert control.dcgain(analysed.loop("tension_ref_AF", "tension_AF")) == pytest.approx(1.0, abs=1e-3)
    unlogged = analysed.loop("tension_ref_AF", "tension_true_AF")
    assert repr(opened) == "<System L_speed_cmd_MF: ['speed_cmd_MF'] -> ['speed_cmd_MF'], dt=0.02>"
    assert unlogged.output_labels == ["tension_true_AF"] and unlogged.dt == 0.02
    for call in (lambda: analysed.loop("tension_ref_A", "tension_AF"), lambda: analysed.open_loop("speed_cmd")):
        with pytest.raises(exo.InputError, match="did you mean"):
            call()


def test_python_control_reads_the_same_model(analysed):
    system = analysed.to_control()
    assert system.dt == 0.02 and {"tension_AF", "stroke_MF", "angle_DIP"} <= set(system.output_labels)
    here = evaluate(system, np.array([1.5]))[0]
    assert system(np.exp(2j * np.pi * 1.5 * 0.02)) == pytest.approx(here, abs=1e-9)


def test_bandwidth_of_a_first_order_lag():
    f = np.linspace(0.0, 10.0, 5001)
    assert bandwidth(f, 1.0, 1.0 / (1.0 + 1j * f / 2.0)) == pytest.approx(2.0, rel=1e-4)
    assert np.isnan(bandwidth(f, 1.0, np.ones(5001)))
