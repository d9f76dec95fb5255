"""Machines of position servos (command -> joint -> reading): ideal ones, or with motor, gear and supply."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from math import ceil
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.schema import listing, mapping, names, number, text, whole
from exodrake.effects import LIBRARY, collect_effects, for_machine, generic_effects, in_order, plugin_effects
from exodrake.effects.servo import carry, lag_behind, limit_speed
from exodrake.effects.signal import scale, shift, take_up_play
from exodrake.effects.timing import delay_command
from exodrake.model.effect import Effect
from exodrake.model.machine import SETTLING, Column, Controller, Gain, Loop, Machine, Segment
from exodrake.model.mechanism import Body, Chain, Drive, Joint, Mechanism, axes_side_by_side
from exodrake.model.part import JOINTS, NORMAL, SCALAR, UNIFORM, Axes, Signal
from exodrake.model.robot import Robot
from exodrake.physics import joint, joint_command, joint_loop, servo
from exodrake.physics.arithmetic import GRAVITY
from exodrake.physics.reading import sensor

FRAMES = replace(LIBRARY["timing.command_latency"].parameters[0], axis=JOINTS)  # each joint late by its own
REFERENCES = (Signal("angle_ref", "rad", JOINTS), Signal("angle_start", "rad", JOINTS))
BEND = Signal("bend", "rad", JOINTS)
ANGLE = ("angle", "noise_angle", "reading_arrival", "angle_read")  # what the sensor of the joints reads and writes
COLUMN = Column("angle", "angle_read", label="Joint angle")
STANDARD = ("speed_limit", "hysteresis")  # laws that every drive may have
OUTER = 0.2  # s, over which the integral of an outer loop acts at least; assumed
SLOW = 0.2  # s, frames of a quasi-static log, which shows no speed: assumed
STEP = 0.02  # rad, of a reference for the analysis: assumed
SWING = 1.0  # rad, by which a joint typically moves; ranges of the generic effects scale with it; assumed
DRAWN = (Signal("noise_angle", "-", JOINTS, NORMAL), Signal("reading_arrival", "-", JOINTS, UNIFORM))
COMPUTED = (
    Signal("command", "rad", JOINTS), Signal("origin", "rad", JOINTS), Signal("setting", "rad", JOINTS),
    Signal("ready", "-", SCALAR), Signal("angle", "rad", JOINTS), Signal("angle_read", "rad", JOINTS),
)  # fmt: skip


SLOWEST = 10.0  # s, the longest frame
SECTION = mapping(
    {
        "part": text(), "joints": listing(text(), least=1), "frame": number(above=0.0, high=SLOWEST),
        "max_effects": whole(1), "effects": names(text()), "settings": listing(text((BEND.name,))),
    },
    required=("part", "joints", "frame", "max_effects", "effects"),
)  # fmt: skip


def add_generic(generic: tuple[Effect, ...], library: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Generic effects of a law that the library lacks: behind a rigid servo an error in reading is one of the aim."""
    known = {effect.family for effect in library}
    return in_order(effect for effect in generic if effect.family not in known)


INERTIA = 1e-3  # kg m2 of each rotor: assumed, since the model has none; links have TINY of it
TINY = 1e-4  # so that a link that play sets free stands still at once, with a friction of BRAKE times the inertia
BRAKE = 20.0  # rad/s2: 2e-5 rad of error at the position loop of a frame of 20 ms
PROMPT = 20.0  # 1/frames, critically damped: the assumed loop settles in a fraction of a frame, as the model's servos
# law at the joint or its command -> field of a drive, and how it follows from the law's parameter
STATED: dict[Callable, tuple[str, Callable[[float, float], float]]] = {
    delay_command: ("delay", lambda frames, frame: frames * frame), lag_behind: ("lag", lambda time, frame: time),
    take_up_play: ("backlash", lambda width, frame: width), limit_speed: ("speed", lambda speed, frame: speed),
    shift: ("offset", lambda offset, frame: offset), scale: ("gain", lambda gain, frame: 1.0 + gain),
}  # fmt: skip


def mechanism(robot: Robot) -> Mechanism:
    """Joints side by side behind fast position loops; the model knows no inertia, so those of the loops are assumed."""
    machine, joints = robot.machine, robot.machine.axes.joints
    part = next(part.name for part in machine.parts if part.module is joint)
    place, fast = axes_side_by_side(joints, "angle", "angle"), PROMPT / machine.frame
    found = [{"gain": robot[f"{part}.ratio.{j}"]} for j in joints]
    stated = set()
    for effect in machine.effects:
        law = next(iter(effect.at.values()))
        if law in STATED and next(iter(effect.at)).startswith("joint"):
            stated.add(effect.id)
            (name, convert), lead = STATED[law], effect.parameters[0]
            for fields, value in zip(found, robot.channels(f"{effect.id}.{lead.name}"), strict=True):
                fields[name] = convert(float(value), machine.frame) * (fields["gain"] if name == "gain" else 1.0)
    light = Body(INERTIA, np.zeros(3), TINY * INERTIA * np.eye(3))
    chain = [Joint(j, "continuous", "", f"link_{j}", at, np.zeros(3), np.array([0.0, 0.0, 1.0]),
                   friction=BRAKE * INERTIA if fields.get("backlash") else 0.0)
             for j, at, fields in zip(joints, place.origins, found, strict=True)]  # fmt: skip
    return Mechanism(
        Chain(joints, tuple(chain), (light,) * len(joints), place.ends[-1]),
        tuple(Drive(INERTIA * fast**2, 2.0 * INERTIA * fast, armature=INERTIA, **fields) for fields in found),
        step=0.1 / fast, stated=frozenset(stated), beside=True,
        notes=("the model of these servos has neither inertias nor gains: masses, armature, friction, kp and kv are",
               "assumed, so that a joint settles in a fraction of a frame; the other numbers are for your arm's model"),
    )  # fmt: skip


def servo_machine(name: str, section: Any, source: str) -> Machine:
    """The machine of a `servos` section of a robot file: `effects` has the library's law by the id of each effect."""
    section = SECTION(section, f"{source}, 'servos'")
    joints = tuple(section["joints"])
    if len(set(joints)) < len(joints):
        raise InputError(f"{source}, 'servos': a joint comes twice: {', '.join(joints)}")
    late: dict[str, Any] = {"points": {"bus.sent": "joint_command.sent"}, "frames": FRAMES}
    own = {"timing.command_latency": late}
    try:
        effects = tuple(for_machine(law, identity, **own.get(law, {})) for identity, law in section["effects"].items())
    except InputError as problem:
        raise InputError(f"{source}, 'servos': {problem}") from None
    settings = (BEND,) if section.get("settings") else ()
    return joint_machine(name, section["part"], joints, effects, section["frame"], section["max_effects"], settings)


def with_long_latency(library: Iterable[Effect], frame: float) -> tuple[Effect, ...]:
    """The effects, commands late by as much as is remembered: a frame [s] may be short."""
    more = joint_command.count_remembered(frame) / joint_command.LEAST
    return tuple(replace(e, parameters=(e.parameters[0].resize(more, "-"), *e.parameters[1:]))
                 if delay_command in e.at.values() else e for e in library)  # fmt: skip


def joint_machine(
    name: str, part: str, joints: tuple[str, ...], library: tuple[Effect, ...], frame: float, max_effects: int,
    settings: tuple[Signal, ...] = (),
) -> Machine:  # fmt: skip
    """A machine of position servos, whose joints are moved by a part of the name `part`; frame: its period [s].

    `STANDARD` laws and the generic ones of its sensors join the effects of the library, if of another family.
    `max_effects`: that a diagnosis may name together; `settings`: `BEND` if logs state the bend of each joint's sheath.
    """
    laws = STANDARD if frame < SLOW else STANDARD[1:]
    standard = (for_machine(f"joint.{law}", f"{part}.{law}") for law in laws)
    library = with_long_latency((*library, *add_generic(tuple(standard), library)), frame)
    given, command = (*REFERENCES, *settings), joint_command.commands(frame, tuple(s.name for s in settings))
    reading = sensor("reading", ANGLE, unit="rad", slot=3, frame=frame, size=SWING, channels=len(joints))
    parts = (replace(joint.PART, name=part), command, reading)
    return Machine(
        name=name, axes=Axes((), joints), signals=(*given, *DRAWN, *COMPUTED), parts=parts, frame=frame, slots=4,
        inputs=tuple(s.name for s in (*given, *DRAWN)), columns=(*(Column(s.name, s.name) for s in given), COLUMN),
        effects=(*library, *add_generic(generic_effects(reading), library), *plugin_effects(parts, library)),
        noise=tuple(f"reading.sigma.{j}" for j in joints), resolution=tuple(f"reading.step.{j}" for j in joints),
        compared=("angle",), noise_std=lambda parameter: {"angle": parameter("reading.repeatability")},
        segments=(Segment(part, "angle"),), max_effects=max_effects, reference_limits=("angle_min", "angle_max"),
        separate=True, loop=make_loop(joints, frame, library), mechanism=mechanism,
        skeleton=lambda robot: axes_side_by_side(robot.machine.axes.joints, "angle", "angle"),
    )  # fmt: skip


TICK = 5e-4  # s, of the motors' equation of motion at most
# the servo of whose size ranges of effects are, a Feetech STS3215 (Rhoban/bam, 2025): stall torque [N m], no-load speed
# [rad/s], and friction of the gear [N m], which counts as viscous at so many rad/s; assumed
STALL, NO_LOAD, FRICTION, TURNING = 3.5, 5.7, 0.05, 1.0
FASTEST = replace(LIBRARY["joint.speed_limit"].parameters[0], high=10.0, default=2.0)
AT_REFERENCE = {"joint.followed": "servo.firmware_reference"}
# laws of commands, and errors of the reading that are not tried: a latency is one of them, joints are read one by one,
# the loop of a servo reads by the same sensor, so that play before it is play of the gear
OF_COMMANDS = (
    for_machine("timing.command_latency", "servo.latency", {"bus.sent": "joint_command.sent"}, frames=FRAMES),
    for_machine("joint.lag", "servo.lag", AT_REFERENCE),
    for_machine("joint.speed_limit", "servo.speed_limit", AT_REFERENCE, speed=FASTEST),
)
LEFT_OUT = tuple(f"reading.{law}" for law in ("delay", "crosstalk", "backlash", "dead_zone", "hysteresis"))


def motor_machine(name: str, joints: tuple[str, ...], frame: float, max_effects: int) -> Machine:
    """A machine of servos with motor, gear and supply; frame: its period [s]."""
    scales = {
        "force": (FRICTION, "N m"), "speed": (TURNING, "rad/s"), "length": (SWING, "rad"),
        "force/speed": (FRICTION / TURNING, "N m s/rad"),
    }  # fmt: skip
    ideal = joint_machine(name, "servo", joints, OF_COMMANDS[:1], frame, max_effects)
    parts = (servo.part(scales), joint_command.commands(frame, ticks=True), *ideal.parts[2:])
    own = (effect for effect in collect_effects(parts) if effect.id not in LEFT_OUT)
    found = (ideal.effects[0], *OF_COMMANDS[1:], *own)
    slots = max(4, ceil(frame / TICK))
    return replace(
        ideal, parts=parts, effects=found, slots=slots, settling=SETTLING, mechanism=motor_mechanism, sizes=size_motors
    )


def size_motors(robot: Robot) -> dict[str, float]:
    """How much more torque, and damping by the back-EMF, the largest motors have than the one that ranges are of."""
    kt, volts, resistance = (robot.channels(f"servo.{name}") for name in ("kt", "supply", "R"))
    torque, damping = (kt * volts / resistance).max() / STALL, (kt**2 / resistance).max() / (STALL / NO_LOAD)
    return {"N m": torque, "N m s/rad": damping, "rad/(N m)": 1.0 / torque, "1/(N m)": 1.0 / torque}


def motor_mechanism(robot: Robot) -> Mechanism:
    """Loads side by side, half points on levers and half bodies, each under a loop; the back-EMF is joint damping."""
    joints = robot.machine.axes.joints

    def with_share(parameter: str, effect: str) -> np.ndarray:
        return robot.channels(f"servo.{parameter}") * (1.0 + robot.channels(f"servo.{effect}.share"))

    def with_amount(parameter: str, effect: str) -> np.ndarray:
        return robot.channels(f"servo.{parameter}") + robot.channels(f"servo.{effect}")

    kt, volts = with_share("kt", "torque_constant"), with_share("supply", "supply")
    heavier = (robot.channels(f"servo.gravity_moment.{name}") for name in ("moment", "lever"))
    load = np.array([*map(carry, robot.channels("servo.inertia"), *heavier)])
    load *= 1.0 + robot.channels("servo.load_inertia.share")
    moment = with_amount("moment", "gravity_moment.moment")
    limit = np.minimum(robot.channels("servo.duty_limit.limit"), 1.0)
    stall, hangs = kt * volts / (resistance := robot.channels("servo.R")), moment != 0.0
    lever = np.divide(0.5 * GRAVITY * load, moment, out=np.zeros(len(joints)), where=hangs)
    mass = np.where(hangs, 2.0 * moment**2 / (GRAVITY**2 * load), load)
    own, low = np.where(hangs, 0.5, 1.0) * load, robot.channels("servo.hanging")
    centres = lever[:, None] * np.column_stack([np.sin(low), np.zeros(len(joints)), -np.cos(low)])
    damping = with_amount("damping", "viscous_friction.coefficient") + kt**2 / resistance
    friction = with_amount("dry_friction", "coulomb_friction.force")
    drives = {
        "kp": stall * with_share("kp", "loop_gain"), "kv": stall * robot.channels("servo.kd"),
        "delay": robot.machine.frame * robot.channels("servo.latency.frames"),
        "lag": robot.channels("servo.lag.time_constant"),
        "speed": np.minimum(volts / kt, robot.channels("servo.speed_limit.speed")),
        "armature": robot.channels("servo.armature"),
        "compliance": with_amount("compliance", "gear_compliance.compliance"),
    }  # fmt: skip
    place = axes_side_by_side(joints, "angle", "angle")
    turning = [Joint(j, "continuous", "", f"link_{j}", place.origins[i], np.zeros(3), np.array([0.0, 1.0, 0.0]),
                     effort=limit[i] * stall[i], damping=damping[i], friction=friction[i])
               for i, j in enumerate(joints)]  # fmt: skip
    bodies = tuple(Body(mass[i], centres[i], own[i] * np.eye(3)) for i in range(len(joints)))
    effects = ("torque_constant", "supply", "load_inertia", "gravity_moment", "loop_gain", "viscous_friction",
               "coulomb_friction", "latency", "lag", "speed_limit", "duty_limit", "gear_compliance")  # fmt: skip
    return Mechanism(
        Chain(joints, tuple(turning), bodies, place.ends[-1]),
        tuple(Drive(**{name: values[i] for name, values in drives.items()}) for i in range(len(joints))),
        step=robot.machine.slot, stated=frozenset(f"servo.{name}" for name in effects), gravity=GRAVITY, beside=True,
        notes=("mass and lever of each load are assumed; its inertia and the moment of its weight are the robot's",
               "damping holds the back-EMF kt^2 / R, so that V / kt is the fastest motion"),
    )  # fmt: skip


def make_loop(joints: tuple[str, ...], frame: float, library: tuple[Effect, ...]) -> Loop:
    """The outer loop that `analyse` and `tune` look at; its integral acts over ten frames first, `OUTER` at least."""
    first = min(0.1 / frame, 1.0 / OUTER)
    proportional, integral = Gain("joint_loop.kp", 0.01, 2.0), Gain("joint_loop.ki", 1e-3 / frame, 1.0 / frame)
    latency = (f"{e.id}.frames" for e in library if e.family == LIBRARY["timing.command_latency"].family)

    def add_controller(robot: Robot) -> Robot:
        machine = robot.machine
        parts = [replace(p, tasks=tuple(replace(t, reads=("angle_sent", *t.reads[1:]), slots=t.slots and (1,))
                                        for t in p.tasks))
                 if p.module is joint_command else p for p in machine.parts]  # fmt: skip
        closed = replace(
            machine, parts=(*parts, joint_loop.PART), signals=(*machine.signals, Signal("angle_sent", "rad", JOINTS)),
            loop=replace(loop, outer=None),
        )  # fmt: skip
        values = {name: float(robot.values[i]) for name, i in machine.index.items()}
        values |= {"joint_loop.kp": 0.0, "joint_loop.ki": first, "joint_loop.lag": 0.0, "joint_loop.period": frame}
        return replace(robot, machine=closed, values=np.array([values[p.name] for p in closed.parameters]))

    loop = Loop(
        reference="angle_ref", command="angle_sent", output="angle", measured="angle_read", part="joint_loop",
        held="sent", gains=(proportional, integral), gentle={"joint_loop.kp": 0.0, "joint_loop.ki": 0.5 * first},
        step=STEP, points={"rest": dict.fromkeys(joints, 0.0)},
        controllers=(
            Controller("I", (integral,), {"joint_loop.lag": 0.0}),
            Controller("PI", (proportional, integral), {"joint_loop.lag": 0.0}),
            Controller("I, filtered reference", (integral, Gain("joint_loop.lag", frame, 1.0))),
        ),
        latency=next(latency, ""), resolution="reading.step", outer=add_controller,
        note="the loop inside a servo cannot be changed: this is one about it, gains assumed (--set joint_loop.ki=5)",
    )  # fmt: skip
    return loop
