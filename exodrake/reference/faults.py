"""Faults of the reference simulator: those of effects.md in forms of its own, those outside every library, and draws.

An injector writes into the parameter record (constants) or into the inputs (courses over time); the forms are in
dynamics.py and simulator.py. The faults `outside.*` are outside effects.md and, as far as possible, outside physics.md
section 4; their forms and magnitudes are [A]. Ranges are those of effects.md and physics.md section 4 where they leave
a gap above the noise, widened [A] where they do not (viscous friction, clock skew, current limit). A draw that leaves
no gap is drawn again by the maker.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from exodrake.reference import dynamics
from exodrake.reference.robot import FRAME, JOINTS, WIRES, InjectedFault, settle_routing

GRAVITY = 9.81  # m/s2
MIDDLE_LOAD = 4.0  # N, load at which a stiffening garment's secant stiffness is the stated one [A]
TOE = 1.5e-4  # m, over which a slack wire comes taut [A]
BURST = 2.5  # frames lost in a row on average [A]


# Injectors take the robot that is being assembled (`simulator.Build`), the indices of the fault's wires or joints, its
# parameters p [SI] and a random generator.


def slow_loop(build, where, p, rng):
    """Speed loop with an extra first-order lag whose delay adds to the loop's own 1/bandwidth."""
    record = build.record
    bandwidth = record["loop_p"] * record["torque_constant"] / record["inertia"]
    record["command_lag"][where] = (1.0 / p["factor"] - 1.0) / bandwidth[where]


def drift(build, where, p, rng):
    """Trend plus a random walk that ends, typically, a seventh of the trend off."""
    rate, time = p["rate"], build.time
    for wire in where:
        steps = rng.standard_normal(len(time)) / np.sqrt(len(time))
        build.inputs[:, dynamics.CELL_DRIFT + wire] += rate * time + 0.15 * abs(rate) * time[-1] * np.cumsum(steps)


def router_height(build, where, p, rng):
    """Distal routers carry more of the error than proximal ones."""
    build.record["height_distal"][:, where] += 1.25 * p["height"]
    build.record["height_proximal"][:, where] += 0.75 * p["height"]
    settle_routing(build.record)


def tremor(build, where, p, rng):
    """A phase that wanders by about half a turn in 10 s [A]."""
    build.record["tremor_torque"], build.record["tremor_frequency"] = p["torque"], p["frequency"]
    build.record["tremor_share"][where] = 1.0
    step = np.sqrt(build.time[1] / 10.0) * np.pi
    build.inputs[:, dynamics.TREMOR_PHASE] += rng.uniform(0, 2 * np.pi) + np.cumsum(
        step * rng.standard_normal(len(build.time))
    )


def drop_frames(build, where, p, rng):
    """Bursty losses (two-state Markov chain) of whole frames, all wires together, with the stated share lost."""
    share = p["probability"]
    leave, enter = 1.0 / BURST, share / (1.0 - share) / BURST
    lost = False
    for frame, value in enumerate(rng.random(len(build.dropped))):
        lost = value >= leave if lost else value < enter
        build.dropped[frame] = lost


def draw_bursts(rng, time, gap, length):
    """Smooth bumps of height 1 at random times: mean gap and mean length [s]."""
    course, clock = np.zeros(len(time)), rng.exponential(gap)
    while clock < time[-1]:
        span = length * rng.uniform(0.5, 1.5)
        inside = (time >= clock) & (time <= clock + span)
        course[inside] = np.sin(np.pi * (time[inside] - clock) / span) ** 2
        clock += span + rng.exponential(gap)
    return course


def wandering_rest(build, where, p, rng):
    """The wearer's resting posture wanders, with standard deviation `size` and correlation time `memory` [s]."""
    keep = np.exp(-FRAME / p["memory"])
    kicks = p["size"] * np.sqrt(1 - keep**2) * rng.standard_normal((3, len(build.time)))
    kicks[:, 0] = 0.0
    build.inputs[:, dynamics.REST_SHIFT : dynamics.REST_SHIFT + 3] += np.asarray(lfilter([1.0], [1.0, -keep], kicks)).T


def torque_bursts(build, where, p, rng):
    """Voluntary flexion now and then."""
    course = p["torque"] * draw_bursts(rng, build.time, 4.0, p["length"])
    build.inputs[:, dynamics.VOLUNTARY : dynamics.VOLUNTARY + 3] += np.outer(course, (1.0, 0.6, 0.25))


def redonning(build, where, p, rng):
    """The glove slips at one moment: routers and wires sit elsewhere from then on."""
    after = np.clip((build.time - rng.uniform(0.3, 0.7) * build.time[-1]) / 0.2, 0.0, 1.0)
    build.inputs[:, dynamics.ROUTER_SHIFT] += p["height"] * after
    for wire in range(3):
        build.inputs[:, dynamics.WIRE_SHIFT + wire] += p["length"] * rng.uniform(-1, 1) * after


def tendon_jump(build, where, p, rng):
    """A wire jumps off a pulley and back again."""
    off = np.clip(3.0 * draw_bursts(rng, build.time, 5.0, p["length"]), 0.0, 1.0)
    build.inputs[:, dynamics.WIRE_SHIFT] += p["shift"] * off


def voltage_sag(build, where, p, rng):
    """The supply sags in spells; back EMF then limits the current."""
    build.record["supply_voltage"], build.record["winding_resistance"] = 12.0, 19.8
    build.inputs[:, dynamics.SUPPLY] -= p["depth"] * np.clip(2 * draw_bursts(rng, build.time, 2.0, 6.0), 0, 1)


def warming(build, where, p, rng):
    """Tissue softens as it warms up over the log."""
    softer = -p["softening"] * (1 - np.exp(-build.time / p["time_constant"]))
    build.inputs[:, dynamics.STIFFENED : dynamics.STIFFENED + 3] += softer[:, None]


def marker_jump(build, where, p, rng):
    """A marker cluster is mislabelled in spells."""
    spells = np.clip(8 * draw_bursts(rng, build.time, 4.0, 2.5), 0, 1)
    build.inputs[:, dynamics.MARKER_SHIFT + 1] += p["angle"] * spells


ONE_ONLY = 0.4  # share of draws that sit on one wire or joint


@dataclass(frozen=True)
class Entry:
    """Distribution of one injected effect: ranges of its parameters and its seat."""

    seat: str  # "wire", "joint", "one joint", or "" (whole robot)
    # Writes the fault into the robot that is being assembled; or record field, of its channels -> parameter, or a
    # function of all parameters
    inject: Callable | dict[str, str | Callable]
    ranges: dict[str, tuple[float, float]]  # Parameter -> (low, high), drawn log-uniformly if low > 0
    # Blocks it acts in, of a fault outside the library (a spool is where motor and tendon meet); an effect of the
    # library says it in its id
    blocks: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()  # Wires or joints it acts on, where these are not drawn
    # Whether the parameters mean what effects.md's mean, so that intervals can be checked against them
    exact: bool = False
    signed: tuple[str, ...] = ()  # Parameters that get either sign
    # Null value of the first parameter, which sets the strength; None for an effect that is there or not there, for a
    # wire whose toe stays when its slack goes, and for a stiffness that is replaced whole
    null: float | None = 0.0


# fmt: off
LIBRARY = {
    "motor.slow_velocity_loop": Entry("wire", slow_loop, {"factor": (0.15, 0.5)}, null=1.0),
    "motor.dead_zone": Entry("wire", {"dead_zone": "width"}, {"width": (0.6e-3, 3e-3)}),
    "motor.current_limit": Entry("wire", {"soft_limit": "limit"}, {"limit": (0.045, 0.12)}, null=math.inf),
    "motor.spool_growth": Entry("wire", {"growth": "growth"}, {"growth": (1.5, 5.5)}),
    "tendon.capstan_friction": Entry("wire", {"capstan": "mu_phi"}, {"mu_phi": (0.1, 0.6)}),
    "tendon.coulomb_friction": Entry("wire", {"coulomb": "force"}, {"force": (0.15, 0.8)}),
    "tendon.stribeck_friction": Entry(
        "wire", {"coulomb": "force", "static": lambda p: p["force"] * p["ratio"], "stribeck_speed": "speed"},
        {"force": (0.2, 0.7), "ratio": (1.25, 1.8), "speed": (1e-3, 5e-3)}),
    "tendon.viscous_friction": Entry("wire", {"viscous": "coefficient"}, {"coefficient": (4.0, 25.0)}),
    # Kelvin-Voigt, mildly stiffening; the stated stiffness is the secant at MIDDLE_LOAD
    "tendon.compliance": Entry(
        "wire", {"garment": lambda p: p["stiffness"] / 1.25,
                 "garment_stiffening": lambda p: 0.25 * p["stiffness"] / MIDDLE_LOAD}, {"stiffness": (700.0, 6000.0)},
        null=math.inf),
    "tendon.creep": Entry("wire", {"creep": "stiffness", "creep_time": "time_constant"},
                          {"stiffness": (4000.0, 15000.0), "time_constant": (2.0, 30.0)}, null=math.inf),
    "tendon.slack": Entry("wire", {"slack": "length", "toe": lambda p: TOE}, {"length": (0.5e-3, 3e-3)}, null=None),
    # the parabola k e (1 + stiffening e / 2) is the start of an exponential k (exp(stiffening e) - 1) / stiffening
    "tendon.stiffening": Entry("wire", {"wire_stiffness": "soft_stiffness", "stiffening": "stiffening"},
                               {"soft_stiffness": (700.0, 1600.0), "stiffening": (80.0, 400.0)}, null=None),
    "sensor.gain": Entry("wire", {"cell_gain": "gain"}, {"gain": (0.02, 0.12)}, exact=True, signed=("gain",)),
    "sensor.offset": Entry("wire", {"cell_offset": "offset"}, {"offset": (0.1, 0.8)}, exact=True, signed=("offset",)),
    "sensor.drift": Entry("wire", drift, {"rate": (3e-3, 2e-2)}, signed=("rate",)),
    "sensor.nonlinearity": Entry("wire", {"cell_bow": "error"}, {"error": (0.1, 0.6)}, signed=("error",)),
    "sensor.lag": Entry("wire", {"cell_lag": "time_constant"}, {"time_constant": (0.015, 0.08)}),
    "sensor.pulley_friction": Entry("wire", {"pulley": "mu"}, {"mu": (0.01, 0.06)}),
    "sensor.crosstalk": Entry("wire", {"crosstalk": "coefficient"}, {"coefficient": (0.01, 0.05)}, exact=True),
    "finger.stiffness": Entry("joint", {"factor": "factor"}, {"factor": (0.55, 1.8)}, exact=True, null=1.0),
    "finger.hardening": Entry("joint", {"hardening": "coefficient"}, {"coefficient": (0.01, 0.08)}),
    "finger.viscoelasticity": Entry("joint", {"relaxing": "fraction", "relaxing_time": "time_constant"},
                                    {"fraction": (0.12, 0.6), "time_constant": (0.7, 10.0)}),
    "finger.hysteresis": Entry("joint", {"loss": "torque", "loss_width": "width"},
                               {"torque": (1.5e-3, 8e-3), "width": (0.02, 0.08)}),
    "finger.coupling": Entry("", {"coupling": "stiffness", "coupling_ratio": "ratio"},
                             {"stiffness": (5e-3, 3e-2), "ratio": (0.5, 0.8)}),
    "finger.router_height": Entry("joint", router_height, {"height": (0.3e-3, 1.4e-3)}, signed=("height",)),
    "finger.router_migration": Entry("wire", {"router_give": "migration"}, {"migration": (3e-5, 1.5e-4)}),
    # the pitch turns the base the way flexion turns a joint: x distal sinks, palm down at 0
    "finger.gravity": Entry("", {"gravity_x": lambda p: GRAVITY * np.sin(p["pitch"]),
                                 "gravity_y": lambda p: -GRAVITY * np.cos(p["pitch"])},
                            {"pitch": (-0.3, 0.3)}, exact=True, null=None),
    "finger.contact": Entry("", {"contact_depth": "distance", "contact_stiffness": "stiffness"},
                            {"distance": (0.034, 0.055), "stiffness": (1000.0, 8000.0)}, null=math.inf),
    "finger.tremor": Entry("one joint", tremor, {"torque": (2e-3, 1e-2), "frequency": (4.0, 10.0)}),
    "finger.spasticity": Entry("joint", {"spastic_gain": "gain", "spastic_threshold": "threshold"},
                               {"gain": (5e-3, 4e-2), "threshold": (0.15, 0.6)}),
    "timing.command_latency": Entry("", {"latency": "frames"}, {"frames": (1, 3)}, exact=True, null=None),
    "timing.dropped_commands": Entry("", drop_frames, {"probability": (0.05, 0.35)}, exact=True),
    "timing.mocap_delay": Entry("", {"mocap_delay": "delay"}, {"delay": (0.012, 0.08)}, exact=True),
    "timing.mocap_clock_skew": Entry("", {"mocap_skew": "skew"}, {"skew": (6e-4, 3e-3)}, exact=True, signed=("skew",)),
    "encoder.homing_offset": Entry(
        "wire", {"homing": "offset"}, {"offset": (0.3e-3, 2e-3)}, exact=True, signed=("offset",)),
    "mocap.gain": Entry("joint", {"marker_gain": "gain"}, {"gain": (0.03, 0.15)}, exact=True, signed=("gain",)),
    "mocap.offset": Entry(
        "joint", {"marker_offset": "offset"}, {"offset": (0.02, 0.15)}, exact=True, signed=("offset",)),
}
OUTSIDE = {
    # bored off centre
    "outside.spool_eccentricity": Entry(
        "", {"eccentricity": "eccentricity", "eccentric_phase": "phase"},
        {"eccentricity": (0.06, 0.15), "phase": (0.1, 6.2)}, ("motor", "tendon"), WIRES),
    # a rough spot, pulling only
    "outside.wire_snag": Entry("", {"snag_force": "force", "snag_place": "place", "snag_width": "width"},
                               {"force": (1.0, 3.0), "place": (5e-3, 9e-3), "width": (4e-4, 1e-3)},
                               ("tendon",), ("AF",)),
    "outside.wandering_rest": Entry(
        "", wandering_rest, {"size": (0.08, 0.2), "memory": (2.0, 10.0)}, ("finger",), JOINTS),
    "outside.torque_bursts": Entry(
        "", torque_bursts, {"torque": (0.008, 0.03), "length": (0.8, 2.0)}, ("finger",), JOINTS, signed=("torque",)),
    # grows with the square of flexion
    "outside.posture_friction": Entry("", {"loss_by_angle": "torque", "loss_width": lambda p: 0.04},
                                      {"torque": (5e-3, 2e-2)}, ("finger",), JOINTS),
    "outside.redonning": Entry("", redonning, {"height": (0.6e-3, 1.5e-3), "length": (1e-3, 2e-3)},
                               ("finger", "tendon"), WIRES, signed=("height",)),
    "outside.tendon_jump": Entry("", tendon_jump, {"shift": (1e-3, 3e-3), "length": (1.0, 3.0)}, ("tendon",), ("AF",)),
    # negative stiffness around one angle
    "outside.snap_through": Entry("", {"notch_torque": "torque", "notch_angle": "angle", "notch_width": "width"},
                                  {"torque": (0.012, 0.03), "angle": (0.6, 0.9), "width": (0.08, 0.16)},
                                  ("finger",), ("PIP",)),
    # rings, kicked by what it accelerates
    "outside.flexible_mount": Entry("", {"mount_frequency": "frequency", "mount_ratio": "ratio"},
                                    {"ratio": (0.8, 1.3), "frequency": (3.0, 6.0)}, ("motor",), WIRES),
    "outside.voltage_sag": Entry("", voltage_sag, {"depth": (0.75, 0.92)}, ("motor",), WIRES),
    # by the all-flexor wire, out of the MCP's plane
    "outside.abduction": Entry("", {"abduction": "splay"}, {"splay": (0.05, 0.12)}, ("finger",), ("MCP",)),
    "outside.warming": Entry("", warming, {"softening": (0.2, 0.4), "time_constant": (8.0, 25.0)}, ("finger",), JOINTS),
    # for good, above a load
    "outside.spool_slip": Entry("", {"slip_rate": "rate", "slip_load": "load"},
                                {"rate": (1e-5, 6e-5), "load": (2.0, 4.0)}, ("motor", "tendon"), WIRES),
    # the speed droops under load
    "outside.leaky_integrator": Entry("", {"leak": "leak"}, {"leak": (3.0, 15.0)}, ("motor",), WIRES),
    # where the flexor wires share a sheath
    "outside.wire_rub": Entry("", {"rub": "mu"}, {"mu": (0.3, 0.8)}, ("tendon",), ("AF", "MF")),
    "outside.marker_jump": Entry("", marker_jump, {"angle": (0.08, 0.25)}, ("mocap",), ("PIP",), signed=("angle",)),
    # until the load has moved far enough
    "outside.sticking_cell": Entry("", {"sticky": "band"}, {"band": (0.15, 0.5)}, ("sensor",), WIRES),
}
# fmt: on
ENTRIES = LIBRARY | OUTSIDE
MARKER_FAULTS = tuple(name for name in ENTRIES if "mocap" in name or "marker" in name)  # unseen without joint angles
WITHOUT_STRENGTH = tuple(name for name, entry in LIBRARY.items() if entry.null is None)


def inject(build, effect: InjectedFault, rng: np.random.Generator) -> None:
    """Write an effect into a robot that is being assembled (`simulator.Build`)."""
    write, place = ENTRIES[effect.id].inject, {name: i for names in (WIRES, JOINTS) for i, name in enumerate(names)}
    where = [place[name] for name in effect.channels] or [0, 1, 2]
    if not isinstance(write, dict):
        return write(build, where, effect.parameters, rng)
    for name, parameter in write.items():
        value = effect.parameters[parameter] if isinstance(parameter, str) else parameter(effect.parameters)
        if build.record[name].ndim:
            build.record[name][where] = value
        else:
            build.record[name] = value


def find_blocks(effect_id: str) -> tuple[str, ...]:
    """Blocks an effect acts in; one of the library in the block that its id begins with."""
    return ENTRIES[effect_id].blocks or (effect_id.split(".")[0],)


def weaken(effect: InjectedFault, strength: float) -> InjectedFault:
    """Injected effect between absent (strength 0) and as it is (1)."""
    name, value = next(iter(effect.parameters.items()))
    null = ENTRIES[effect.id].null or 0.0
    weaker = value / strength if null == math.inf else null + strength * (value - null)
    return replace(effect, parameters=effect.parameters | {name: weaker})


def draw_effect(effect_id: str, rng: np.random.Generator) -> InjectedFault:
    """One effect with parameters and seat drawn from its catalogue line."""
    entry, parameters = ENTRIES[effect_id], {}
    for name, (low, high) in entry.ranges.items():  # log-uniform; uniform where low <= 0
        value = np.exp(rng.uniform(np.log(low), np.log(high))) if low > 0 else rng.uniform(low, high)
        parameters[name] = float(value * rng.choice((-1, 1)) if name in entry.signed else value)
    if effect_id == "finger.gravity" and rng.random() < 0.5:
        parameters["pitch"] += float(np.pi)
    if effect_id == "timing.command_latency":
        parameters["frames"] = float(rng.integers(1, 4))
    if effect_id == "finger.stiffness" and 0.85 < parameters["factor"] < 1.18:
        parameters["factor"] *= 1.35
    channels = {"wire": WIRES, "joint": JOINTS, "one joint": JOINTS[:2]}.get(entry.seat, ())
    if entry.seat == "one joint" or (channels and rng.random() < ONE_ONLY):
        channels = (str(rng.choice(channels)),)
    return InjectedFault(effect_id, channels, parameters)
