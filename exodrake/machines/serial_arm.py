"""Machines of one serial arm, described by the `arm` section of a robot file and a URDF file beside it; no code.

    arm: {urdf: arm.urdf, form: inverse, frame: 0.005}      # or closed-loop, or cable; tip: LINK where joints branch

`inverse` predicts the effort from a measured motion; `closed-loop` runs controller, motors and forward dynamics;
`cable`: position_ref -> PD controller -> A' -> motors -> cables -> arm, motor_position -> A -> controller.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.schema import mapping, number, text
from exodrake.effects import collect_effects, friction
from exodrake.machines.urdf import read_urdf
from exodrake.model.effect import Effect
from exodrake.model.machine import SETTLING, Column, Controller, Gain, Loop, Machine, Segment
from exodrake.model.mechanism import GRAVITY, Body, Chain, Drive, Joint, Mechanism, Shape
from exodrake.model.part import JOINTS, NORMAL, UNIFORM, Axes, Output, Part, Signal, Task
from exodrake.model.robot import Robot
from exodrake.physics import arm as dynamics, arm_drive, cable, gear_motor
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
REST = 0.01  # of the largest speed, below which dry friction of the largest effort counts as rest: assumed
CROSSTALK = ("torque.crosstalk", "encoder.crosstalk")  # not tried: joints are measured one by one
OFFSET = ("arm.offset",)  # which is `torque.offset` in inverse dynamics

# of arms with cables
RATIO = 0.05  # of joint to motor: assumed, as of small gears and capstans
RESONANCE = 2.0 * np.pi * 15.0  # rad/s of the links on their cables, motors held: assumed; 10-30 Hz are usual
REFLECTED = 0.2  # inertia of a motor over that of its links, as the joint feels it: assumed
LOSS = 1e-3  # s, of a steel cable: 5 % of critical damping at that resonance: assumed
TAUT = 2.0  # pretension in efforts of a moderate motion: assumed, so that no strand goes slack in one
SENSORS = {"position": "link_encoder", "motor_position": "encoder", "motor_effort": "torque"}  # by kind of column
SEEN = ("link_position", *list(SENSORS)[1:])  # the signals that they measure
COLUMNS = (
    Column("position", "link_position_read", required=False),
    Column("motor_effort_ref", "motor_effort_ref", required=False, unit="N m"),
    Column("motor_position", "motor_position_read"),
    Column("motor_effort", "motor_effort_read", unit="N m"),
)
SEGMENTS = (
    Segment("drive", "motor_effort", ("motor_position",)),
    Segment("cable", "motor_position", ("motor_effort",)),
    Segment("arm", "position", ("motor_position",)),
)
OF_CABLES = ("arm.joint_compliance", "arm.rotor_inertia")  # which the cables and motors are themselves


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
        inputs=tuple(s.name for s in given), effects=effects_in(units(chain), parts, without), compared=tuple(sensors),
        slots=slots if slots == 1 else max(slots, round(np.ceil(frame / TICK))),
        noise=tuple(f"{sensor}.sigma.{j}" for sensor in sensors.values() for j in chain.names),
        resolution=tuple(f"{sensor}.step.{j}" for sensor in sensors.values() for j in chain.names),
        noise_std=lambda parameter: {kind: parameter(f"{sensor}.repeatability") for kind, sensor in sensors.items()},
        max_effects=6, reference_limits=("position_min", "position_max"), skeleton=shape, mechanism=mechanism, **rest,
    )  # fmt: skip


def inverse_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in inverse-dynamics form: position, velocity and acceleration are measured, the effort is predicted."""
    unit, efforts = units(chain), typical_efforts(chain)
    speed, force = unit["velocity"], unit["effort"]
    motion = signals(unit, "position", "velocity", "acceleration")
    shown = {**{s.name: s.name for s in motion}, "effort": "effort_read"}
    found = columns(chain, shown)
    torque = reading("torque", "effort", unit, 0, frame, float(efforts.max()), len(chain.names))
    return make_machine(
        name, chain, frame, (dynamics.inverse_part(scales(efforts, unit), unit), torque), {found[-1].kind: "torque"},
        CROSSTALK + OFFSET, (*motion, *noise("effort")), signals(unit, "effort", "effort_read"), found, slots=1,
        segments=(Segment("arm", found[-1].kind),), defaults=chain_values(chain, "arm"),
        recorded={"arm.mobility": lambda size: REST * size.get(speed, np.inf) / max(size.get(force, 0.0), 1e-12)},
        resting={found[-1].kind: found[1].kind},
    )  # fmt: skip


def closed_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in closed loop: controller, motors, forward dynamics, encoders and torque sensors."""
    unit, efforts, count = units(chain), typical_efforts(chain), len(chain.names)
    parts = (
        dynamics.forward_part(count, 0, scales(efforts, unit), unit), gear_motor.PART,
        reading("encoder", "position", unit, 1, frame, SWING, count),
        reading("torque", "effort", unit, 3, frame, float(efforts.max()), count), arm_drive.part(2, unit),
    )  # fmt: skip
    given = signals(unit, "position_ref", "position_start")
    inner = signals(unit, "position", "position_read", "effort_ref", "effort", "effort_true", "effort_read")
    shown = {s.name: s.name for s in given}
    shown |= {"effort_ref": "effort_ref", "position": "position_read", "effort": "effort_read"}
    found = columns(chain, shown)
    position, effort = found[-2].kind, found[-1].kind
    return make_machine(
        name, chain, frame, parts, {position: "encoder", effort: "torque"}, CROSSTALK,
        (*given, *noise("position", "effort")), (*inner, Signal("link_position", unit["position"], JOINTS)), found,
        segments=(Segment("drive", effort, (position,)), Segment("arm", position, (effort,))),
        loop=joint_control(chain, {"arm.coulomb_friction": {}}), settling=SETTLING,
        defaults=chain_values(chain, "arm") | drive_defaults(chain, efforts, frame),
    )  # fmt: skip


def cable_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in closed loop that motors move through cables: arm, cables, motors, sensors and controller."""
    unit, efforts, count = units(chain), typical_efforts(chain), len(chain.names)
    most = RATIO * float(efforts.max())
    forward = dynamics.forward_part(count, 0, scales(efforts, unit), unit)
    shown = Output.of_states(effort="motor_effort", effort_true="motor_effort_true")
    motors = replace(gear_motor.PART, tasks=(Task("update", ("motor_effort_ref",)),), outputs=(shown,))
    seen = {"link_position": unit["position"], "motor_position": "rad", "motor_effort": "N m"}
    readings = zip(SENSORS.values(), SEEN, (5, 2, 4), (SWING, SWING / RATIO, most), strict=True)
    parts = (
        replace(forward, tasks=(forward.tasks[0], Task("stand", ("link_start",), slots=(0,)))),
        cable.part(1, SHARE * most, SPEED / RATIO, unit),
        motors,
        *(reading(sensor, signal, seen, slot, frame, size, count) for sensor, signal, slot, size in readings),
        arm_drive.part(3, unit),
    )
    rubbing = tuple(
        e.id for e in effects_in(unit, parts, ())
        if e.id.startswith("arm.") and all(law.__module__ == friction.__name__ for law in e.at.values())
    )  # fmt: skip
    kinds = {"position": "position", "position_read": "position", "link_position": "position", "effort_ref": "effort"}
    kinds |= {"link_position_read": "position", "effort_true": "effort", "link_start": "position"}
    inner = {signal: unit[kind] for signal, kind in kinds.items()}  # of joints, then of motors
    inner |= dict.fromkeys(("motor_start", "motor_position", "motor_position_read"), "rad")
    inner |= dict.fromkeys(("motor_effort_ref", "motor_effort", "motor_effort_true", "motor_effort_read"), "N m")
    given = signals(unit, "position_ref", "position_start")
    return make_machine(
        name, chain, frame, parts, SENSORS,
        (*(f"{sensor}.crosstalk" for sensor in SENSORS.values()), *rubbing, *OF_CABLES), (*given, *noise(*SEEN)),
        tuple(Signal(signal, u, JOINTS) for signal, u in inner.items()),
        (*(Column(s.name, s.name) for s in given), *COLUMNS), slots=6, segments=SEGMENTS,
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
    """A sensor of a signal of the joints."""
    joined = (signal, f"noise_{signal}", f"arrival_{signal}", f"{signal}_read")
    return sensor(name, joined, unit[signal], slot, frame, size, count)


def effects_in(unit: Mapping[str, str], parts: tuple[Part, ...], without: tuple[str, ...]) -> tuple[Effect, ...]:
    """The effects of the parts but for some, those that are made for turning joints in the units of these."""
    own = {TURNS["position"]: unit["position"], TURNS["inertia"]: unit["inertia"], "rad/(N m)": unit["position/effort"]}
    kept = (effect for effect in collect_effects(parts) if effect.id not in without)
    return tuple(
        replace(effect, parameters=tuple(replace(p, unit=own.get(p.unit, p.unit)) for p in effect.parameters))
        for effect in kept
    )


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
        mass = robot[f"arm.mass.{j}"] * (1.0 + value(f"arm.link_mass.share.{j}"))
        tensor = np.zeros((3, 3))
        tensor[np.triu_indices(3)] = vector("arm", j, "xx", "xy", "xz", "yy", "yz", "zz")
        centre = vector("arm", j, "com_x", "com_y", "com_z")
        bodies.append(Body(mass, centre, tensor + np.triu(tensor, 1).T))
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
        drives.append(Drive(
            kp=value("drive.kp") * value(f"drive.stiffness.{j}"), kv=value("drive.kd") * value(f"drive.viscosity.{j}"),
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
    stated = ("payload", "link_mass", "rotor_inertia", "viscous_friction", "coulomb_friction", "joint_compliance")
    return Mechanism(
        Chain(joints, tuple(chain), tuple(bodies), np.array([robot[f"arm.tip_{axis}"] for axis in "xyz"])),
        tuple(drives), min(robot.machine.slot, robot.machine.frame / 4), frozenset(f"arm.{name}" for name in stated),
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


def scales(efforts: np.ndarray, unit: Mapping[str, str]) -> dict[str, tuple[float, str]]:
    """Sizes of the friction of joints, for the generic effects."""
    force = SHARE * float(efforts.max())
    return {
        "force": (force, unit["effort"]), "speed": (SPEED, unit["velocity"]), "length": (SWING, unit["position"]),
        "force/speed": (force / SPEED, unit["effort/speed"]),
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
