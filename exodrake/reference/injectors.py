"""Injectors of the effects of effects.md, each in the reference simulator's own functional form.

An injector writes into the parameter record (constants) or into the inputs (courses over time). The forms are in
tendons.py, joint_torques.py, dynamics.py and control_loop.py; here an effect's parameters, named as in effects.md,
become their constants.
"""

import numpy as np

from exodrake.reference.parameters import settle_routing
from exodrake.reference.records import CELL_DRIFT, JOINTS, TREMOR_PHASE, WIRES

GRAVITY = 9.81  # m/s2
MIDDLE_LOAD = 4.0  # N, load at which a stiffening garment's secant stiffness is the stated one [A]
TOE = 1.5e-4  # m, over which a slack wire comes taut [A]
BURST = 2.5  # frames lost in a row on average [A]


def wires_of(effect):
    """Indices of the effect's wires; all if it names none."""
    return [WIRES.index(name) for name in effect.wires] or [0, 1, 2]


def joints_of(effect):
    """Indices of the effect's joints; all if it names none."""
    return [JOINTS.index(name) for name in effect.joints] or [0, 1, 2]


def set_wires(**fields):
    """Injector of plain per-wire constants: record field = effect parameter."""

    def inject(build, effect, rng):
        for name, parameter in fields.items():
            build.record[name][wires_of(effect)] = effect.parameters[parameter]

    return inject


def set_joints(**fields):
    """Injector of plain per-joint constants."""

    def inject(build, effect, rng):
        for name, parameter in fields.items():
            build.record[name][joints_of(effect)] = effect.parameters[parameter]

    return inject


def slow_loop(build, effect, rng):
    """Speed loop with an extra first-order lag whose delay adds to the loop's own 1/bandwidth."""
    record = build.record
    bandwidth = record["loop_p"] * record["torque_constant"] / record["inertia"]
    where = wires_of(effect)
    record["command_lag"][where] = (1.0 / effect.parameters["factor"] - 1.0) / bandwidth[where]


def stribeck(build, effect, rng):
    """LuGre friction whose static level exceeds the Coulomb level by the ratio."""
    set_wires(coulomb="force")(build, effect, rng)
    build.record["static"][wires_of(effect)] = effect.parameters["force"] * effect.parameters["ratio"]
    build.record["stribeck_speed"] = effect.parameters["speed"]


def compliance(build, effect, rng):
    """Kelvin-Voigt, mildly stiffening; the stated stiffness is the secant at MIDDLE_LOAD."""
    stiffness, where = effect.parameters["stiffness"], wires_of(effect)
    build.record["garment"][where] = stiffness / 1.25
    build.record["garment_stiffening"][where] = 0.25 * stiffness / MIDDLE_LOAD


def slack(build, effect, rng):
    """Wire too long, that comes taut over a toe."""
    set_wires(slack="length")(build, effect, rng)
    build.record["toe"][wires_of(effect)] = TOE


def stiffening(build, effect, rng):
    """Parabola k e (1 + stiffening e / 2): the start of an exponential k (exp(stiffening e) - 1) / stiffening."""
    where = wires_of(effect)
    build.record["wire_stiffness"][where] = effect.parameters["soft_stiffness"]
    build.record["stiffening"][where] = effect.parameters["stiffening"]


def drift(build, effect, rng):
    """Trend plus a random walk that ends, typically, a seventh of the trend off."""
    rate, time = effect.parameters["rate"], build.time
    for wire in wires_of(effect):
        steps = rng.standard_normal(len(time)) / np.sqrt(len(time))
        build.inputs[:, CELL_DRIFT + wire] += rate * time + 0.15 * abs(rate) * time[-1] * np.cumsum(steps)


def coupling(build, effect, rng):
    """Spring between DIP and PIP."""
    build.record["coupling"][2] = effect.parameters["stiffness"]
    build.record["coupling_ratio"][2] = effect.parameters["ratio"]


def router_height(build, effect, rng):
    """Distal routers carry more of the error than proximal ones."""
    where, error = joints_of(effect), effect.parameters["height"]
    build.record["height_distal"][:, where] += 1.25 * error
    build.record["height_proximal"][:, where] += 0.75 * error
    settle_routing(build.record)


def gravity(build, effect, rng):
    """Pitch turns the base the way flexion turns a joint: x distal sinks, palm down at 0."""
    pitch = effect.parameters["pitch"]
    build.record["gravity_x"] = GRAVITY * np.sin(pitch)
    build.record["gravity_y"] = -GRAVITY * np.cos(pitch)


def contact(build, effect, rng):
    """Object below the fingertip, Hunt-Crossley."""
    build.record["contact_depth"] = effect.parameters["distance"]
    build.record["contact_stiffness"] = effect.parameters["stiffness"]


def tremor(build, effect, rng):
    """A phase that wanders by about half a turn in 10 s [A]."""
    build.record["tremor_torque"] = effect.parameters["torque"]
    build.record["tremor_frequency"] = effect.parameters["frequency"]
    build.record["tremor_share"][joints_of(effect)] = 1.0
    step = np.sqrt(build.time[1] / 10.0) * np.pi
    build.inputs[:, TREMOR_PHASE] += rng.uniform(0, 2 * np.pi) + np.cumsum(step * rng.standard_normal(len(build.time)))


def latency(build, effect, rng):
    """Commands that arrive whole frames late."""
    build.record["latency"] = effect.parameters["frames"]


def dropped(build, effect, rng):
    """Bursty losses (two-state Markov chain) of whole frames, all wires together, with the stated share lost."""
    share = effect.parameters["probability"]
    leave, enter = 1.0 / BURST, share / (1.0 - share) / BURST
    lost, chance = False, rng.random(len(build.dropped))
    for frame, value in enumerate(chance):
        lost = value >= leave if lost else value < enter
        build.dropped[frame] = lost


def mocap_delay(build, effect, rng):
    """Angles logged a constant time late."""
    build.delay = effect.parameters["delay"]


def mocap_skew(build, effect, rng):
    """Motion-capture clock of another rate."""
    build.skew = effect.parameters["skew"]


LIBRARY_INJECTORS = {
    "motor.slow_velocity_loop": slow_loop,
    "motor.dead_zone": set_wires(dead_zone="width"),
    "motor.current_limit": set_wires(soft_limit="limit"),
    "motor.spool_growth": set_wires(growth="growth"),
    "tendon.capstan_friction": set_wires(capstan="mu_phi"),
    "tendon.coulomb_friction": set_wires(coulomb="force"),
    "tendon.stribeck_friction": stribeck,
    "tendon.viscous_friction": set_wires(viscous="coefficient"),
    "tendon.compliance": compliance,
    "tendon.creep": set_wires(creep="stiffness", creep_time="time_constant"),
    "tendon.slack": slack,
    "tendon.stiffening": stiffening,
    "sensor.gain": set_wires(cell_gain="gain"),
    "sensor.offset": set_wires(cell_offset="offset"),
    "sensor.drift": drift,
    "sensor.nonlinearity": set_wires(cell_bow="error"),
    "sensor.lag": set_wires(cell_lag="time_constant"),
    "sensor.pulley_friction": set_wires(pulley="mu"),
    "sensor.crosstalk": set_wires(crosstalk="coefficient"),
    "finger.stiffness": set_joints(factor="factor"),
    "finger.hardening": set_joints(hardening="coefficient"),
    "finger.viscoelasticity": set_joints(relaxing="fraction", relaxing_time="time_constant"),
    "finger.hysteresis": set_joints(loss="torque", loss_width="width"),
    "finger.coupling": coupling,
    "finger.router_height": router_height,
    "finger.router_migration": set_wires(router_give="migration"),
    "finger.gravity": gravity,
    "finger.contact": contact,
    "finger.tremor": tremor,
    "finger.spasticity": set_joints(spastic_gain="gain", spastic_threshold="threshold"),
    "timing.command_latency": latency,
    "timing.dropped_commands": dropped,
    "timing.mocap_delay": mocap_delay,
    "timing.mocap_clock_skew": mocap_skew,
    "encoder.homing_offset": set_wires(homing="offset"),
    "mocap.gain": set_joints(marker_gain="gain"),
    "mocap.offset": set_joints(marker_offset="offset"),
}
