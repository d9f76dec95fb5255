"""Robots as MJCF for MuJoCo, URDF, and actuators for Isaac Lab: `export_robot(robot, "arm.xml", "mjcf")`.

A file states what its format can; a comment at its head names the rest. Each format is a template, `export_FORM.txt`.
"""

from math import ceil, floor, isfinite
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from exodrake.core.errors import InputError, argument, nearest
from exodrake.core.files import write_text
from exodrake.model.mechanism import Body, Drive, Mechanism
from exodrake.model.robot import Robot, effect_in_words

# fields of a drive that a format does not state, with their units; of a joint that slides m stands for rad, N for N m
LEFT_OUT = {
    "mjcf": {"speed": "rad/s"},
    "urdf": {"kp": "N m/rad", "kv": "N m s/rad", "gain": "-", "offset": "rad", "delay": "s", "lag": "s", "gravity": "-",
             "compliance": "rad/(N m)", "backlash": "rad", "spring": "N m/rad", "rest": "rad"},
    "isaac": {"gain": "-", "offset": "rad", "lag": "s", "gravity": "-", "compliance": "rad/(N m)", "backlash": "rad"},
}  # fmt: skip
ENDINGS = {"mjcf": (".xml", ".mjcf"), "urdf": (".urdf", ".xml"), "isaac": (".py",)}
TINY = 1e-6  # kg and kg m2 of bodies that stand for a rotor: assumed, far below any link's
THIN = 0.03  # of the arm's longest link: radius with which links are drawn
PHYSICS_STEP = 0.005  # s, of Isaac Lab's examples


def export_robot(robot: Robot, path: str | Path, form: str = "mjcf") -> None:
    """Writes a robot, effects and all, for another simulator.

    Args:
        robot: such as the improved one of a diagnosis.
        path: of the file.
        form: "mjcf" for MuJoCo, "urdf", or "isaac" for a Python file of Isaac Lab's actuator configurations.

    Raises:
        InputError: for an unknown form, a robot that the form cannot hold, and a file that cannot be written.

    Examples:
        >>> import exodrake as exo
        >>> export_robot(exo.load_robot("so101"), "so101.xml", "mjcf")
    """
    text = robot_as(argument("robot", robot, Robot), form)
    if Path(path).suffix.lower() not in ENDINGS[form]:
        raise InputError(f"{path}: wanted a file whose name ends in {' or '.join(ENDINGS[form])}, as {form} does")
    write_text(path, text)


def robot_as(robot: Robot, form: str) -> str:
    """Text of the file that `export_robot` writes."""
    if form not in LEFT_OUT:
        raise InputError(f"unknown form {form!r}{nearest(form, list(LEFT_OUT))}; there are {', '.join(LEFT_OUT)}")
    if robot.machine.mechanism is None:
        raise InputError(f"{robot.machine.name}: its machine does not say which bodies and joints it has (`mechanism`)")
    from jinja2 import Environment, StrictUndefined

    mechanism = robot.machine.mechanism(robot)
    values = {"mjcf": mjcf, "urdf": urdf, "isaac": isaac}[form](robot, mechanism)
    source = Path(__file__).with_name(f"export_{form}.txt").read_text()
    template = Environment(undefined=StrictUndefined, autoescape=form != "isaac").from_string(source)
    values |= {"text": text, "mechanism": mechanism, "name": robot.machine.name}
    return template.render(head=head(robot, mechanism, form), **values) + "\n"


def head(robot: Robot, mechanism: Mechanism, form: str) -> list[str]:
    """Sentences at the head of a file: what it is, what is assumed, and what the format does not state."""
    lost, nothing = [], Drive()
    for name, unit in LEFT_OUT[form].items():
        values = {j: getattr(drive, name) for j, drive in zip(mechanism.chain.names, mechanism.drives, strict=True)}
        listed = ", ".join(f"{j} {value:.6g}" for j, value in values.items() if value != getattr(nothing, name))
        lost += [f"{name} [{unit}] {listed}"] if listed else []
    if form != "mjcf" and mechanism.tendons:
        lost.append(f"tendons {', '.join(t.name for t in mechanism.tendons)}")
    lost += [f"effect {effect_in_words(robot, e)}" for e in robot.effects() if e not in mechanism.stated]
    first = f"{robot.machine.name} from {robot.source or 'Python'}, written by exodrake; SI units."
    return [first, *mechanism.notes, *(f"not stated here: {one}" for one in lost)]


def text(*values: Any) -> str:
    """Numbers as an attribute that reads back to the same bits."""
    return " ".join(repr(float(v)) for v in np.concatenate([np.ravel(v) for v in values]))


def attributes(**values: Any) -> dict[str, str]:
    """Attributes of the numbers that are neither 0 nor infinite."""
    return {name: text(v) for name, v in values.items() if np.any(v) and np.all(np.isfinite(v))}


def isaac(robot: Robot, mechanism: Mechanism) -> dict[str, Any]:
    """Groups of actuators of one delay each."""
    if mechanism.tendons:
        raise InputError(f"{robot.machine.name}: tendons move it, and Isaac Lab's actuators sit on joints; take --mjcf")
    step = min(PHYSICS_STEP, robot.machine.frame)
    delays: dict[tuple[int, int], list[int]] = {}
    for i, drive in enumerate(mechanism.drives):
        late = drive.delay / step
        delays.setdefault((floor(late + 1e-9), ceil(late - 1e-9)), []).append(i)
    groups = []
    for (low, high), members in delays.items():
        joints, drives = [mechanism.chain.joints[i] for i in members], [mechanism.drives[i] for i in members]
        values = {
            "effort_limit": [j.effort for j in joints], "velocity_limit": [d.speed for d in drives],
            "stiffness": [d.kp + d.spring for d in drives], "damping": [d.kv for d in drives],
            "armature": [d.armature for d in drives], "friction": [j.friction for j in joints],
            "viscous_friction": [j.damping for j in joints],
        }  # fmt: skip
        fields: dict[str, Any] = {"joint_names_expr": [j.name for j in joints]}
        for name, items in values.items():
            if all(map(isfinite, items)) and (any(items) or name in ("stiffness", "damping")):
                each = dict(zip(fields["joint_names_expr"], map(float, items), strict=True))
                fields[name] = each if len(set(items)) > 1 else float(items[0])
        fields |= {"min_delay": low, "max_delay": high} if high else {}
        kind = "DelayedPDActuatorCfg" if high else "ImplicitActuatorCfg"
        groups.append((repr(f"delay_{low}_{high}" if high else "prompt"), {"kind": kind, "fields": fields}))
    return {"step": step, "groups": groups}


def mjcf(robot: Robot, mechanism: Mechanism) -> dict[str, Any]:
    """Attributes of each link with its joint, rotor and transmission, of the actuators and of the taut tendons."""
    chain, step, links, actuators = mechanism.chain, mechanism.step, [], []
    stiff = text(2.0 * step, 1.0)  # the stiffest constraint that MuJoCo keeps stable, critically damped
    ends = [*(joint.origin for joint in chain.joints[1:]), chain.tip]
    thin = THIN * max(float(np.linalg.norm(end)) for end in [*ends, [0.1, 0.0, 0.0]])
    for i, (joint, drive) in enumerate(zip(chain.joints, mechanism.drives, strict=True)):
        frame = {"pos": text(joint.origin), "euler": text(joint.angles)}
        moving = {"type": "slide" if joint.kind == "prismatic" else "hinge", "axis": text(joint.axis)}
        limits = {"range": text(joint.lower, joint.upper)} if isfinite(joint.upper - joint.lower) else {}
        spring = attributes(stiffness=drive.spring, springref=drive.rest)
        drag = attributes(damping=joint.damping, frictionloss=joint.friction)
        drag |= {"solreffriction": stiff} if joint.friction else {}
        rotor = attributes(armature=drive.armature)
        if drive.gravity:  # the motor bears it, within the limit of its effort
            rotor["actuatorgravcomp"] = "true"
            rotor |= {"actuatorfrcrange": text(-joint.effort, joint.effort)} if isfinite(joint.effort) else {}
        radius = thin if mechanism.radii is None else mechanism.radii[i]
        end = chain.tip if mechanism.beside else ends[i]
        capsule = {"type": "capsule", "fromto": text([0.0] * 3, end)} if np.linalg.norm(end) > radius else {}
        link = {"geom": capsule | {"size": text(radius)}, "tie": {}}
        link["body"] = frame | attributes(gravcomp=drive.gravity) | {"name": joint.child}
        link["joint"] = moving | limits | rotor | drag | spring | {"name": joint.name}
        driven = joint.name
        if drive.compliance or drive.backlash:  # a rotor on the link's axis, tied to the link with play and by a spring
            driven, play = f"{joint.name}_rotor", text(-drive.backlash, drive.backlash)
            own, others = (drag, {}) if drive.compliance else ({}, drag)
            link["joint"] = moving | limits | spring | others | {"name": joint.name}
            link["rotor"], link["rotor_body"] = moving | rotor | own | {"name": driven}, frame | {"name": driven}
            tied = {"range": play, "solreflimit": stiff}
            if drive.compliance:
                tied = {"stiffness": text(1.0 / drive.compliance), "springlength": play}
            link["tie"] = tied | {"name": f"{joint.name}_transmission"}
        links.append(link)
        if not mechanism.tendons:
            actuators.append(actuator(drive, joint.name, driven, joint.effort, step))
    for tendon in mechanism.tendons:
        names = {"name": tendon.name, "tendon": tendon.name, "gear": "-1", "kp": text(tendon.stiffness)}
        force = {"actrange": "-10 10", "forcerange": text(0.0, min(tendon.limit, 1e9))}
        actuators.append(("intvelocity", state_delay(tendon.delay, step) | names | force))
    rest, frames = [drive.rest for drive in mechanism.drives], [(Rotation.identity(), np.zeros(3))]
    for joint, value in zip(chain.joints, rest, strict=True):
        turn, origin = frames[-1]
        turned = turn * Rotation.from_euler("xyz", joint.angles) * Rotation.from_rotvec(value * joint.axis)
        frames.append((turned, origin + turn.apply(joint.origin)))
    taut = []  # lengths of the tendons, wound in
    for tendon in mechanism.tendons:
        placed = [frames[segment][1] + frames[segment][0].apply(point) for segment, point in tendon.points]
        taut.append(-float(np.linalg.norm(np.diff(placed, axis=0), axis=1).sum()))
    return {
        "links": links, "actuators": actuators, "thin": thin, "attributes": attributes, "rest": rest, "taut": taut,
        "held": attributes(pos=chain.tip, gravcomp=mechanism.borne) | {"name": "payload"},
        "rotor": Body(TINY, np.zeros(3), TINY * np.eye(3)),
        "payload": Body(mechanism.payload, np.zeros(3), TINY * np.eye(3)),
    }  # fmt: skip


def actuator(drive: Drive, name: str, joint: str, effort: float, step: float) -> tuple[str, dict[str, str]]:
    """Kind and attributes of the position loop of a joint; a torque motor where it has none."""
    common = {"name": name, "joint": joint, **state_delay(drive.delay, step)}
    if isfinite(effort) and not drive.gravity:
        common["forcerange"] = text(-effort, effort)
    if not drive.kp:
        return "motor", common
    if drive.gain == 1.0 and drive.offset == 0.0:
        gains = {"kp": text(drive.kp), "kv": text(drive.kv)}
        return "position", common | gains | attributes(timeconst=drive.lag)
    lag = {"dyntype": "filterexact", "dynprm": text(drive.lag)} if drive.lag else {}
    return "general", common | lag | {
        "gaintype": "fixed", "gainprm": text(drive.kp * drive.gain), "biastype": "affine",
        "biasprm": text(drive.kp * drive.offset, -drive.kp, -drive.kv),
    }  # fmt: skip


def state_delay(delay: float, step: float) -> dict[str, str]:
    """Dead time [s] of an actuator's command, with room for the commands on their way."""
    return {"delay": text(delay), "nsample": str(ceil(delay / step) + 1)} if delay else {}


def urdf(robot: Robot, mechanism: Mechanism) -> dict[str, Any]:
    """Joint, body and drive of each link, the last with the payload; rotors' inertias are in Drake's extension."""
    chain, loads = mechanism.chain, [*mechanism.chain.bodies]
    loads[-1] = loads[-1].join(Body(mechanism.payload), np.eye(3), chain.tip)
    links = list(zip(chain.joints, loads, mechanism.drives, strict=True))
    return {"links": links, "finite": lambda limit: min(max(limit, -1e9), 1e9)}  # 1e9: no limit
