"""Analysis of the closed loop at one operating point, `exo.analyse(robot)`, and its results as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.limit_cycles import LimitCycles
from exodrake.analysis.linear_model import KINK, FrameModel, OperatingPoint, linearise_robot
from exodrake.analysis.margins import (
    DelayBudget,
    LatencySweep,
    Margins,
    StabilityMap,
    delay_budget,
    latency_sweep,
    margins,
    open_loop,
    stability_map,
)
from exodrake.analysis.responses import FrequencyResponse, StepResponse, frequency_response, step_response
from exodrake.analysis.robustness import Band, Robustness, robustness
from exodrake.core.errors import argument, short_repr
from exodrake.core.plain import plain
from exodrake.core.robot import Robot

if TYPE_CHECKING:
    import control

KICK, KICKED = 0.1, 1000  # reference step of one frame, as a share of the loop's step; frames simulated
HARD = 1.0  # the same for a loop that a small kick does not move
ROUGH = 1e-3  # slopes of two step sizes that differ by more deserve a word
STEADY_ERROR = 0.02  # share of a step


@short_repr
@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The closed loop of a robot at an operating point.

    Attributes:
        robot: robot that was analysed.
        point: operating point at which it rests.
        model: linear model with one step per frame.
        opened: linear model opened at its commands, see `margins.cut`.
        steps: step response of each channel, in the machine's order.
        responses: frequency response of each channel.
        margins: stability margins of each channel's loop.
        delays: delay budget of each channel.
        robust: robustness with all commands at once.
        gains: stability map over two gains.
        latency: stability over command latency; None where the robot knows no such effect.
        returns: whether the nonlinear simulation comes back to rest after a kick; it decides where the poles do not.
        notes: what a reader must know before trusting the numbers, a sentence each.
        bands: robustness over populations of robots and operating points.
    """

    robot: Robot
    point: OperatingPoint
    model: FrameModel
    opened: FrameModel
    steps: tuple[StepResponse, ...]
    responses: tuple[FrequencyResponse, ...]
    margins: tuple[Margins, ...]
    delays: tuple[DelayBudget, ...]
    robust: Robustness
    gains: StabilityMap
    latency: LatencySweep | None
    returns: bool
    notes: tuple[str, ...]
    bands: tuple[Band, ...] = ()

    @property
    def stable(self) -> bool:
        """Whether all poles lie inside the unit circle; where they mean little, whether the loop returns to rest."""
        return self.returns if self.kick_decides else self.model.spectral_radius < 1.0

    @property
    def kick_decides(self) -> bool:
        """Whether the nonlinear simulation decides on stability, because the poles do not."""
        return not self.model.decides

    def to_control(self, *kinds: str) -> control.StateSpace:
        """The linear model as a python-control `StateSpace` with dt = one frame; see `FrameModel.to_control`."""
        return self.model.to_control(*kinds)


def analyse(robot: Robot, at: Mapping[str, float] | str | None = None, seed: int | None = None) -> ClosedLoop:
    """Step responses, poles, margins, frequency response and stability maps of a robot's closed loop.

    Args:
        robot: to be analysed.
        at: operating point, channel -> reference [SI] or the name of one of the machine's; its first by default.
        seed: of sensor noise in the measured frequency response; None measures without noise and rounding.

    Raises:
        InputError: no closed loop, unknown channel, reference outside its limits, kp = 0, or no state of rest.

    Examples:
        >>> import exodrake as exo
        >>> exo.analyse(exo.load_robot()).margins[0].channel
        'AF'
    """
    loop, point, model = linearise_robot(argument("robot", robot, Robot), at)
    whole = open_loop(loop, model)
    channels = range(len(loop.channels))
    steps = tuple(step_response(loop, point, i) for i in channels)
    found = tuple(margins(whole, i) for i in channels)
    responses = tuple(frequency_response(loop, point, model, i, seed=seed) for i in channels)
    maps = stability_map(loop, point), latency_sweep(loop, point)
    back = returns(loop, point)
    return ClosedLoop(
        robot, point, model, whole, steps, responses, found, delay_budget(loop, found),
        robustness(loop, point, model, "this robot"), *maps, back,
        (*list_remarks(loop, point, model, steps), *list_margin_remarks(found)),
    )  # fmt: skip


def returns(loop: FrameMap, point: OperatingPoint) -> bool:
    """Whether the nonlinear loop comes back to rest, to within 1 %, after a reference of a tenth of a step for a frame.

    A loop that this does not move gets the whole step. One that rests farther than a step from where it was, as at a
    limit of its commands, has not come back.
    """
    for kick in (KICK, HARD):
        rows = np.tile(point.references, (KICKED, 1))
        rows[0] += kick * loop.loop.step
        output = loop.run(point.state, rows)[1][:, loop.signals[loop.loop.output]]
        speed = np.abs(np.diff(output, axis=0)).max(axis=1)
        if speed.max() > 1e-6 * loop.loop.step:
            away = np.abs(output[-1] - point.output).max()
            return bool(speed[-50:].max() < 0.01 * speed.max() and away < loop.loop.step)
    return True


def list_remarks(
    loop: FrameMap, point: OperatingPoint, model: FrameModel, steps: tuple[StepResponse, ...]
) -> tuple[str, ...]:
    """Conditions under which the results mean little, a sentence each."""
    notes = []
    if not point.steady:
        notes.append("the robot's own gains do not bring it to rest; the operating point was reached with gentler ones")
    if point.residual > 1e-6:
        notes.append(f"something slow still moves ({point.residual:.1g} of its excursion a frame)")
    if model.marginal:
        notes.append(
            f"a pole lies on the unit circle (radius 1 {model.spectral_radius - 1.0:+.0e}), as in a loop that rests "
            "within a dead zone or does not act: only the simulated kick says whether it is stable"
        )
    elif model.spectral_radius > 1.0 and model.kink <= KINK:
        notes.append(
            "the loop is unstable here: its step and frequency responses are those of a growing oscillation, "
            "and it has no margins"
        )
    if point.slack:
        notes.append(f"slack at rest: {', '.join(point.slack)}; poles hold for slack channels, not for taut ones")
    if model.kink > KINK:
        notes.append(
            f"one-sided slopes differ ({model.where}, {model.kink:.2g}): a kink such as friction; "
            "poles, margins and maps mean little, steps and multisine do"
        )
    if model.convergence > ROUGH:
        notes.append(f"difference quotients depend on their step ({model.convergence:.2g}): rounding or a kink nearby")
    unit = loop.robot.machine.signal[loop.loop.output].unit
    for step in steps:
        if abs(step.steady_error) > STEADY_ERROR * abs(step.size):
            notes.append(
                f"{step.channel} ends {step.steady_error:+.3g} {unit} off its reference after {step.time[-1]:.3g} s"
            )
    return tuple(notes)


def list_margin_remarks(found: tuple[Margins, ...]) -> tuple[str, ...]:
    """Remarks on the margins, a sentence each."""
    notes = []
    if idle := [m.channel for m in found if not np.abs(m.loop).max() > 0.0]:
        notes.append(f"the command of {', '.join(idle)} does not act on its reading here: no margins")
    if odd := [m.channel for m in found if not m.consistent]:
        notes.append(f"encirclements and poles disagree for {', '.join(odd)}: no margins")
    for m in found:
        if m.gain_low > 0.0:
            notes.append(f"{m.channel} is conditionally stable: {m.gain_low:.2g} of its loop gain is too little")
    return tuple(notes)


UNITS = {  # names of fields in JSON
    "rise": "rise_time [s]", "settling": "settling_time [s]", "time_constant": "time_constant [s]",
    "frequency": "frequency [Hz]", "bandwidth": "bandwidth [Hz]", "bandwidth_measured": "bandwidth_measured [Hz]",
    "phase_margin": "phase_margin [rad]", "crossover": "crossover [Hz]", "delay_margin": "delay_margin [s]",
    "delay_limit": "delay_limit [s]", "step": "difference_step", "where": "kink_at", "period": "period [s]",
    "residual": "residual [excursion/frame]", "steady": "steady_by_own_gains",
}  # fmt: skip


def name_fields(result: Any, *without: str) -> dict[str, Any]:
    """Fields of a result, units in their names, some left out."""
    fields: dict[str, Any] = vars(result)
    return {UNITS.get(k, k): v for k, v in fields.items() if k not in without}


def to_plain(result: ClosedLoop, cycles: tuple[LimitCycles, ...] = ()) -> dict[str, Any]:
    """All results as plain data for JSON, units in the keys; values that are not finite become null."""
    robot, machine, gains, latency = result.robot, result.robot.machine, result.gains, result.latency
    readings = {
        f"{kind} [{machine.signal[machine.column(kind).signal].unit}]": dict(
            zip(machine.channels(machine.column(kind).signal), values)
        )
        for kind, values in result.point.readings.items()
    }
    return plain(
        {
            "robot": robot.source or machine.name,
            "effects": robot.effects(),
            "stable": result.stable,
            "decided_by": "simulated kick" if result.kick_decides else "poles",
            "spectral_radius": result.model.spectral_radius,
            "returns_after_kick": result.returns,
            "notes": list(result.notes),
            "operating_point": readings
            | name_fields(result.point, "references", "state", "output", "readings", "slack"),
            "poles": [{"z": p.z, "modulus": abs(p.z), **name_fields(p)} for p in result.model.poles()],
            "linear_model": name_fields(result.model, "N", "M"),
            "steps": {s.channel: name_fields(s, "channel", "time", "output") for s in result.steps},
            "frequency_response": {r.channel: name_fields(r, "channel") for r in result.responses},
            "margins": {m.channel: name_fields(m, "channel", "frequency", "loop") for m in result.margins},
            "delays": {
                d.channel: {
                    "slots": {"read": d.read_slot, "control": d.control_slot, "write": d.write_slot},
                    "reading to law [s]": d.to_control,
                    "law to plant [s]": d.to_write,
                    "hold [s]": d.hold,
                    "total [s]": d.total,
                    "margin [s]": d.margin,
                    "margin [slots]": d.spare_slots,
                }
                for d in result.delays
            },
            "robustness": result.robust.numbers,
            "bands": {
                b.name: {
                    "members": {m.label: m.numbers for m in b.members},
                    "range over stable members": {
                        n: b.range(n) for n in (b.members[0].numbers if b.members else ()) if n != "spectral radius"
                    },
                    "unstable": b.unstable,
                    "undecided by their poles": b.undecided,
                    "without operating point": list(b.failures),
                }
                for b in result.bands
            },
            "limit_cycles": {c.label: {k: v for k, v in vars(c).items() if k != "label"} for c in cycles},
            "stability_map": {
                "gains": {name: machine.parameters[robot.indices(name)[0]].unit for name in gains.names},
                "first": gains.first,
                "second": gains.second,
                "spectral_radius": gains.radius,
                "limit of the first": gains.limit,
                "nominal": gains.nominal,
            },
            "latency": latency
            and {"frames": latency.frames, "spectral_radius": latency.radius, "limit [frames]": latency.limit},
        }
    )


def model_bytes(result: ClosedLoop) -> bytes:
    """NPZ with A, B, C, D, dt, states, inputs, outputs: what `control.StateSpace` takes, without python-control."""
    m, buffer = result.model, BytesIO()
    states, inputs, outputs = np.array(m.states), np.array(m.inputs), np.array(m.outputs)
    np.savez(buffer, A=m.A, B=m.B, C=m.C, D=m.D, dt=m.period, states=states, inputs=inputs, outputs=outputs)
    return buffer.getvalue()
