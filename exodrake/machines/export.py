"""Robots as MJCF for MuJoCo, URDF, and actuators for Isaac Lab: `export_robot(robot, "arm.xml", "mjcf")`.

A file states what its format can; a comment at its head names the rest.
"""

from math import ceil, floor, isfinite
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

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
    text, ending = robot_as(argument("robot", robot, Robot), form), Path(path).suffix.lower()
    if ending not in ENDINGS[form]:
        raise InputError(f"{path}: wanted a file whose name ends in {' or '.join(ENDINGS[form])}, as {form} does")
    write_text(path, text)


def robot_as(robot: Robot, form: str) -> str:
    """Text of the file that `export_robot` writes."""
    if form not in LEFT_OUT:
        raise InputError(f"unknown form {form!r}{nearest(form, list(LEFT_OUT))}; there are {', '.join(LEFT_OUT)}")
    if robot.machine.mechanism is None:
        raise InputError(f"{robot.machine.name}: its machine does not say which bodies and joints it has (`mechanism`)")
    mechanism = robot.machine.mechanism(robot)
    said = head(robot, mechanism, form)
    if form != "isaac":
        root = mjcf(mechanism) if form == "mjcf" else urdf(mechanism)
        root.set("model" if form == "mjcf" else "name", robot.machine.name)
        root.insert(0, Comment("\n  " + "\n  ".join(said).replace("--", "- -") + "\n"))
        indent(root)
        return tostring(root, encoding="unicode") + "\n"
    from jinja2 import Environment, StrictUndefined

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
    source = Path(__file__).with_name("isaac_actuators.py.txt").read_text()
    template = Environment(undefined=StrictUndefined).from_string(source, {"step": step})
    return template.render(head=[line.replace('"""', "'''").replace("\\", "/") for line in said], groups=groups) + "\n"


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


def mjcf(mechanism: Mechanism) -> Element:
    """The robot as MJCF."""
    root, chain = Element("mujoco"), mechanism.chain
    SubElement(root, "compiler", angle="radian", eulerseq="XYZ", autolimits="true")
    SubElement(root, "option", timestep=text(mechanism.step), gravity=text([0.0, 0.0, 0.0 - mechanism.gravity]),
               integrator="implicitfast")  # fmt: skip
    default, world = SubElement(root, "default"), SubElement(root, "worldbody")
    SubElement(default, "geom", contype="0", conaffinity="0", mass="0", rgba="0.7 0.75 0.8 0.5")
    SubElement(world, "light", directional="true", pos="0 0 3", ambient="0.4 0.4 0.4")
    base = SubElement(world, "body", name="base", euler=text([*mechanism.tilt, 0.0]))
    tendons, actuators = Element("tendon"), Element("actuator")
    stiff = text([2.0 * mechanism.step, 1.0])  # the stiffest constraint that MuJoCo keeps stable, critically damped
    bodies, ends = [base], [*(joint.origin for joint in chain.joints[1:]), chain.tip]
    thin = THIN * max(float(np.linalg.norm(end)) for end in [*ends, [0.1, 0.0, 0.0]])
    for i, (joint, body, drive) in enumerate(zip(chain.joints, chain.bodies, mechanism.drives, strict=True)):
        parent = base if mechanism.beside else bodies[-1]
        frame = {"pos": text(joint.origin), "euler": text(joint.angles)}
        moving = {"type": "slide" if joint.kind == "prismatic" else "hinge", "axis": text(joint.axis)}
        limits = {"range": text([joint.lower, joint.upper])} if isfinite(joint.upper - joint.lower) else {}
        spring = attributes(stiffness=drive.spring, springref=drive.rest)
        drag = attributes(damping=joint.damping, frictionloss=joint.friction)
        drag |= {"solreffriction": stiff} if joint.friction else {}
        rotor = attributes(armature=drive.armature)
        if drive.gravity:  # the motor bears it, within the limit of its effort
            rotor["actuatorgravcomp"] = "true"
            rotor |= {"actuatorfrcrange": text([-joint.effort, joint.effort])} if isfinite(joint.effort) else {}
        link = SubElement(parent, "body", frame | attributes(gravcomp=drive.gravity), name=joint.child)
        inertial(link, body)
        driven = joint.name
        if drive.compliance or drive.backlash:  # a rotor on the link's axis, tied to the link with play and by a spring
            driven = f"{joint.name}_rotor"
            turning = SubElement(parent, "body", frame, name=driven)
            inertial(turning, Body(TINY, np.zeros(3), TINY * np.eye(3)))
            SubElement(turning, "joint", moving | rotor | (drag if drive.compliance else {}), name=driven)
            SubElement(link, "joint", moving | limits | spring | ({} if drive.compliance else drag), name=joint.name)
            play = text([-drive.backlash, drive.backlash])
            tied = {"range": play, "solreflimit": stiff}
            if drive.compliance:
                tied = {"stiffness": text(1.0 / drive.compliance), "springlength": play}
            tie = SubElement(tendons, "fixed", tied, name=f"{joint.name}_transmission")
            for name, coefficient in ((driven, 1.0), (joint.name, -1.0)):
                SubElement(tie, "joint", joint=name, coef=text(coefficient))
        else:
            SubElement(link, "joint", moving | limits | rotor | drag | spring, name=joint.name)
        radius = thin if mechanism.radii is None else mechanism.radii[i]
        end = chain.tip if mechanism.beside else ends[i]
        capsule = {"type": "capsule", "fromto": text([0.0] * 3, end)} if np.linalg.norm(end) > radius else {}
        SubElement(link, "geom", capsule, size=text(radius))
        bodies.append(link)
        if not mechanism.tendons:
            actuators.append(actuator(drive, joint.name, driven, joint.effort, mechanism.step))
    if mechanism.payload:
        held = SubElement(bodies[-1], "body", attributes(pos=chain.tip, gravcomp=mechanism.borne), name="payload")
        inertial(held, Body(mechanism.payload, np.zeros(3), TINY * np.eye(3)))
    for tendon in mechanism.tendons:
        drag = attributes(damping=tendon.damping, frictionloss=tendon.friction)
        cable = SubElement(tendons, "spatial", drag, name=tendon.name, width=text(0.1 * thin), rgba="0.8 0.3 0 1")
        for k, (segment, point) in enumerate(tendon.points):
            SubElement(bodies[segment], "site", name=f"{tendon.name}_{k}", pos=text(point), size=text(0.1 * thin))
            SubElement(cable, "site", site=f"{tendon.name}_{k}")
        SubElement(
            actuators, "intvelocity", state_delay(tendon.delay, mechanism.step), name=tendon.name, tendon=tendon.name,
            gear="-1", kp=text(tendon.stiffness), actrange="-10 10", forcerange=text([0.0, min(tendon.limit, 1e9)]),
        )  # fmt: skip
    root.extend(part for part in (tendons, actuators) if len(part))
    if mechanism.tendons:
        rest = np.array([drive.rest for drive in mechanism.drives])
        frames = [(Rotation.identity(), np.zeros(3))]
        for joint, value in zip(chain.joints, rest, strict=True):
            turn, origin = frames[-1]
            turned = turn * Rotation.from_euler("xyz", joint.angles) * Rotation.from_rotvec(value * joint.axis)
            frames.append((turned, origin + turn.apply(joint.origin)))
        taut = []  # lengths of the tendons, wound in
        for tendon in mechanism.tendons:
            placed = [frames[segment][1] + frames[segment][0].apply(point) for segment, point in tendon.points]
            taut.append(-float(np.linalg.norm(np.diff(placed, axis=0), axis=1).sum()))
        SubElement(SubElement(root, "keyframe"), "key", name="rest", qpos=text(rest), act=text(taut))
    return root


def inertial(element: Element, body: Body) -> None:
    """Mass and inertia of a link as MJCF."""
    tensor = text(np.diag(body.inertia), body.inertia[np.triu_indices(3, 1)])
    SubElement(element, "inertial", pos=text(body.centre), mass=text(body.mass), fullinertia=tensor)


def actuator(drive: Drive, name: str, joint: str, effort: float, step: float) -> Element:
    """The position loop of a joint; a torque motor where it has none."""
    common = {"name": name, "joint": joint, **state_delay(drive.delay, step)}
    if isfinite(effort) and not drive.gravity:
        common["forcerange"] = text([-effort, effort])
    if not drive.kp:
        return Element("motor", common)
    if drive.gain == 1.0 and drive.offset == 0.0:
        gains = {"kp": text(drive.kp), "kv": text(drive.kv)}
        return Element("position", common | gains | attributes(timeconst=drive.lag))
    lag = {"dyntype": "filterexact", "dynprm": text(drive.lag)} if drive.lag else {}
    return Element("general", common | lag | {
        "gaintype": "fixed", "gainprm": text(drive.kp * drive.gain), "biastype": "affine",
        "biasprm": text([drive.kp * drive.offset, -drive.kp, -drive.kv]),
    })  # fmt: skip


def state_delay(delay: float, step: float) -> dict[str, str]:
    """Dead time [s] of an actuator's command, with room for the commands on their way."""
    return {"delay": text(delay), "nsample": str(ceil(delay / step) + 1)} if delay else {}


def urdf(mechanism: Mechanism) -> Element:
    """The robot as URDF; rotors' inertias by Drake's extension. The link `world` holds the tilted base."""
    root, chain = Element("robot", {"xmlns:drake": "http://drake.mit.edu"}), mechanism.chain
    SubElement(root, "link", name="world")
    base = SubElement(root, "joint", name="base", type="fixed")
    SubElement(base, "parent", link="world")
    SubElement(base, "child", link="base")
    SubElement(base, "origin", rpy=text([*mechanism.tilt, 0.0]))
    SubElement(root, "link", name="base")
    loads = list(chain.bodies)
    loads[-1] = loads[-1].join(Body(mechanism.payload), np.eye(3), chain.tip)
    before = "base"
    for joint, body, drive in zip(chain.joints, loads, mechanism.drives, strict=True):
        own = SubElement(SubElement(root, "link", name=joint.child), "inertial")
        SubElement(own, "origin", xyz=text(body.centre))
        SubElement(own, "mass", value=text(body.mass))
        upper = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), body.inertia[np.triu_indices(3)], strict=True)
        SubElement(own, "inertia", {name: text(value) for name, value in upper})
        moving = SubElement(root, "joint", name=joint.name, type=joint.kind)
        SubElement(moving, "parent", link="base" if mechanism.beside else before)
        SubElement(moving, "child", link=joint.child)
        SubElement(moving, "origin", xyz=text(joint.origin), rpy=text(joint.angles))
        SubElement(moving, "axis", xyz=text(joint.axis))
        effort, speed = (text(min(limit, 1e9)) for limit in (joint.effort, drive.speed))  # 1e9: no limit
        ends = {"lower": text(max(joint.lower, -1e9)), "upper": text(min(joint.upper, 1e9))}
        ends = {} if joint.kind == "continuous" else ends
        SubElement(moving, "limit", ends | {"effort": effort, "velocity": speed})
        SubElement(moving, "dynamics", damping=text(joint.damping), friction=text(joint.friction))
        if not mechanism.tendons:
            driven = SubElement(root, "transmission", name=joint.name)
            SubElement(driven, "type").text = "transmission_interface/SimpleTransmission"
            SubElement(SubElement(driven, "joint", name=joint.name), "hardwareInterface").text = "EffortJointInterface"
            motor = SubElement(driven, "actuator", name=joint.name)
            SubElement(motor, "drake:rotor_inertia", value=text(drive.armature))
        before = joint.child
    return root
