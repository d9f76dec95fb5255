"""What an analysis of a closed loop needs to know of a machine: signals, gains, controllers, operating points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from exodrake.core.robot import Robot


@dataclass(frozen=True)
class Gain:
    """A gain of the controller: parameter (name without channel), and the reach of maps and searches [its unit]."""

    parameter: str
    low: float
    high: float


@dataclass(frozen=True)
class Controller:
    """A structure of the controller that can be tuned: which gains are searched, which parameters have other values.

    Attributes:
        name: as in reports.
        gains: searched on logarithmic scales, between bounds above 0.
        fixed: values [SI] of further parameters, by name without channel.
        compliance: parameters that take the columns of the loop's static compliance d(actuated)/d(output), or ().
    """

    name: str
    gains: tuple[Gain, ...]
    fixed: Mapping[str, float] = field(default_factory=dict)
    compliance: tuple[str, ...] = ()


@dataclass(frozen=True)
class Loop:
    """The closed loop of a machine: one controller, run once a frame, with a command and a reading for each channel.

    Attributes:
        reference, command: signals into and out of the controller.
        output, measured: signals of the controlled quantity itself and of its reading.
        actuated: signal that the command's integral moves, for the static compliance; "" where there is none.
        part: name of the controller among the parts.
        held: its state that holds the command until the next.
        gains: the two of the stability map.
        gentle: gains that bring a loop to rest whose own do not.
        step: of a reference, large against noise and small against the limits [unit of the reference].
        points: operating points: name -> channel -> reference [SI]; the first is the machine's own.
        controllers: structures that `tune` compares.
        latency: parameter (without channel) of a latency of the command in frames; "" where there is none.
        resolution: parameter by which the reading is rounded; "" where it is not.
        nonlinear: effects of which limit cycles are predicted, beside the rounding: id -> values [SI] not at default.
        outer: adds the controller to a machine whose own drives cannot be opened; None where it has one.
    """

    reference: str
    command: str
    output: str
    measured: str
    part: str
    held: str
    gains: tuple[Gain, Gain]
    gentle: Mapping[str, float]
    step: float
    points: Mapping[str, Mapping[str, float]]
    controllers: tuple[Controller, ...] = ()
    actuated: str = ""
    latency: str = ""
    resolution: str = ""
    nonlinear: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    outer: Callable[[Robot], Robot] | None = None
