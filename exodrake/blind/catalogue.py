"""What may be injected, where and how much: one line per effect, and the draw of one of them.

Ranges are those of effects.md and physics.md section 4 where they leave a gap above the noise, widened [A]
where they do not (viscous friction, clock skew, current limit). A draw that leaves no gap is drawn again by the
maker.
"""

from dataclasses import dataclass

import numpy as np

from exodrake.blind.injectors import LIBRARY_INJECTORS
from exodrake.blind.outside import OUTSIDE_INJECTORS
from exodrake.blind.records import JOINTS, WIRES
from exodrake.blind.robot_spec import InjectedFault

INJECTORS = LIBRARY_INJECTORS | OUTSIDE_INJECTORS
ONE_ONLY = 0.4  # share of draws that sit on one wire or joint


@dataclass(frozen=True)
class Entry:
    """How one effect is drawn.

    Attributes:
        seat: "wire", "joint", "one joint", or "" (whole robot).
        ranges: parameter -> (low, high), drawn log-uniformly if low > 0.
        exact: whether the parameters mean what effects.md's mean, so that intervals can be checked against them.
        signed: parameters that get either sign.
    """

    seat: str
    ranges: dict
    exact: bool = False
    signed: tuple = ()


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

OUTSIDE = {
    "outside.spool_eccentricity": Entry("", {"eccentricity": (0.06, 0.15), "phase": (0.1, 6.2)}),
    "outside.wire_snag": Entry("", {"force": (1.0, 3.0), "place": (5e-3, 9e-3), "width": (4e-4, 1e-3)}),
    "outside.wandering_rest": Entry("", {"size": (0.08, 0.2), "memory": (2.0, 10.0)}),
    "outside.torque_bursts": Entry("", {"torque": (0.008, 0.03), "length": (0.8, 2.0)}, signed=("torque",)),
    "outside.posture_friction": Entry("", {"torque": (5e-3, 2e-2)}),
    "outside.redonning": Entry("", {"height": (0.6e-3, 1.5e-3), "length": (1e-3, 2e-3)}, signed=("height",)),
    "outside.tendon_jump": Entry("", {"shift": (1e-3, 3e-3), "length": (1.0, 3.0)}),
    "outside.snap_through": Entry("", {"torque": (0.012, 0.03), "angle": (0.6, 0.9), "width": (0.08, 0.16)}),
    "outside.flexible_mount": Entry("", {"ratio": (0.8, 1.3), "frequency": (3.0, 6.0)}),
    "outside.voltage_sag": Entry("", {"depth": (0.75, 0.92)}),
    "outside.abduction": Entry("", {"splay": (0.05, 0.12)}),
    "outside.warming": Entry("", {"softening": (0.2, 0.4), "time_constant": (8.0, 25.0)}),
    "outside.spool_slip": Entry("", {"rate": (1e-5, 6e-5), "load": (2.0, 4.0)}),
    "outside.leaky_integrator": Entry("", {"leak": (3.0, 15.0)}),
    "outside.wire_rub": Entry("", {"mu": (0.3, 0.8)}),
    "outside.marker_jump": Entry("", {"angle": (0.08, 0.25)}, signed=("angle",)),
    "outside.sticking_cell": Entry("", {"band": (0.15, 0.5)}),
}
ENTRIES = LIBRARY | OUTSIDE


def without_entry(effect_ids):
    """Ids of a library's effects that this catalogue lacks, and that no case can therefore hold."""
    return [effect_id for effect_id in effect_ids if effect_id not in LIBRARY]


def block_of(effect_id):
    """Block an effect belongs to: the part of its id before the dot."""
    return effect_id.split(".")[0]


def draw_value(rng, low, high, signed):
    """One parameter, log-uniform over (low, high); uniform where low <= 0."""
    value = np.exp(rng.uniform(np.log(low), np.log(high))) if low > 0 else rng.uniform(low, high)
    return float(value * rng.choice((-1, 1)) if signed else value)


def draw_seat(rng, seat):
    """Wires and joints an effect sits on."""
    names = {"wire": WIRES, "joint": JOINTS, "one joint": JOINTS[:2]}.get(seat, ())
    chosen = tuple(names)
    if seat == "one joint" or (names and rng.random() < ONE_ONLY):
        chosen = (str(rng.choice(names)),)
    return (chosen, ()) if seat == "wire" else ((), chosen)


def draw_effect(effect_id, rng):
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
