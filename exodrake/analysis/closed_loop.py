"""Analysis of the closed loop at one operating point: `exo.analyse(robot)`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exodrake.analysis.delay_budget import DelayBudget, delay_budget
from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.frequency_response import FrequencyResponse, frequency_response
from exodrake.analysis.linear_model import KINK, FrameModel
from exodrake.analysis.margins import Margins, margins
from exodrake.analysis.open_loop import OpenLoop, opened
from exodrake.analysis.operating_point import OperatingPoint, linearised
from exodrake.analysis.robustness import Band, Robustness, robustness
from exodrake.analysis.stability_map import LatencySweep, StabilityMap, latency_sweep, stability_map
from exodrake.analysis.step_response import StepResponse, step_response
from exodrake.core.argument import argument
from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.core.short_repr import short_repr

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
        opened: linear model opened at its commands.
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
    opened: OpenLoop
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
        return self.returns if self.witnessed else self.model.spectral_radius < 1.0

    @property
    def witnessed(self) -> bool:
        """Whether the nonlinear simulation decides on stability, because the poles do not."""
        return not self.model.decides

    def to_control(self, *kinds: str) -> control.StateSpace:
        """The linear model as a python-control `StateSpace` with dt = one frame; see `to_control` below."""
        return to_control(self.model, *kinds)


def analyse(robot: Robot, at: Mapping[str, float] | str | None = None, seed: int | None = None) -> ClosedLoop:
    """Step responses, poles, margins, frequency response and stability maps of a robot's closed loop.

    Args:
        robot: to be analysed.
        at: operating point, channel -> reference [SI] or the name of one of the machine's; its first by default.
        seed: of sensor noise in the measured frequency response; None measures without noise and rounding.

    Raises:
        InputError: no closed loop, unknown channel, reference outside its limits, kp = 0, or no state of rest.
    """
    loop, point, model = linearised(argument("robot", robot, Robot), at)
    whole = opened(loop, model)
    channels = range(len(loop.channels))
    steps = tuple(step_response(loop, point, i) for i in channels)
    found = tuple(margins(whole, i) for i in channels)
    responses = tuple(frequency_response(loop, point, model, i, seed=seed) for i in channels)
    maps = stability_map(loop, point), latency_sweep(loop, point)
    back = returns(loop, point)
    return ClosedLoop(
        robot, point, model, whole, steps, responses, found, delay_budget(loop, found),
        robustness(loop, point, model, "this robot"), *maps, back,
        (*remarks(loop, point, model, steps), *margin_remarks(found)),
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


def remarks(
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


def margin_remarks(found: tuple[Margins, ...]) -> tuple[str, ...]:
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


def to_control(model: FrameModel, *kinds: str) -> control.StateSpace:
    """A linear model as python-control's `StateSpace`, dt = one frame, signals named as log columns.

    Args:
        model: to be converted.
        kinds: of outputs, such as "tension", "stroke"; all by default.

    Raises:
        InputError: python-control is not installed, or a kind is unknown.
    """
    try:
        from control import StateSpace
    except ImportError:
        raise InputError("python-control is not installed; pip install 'exodrake[control]'") from None
    known = sorted({name.rsplit("_", 1)[0] for name in model.outputs})
    for kind in kinds:
        if kind not in known:
            raise InputError(f"the model has no output {kind!r}; there are {', '.join(known)}")
    m = model.select(*(kinds or known))
    names = {"states": [name.replace(".", "_") for name in m.states], "inputs": [*m.inputs], "outputs": [*m.outputs]}
    return StateSpace(m.A, m.B, m.C, m.D, m.period, remove_useless_states=False, **names)
