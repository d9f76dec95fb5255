"""A closed loop as plain data for JSON; values that are not finite become null."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np

from exodrake.analysis.closed_loop import ClosedLoop
from exodrake.analysis.delay_budget import DelayBudget
from exodrake.analysis.frequency_response import FrequencyResponse
from exodrake.analysis.limit_cycles import LimitCycles
from exodrake.analysis.linear_model import Pole
from exodrake.analysis.margins import Margins
from exodrake.analysis.robustness import Band
from exodrake.analysis.step_response import StepResponse
from exodrake.core.plain import plain


def closed_loop_numbers(result: ClosedLoop, cycles: tuple[LimitCycles, ...] = ()) -> dict[str, Any]:
    """All results with units in the keys."""
    machine, point, model, latency = result.robot.machine, result.point, result.model, result.latency
    readings = {
        f"{kind} [{machine.signal[machine.column(kind).signal].unit}]": dict(
            zip(machine.channels(machine.column(kind).signal), values)
        )
        for kind, values in point.readings.items()
    }
    return plain(
        {
            "robot": result.robot.source or machine.name,
            "effects": result.robot.effects(),
            "stable": result.stable,
            "decided_by": "simulated kick" if result.witnessed else "poles",
            "spectral_radius": model.spectral_radius,
            "returns_after_kick": result.returns,
            "notes": list(result.notes),
            "operating_point": readings
            | {
                "frames": point.frames,
                "residual [excursion/frame]": point.residual,
                "steady_by_own_gains": point.steady,
            },
            "poles": [pole_numbers(p) for p in model.poles()],
            "linear_model": model_numbers(result),
            "steps": {s.channel: step_numbers(s) for s in result.steps},
            "frequency_response": {r.channel: response_numbers(r) for r in result.responses},
            "margins": {m.channel: margin_numbers(m) for m in result.margins},
            "delays": {d.channel: delay_numbers(d) for d in result.delays},
            "robustness": result.robust.numbers,
            "bands": {b.name: band_numbers(b) for b in result.bands},
            "limit_cycles": {c.label: {k: v for k, v in vars(c).items() if k != "label"} for c in cycles},
            "stability_map": map_numbers(result),
            "latency": latency
            and {"frames": latency.frames, "spectral_radius": latency.radius, "limit [frames]": latency.limit},
        }
    )


def map_numbers(result: ClosedLoop) -> dict[str, Any]:
    """Spectral radius over the two gains."""
    return {
        "gains": {name: unit_of(result, name) for name in result.gains.names},
        "first": result.gains.first,
        "second": result.gains.second,
        "spectral_radius": result.gains.radius,
        "limit of the first": result.gains.limit,
        "nominal": result.gains.nominal,
    }


def model_numbers(result: ClosedLoop) -> dict[str, Any]:
    """The linear model with its names and how well the differences agree."""
    m = result.model
    names = {"period [s]": m.period, "states": m.states, "inputs": m.inputs, "outputs": m.outputs}
    quality = {"difference_step": m.step, "convergence": m.convergence, "kink": m.kink, "kink_at": m.where}
    return names | {"A": m.A, "B": m.B, "C": m.C, "D": m.D} | quality


def renamed(result: Any, names: dict[str, str], without: tuple[str, ...]) -> dict[str, Any]:
    """Fields of a result, units in their names, some left out."""
    fields: dict[str, Any] = vars(result)
    return {names.get(k, k): v for k, v in fields.items() if k not in without}


def pole_numbers(pole: Pole) -> dict[str, Any]:
    """One pole."""
    names = {"frequency": "frequency [Hz]", "time_constant": "time_constant [s]"}
    return {"z": pole.z, "modulus": abs(pole.z)} | renamed(pole, names, ())


def step_numbers(step: StepResponse) -> dict[str, Any]:
    """Characteristics of a step response."""
    names = {"rise": "rise_time [s]", "settling": "settling_time [s]"}
    return renamed(step, names, ("channel", "time", "output"))


def response_numbers(response: FrequencyResponse) -> dict[str, Any]:
    """Measured and linear frequency response."""
    names = {k: f"{k} [Hz]" for k in ("frequency", "bandwidth", "bandwidth_measured")}
    return renamed(response, names, ("channel",))


def margin_numbers(m: Margins) -> dict[str, Any]:
    """Margins of one channel."""
    names = {"phase_margin": "phase_margin [rad]", "crossover": "crossover [Hz]"}
    names |= {"delay_margin": "delay_margin [s]", "delay_limit": "delay_limit [s]"}
    return renamed(m, names, ("channel", "frequency", "loop"))


def delay_numbers(d: DelayBudget) -> dict[str, Any]:
    """Delay budget of one channel."""
    slots = {"read": d.read_slot, "control": d.control_slot, "write": d.write_slot}
    parts = {"reading to law [s]": d.to_control, "law to plant [s]": d.to_write, "hold [s]": d.hold}
    return {"slots": slots, **parts, "total [s]": d.total, "margin [s]": d.margin, "margin [slots]": d.spare_slots}


def band_numbers(b: Band) -> dict[str, Any]:
    """Range of every number over a population, and its members."""
    names = [n for n in b.members[0].numbers if n != "spectral radius"] if b.members else []
    return {
        "members": {m.label: m.numbers for m in b.members},
        "range over stable members": {n: b.range(n) for n in names},
        "unstable": b.unstable,
        "undecided by their poles": b.undecided,
        "without operating point": list(b.failures),
    }


def unit_of(result: ClosedLoop, name: str) -> str:
    """SI unit of a parameter, named without channel."""
    return result.robot.machine.parameters[result.robot.indices(name)[0]].unit


def model_bytes(result: ClosedLoop) -> bytes:
    """NPZ with A, B, C, D, dt, states, inputs, outputs: what `control.StateSpace` takes, without python-control."""
    m, buffer = result.model, BytesIO()
    states, inputs, outputs = np.array(m.states), np.array(m.inputs), np.array(m.outputs)
    np.savez(buffer, A=m.A, B=m.B, C=m.C, D=m.D, dt=m.period, states=states, inputs=inputs, outputs=outputs)
    return buffer.getvalue()
