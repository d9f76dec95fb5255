"""One robot of the reference simulator: parameters, injected faults and a motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from exodrake.reference.parameters import draw_parameters

FRAME = 0.02


@dataclass(frozen=True)
class InjectedFault:
    """One effect in a robot.

    Attributes:
        id: Id of the effect.
        wires: Wires it sits on; empty for all or none.
        joints: Joints it sits on; empty for all or none.
        parameters: Parameters by effects.md's names [SI].
    """

    id: str
    wires: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    parameters: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Protocol:
    """A motion: name and tension references (n, 3) [N], one row per 20 ms frame."""

    name: str
    reference: np.ndarray


@dataclass(frozen=True)
class RobotSpec:
    """A robot: its parameters (see `draw_parameters`), injected faults, and whether sensors are noisy and quantised."""

    parameters: dict[str, Any] = field(default_factory=draw_parameters)
    effects: tuple[InjectedFault, ...] = ()
    noisy: bool = True
