"""Everything about the closed loop at one operating point: `exo.analyse(robot)`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exodrake.analysis.frame_map import FrameMap
from exodrake.analysis.frequency import FrequencyResponse, frequency_response
from exodrake.analysis.linear import FrameModel, linearise
from exodrake.analysis.margins import Margins, margins
from exodrake.analysis.operating import OperatingPoint, operating_point
from exodrake.analysis.stability import LatencySweep, StabilityMap, latency_sweep, stability_map
from exodrake.analysis.steps import StepResponse, step_response
from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.core.short_repr import short_repr

if TYPE_CHECKING:
    import control

KICK, KICKED = 0.1, 1000  # reference step of one frame [N]; frames simulated
KINK, ROUGH = 0.02, 1e-3  # one-sided slopes, and step sizes, that differ by more deserve a word
STEADY_ERROR = 0.02  # share of a step


@short_repr
@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The closed loop of a robot at an operating point.

    Attributes:
        robot: analysed. point: where it rests. model: linear, one step per frame.
        steps, responses, margins: one per tendon, in the machine's order.
        gains: stability over kp and kd. latency: over command latency; None where the robot knows no such effect.
        returns: whether the nonlinear simulation comes back to rest after a kick, the witness where poles mean little.
        notes: what a reader must know before trusting the numbers, a sentence each.
    """

    robot: Robot
    point: OperatingPoint
    model: FrameModel
    steps: tuple[StepResponse, ...]
    responses: tuple[FrequencyResponse, ...]
    margins: tuple[Margins, ...]
    gains: StabilityMap
    latency: LatencySweep | None
    returns: bool
    notes: tuple[str, ...]

    @property
    def stable(self) -> bool:
        """Whether all poles lie inside the unit circle; at a kink, where they mean little, whether the loop returns."""
        return self.returns if self.kinked else self.model.spectral_radius < 1.0

    @property
    def kinked(self) -> bool:
        """Whether the loop rests at a kink, such as stuck friction, where a linear model means little."""
        return self.model.kink > KINK

    def to_control(self, *kinds: str) -> control.StateSpace:
        """The linear model as a python-control `StateSpace` with dt = one frame; see `to_control` below."""
        return to_control(self.model, *kinds)


def analyse(robot: Robot, at: Mapping[str, float] | None = None, seed: int | None = None) -> ClosedLoop:
    """Step responses, poles, margins, frequency response and stability maps of a robot's closed loop.

    Args:
        robot: to be analysed.
        at: operating point, tendon -> tension reference [N]; the machine's own by default.
        seed: of sensor noise in the measured frequency response; None measures without noise and rounding.

    Raises:
        InputError: no tension loop, unknown tendon, reference outside its limits, kp = 0, or no state of rest.
    """
    loop = FrameMap.of(robot)
    point = operating_point(loop, at)
    model = linearise(loop, point.state, point.references)
    tendons = robot.machine.axes.tendons
    steps = tuple(step_response(loop, point, i) for i in range(len(tendons)))
    found = tuple(margins(model, name) for name in tendons)
    responses = tuple(frequency_response(loop, point, model, i, seed=seed) for i in range(len(tendons)))
    maps = stability_map(loop, point), latency_sweep(loop, point)
    back = returns(loop, point)
    return ClosedLoop(robot, point, model, steps, responses, found, *maps, back, remarks(point, model, steps))


def returns(loop: FrameMap, point: OperatingPoint) -> bool:
    """Whether the nonlinear loop rests again, to within 1 %, 20 s after a reference of 0.1 N more for a frame."""
    rows = np.tile(point.references, (KICKED, 1))
    rows[0] += KICK
    tension = loop.run(point.state, rows)[1][:, loop.signals["tension"]]
    speed = np.abs(np.diff(tension, axis=0)).max(axis=1)
    return bool(speed[-50:].max() < 0.01 * speed.max())


def remarks(point: OperatingPoint, model: FrameModel, steps: tuple[StepResponse, ...]) -> tuple[str, ...]:
    """Conditions under which the results mean little, a sentence each."""
    notes = []
    if not point.steady:
        notes.append("the robot's own gains do not bring it to rest; the operating point was reached with gentler ones")
    if point.residual > 1e-6:
        notes.append(f"something slow still moves ({point.residual:.1g} of its excursion a frame)")
    if model.spectral_radius >= 1.0 and model.kink <= KINK:
        notes.append("the loop is unstable here: its step and frequency responses are those of a growing oscillation")
    if point.slack:
        notes.append(f"slack at rest: {', '.join(point.slack)}; poles hold for slack tendons, not for taut ones")
    if model.kink > KINK:
        notes.append(
            f"one-sided slopes differ ({model.where}, {model.kink:.2g}): a kink such as friction; "
            "poles, margins and maps mean little, steps and multisine do"
        )
    if model.convergence > ROUGH:
        notes.append(f"difference quotients depend on their step ({model.convergence:.2g}): rounding or a kink nearby")
    for step in steps:
        if abs(step.steady_error) > STEADY_ERROR * abs(step.size):
            notes.append(
                f"{step.channel} ends {step.steady_error:+.3f} N off its reference after {step.time[-1]:.0f} s"
            )
    return tuple(notes)


def to_control(model: FrameModel, *kinds: str) -> control.StateSpace:
    """A linear model as python-control's `StateSpace`, dt = one frame, signals named as log columns.

    Args:
        model: to be converted.
        kinds: of outputs: "tension", "angle", "stroke", "speed_cmd"; tension and angle by default.

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
    m = model.select(*(kinds or ("tension", "angle")))
    names = [name.replace(".", "_") for name in m.states]
    return StateSpace(
        m.A,
        m.B,
        m.C,
        m.D,
        m.period,
        states=names,
        inputs=list(m.inputs),
        outputs=list(m.outputs),
        remove_useless_states=False,
    )
