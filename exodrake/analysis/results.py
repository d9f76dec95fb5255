"""A closed loop as plain data for JSON; values that are not finite become null."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np

from exodrake.analysis.closed_loop import ClosedLoop
from exodrake.analysis.frequency import FrequencyResponse
from exodrake.analysis.linear import Pole
from exodrake.analysis.margins import Margins
from exodrake.analysis.steps import StepResponse
from exodrake.core.plain import plain


def closed_loop_numbers(result: ClosedLoop) -> dict[str, Any]:
    """All results with units in the keys."""
    axes, point, model = result.robot.machine.axes, result.point, result.model
    latency = result.latency
    return plain(
        {
            "robot": result.robot.source or result.robot.machine.name,
            "effects": result.robot.effects(),
            "stable": result.stable,
            "spectral_radius": model.spectral_radius,
            "returns_after_kick": result.returns,
            "notes": list(result.notes),
            "operating_point": {
                "tension_ref [N]": dict(zip(axes.tendons, point.references)),
                "tension [N]": dict(zip(axes.tendons, point.tension)),
                "angle [rad]": dict(zip(axes.joints, point.angle)),
                "frames": point.frames,
                "residual [excursion/frame]": point.residual,
                "settled_by_own_gains": point.steady,
            },
            "poles": [pole_numbers(p) for p in model.poles()],
            "linear_model": model_numbers(result),
            "steps": {s.channel: step_numbers(s) for s in result.steps},
            "frequency_response": {r.channel: response_numbers(r) for r in result.responses},
            "margins": {m.channel: margin_numbers(m) for m in result.margins},
            "stability_map": {
                "kp [m/(s N)]": result.gains.kp,
                "kd [m/N]": result.gains.kd,
                "spectral_radius": result.gains.radius,
                "kp_limit [m/(s N)]": result.gains.limit,
                "nominal": result.gains.nominal,
            },
            "latency": latency
            and {"frames": latency.frames, "spectral_radius": latency.radius, "limit [frames]": latency.limit},
        }
    )


def model_numbers(result: ClosedLoop) -> dict[str, Any]:
    """The linear model with its names and how well the differences agree."""
    m = result.model
    names = {"period [s]": m.period, "states": m.states, "inputs": m.inputs, "outputs": m.outputs}
    quality = {"difference_step": m.step, "convergence": m.convergence, "kink": m.kink, "kink_at": m.where}
    return names | {"A": m.A, "B": m.B, "C": m.C, "D": m.D} | quality


def pole_numbers(pole: Pole) -> dict[str, Any]:
    """One pole."""
    named = {"z": pole.z, "modulus": abs(pole.z), "frequency [Hz]": pole.frequency}
    return named | {"damping": pole.damping, "time_constant [s]": pole.time_constant, "state": pole.state}


def step_numbers(step: StepResponse) -> dict[str, Any]:
    """Characteristics of a step response."""
    return {
        "size [N]": step.size,
        "rise_time [s]": step.rise,
        "overshoot": step.overshoot,
        "settling_time [s]": step.settling,
        "steady_error [N]": step.steady_error,
        "crosstalk": step.crosstalk,
    }


def response_numbers(response: FrequencyResponse) -> dict[str, Any]:
    """Measured and linear frequency response."""
    return {
        "bandwidth [Hz]": response.bandwidth,
        "bandwidth_measured [Hz]": response.bandwidth_measured,
        "frequency [Hz]": response.frequency,
        "measured": response.measured,
        "spread": response.spread,
        "coherence": response.coherence,
        "linear": response.linear,
    }


def margin_numbers(m: Margins) -> dict[str, Any]:
    """Margins of one tendon."""
    return {
        "gain_margin": m.gain_margin,
        "gain_limit": m.gain_limit,
        "phase_margin [rad]": m.phase_margin,
        "crossover [Hz]": m.crossover,
        "delay_margin [s]": m.delay_margin,
        "delay_limit [s]": m.delay_limit,
        "peak_sensitivity": m.peak_sensitivity,
    }


def model_bytes(result: ClosedLoop) -> bytes:
    """NPZ with A, B, C, D, dt, states, inputs, outputs: what `control.StateSpace` takes, without python-control."""
    m, buffer = result.model.select("tension", "angle"), BytesIO()
    states, inputs, outputs = np.array(m.states), np.array(m.inputs), np.array(m.outputs)
    np.savez(buffer, A=m.A, B=m.B, C=m.C, D=m.D, dt=m.period, states=states, inputs=inputs, outputs=outputs)
    return buffer.getvalue()
