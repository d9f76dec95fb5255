"""Catalogue of the faults that may be injected: one line per effect, and the draw of one of them.

Ranges are those of effects.md and physics.md section 4 where they leave a gap above the noise, widened [A]
where they do not (viscous friction, clock skew, current limit). A draw that leaves no gap is drawn again by the
maker.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from exodrake.reference.injectors import LIBRARY_INJECTORS
from exodrake.reference.outside import OUTSIDE_INJECTORS
from exodrake.reference.records import JOINTS, WIRES
from exodrake.reference.robot_spec import InjectedFault

INJECTORS = LIBRARY_INJECTORS | OUTSIDE_INJECTORS
ONE_ONLY = 0.4  # share of draws that sit on one wire or joint


@dataclass(frozen=True)
class Entry:
    """Distribution of one injected effect: ranges of its parameters and its seat.

    Attributes:
        seat: "wire", "joint", "one joint", or "" (whole robot).
        ranges: Parameter -> (low, high), drawn log-uniformly if low > 0.
        exact: Whether the parameters mean what effects.md's mean, so that intervals can be checked against them.
        signed: Parameters that get either sign.
        blocks: Blocks it acts in, of a fault outside the library; an effect of the library says it in its id.
        channels: Wires or joints it acts on, where these are not drawn.
    """

    seat: str
    ranges: dict[str, tuple[float, float]]
    exact: bool = False
    signed: tuple[str, ...] = ()
    blocks: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()


LIBRARY = {
    "motor.slow_velocity_loop": Entry("wire", {"factor": (0.15, 0.5)}),
    "motor.dead_zone": Entry("wire", {"width": (0.6e-3, 3e-3)}),
    "motor.current_limit": Entry("wire", {"limit": (0.045, 0.12)}),
    "motor.spool_growth": Entry("wire", {"growth": (1.5, 5.5)}),
    "tendon.capstan_friction": Entry("wire", {"mu_phi": (0.1, 0.6)}),
    "tendon.coulomb_friction": Entry("wire", {"force": (0.15, 0.8)}),
    "tendon.stribeck_friction": Entry("wire", {"force": (0.2, 0.7), "ratio": (1.25, 1.8), "speed": (1e-3, 5e-3)}),
    "tendon.viscous_friction": Entry("wire", {"coefficient": (4.0, 25.0)}),
    "tendon.compliance": Entry("wire", {"stiffness": (700.0, 6000.0)}),
    "tendon.creep": Entry("wire", {"stiffness": (4000.0, 15000.0), "time_constant": (2.0, 30.0)}),
    "tendon.slack": Entry("wire", {"length": (0.5e-3, 3e-3)}),
    "tendon.stiffening": Entry("wire", {"soft_stiffness": (700.0, 1600.0), "stiffening": (80.0, 400.0)}),
    "sensor.gain": Entry("wire", {"gain": (0.02, 0.12)}, exact=True, signed=("gain",)),
    "sensor.offset": Entry("wire", {"offset": (0.1, 0.8)}, exact=True, signed=("offset",)),
    "sensor.drift": Entry("wire", {"rate": (3e-3, 2e-2)}, signed=("rate",)),
    "sensor.nonlinearity": Entry("wire", {"error": (0.1, 0.6)}, signed=("error",)),
    "sensor.lag": Entry("wire", {"time_constant": (0.015, 0.08)}),
    "sensor.pulley_friction": Entry("wire", {"mu": (0.01, 0.06)}),
    "sensor.crosstalk": Entry("wire", {"coefficient": (0.01, 0.05)}, exact=True),
    "finger.stiffness": Entry("joint", {"factor": (0.55, 1.8)}, exact=True),
    "finger.hardening": Entry("joint", {"coefficient": (0.01, 0.08)}),
    "finger.viscoelasticity": Entry("joint", {"fraction": (0.12, 0.6), "time_constant": (0.7, 10.0)}),
    "finger.hysteresis": Entry("joint", {"torque": (1.5e-3, 8e-3), "width": (0.02, 0.08)}),
    "finger.coupling": Entry("", {"stiffness": (5e-3, 3e-2), "ratio": (0.5, 0.8)}),
    "finger.router_height": Entry("joint", {"height": (0.3e-3, 1.4e-3)}, signed=("height",)),
    "finger.router_migration": Entry("wire", {"migration": (3e-5, 1.5e-4)}),
    "finger.gravity": Entry("", {"pitch": (-0.3, 0.3)}, exact=True),
    "finger.contact": Entry("", {"distance": (0.034, 0.055), "stiffness": (1000.0, 8000.0)}),
    "finger.tremor": Entry("one joint", {"torque": (2e-3, 1e-2), "frequency": (4.0, 10.0)}),
    "finger.spasticity": Entry("joint", {"gain": (5e-3, 4e-2), "threshold": (0.15, 0.6)}),
    "timing.command_latency": Entry("", {"frames": (1, 3)}, exact=True),
    "timing.dropped_commands": Entry("", {"probability": (0.05, 0.35)}, exact=True),
    "timing.mocap_delay": Entry("", {"delay": (0.012, 0.08)}, exact=True),
    "timing.mocap_clock_skew": Entry("", {"skew": (6e-4, 3e-3)}, exact=True, signed=("skew",)),
    "encoder.homing_offset": Entry("wire", {"offset": (0.3e-3, 2e-3)}, exact=True, signed=("offset",)),
    "mocap.gain": Entry("joint", {"gain": (0.03, 0.15)}, exact=True, signed=("gain",)),
    "mocap.offset": Entry("joint", {"offset": (0.02, 0.15)}, exact=True, signed=("offset",)),
}


def outside(
    ranges: dict[str, tuple[float, float]],
    blocks: tuple[str, ...],
    channels: tuple[str, ...],
    signed: tuple[str, ...] = (),
) -> Entry:
    """Entry of a fault outside the library, on channels that are not drawn; a spool is where motor and tendon meet."""
    return Entry("", ranges, signed=signed, blocks=blocks, channels=channels)


OUTSIDE = {
    "outside.spool_eccentricity": outside(
        {"eccentricity": (0.06, 0.15), "phase": (0.1, 6.2)}, ("motor", "tendon"), WIRES
    ),
    "outside.wire_snag": outside(
        {"force": (1.0, 3.0), "place": (5e-3, 9e-3), "width": (4e-4, 1e-3)}, ("tendon",), ("AF",)
    ),
    "outside.wandering_rest": outside({"size": (0.08, 0.2), "memory": (2.0, 10.0)}, ("finger",), JOINTS),
    "outside.torque_bursts": outside(
        {"torque": (0.008, 0.03), "length": (0.8, 2.0)}, ("finger",), JOINTS, signed=("torque",)
    ),
    "outside.posture_friction": outside({"torque": (5e-3, 2e-2)}, ("finger",), JOINTS),
    "outside.redonning": outside(
        {"height": (0.6e-3, 1.5e-3), "length": (1e-3, 2e-3)}, ("finger", "tendon"), WIRES, signed=("height",)
    ),
    "outside.tendon_jump": outside({"shift": (1e-3, 3e-3), "length": (1.0, 3.0)}, ("tendon",), ("AF",)),
    "outside.snap_through": outside(
        {"torque": (0.012, 0.03), "angle": (0.6, 0.9), "width": (0.08, 0.16)}, ("finger",), ("PIP",)
    ),
    "outside.flexible_mount": outside({"ratio": (0.8, 1.3), "frequency": (3.0, 6.0)}, ("motor",), WIRES),
    "outside.voltage_sag": outside({"depth": (0.75, 0.92)}, ("motor",), WIRES),
    "outside.abduction": outside({"splay": (0.05, 0.12)}, ("finger",), ("MCP",)),
    "outside.warming": outside({"softening": (0.2, 0.4), "time_constant": (8.0, 25.0)}, ("finger",), JOINTS),
    "outside.spool_slip": outside({"rate": (1e-5, 6e-5), "load": (2.0, 4.0)}, ("motor", "tendon"), WIRES),
    "outside.leaky_integrator": outside({"leak": (3.0, 15.0)}, ("motor",), WIRES),
    "outside.wire_rub": outside({"mu": (0.3, 0.8)}, ("tendon",), ("AF", "MF")),
    "outside.marker_jump": outside({"angle": (0.08, 0.25)}, ("mocap",), ("PIP",), signed=("angle",)),
    "outside.sticking_cell": outside({"band": (0.15, 0.5)}, ("sensor",), WIRES),
}
ENTRIES = LIBRARY | OUTSIDE
MARKER_FAULTS = tuple(name for name in ENTRIES if "mocap" in name or "marker" in name)  # unseen without joint angles

# effects without a strength: there or not there, a wire whose toe stays when its slack goes, a stiffness that is
# replaced whole
WITHOUT_STRENGTH = ("finger.gravity", "tendon.slack", "tendon.stiffening", "timing.command_latency")
NULLS = {
    "motor.slow_velocity_loop": 1.0,
    "motor.current_limit": math.inf,
    "tendon.compliance": math.inf,
    "tendon.creep": math.inf,
    "finger.stiffness": 1.0,
    "finger.contact": math.inf,
}
"""Effect -> null value of its first parameter, which sets its strength; 0 for the others."""


def without_entry(effect_ids: Iterable[str]) -> list[str]:
    """Ids of a library's effects that this catalogue lacks, and that no case can therefore hold."""
    return [effect_id for effect_id in effect_ids if effect_id not in LIBRARY]


def block_of(effect_id: str) -> str:
    """Block an effect of the library belongs to: the part of its id before the dot."""
    return effect_id.split(".")[0]


def blocks_of(effect_id: str) -> tuple[str, ...]:
    """Blocks an effect acts in."""
    return ENTRIES[effect_id].blocks or (block_of(effect_id),)


def channels_of(effect: InjectedFault, names: Iterable[str]) -> list[str]:
    """Channels among `names` (wires or joints) that an injected effect acts on."""
    return [name for name in (*effect.wires, *effect.joints, *ENTRIES[effect.id].channels) if name in names]


def weakened(effect: InjectedFault, strength: float) -> InjectedFault:
    """Injected effect between absent (strength 0) and as it is (1)."""
    name, value = next(iter(effect.parameters.items()))
    null = NULLS.get(effect.id, 0.0)
    weaker = value / strength if null == math.inf else null + strength * (value - null)
    return replace(effect, parameters=effect.parameters | {name: weaker})


def draw_value(rng: np.random.Generator, low: float, high: float, signed: bool) -> float:
    """One parameter, log-uniform over (low, high); uniform where low <= 0."""
    value = np.exp(rng.uniform(np.log(low), np.log(high))) if low > 0 else rng.uniform(low, high)
    return float(value * rng.choice((-1, 1)) if signed else value)


def draw_seat(rng: np.random.Generator, seat: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Wires and joints an effect sits on."""
    names = {"wire": WIRES, "joint": JOINTS, "one joint": JOINTS[:2]}.get(seat, ())
    chosen = tuple(names)
    if seat == "one joint" or (names and rng.random() < ONE_ONLY):
        chosen = (str(rng.choice(names)),)
    return (chosen, ()) if seat == "wire" else ((), chosen)


def draw_effect(effect_id: str, rng: np.random.Generator) -> InjectedFault:
    """One effect with parameters and seat drawn from its catalogue line."""
    entry = ENTRIES[effect_id]
    parameters = {name: draw_value(rng, low, high, name in entry.signed) for name, (low, high) in entry.ranges.items()}
    if effect_id == "finger.gravity" and rng.random() < 0.5:
        parameters["pitch"] += float(np.pi)
    if effect_id == "timing.command_latency":
        parameters["frames"] = float(rng.integers(1, 4))
    if effect_id == "finger.stiffness" and 0.85 < parameters["factor"] < 1.18:
        parameters["factor"] *= 1.35
    wires, joints = draw_seat(rng, entry.seat)
    return InjectedFault(effect_id, wires, joints, parameters)
