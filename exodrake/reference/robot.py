"""A robot of the reference simulator: nominal parameters of nominal.yaml, injected faults, motion. SI throughout."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.schema import read_yaml
from exodrake.reference.dynamics import FRAME as FRAME, ROBOT

WIRES = ("AF", "MF", "AE")
JOINTS = ("MCP", "PIP", "DIP")
NOMINAL, FORMS = read_yaml(Path(__file__).with_name("nominal.yaml")).values()  # by name, with value [SI] and unit
WHOLE = ("tau_cell", "gear", "kp", "kd", "speed_max", "quantum_force")
SPOOL_CONFIGURED = 7.5e-3  # m, what drive and log assume
TENSION_MAX = np.array([12.0, 8.0, 8.0])  # N
TENSION_MIN = 0.3  # N
CLIP = 2.5  # standard deviations


def draw_parameters(rng: np.random.Generator | None = None) -> dict[str, np.ndarray]:
    """Draw one robot's parameters; the nominal ones without a generator.

    Name -> value [SI], each times its own clipped normal factor: scalar, (3,) by wire or joint, or (2, 3) by side and
    joint.
    """
    parameters = {}
    for name, item in NOMINAL.items():
        shape = () if name in WHOLE else (2, 3) if name == "axial" else (3,)
        factor = 1.0 if rng is None else 1.0 + item["tolerance"] * np.clip(rng.standard_normal(shape), -CLIP, CLIP)
        parameters[name] = np.broadcast_to(np.asarray(item["value"], float), shape) * factor
    return parameters


def robot_record(parameters, quantised=True):
    """Parameter record of a robot without any effect; phalanges are solid cylinders, centre of mass half way."""
    record, length = np.zeros(1, ROBOT)[0], parameters["length"]
    heights = np.array([parameters["height_flexor"], parameters["height_extensor"]])
    derived = {
        "axial_distal": parameters["axial"], "axial_proximal": parameters["axial"],
        "height_distal": heights, "height_proximal": heights, "centre": length / 2,
        "unit_inertia": length**2 / 3 + parameters["radius"] ** 2 / 4, "spool_config": SPOOL_CONFIGURED, "factor": 1.0,
    }  # fmt: skip
    for name, value in (parameters | derived | {name: form["value"] for name, form in FORMS.items()}).items():
        if name in ROBOT.names:
            record[name] = value
    record["quantum_force"] *= quantised
    return settle_routing(record)


def settle_routing(record):
    """Distance between the routers at q = 0, so that l(0) = 0 whatever the heights."""
    heights = record["height_distal"] - record["height_proximal"]
    record["straight"] = np.hypot(record["axial_distal"] + record["axial_proximal"], heights)
    return record


@dataclass(frozen=True)
class InjectedFault:
    """One effect in a robot: wires or joints that it sits on (none for all), parameters by effects.md's names [SI]."""

    id: str
    channels: tuple[str, ...] = ()
    parameters: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class RobotSpec:
    """A robot: its parameters (see `draw_parameters`), injected faults, and whether sensors are noisy and quantised."""

    parameters: dict[str, Any] = field(default_factory=draw_parameters)
    effects: tuple[InjectedFault, ...] = ()
    noisy: bool = True
