"""Machines of one serial arm, described by the `arm` section of a robot file and a URDF file beside it; no code.

    arm: {urdf: arm.urdf, form: inverse, frame: 0.005}      # or closed-loop, or cable; tip: LINK where joints branch

`inverse` predicts the effort from a measured motion; `closed-loop` runs controller, motors and forward dynamics;
`cable`: position_ref -> PD controller -> A' -> motors -> cables -> arm, motor_position -> A -> controller.

Of a URDF file joints, link inertias and limits are read, no meshes. It is data of somebody else: each value is checked,
the size is limited, and document types and entities are refused, so that nothing is expanded or fetched. Drake's parser
reads the same values (`tests/test_arm.py`).
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from exodrake.core.errors import InputError, nearest
from exodrake.core.files import read_bytes
from exodrake.core.schema import mapping, number, quote, text
from exodrake.effects import collect_effects
from exodrake.model.machine import SETTLING, Column, Controller, Gain, Loop, Machine, Segment
from exodrake.model.mechanism import Body, Chain, Drive, Joint, Mechanism, Shape
from exodrake.model.part import JOINTS, NORMAL, UNIFORM, Axes, Delay, Output, Part, Signal, Task
from exodrake.model.robot import Robot
from exodrake.physics import arm as dynamics, arm_drive, cable, gear_motor
from exodrake.physics.arithmetic import GRAVITY
from exodrake.physics.reading import sensor

STEP = 0.02  # rad or m, of a reference for the analysis: assumed
SWING, SPEED, BRISK = 1.0, 0.5, 2.0  # rad, rad/s, rad/s2 of a moderate motion: assumed
SHARE = 0.05  # of friction in the largest effort: assumed
BANDWIDTH = 2.0 * np.pi * 2.0  # rad/s of the nominal position loops: assumed
STOP = 2.0 * np.pi * 20.0  # rad/s of a link on its end stop, half of critically damped: assumed, stiff rubber
FAR = 1e6  # rad or m: no end stop
POSTURES = 20  # at which efforts are evaluated
TURNS = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s2", "effort": "N m", "inertia": "kg m2"}
SLIDES = {"position": "m", "velocity": "m/s", "acceleration": "m/s2", "effort": "N", "inertia": "kg"}
RATES = {"velocity": "position", "acceleration": "velocity"}  # kind -> the one whose rate of change it is
FORMS = ("inverse", "closed-loop", "cable")
SLOWEST, TICK = 10.0, 5e-4  # s: longest frame; the plant's tick at most, so that a wrist's resonance is resolved
SECTION = mapping(
    {"urdf": text(), "form": text(FORMS), "frame": number(above=0.0, high=SLOWEST), "tip": text()}, required=("urdf",)
)
FRAME = 0.005  # s, as most recordings of arms: assumed
LATE = 0.005  # s: efforts are late by three rows at most, or by three times this where rows are closer; assumed
REST = 0.01  # of the largest speed, below which dry friction of the largest effort counts as rest: assumed
CROSSTALK = ("torque.crosstalk", "encoder.crosstalk")  # not tried: joints are measured one by one
COUNTED = (-0.05, 0.02, 0.05)  # gain of an encoder: counts are exact, pitch and radius err by some per cent. Assumed
# not tried in inverse dynamics: an offset that is the sensor's, a delay of the reading, which `arm.delay` is, and laws
# that make what is predicted smoother or smaller, which noise of the recorded motion asks for
INVERSE = ("arm.offset", "torque.delay", "torque.low_pass", "torque.hysteresis", "torque.saturation")

# of arms with cables
RATIO = 0.05  # of joint to motor: assumed, as of small gears and capstans
RESONANCE = 2.0 * np.pi * 15.0  # rad/s of the links on their cables, motors held: assumed; 10-30 Hz are usual
ORDINARY = 10.0  # kg of an arm that the library's ranges are of, with 1 kg m2 at the joint that moves most: assumed
REFLECTED = 0.2  # inertia of a motor over that of its links, as the joint feels it: assumed
LOSS = 1e-3  # s, of a steel cable: 5 % of critical damping at that resonance: assumed
TAUT = 2.0  # pretension in efforts of a moderate motion: assumed, so that no strand goes slack in one
SENSORS = {"link_position": "link_encoder", "motor_position": "encoder", "motor_effort": "torque"}  # by signal
COLUMNS = (
    Column("motor_effort_ref", "motor_effort_ref", required=False, unit="N m"),
    Column("motor_position", "motor_position_read"),
    Column("motor_effort", "motor_effort_read", unit="N m"),
)
OF_CABLES = ("arm.joint_compliance", "arm.rotor_inertia", "arm.encoder_offset")  # of cables, motors and encoders

# of URDF files
MAX_BYTES = 4_000_000  # a hundred times a long one
LARGEST = 1e9  # of a length, mass, inertia or loss [SI]: beyond any arm
KINDS = ("revolute", "continuous", "prismatic", "fixed")
MAX_JOINTS, MAX_ALL = 30, 300  # that move on the way to the tip; in the file


def arm_machine(name: str, section: Any, folder: Path, source: str) -> Machine:
    """The machine of an `arm` section of a robot file; InputError for a URDF that is not in its folder or no arm."""
    section = SECTION(section, f"{source}, 'arm'")
    path = (folder / section["urdf"]).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise InputError(f"{source}: urdf {section['urdf']} lies outside the folder of the robot file")
    chain = read_urdf(path, section.get("tip", ""))
    make = dict(zip(FORMS, (inverse_machine, closed_machine, cable_machine), strict=True))
    return make[section.get("form", FORMS[0])](name, chain, section.get("frame", FRAME))


def make_machine(
    name: str, chain: Chain, frame: float, parts: tuple[Part, ...], sensors: Mapping[str, str],
    without: tuple[str, ...], given: tuple[Signal, ...], inner: tuple[Signal, ...], columns: tuple[Column, ...],
    slots: int = 4, **rest: Any,
) -> Machine:  # fmt: skip
    """The machine of an arm of some parts; sensors: column kind -> part; without: ids of effects that it has not."""
    return Machine(
        name=name, axes=Axes((), chain.names), parts=parts, signals=(*given, *inner), columns=columns, frame=frame,
        inputs=tuple(s.name for s in given), compared=tuple(sensors),
        effects=tuple(effect for effect in collect_effects(parts) if effect.id not in without),
        slots=slots if slots == 1 else max(slots, round(np.ceil(frame / TICK))),
        noise=tuple(f"{sensor}.sigma.{j}" for sensor in sensors.values() for j in chain.names),
        resolution=tuple(f"{sensor}.step.{j}" for sensor in sensors.values() for j in chain.names),
        noise_std=lambda parameter: {kind: parameter(f"{sensor}.repeatability") for kind, sensor in sensors.items()},
        max_effects=6, reference_limits=("position_min", "position_max"), skeleton=shape, mechanism=mechanism, **rest,
    )  # fmt: skip


def inverse_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in inverse-dynamics form: position, velocity and acceleration are measured, the effort is predicted."""
    unit, efforts = units(chain), typical_efforts(chain)
    speed, force, motion = unit["velocity"], unit["effort"], signals(unit, "position", "velocity", "acceleration")
    late = Delay("effort_delay", "noise_effort", tuple(f"torque.sigma.{j}" for j in chain.names))
    *given, effort = columns(chain, {**{s.name: s.name for s in motion}, "effort": "effort_read"})
    parts = (
        dynamics.inverse_part(scales(chain, efforts) | {"period": (max(frame, LATE), "s")}, unit),
        reading("torque", "effort", unit, 0, frame, float(efforts.max()), len(chain.names)),
    )  # fmt: skip
    return make_machine(
        name, chain, frame, parts, {effort.kind: "torque"}, CROSSTALK + INVERSE, (*motion, *noise("effort")),
        (*signals(unit, "effort", "effort_read"), Signal(late.signal, "s", JOINTS)),
        (*given, replace(effort, delay=late)), slots=1, segments=(Segment("arm", effort.kind),),
        defaults=chain_values(chain, "arm"), resting={effort.kind: given[1].kind},
        recorded={"arm.mobility": lambda size: REST * size.get(speed, np.inf) / max(size.get(force, 0.0), 1e-12)},
    )  # fmt: skip


def closed_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in closed loop: controller, motors, forward dynamics, encoders and torque sensors."""
    unit, efforts, count = units(chain), typical_efforts(chain), len(chain.names)
    parts = (
        dynamics.forward_part(count, 0, scales(chain, efforts), unit), gear_motor.PART,
        reading("encoder", "position", unit, 1, frame, travel(chain), count),
        reading("torque", "effort", unit, 3, frame, float(efforts.max()), count), arm_drive.part(2, unit),
    )  # fmt: skip
    given = signals(unit, "position_ref", "position_start")
    inner = signals(unit, "position", "position_read", "effort_ref", "effort", "effort_true", "effort_read")
    shown = {s.name: s.name for s in given}
    shown |= {"effort_ref": "effort_ref", "position": "position_read", "effort": "effort_read"}
    found = columns(chain, shown)
    position, effort = found[-2].kind, found[-1].kind
    return make_machine(
        name, chain, frame, parts, {position: "encoder", effort: "torque"}, (*CROSSTALK, "encoder.offset"),
        (*given, *noise("position", "effort")), (*inner, Signal("link_position", unit["position"], JOINTS)), found,
        segments=(Segment("drive", effort, (position,)), Segment("arm", position, (effort,))),
        loop=joint_control(chain, {"arm.coulomb_friction": {}}), settling=SETTLING,
        defaults=chain_values(chain, "arm") | drive_defaults(chain, efforts, frame),
    )  # fmt: skip


def cable_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in closed loop that motors move through cables: arm, cables, motors, sensors and controller."""
    unit, efforts, count = units(chain), typical_efforts(chain), len(chain.names)
    most = RATIO * float(efforts.max())
    forward = dynamics.forward_part(count, 0, scales(chain, efforts), unit)
    shown = Output.of_states(effort="motor_effort", effort_true="motor_effort_true")
    motors = replace(gear_motor.PART, tasks=(Task("update", ("motor_effort_ref",)),), outputs=(shown,))
    seen = {"link_position": unit["position"], "motor_position": "rad", "motor_effort": "N m"}
    readings = zip(SENSORS.values(), SENSORS, (5, 2, 4), (size := travel(chain), size / RATIO, most), strict=True)
    parts = (
        replace(forward, tasks=(forward.tasks[0], Task("stand", ("link_start",), slots=(0,)))),
        cable.part(1, SHARE * most, SPEED / RATIO, unit),
        motors,
        *(reading(sensor, signal, seen, slot, frame, size, count) for sensor, signal, slot, size in readings),
        arm_drive.part(3, unit),
    )
    kinds = {"position": "position", "position_read": "position", "link_position": "position", "effort_ref": "effort"}
    kinds |= {"link_position_read": "position", "effort_true": "effort", "link_start": "position"}
    inner = {signal: unit[kind] for signal, kind in kinds.items()}  # of joints, then of motors
    inner |= dict.fromkeys(("motor_start", "motor_position", "motor_position_read"), "rad")
    inner |= dict.fromkeys(("motor_effort_ref", "motor_effort", "motor_effort_true", "motor_effort_read"), "N m")
    given = signals(unit, "position_ref", "position_start")
    *asked, position = columns(chain, {s.name: s.name for s in given} | {"position": "link_position_read"})
    seen_as = dict(zip((position.kind, *list(SENSORS)[1:]), SENSORS.values(), strict=True))  # kind of column -> sensor
    return make_machine(
        name, chain, frame, parts, seen_as,
        (*(f"{sensor}.crosstalk" for sensor in SENSORS.values()), *OF_CABLES), (*given, *noise(*SENSORS)),
        tuple(Signal(signal, u, JOINTS) for signal, u in inner.items()),
        (*asked, replace(position, required=False), *COLUMNS), slots=6,
        segments=(
            Segment("drive", "motor_effort", ("motor_position",)),
            Segment("cable", "motor_position", ("motor_effort",)),
            Segment("arm", position.kind, ("motor_position",)),
        ),
        loop=joint_control(chain, {}), settling=SETTLING, defaults=cable_defaults(chain, efforts, frame),
    )  # fmt: skip


def cable_defaults(chain: Chain, efforts: np.ndarray, frame: float) -> dict[str, float]:
    """Values of what the robot file need not state: the arm's, and cables and motors of its size."""
    found = chain_values(chain, "arm") | drive_defaults(chain, efforts, frame)
    for channel, m, effort in zip(chain.names, compute_inertias(chain), efforts, strict=True):
        found[f"motor.current_max.{channel}"] *= RATIO
        found |= {
            f"cable.ratio.{channel}": RATIO, f"cable.by_previous.{channel}": 0.0, f"cable.by_next.{channel}": 0.0,
            f"cable.stiffness.{channel}": m * RESONANCE**2, f"cable.pretension.{channel}": TAUT * effort,
            f"cable.loss.{channel}": LOSS, f"cable.inertia.{channel}": REFLECTED * m * RATIO**2,
            f"cable.damping.{channel}": 0.0, f"cable.dry_friction.{channel}": 0.0,
            f"drive.viscosity.{channel}": 2.0 * (1.0 + REFLECTED) * m * BANDWIDTH,
        }  # fmt: skip
    return {name: float(value) for name, value in found.items()}


def signals(unit: Mapping[str, str], *names: str) -> tuple[Signal, ...]:
    """Signals of the joints; the unit is that of the kind with which the name begins."""
    return tuple(Signal(name, unit[name.split("_")[0]], JOINTS) for name in names)


def noise(*names: str) -> tuple[Signal, ...]:
    """Noise of the sensors of these quantities, and what may be lost of their readings."""
    kinds = (("noise", NORMAL), ("arrival", UNIFORM))
    return tuple(Signal(f"{kind}_{name}", "-", JOINTS, law) for kind, law in kinds for name in names)


def columns(chain: Chain, shown: Mapping[str, str]) -> tuple[Column, ...]:
    """Log columns: kind -> signal. Kinds of mixed joints say so."""
    before, unit = "joint_" if len(set(chain.sliding)) > 1 else "", units(chain)
    found = []
    for kind, signal in shown.items():
        rate, own = before + RATES[kind] if kind in RATES else "", unit["effort"] if "effort" in kind else ""
        found.append(Column(before + kind, signal, required=kind != "effort_ref", unit=own, rate_of=rate))
    return tuple(found)


def reading(name: str, signal: str, unit: Mapping[str, str], slot: int, frame: float, size: float, count: int) -> Part:
    """A sensor of a signal of the joints; that of a position is an encoder."""
    joined = (signal, f"noise_{signal}", f"arrival_{signal}", f"{signal}_read")
    ranges = {"signal.gain": COUNTED} if signal.endswith("position") else {}
    return replace(sensor(name, joined, unit[signal], slot, frame, size, count), ranges=ranges)


def shape(robot: Robot) -> Shape:
    """Geometry that a recording draws: the joints of the robot's parameters, in order."""
    found = mechanism(robot)
    chain, tilt = found.chain, np.array(found.tilt)
    origins, angles, axes = (np.array([getattr(j, n) for j in chain.joints]) for n in ("origin", "angles", "axis"))
    column = next(c for c in robot.machine.columns if c.kind.endswith("position") and c.signal != "position_ref")
    ends, load = np.vstack([origins[1:], chain.tip]), robot.machine.compared[-1]
    return Shape(chain.names, origins, angles, axes, chain.sliding, ends, tilt, column.kind, load)


def mechanism(robot: Robot) -> Mechanism:
    """The arm with its payload, rotors, friction and position loops, as other simulators take it."""
    known, joints = robot.machine.index, robot.machine.axes.joints

    def value(name: str, otherwise: float = 0.0) -> float:
        return robot[name] if name in known else otherwise

    def vector(part: str, joint: str, *names: str) -> np.ndarray:
        return np.array([robot[f"{part}.{name}.{joint}"] for name in names])

    chain, bodies, drives, notes = [], [], [], []
    for j in joints:
        heavier = 1.0 + value(f"arm.link_mass.share.{j}")
        mass = heavier * robot[f"arm.mass.{j}"]
        tensor = np.zeros((3, 3))
        tensor[np.triu_indices(3)] = vector("arm", j, "xx", "xy", "xz", "yy", "yz", "zz")
        centre = vector("arm", j, "com_x", "com_y", "com_z")
        bodies.append(Body(mass, centre, heavier * (tensor + np.triu(tensor, 1).T)))
        ratio = value(f"cable.ratio.{j}", 1.0) or 1.0  # of a cable arm the motor's side counts by ratio
        motor = value(f"motor.torque_constant.{j}") * value(f"motor.ratio.{j}") * value(f"motor.current_max.{j}")
        low, high = value(f"arm.stop_low.{j}", -FAR), value(f"arm.stop_high.{j}", FAR)
        kind = "prismatic" if robot[f"arm.sliding.{j}"] else "revolute" if high - low < FAR else "continuous"
        chain.append(Joint(
            j, kind, "", f"link_{j}", vector("arm", j, *"xyz"), vector("arm", j, "roll", "pitch", "yaw"),
            vector("arm", j, "axis_x", "axis_y", "axis_z"),
            low if low > -FAR else -np.inf, high if high < FAR else np.inf, abs(motor / ratio) or np.inf,
            robot[f"arm.damping.{j}"] + value(f"arm.viscous_friction.coefficient.{j}")
            + value(f"cable.damping.{j}") / ratio**2,
            robot[f"arm.dry_friction.{j}"] + value(f"arm.coulomb_friction.force.{j}")
            + value(f"cable.dry_friction.{j}") / abs(ratio),
        ))  # fmt: skip
        share = value(f"drive.feedforward.{j}") + value(f"arm_drive.gravity_compensation.share.{j}")
        believed = value(f"drive.mass.{j}") * share
        gains = (1.0 + value(f"arm_drive.{name}_gain.share.{j}") for name in ("position", "velocity"))
        drives.append(Drive(
            kp=value("drive.kp") * value(f"drive.stiffness.{j}") * next(gains),
            kv=value("drive.kd") * value(f"drive.viscosity.{j}") * next(gains),
            gravity=believed / mass if mass else 0.0,
            armature=robot[f"arm.rotor_inertia.{j}"] + value(f"arm.rotor_inertia.inertia.{j}")
            + value(f"cable.inertia.{j}") / ratio**2,
            compliance=value(f"arm.compliance.{j}") + value(f"arm.joint_compliance.compliance.{j}"),
        ))  # fmt: skip
        off = np.abs(vector("drive", j, "com_x", "com_y", "com_z") - centre).max() if believed else 0.0
        if off:
            notes.append(f"{j}: the controller believes the link's centre of mass {off:.3g} m elsewhere")
    payload = robot["arm.tip_mass"] + value("arm.payload.mass")
    if "cable.ratio" in {name.rsplit(".", 1)[0] for name in known}:
        notes.append("motors act on the joints without the elasticity and the coupling of the cables")
    if any(drive.kp for drive in drives):
        once = f"the robot's controller computes once in {robot.machine.frame:g} s and differentiates the error"
        notes.append(f"{once}: send q_ref + (kv / kp) dq_ref/dt")
        if any(robot.channels("motor.time_constant")):
            notes.append("the time constant of the motors' current loops is left out")
    own = ("payload", "link_mass", "rotor_inertia", "viscous_friction", "coulomb_friction", "joint_compliance")
    stated = (*(f"arm.{name}" for name in own), "arm_drive.position_gain", "arm_drive.velocity_gain")
    return Mechanism(
        Chain(joints, tuple(chain), tuple(bodies), np.array([robot[f"arm.tip_{axis}"] for axis in "xyz"])),
        tuple(drives), min(robot.machine.slot, robot.machine.frame / 4), frozenset(stated),
        payload=payload,
        borne=value("drive.tip_mass") * share / payload if payload else 0.0,
        tilt=(robot["arm.base_roll"], robot["arm.base_pitch"]), gravity=robot["arm.gravity"], notes=tuple(notes),
    )  # fmt: skip


def units(chain: Chain) -> dict[str, str]:
    """Units of the signals, and of gains and damping; none ("-") where joints of both kinds share a signal."""
    mixed, own = len(set(chain.sliding)) > 1, SLIDES if any(chain.sliding) else TURNS
    force, per = own["effort"], own["position"]
    ratios = {"effort/speed": f"{force} s/{per}", "effort/position": f"{force}/{per}"}
    ratios["position/effort"] = f"{per}/({force})" if " " in force else f"{per}/{force}"
    return dict.fromkeys(own | ratios, "-") if mixed else own | ratios


def chain_values(chain: Chain, part: str) -> dict[str, float]:
    """Bodies, axes, gravity and, of the arm itself, losses, as the URDF states them: name of a parameter -> [SI]."""
    found = {f"{part}.gravity": GRAVITY, f"{part}.tip_mass": 0.0, f"{part}.base_roll": 0.0, f"{part}.base_pitch": 0.0}
    found |= {f"{part}.tip_{name}": float(value) for name, value in zip("xyz", chain.tip, strict=True)}
    for channel, joint, body in zip(chain.names, chain.joints, chain.bodies, strict=True):
        values = {"mass": body.mass, "sliding": float(joint.kind == "prismatic")}
        for i, axis in enumerate("xyz"):
            values |= {f"com_{axis}": body.centre[i], axis: joint.origin[i], f"axis_{axis}": joint.axis[i]}
            values |= {axis + "xyz"[k]: body.inertia[i, k] for k in range(i, 3)}
        values |= dict(zip(("roll", "pitch", "yaw"), joint.angles, strict=True))
        losses = {"damping": joint.damping, "dry_friction": joint.friction, "rotor_inertia": 0.0}
        values |= losses if part == "arm" else {}
        found |= {f"{part}.{name}.{channel}": float(value) for name, value in values.items()}
    return found


def compute_dynamics(
    chain: Chain, q: np.ndarray, rate: np.ndarray, acceleration: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Efforts (n,) and mass matrix (n, n) of the bare arm at a motion (n,) each [SI], by the equations themselves."""
    n = len(q)
    w = np.zeros((dynamics.WIDTH + n) * n)
    for j, (joint, body) in enumerate(zip(chain.joints, chain.bodies, strict=True)):
        dynamics.place(w, j, joint.origin, joint.angles, joint.axis, chain.sliding[j], q[j])
        dynamics.load(w, j, body.mass, body.centre, body.inertia[np.triu_indices(3)])
        dynamics.move(w, j, rate[j], acceleration[j], (0.0, 0.0, -GRAVITY))
    dynamics.gather(w, n, dynamics.WRENCH, dynamics.WIDTH - dynamics.WRENCH)
    efforts = np.array([dynamics.effort(w, j) for j in range(n)])
    dynamics.mass_matrix(w, n, dynamics.WIDTH * n)
    return efforts, w[dynamics.WIDTH * n :].reshape(n, n)


def middle(chain: Chain) -> np.ndarray:
    """Middle of each joint's range (n,); 0 of one without limits."""
    return np.array([0.5 * (j.lower + j.upper) if np.isfinite(j.upper - j.lower) else 0.0 for j in chain.joints])


def typical_efforts(chain: Chain) -> np.ndarray:
    """Root mean square of the effort of each joint (n,) in moderate motions at random postures about the middle."""
    rng, n = np.random.default_rng(0), len(chain.names)
    draws = (rng.uniform(-SWING, SWING, (3, n)) for _ in range(POSTURES))
    found = [compute_dynamics(chain, middle(chain) + q, SPEED * v, BRISK * a)[0] for q, v, a in draws]
    return np.maximum(np.sqrt(np.mean(np.square(found), axis=0)), 1e-3)


def travel(chain: Chain) -> float:
    """How far a moderate motion goes to either side [rad], or [m] where all joints slide: half the shortest stroke."""
    return min(SWING, *(0.5 * (j.upper - j.lower) for j in chain.joints)) if all(chain.sliding) else SWING


def scales(chain: Chain, efforts: np.ndarray) -> dict[str, tuple[float, str]]:
    """Sizes and units of the effects of joints: ranges of the library are those of an arm of `ORDINARY` mass."""
    unit, force = units(chain), SHARE * float(efforts.max())
    inertia = float(compute_inertias(chain).max()) or 1.0
    mass = sum(body.mass for body in chain.bodies) / ORDINARY or 1.0
    return {
        "rad": (1.0, unit["position"]), "kg": (mass, "kg"), "kg m2": (inertia, unit["inertia"]),
        "rad/(N m)": (1.0 / inertia, unit["position/effort"]),
        "force": (force, unit["effort"]), "speed": (SPEED, unit["velocity"]),
        "length": (travel(chain), unit["position"]), "force/speed": (force / SPEED, unit["effort/speed"]),
    }  # fmt: skip


def compute_inertias(chain: Chain) -> np.ndarray:
    """Inertia that the drive of each joint moves (n,), the arm in the middle of its ranges [kg m2] or [kg]."""
    rest = np.zeros(len(chain.names))
    return np.diag(compute_dynamics(chain, middle(chain), rest, rest)[1])


def drive_defaults(chain: Chain, efforts: np.ndarray, frame: float) -> dict[str, float]:
    """Gains of a moderate bandwidth, a controller that knows the arm, motors that reach its efforts and limits."""
    found = chain_values(chain, "drive") | {"drive.kp": 1.0, "drive.kd": 1.0, "drive.period": frame}
    for channel, joint, m, most in zip(chain.names, chain.joints, compute_inertias(chain), efforts, strict=True):
        limit = joint.effort if 0.0 < joint.effort < np.inf else 10.0 * most
        stops = np.isfinite(joint.upper - joint.lower) and joint.upper > joint.lower
        found |= {
            f"drive.stiffness.{channel}": m * BANDWIDTH**2, f"drive.viscosity.{channel}": 2.0 * m * BANDWIDTH,
            f"drive.feedforward.{channel}": 1.0, f"arm.stop_stiffness.{channel}": m * STOP**2,
            f"arm.stop_damping.{channel}": m * STOP, f"arm.stop_low.{channel}": joint.lower if stops else -FAR,
            f"arm.stop_high.{channel}": joint.upper if stops else FAR, f"arm.compliance.{channel}": 0.0,
            f"motor.torque_constant.{channel}": 1.0, f"motor.ratio.{channel}": 1.0,
            f"motor.current_max.{channel}": limit, f"motor.time_constant.{channel}": 0.0,
        }  # fmt: skip
    return {name: float(value) for name, value in found.items()}


def joint_control(chain: Chain, nonlinear: Mapping[str, Mapping[str, float]]) -> Loop:
    """The loop that `analyse` and `tune` look at; nonlinear: effects of which limit cycles are predicted."""
    gains = (Gain("drive.kp", 0.1, 10.0), Gain("drive.kd", 0.1, 10.0))
    return Loop(
        reference="position_ref", command="effort_ref", output="position", measured="position_read",
        part="drive", held="effort", gains=gains, gentle={"drive.kp": 0.5, "drive.kd": 1.0}, step=STEP,
        points={"middle": dict(zip(chain.names, middle(chain).tolist(), strict=True))},
        controllers=(Controller("PD", gains),), resolution="encoder.step", nonlinear=nonlinear,
    )  # fmt: skip


def read_attribute(element: ElementTree.Element, name: str, source: str) -> str:
    """An attribute that must be there."""
    if not (found := element.get(name)):
        raise InputError(f"{source}: a <{element.tag}> without {name}")
    return found


def numbers(
    element: ElementTree.Element | None, name: str, default: Sequence[float], where: str, most: float = LARGEST
) -> np.ndarray:
    """Numbers of an attribute, none beyond any arm's, as many as the default has; the default without it."""
    text = None if element is None else element.get(name)
    if text is None:
        return np.array(default, dtype=float)
    try:
        found = np.array([float(word) for word in text.split()])
    except ValueError:
        found = np.zeros(0)
    if len(found) != len(default) or not np.isfinite(found).all():
        raise InputError(f"{where}: {name} is {quote(text)}, wanted {len(default)} number{'s' * (len(default) > 1)}")
    if np.abs(found).max() > most:
        raise InputError(f"{where}: {name} is {quote(text)}, beyond any arm's, {most:g}")
    return found


def rotation(angles: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) of roll, pitch, yaw (3,) [rad] about fixed axes."""
    return np.reshape(dynamics.roll_pitch_yaw(*angles), (3, 3))


def read_body(link: ElementTree.Element, source: str) -> Body:
    """Mass and inertia of a link; none where it states none."""
    inertial, where = link.find("inertial"), f"{source}: link {quote(link.get('name'))}"
    if inertial is None:
        return Body()
    origin, tensor = inertial.find("origin"), inertial.find("inertia")
    mass = float(numbers(inertial.find("mass"), "value", [0.0], where)[0])
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    xx, xy, xz, yy, yz, zz = (float(numbers(tensor, name, [0.0], where)[0]) for name in names)
    turn = rotation(numbers(origin, "rpy", [0.0] * 3, where))
    inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    if mass < 0.0 or np.linalg.eigvalsh(inertia)[0] < -1e-9 * max(1e-9, float(np.abs(inertia).max())):
        raise InputError(f"{where}: mass {mass:g} kg and inertia are those of no body")
    return Body(mass, numbers(origin, "xyz", [0.0] * 3, where), inertia)


def read_joint(element: ElementTree.Element, source: str) -> Joint:
    """A joint. InputError for a kind that an arm does not have."""
    name = read_attribute(element, "name", source)
    kind, where = read_attribute(element, "type", source), f"{source}: joint {name}"
    if kind not in KINDS:
        raise InputError(f"{where} is {quote(kind)}, wanted {', '.join(KINDS)}")
    if element.find("mimic") is not None:
        raise InputError(f"{where} mimics another one, which is not modelled")
    parent, child = (element.find(end) for end in ("parent", "child"))
    if parent is None or child is None:
        raise InputError(f"{where} lacks its parent or child link")
    origin, limit, dynamics = (element.find(tag) for tag in ("origin", "limit", "dynamics"))
    axis = numbers(element.find("axis"), "xyz", [1.0, 0.0, 0.0], where)
    if kind != "fixed" and not np.linalg.norm(axis) > 0.0:
        raise InputError(f"{where}: its axis has no length")
    free = math.inf if kind == "continuous" or limit is None else 0.0
    stated = {"lower": -free, "upper": free, "effort": math.inf}
    ends = [numbers(limit, n, [d], where, math.inf)[0] for n, d in stated.items()]
    ends = [end if abs(end) < LARGEST else math.copysign(math.inf, end) for end in ends]  # as some programs write none
    if ends[0] > ends[1] or ends[0] == math.inf or ends[1] == -math.inf:
        raise InputError(f"{where}: its lower limit {ends[0]:g} exceeds its upper one {ends[1]:g}")
    losses = [float(numbers(dynamics, n, [0.0], where)[0]) for n in ("damping", "friction")]
    return Joint(
        name, kind, read_attribute(parent, "link", source), read_attribute(child, "link", source),
        numbers(origin, "xyz", [0.0] * 3, where), numbers(origin, "rpy", [0.0] * 3, where),
        axis / (np.linalg.norm(axis) or 1.0), *(float(end) for end in ends), *losses,
    )  # fmt: skip


def read_urdf(path: str | Path, tip: str = "") -> Chain:
    """The arm of a URDF file up to the link `tip`, which is needed where moving joints branch; others stand at 0."""
    source = Path(path).name
    data = read_bytes(path)
    if len(data) > MAX_BYTES:
        raise InputError(f"{source}: {len(data)} bytes, more than {MAX_BYTES}")
    plain = data.replace(b"\0", b"").upper()  # UTF-16 would hide a declaration
    if b"<!DOCTYPE" in plain or b"<!ENTITY" in plain:
        raise InputError(f"{source}: declares a document type or entities, which a robot description does not need")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{source}: not XML ({error})") from None
    if root.tag != "robot":
        raise InputError(f"{source}: begins with <{quote(root.tag)[1:-1]}>, wanted <robot>, a URDF file")
    if root.find("{*}macro") is not None or b"<XACRO:" in plain:
        raise InputError(f"{source}: holds xacro macros; expand them first: xacro {source} > arm.urdf")
    bodies = {read_attribute(link, "name", source): read_body(link, source) for link in root.findall("link")}
    joints = [read_joint(element, source) for element in root.findall("joint")]
    if len(joints) > MAX_ALL:
        raise InputError(f"{source}: {len(joints)} joints, more than {MAX_ALL}")
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in bodies:
                raise InputError(f"{source}: joint {joint.name} names a link {link!r} that is not there")
    by_child = {joint.child: joint for joint in joints}
    if len(by_child) < len(joints):
        raise InputError(f"{source}: a link hangs on two joints, so this is no serial arm")
    if tip and tip not in bodies:
        raise InputError(f"{source}: no link {tip!r}{nearest(tip, list(bodies))}")
    count = sum(joint.kind != "fixed" for joint in joints)
    leaves = [link for link in bodies if all(joint.parent != link for joint in joints)]
    if not tip and not (count and leaves):
        raise InputError(f"{source}: no joint moves, so there is no arm")
    whole = []  # ways from the base to the tip, or to each leaf
    for link in [tip] if tip else leaves:
        way: list[Joint] = []
        while link in by_child:
            way.insert(0, by_child[link])
            link = way[0].parent
            if len(way) > len(by_child):
                raise InputError(f"{source}: its links form a ring")
        whole += [way] if tip or sum(joint.kind != "fixed" for joint in way) == count else []
    if not whole:
        raise InputError(f"{source}: its moving joints branch; name the last link, `tip`: {', '.join(leaves[:8])}")
    return make_chain(max(whole, key=len), joints, bodies, source)


def make_chain(path: Sequence[Joint], joints: Sequence[Joint], bodies: Mapping[str, Body], source: str) -> Chain:
    """The arm along a path of joints; what hangs on its links moves with them."""
    moving = [joint for joint in path if joint.kind != "fixed"]
    if not 0 < len(moving) <= MAX_JOINTS:
        raise InputError(f"{source}: {len(moving)} moving joints on the way to the tip, wanted 1 to {MAX_JOINTS}")
    on_way = {joint.name for joint in moving}

    def whole(link: str) -> Body:
        """A link and all that hangs on it, but for what the arm's next joint moves."""
        found = bodies[link]
        for joint in (j for j in joints if j.parent == link and j.name not in on_way):
            found = found.join(whole(joint.child), rotation(joint.angles), joint.origin)
        return found

    turn, point, placed, direct = np.eye(3), np.zeros(3), [], True
    for joint in path:
        point, turn = point + turn @ joint.origin, turn @ rotation(joint.angles)
        if joint.kind != "fixed":
            angles = joint.angles
            if not direct:  # roll, pitch, yaw of the turn
                flat = math.hypot(turn[0, 0], turn[1, 0])
                sines = (turn[2, 1], turn[2, 2], turn[1, 0], turn[0, 0])
                roll, full, yaw, level = sines if flat > 1e-9 else (-turn[1, 2], turn[1, 1], 0.0, 1.0)
                angles = np.array([math.atan2(roll, full), math.atan2(-turn[2, 0], flat), math.atan2(yaw, level)])
            placed.append(replace(joint, origin=point, angles=angles))
            turn, point = np.eye(3), np.zeros(3)
        direct = joint.kind != "fixed"
    carried = tuple(whole(joint.child) for joint in moving)
    if not carried[-1].mass > 0.0:
        raise InputError(f"{source}: link {moving[-1].child}, which the last joint moves, has no mass")
    names = [re.sub(r"[^A-Za-z0-9]", "", joint.name) for joint in moving]  # as log columns have them
    names = tuple(name if name[:1].isalpha() else f"J{name}" for name in names)
    if len(set(names)) < len(names):
        listed = ", ".join(joint.name for joint in moving)
        raise InputError(f"{source}: names of joints differ only in signs: {listed}")
    return Chain(names, tuple(placed), carried, point)
