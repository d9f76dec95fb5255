"""Effects that are in no library: what an UNKNOWN case is made of. All forms and magnitudes [A].

Each is outside effects.md, and as far as possible outside physics.md section 4 too, since the library may hold more
than effects.md lists.
"""

import numpy as np

from exodrake.reference.records import MARKER_SHIFT, REST_SHIFT, ROUTER_SHIFT, STIFFENED, SUPPLY, VOLUNTARY, WIRE_SHIFT

FRAME = 0.02


def walk(rng, samples, size, memory):
    """A wandering course (samples,) of standard deviation `size` with correlation time `memory` [s]; starts at 0."""
    keep = np.exp(-FRAME / memory)
    kicks = size * np.sqrt(1 - keep**2) * rng.standard_normal(samples)
    course = np.zeros(samples)
    for row in range(1, samples):
        course[row] = keep * course[row - 1] + kicks[row]
    return course


def bursts(rng, time, gap, length):
    """Smooth bumps of height 1 at random times: mean gap and mean length [s]."""
    course, clock = np.zeros(len(time)), rng.exponential(gap)
    while clock < time[-1]:
        span = length * rng.uniform(0.5, 1.5)
        inside = (time >= clock) & (time <= clock + span)
        course[inside] = np.sin(np.pi * (time[inside] - clock) / span) ** 2
        clock += span + rng.exponential(gap)
    return course


def spool_eccentricity(build, effect, rng):
    """Spool bored off centre: radius changes periodically with its angle."""
    build.record["eccentricity"] = effect.parameters["eccentricity"]
    build.record["eccentric_phase"] = effect.parameters["phase"]


def wire_snag(build, effect, rng):
    """A rough spot that holds the all-flexor wire back at one place, pulling only."""
    for name in ("snag_force", "snag_place", "snag_width"):
        build.record[name] = effect.parameters[name.removeprefix("snag_")]


def wandering_rest(build, effect, rng):
    """The wearer's resting posture wanders."""
    for joint in range(3):
        build.inputs[:, REST_SHIFT + joint] += walk(
            rng, len(build.time), effect.parameters["size"], effect.parameters["memory"]
        )


def torque_bursts(build, effect, rng):
    """Voluntary flexion now and then."""
    course = effect.parameters["torque"] * bursts(rng, build.time, 4.0, effect.parameters["length"])
    for joint, share in enumerate((1.0, 0.6, 0.25)):
        build.inputs[:, VOLUNTARY + joint] += share * course


def posture_friction(build, effect, rng):
    """Joint friction that grows with the square of flexion."""
    build.record["loss_by_angle"] = effect.parameters["torque"]
    build.record["loss_width"] = 0.04


def redonning(build, effect, rng):
    """The glove slips at one moment: routers and wires sit elsewhere from then on."""
    after = np.clip((build.time - rng.uniform(0.3, 0.7) * build.time[-1]) / 0.2, 0.0, 1.0)
    build.inputs[:, ROUTER_SHIFT] += effect.parameters["height"] * after
    for wire in range(3):
        build.inputs[:, WIRE_SHIFT + wire] += effect.parameters["length"] * rng.uniform(-1, 1) * after


def tendon_jump(build, effect, rng):
    """A wire jumps off a pulley and back again."""
    off = np.clip(3.0 * bursts(rng, build.time, 5.0, effect.parameters["length"]), 0.0, 1.0)
    build.inputs[:, WIRE_SHIFT] += effect.parameters["shift"] * off


def snap_through(build, effect, rng):
    """Negative stiffness around one PIP angle."""
    build.record["notch_torque"] = effect.parameters["torque"]
    build.record["notch_angle"] = effect.parameters["angle"]
    build.record["notch_width"] = effect.parameters["width"]


def flexible_mount(build, effect, rng):
    """The actuation unit rings on its mount, kicked by what it accelerates."""
    build.record["mount_frequency"] = effect.parameters["frequency"]
    build.record["mount_ratio"] = effect.parameters["ratio"]


def voltage_sag(build, effect, rng):
    """The supply sags in spells; back EMF then limits the current."""
    build.record["supply_voltage"] = 12.0
    build.record["winding_resistance"] = 19.8
    build.inputs[:, SUPPLY] -= effect.parameters["depth"] * np.clip(2 * bursts(rng, build.time, 2.0, 6.0), 0, 1)


def abduction(build, effect, rng):
    """The finger splays as the all-flexor wire pulls: the MCP's plane no longer holds the wires."""
    build.record["abduction"] = effect.parameters["splay"]


def warming(build, effect, rng):
    """Tissue softens as it warms up over the log."""
    softer = -effect.parameters["softening"] * (1 - np.exp(-build.time / effect.parameters["time_constant"]))
    for joint in range(3):
        build.inputs[:, STIFFENED + joint] += softer


def spool_slip(build, effect, rng):
    """The wire slips on its spool, for good, while the load is above a threshold."""
    build.record["slip_rate"] = effect.parameters["rate"]
    build.record["slip_load"] = effect.parameters["load"]


def leaky_integrator(build, effect, rng):
    """The drive's integrator forgets, so the speed droops under load."""
    build.record["leak"] = effect.parameters["leak"]


def wire_rub(build, effect, rng):
    """The two flexor wires rub against each other where they share a sheath."""
    build.record["rub"] = effect.parameters["mu"]


def marker_jump(build, effect, rng):
    """A marker cluster is mislabelled in spells."""
    spells = np.clip(8 * bursts(rng, build.time, 4.0, 2.5), 0, 1)
    build.inputs[:, MARKER_SHIFT + 1] += effect.parameters["angle"] * spells


def sticking_cell(build, effect, rng):
    """The cell's reading stays put until the load has moved far enough."""
    build.record["sticky"] = effect.parameters["band"]


_ALL = (
    spool_eccentricity,
    wire_snag,
    wandering_rest,
    torque_bursts,
    posture_friction,
    redonning,
    tendon_jump,
    snap_through,
    flexible_mount,
    voltage_sag,
    abduction,
    warming,
    spool_slip,
    leaky_integrator,
    wire_rub,
    marker_jump,
    sticking_cell,
)
OUTSIDE_INJECTORS = {f"outside.{inject.__name__}": inject for inject in _ALL}
