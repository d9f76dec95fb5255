"""Machines of one serial arm, described by the `arm` section of a robot file and a URDF file beside it; no code.

    machine: my_arm
    arm: {urdf: arm.urdf, form: inverse, frame: 0.005}          # or form: closed-loop; tip: LINK where joints branch

`inverse`: motion is measured and the effort predicted from it. `closed-loop`: references go through PD controller,
motors and forward dynamics. Parameters that the URDF states need not be in the robot file. A linear or rotary axis is
an arm of one joint.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.loop import Controller, Gain, Loop
from exodrake.core.machine import Column, Machine
from exodrake.core.schema import mapping, number, text
from exodrake.core.segment import Segment
from exodrake.core.signal import JOINTS, NORMAL, UNIFORM, Axes, Signal
from exodrake.core.skeleton import Shape
from exodrake.effects import effects_of
from exodrake.machines.urdf import Chain, read_urdf
from exodrake.systems import arm_drive, arm_forward, arm_inverse, gear_motor, rigid_arm
from exodrake.systems.reading import sensor

FORMS = ("inverse", "closed-loop")
SLOWEST, TICK = 10.0, 5e-4  # s: longest frame; the plant's tick at most, so that a wrist's resonance is resolved
SECTION = mapping(
    {"urdf": text(), "form": text(FORMS), "frame": number(above=0.0, high=SLOWEST), "tip": text()}, required=("urdf",)
)
FRAME = 0.005  # s, as most recordings of arms: assumed
SWING, SPEED, BRISK = 1.0, 0.5, 2.0  # rad, rad/s, rad/s2 of a moderate motion: assumed
SHARE = 0.05  # of friction in the largest effort: assumed
BANDWIDTH = 2.0 * np.pi * 2.0  # rad/s of the nominal position loops: assumed
STEP = 0.02  # rad or m, of a reference for the analysis: assumed
POSTURES = 20  # at which efforts are looked at
TURNS = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s2", "effort": "N m"}
SLIDES = {"position": "m", "velocity": "m/s", "acceleration": "m/s2", "effort": "N"}
CROSSTALK = ("torque.crosstalk", "encoder.crosstalk")  # not tried: joints are measured one by one
OFFSET = ("arm.offset",)  # which is `torque.offset` in inverse dynamics


def arm_machine(name: str, section: Any, folder: Path, source: str) -> Machine:
    """The machine of an `arm` section.

    Args:
        name: of the machine.
        section: content of the key `arm`.
        folder: that holds the robot file; the URDF file must lie in it.
        source: of the section, for messages.

    Raises:
        InputError: for an unknown key, and a URDF file that is absent, elsewhere or no serial arm.
    """
    section = SECTION(section, f"{source}, 'arm'")
    path = (folder / section["urdf"]).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise InputError(f"{source}: urdf {section['urdf']} lies outside the folder of the robot file")
    chain = read_urdf(path, section.get("tip", ""))
    build = inverse_machine if section.get("form", FORMS[0]) == FORMS[0] else closed_machine
    return build(name, chain, section.get("frame", FRAME))


def units(chain: Chain) -> dict[str, str]:
    """Units of the signals, and of gains and damping; none ("-") where joints of both kinds share a signal."""
    kinds = set(chain.sliding)
    found = TURNS if kinds == {0.0} else SLIDES if kinds == {1.0} else dict.fromkeys(TURNS, "-")
    mixed = len(kinds) > 1
    force, per = found["effort"], found["position"]
    ratios = {"effort/speed": f"{force} s/{per}", "effort/position": f"{force}/{per}"}
    return found | (dict.fromkeys(ratios, "-") if mixed else ratios)


def stated(chain: Chain, part: str) -> dict[str, float]:
    """Parameters of the arm as the URDF states them, by full name [SI]."""
    names = ("x", "y", "z")
    found = {f"{part}.gravity": 9.81, f"{part}.tip_mass": 0.0, f"{part}.base_roll": 0.0, f"{part}.base_pitch": 0.0}
    found |= {f"{part}.tip_{name}": float(value) for name, value in zip(names, chain.tip, strict=True)}
    for channel, joint, body in zip(chain.names, chain.joints, chain.bodies, strict=True):
        values = {"mass": body.mass, "sliding": float(joint.kind == "prismatic")}
        for i, axis in enumerate(names):
            values |= {f"com_{axis}": body.centre[i], axis: joint.origin[i], f"axis_{axis}": joint.axis[i]}
            values |= {axis + names[k]: body.inertia[i, k] for k in range(i, 3)}
        values |= dict(zip(("roll", "pitch", "yaw"), joint.angles, strict=True))
        found |= {f"{part}.{name}.{channel}": float(value) for name, value in values.items()}
    return found


def losses(chain: Chain) -> dict[str, float]:
    """Damping and dry friction of the URDF, and rotors without inertia."""
    found = {}
    for channel, joint in zip(chain.names, chain.joints, strict=True):
        found |= {f"arm.damping.{channel}": joint.damping, f"arm.dry_friction.{channel}": joint.friction}
        found[f"arm.rotor_inertia.{channel}"] = 0.0
    return found


def moved(chain: Chain, q: np.ndarray, rate: np.ndarray, acceleration: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Efforts (n,) and mass matrix (n, n) of the bare arm at a motion (n,) each [SI], by the equations themselves."""
    n = len(q)
    w = np.zeros((rigid_arm.WIDTH + n) * n)
    for j, (joint, body) in enumerate(zip(chain.joints, chain.bodies, strict=True)):
        rigid_arm.place(w, j, joint.origin, joint.angles, joint.axis, chain.sliding[j], q[j])
        rigid_arm.load(w, j, body.mass, body.centre, body.inertia[np.triu_indices(3)])
        rigid_arm.move(w, j, rate[j], acceleration[j], (0.0, 0.0, -9.81))
    rigid_arm.gather(w, n, rigid_arm.WRENCH, rigid_arm.WIDTH - rigid_arm.WRENCH)
    efforts = np.array([rigid_arm.effort(w, j) for j in range(n)])
    rigid_arm.mass_matrix(w, n, rigid_arm.WIDTH * n)
    return efforts, w[rigid_arm.WIDTH * n :].reshape(n, n)


def middle(chain: Chain) -> np.ndarray:
    """Middle of each joint's range (n,); 0 of one without limits."""
    ends = [(j.lower, j.upper) if np.isfinite(j.upper - j.lower) else (0.0, 0.0) for j in chain.joints]
    return np.array([0.5 * (low + high) for low, high in ends])


def typical_efforts(chain: Chain) -> np.ndarray:
    """Root mean square of the effort of each joint (n,) in moderate motions at random postures about the middle."""
    rng, n = np.random.default_rng(0), len(chain.names)
    draws = (rng.uniform(-SWING, SWING, (3, n)) for _ in range(POSTURES))
    found = [moved(chain, middle(chain) + q, SPEED * v, BRISK * a)[0] for q, v, a in draws]
    return np.maximum(np.sqrt(np.mean(np.square(found), axis=0)), 1e-3)


def scales(efforts: np.ndarray, unit: Mapping[str, str]) -> dict[str, tuple[float, str]]:
    """Sizes of the friction of joints, for the generic effects."""
    force = SHARE * float(efforts.max())
    return {
        "force": (force, unit["effort"]), "speed": (SPEED, unit["velocity"]), "length": (SWING, unit["position"]),
        "force/speed": (force / SPEED, unit["effort/speed"]),
    }  # fmt: skip


def noise_std(parameter: Callable[[str], float]) -> dict[str, float]:
    """By how much the efforts of equal motions differ [N m]; the noise of each joint comes from simulated runs."""
    return {"effort": parameter("torque.floor")}


def both_std(parameter: Callable[[str], float]) -> dict[str, float]:
    """The same, and that of positions [rad]."""
    return {"position": parameter("encoder.floor"), **noise_std(parameter)}


def signals(unit: Mapping[str, str], *names: str) -> tuple[Signal, ...]:
    """Signals of the joints; the unit is that of the kind with which the name begins."""
    return tuple(Signal(name, unit[name.split("_")[0]], JOINTS) for name in names)


def drawn(*names: str) -> tuple[Signal, ...]:
    """Noise of the sensors of these quantities, and what may be lost of their readings."""
    noise = (Signal(f"noise_{name}", "-", JOINTS, NORMAL) for name in names)
    return (*noise, *(Signal(f"arrival_{name}", "-", JOINTS, UNIFORM) for name in names))


def columns(chain: Chain, shown: Mapping[str, str], rates: Mapping[str, str]) -> tuple[Column, ...]:
    """Log columns: kind -> signal; rates: kind -> the one whose rate it is. Kinds of mixed joints say so."""
    before, unit = "joint_" if len(set(chain.sliding)) > 1 else "", units(chain)
    return tuple(
        Column(
            before + kind, signal, required=kind != "effort_ref", unit=unit["effort"] if "effort" in kind else "",
            rate_of=before + rates[kind] if kind in rates else "",
        )
        for kind, signal in shown.items()
    )  # fmt: skip


def inverse_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in inverse-dynamics form: position, velocity and acceleration are measured, the effort is predicted."""
    unit, efforts, count = units(chain), typical_efforts(chain), len(chain.names)
    torque = sensor(
        "torque", ("effort", "noise_effort", "arrival_effort", "effort_read"), unit["effort"], 0, frame,
        float(efforts.max()), count,
    )  # fmt: skip
    parts = (arm_inverse.part(scales(efforts, unit), unit), torque)
    motion = signals(unit, "position", "velocity", "acceleration")
    shown = {**{s.name: s.name for s in motion}, "effort": "effort_read"}
    found = columns(chain, shown, {"velocity": "position", "acceleration": "velocity"})
    return Machine(
        name=name,
        axes=Axes((), chain.names),
        signals=(*motion, *drawn("effort"), *signals(unit, "effort", "effort_read")),
        parts=parts,
        inputs=(*(s.name for s in motion), "noise_effort", "arrival_effort"),
        columns=found,
        effects=tuple(e for e in effects_of(parts) if e.id not in CROSSTALK + OFFSET),
        frame=frame,
        slots=1,
        noise=tuple(f"torque.sigma.{j}" for j in chain.names),
        resolution=tuple(f"torque.step.{j}" for j in chain.names),
        compared=(found[-1].kind,),
        noise_std=lambda parameter: renamed(noise_std(parameter), found),
        segments=(Segment("arm", found[-1].kind),),
        max_effects=4,
        reference_limits=("position_min", "position_max"),
        skeleton=shape,
        defaults=stated(chain, "arm") | losses(chain),
    )


def renamed(noise: dict[str, float], found: tuple[Column, ...]) -> dict[str, float]:
    """Noise by the kind of its column."""
    return {column.kind: noise[key] for column in found for key in noise if column.kind.removeprefix("joint_") == key}


def closed_machine(name: str, chain: Chain, frame: float) -> Machine:
    """The arm in closed loop: controller, motors, forward dynamics, encoders and torque sensors."""
    unit, efforts, count = units(chain), typical_efforts(chain), len(chain.names)
    slots = max(4, round(np.ceil(frame / TICK)))
    encoder = sensor(
        "encoder", ("position", "noise_position", "arrival_position", "position_read"), unit["position"], 1, frame,
        SWING, count,
    )  # fmt: skip
    torque = sensor(
        "torque", ("effort", "noise_effort", "arrival_effort", "effort_read"), unit["effort"], 3, frame,
        float(efforts.max()), count,
    )  # fmt: skip
    forward = arm_forward.part(count, 0, scales(efforts, unit), unit)
    parts = (forward, gear_motor.PART, encoder, torque, arm_drive.part(2, unit))
    given = signals(unit, "position_ref", "position_start")
    inner = signals(unit, "position", "position_read", "effort_ref", "effort", "effort_true", "effort_read")
    link = Signal("link_position", unit["position"], JOINTS)
    noises = drawn("position", "effort")
    shown = {s.name: s.name for s in given}
    shown |= {"effort_ref": "effort_ref", "position": "position_read", "effort": "effort_read"}
    found = columns(chain, shown, {})
    position, effort = found[-2].kind, found[-1].kind
    return Machine(
        name=name,
        axes=Axes((), chain.names),
        signals=(*given, *noises, *inner, link),
        parts=parts,
        inputs=(*(s.name for s in given), *(s.name for s in noises)),
        columns=found,
        effects=tuple(e for e in effects_of(parts) if e.id not in CROSSTALK),
        frame=frame,
        slots=slots,
        noise=tuple(f"{part}.sigma.{j}" for part in ("encoder", "torque") for j in chain.names),
        resolution=tuple(f"{part}.step.{j}" for part in ("encoder", "torque") for j in chain.names),
        compared=(position, effort),
        noise_std=lambda parameter: renamed(both_std(parameter), found),
        segments=(Segment("drive", effort, (position,)), Segment("arm", position, (effort,))),
        max_effects=4,
        reference_limits=("position_min", "position_max"),
        skeleton=shape,
        loop=loop_of(chain),
        defaults=stated(chain, "arm") | losses(chain) | drive_defaults(chain, efforts, frame),
    )


def drive_defaults(chain: Chain, efforts: np.ndarray, frame: float) -> dict[str, float]:
    """Gains of a moderate bandwidth, a controller that knows the arm, motors that reach its efforts and limits."""
    inertia = np.diag(moved(chain, middle(chain), np.zeros(len(efforts)), np.zeros(len(efforts)))[1])
    found = stated(chain, "drive") | {"drive.kp": 1.0, "drive.kd": 1.0, "drive.period": frame}
    for channel, joint, m, most in zip(chain.names, chain.joints, inertia, efforts, strict=True):
        limit = joint.effort if 0.0 < joint.effort < np.inf else 10.0 * most
        found |= {
            f"drive.stiffness.{channel}": m * BANDWIDTH**2, f"drive.viscosity.{channel}": 2.0 * m * BANDWIDTH,
            f"drive.feedforward.{channel}": 1.0, f"arm.compliance.{channel}": 0.0,
            f"motor.torque_constant.{channel}": 1.0, f"motor.ratio.{channel}": 1.0,
            f"motor.current_max.{channel}": limit, f"motor.time_constant.{channel}": 0.0,
        }  # fmt: skip
    return {name: float(value) for name, value in found.items()}


def loop_of(chain: Chain) -> Loop:
    """The closed loop that `analyse` and `tune` look at."""
    gains = (Gain("drive.kp", 0.1, 10.0), Gain("drive.kd", 0.1, 10.0))
    return Loop(
        reference="position_ref", command="effort_ref", output="position", measured="position_read",
        part="drive", held="effort", gains=gains, gentle={"drive.kp": 0.5, "drive.kd": 1.0}, step=STEP,
        points={"middle": dict(zip(chain.names, middle(chain).tolist(), strict=True))},
        controllers=(Controller("PD", gains),), resolution="encoder.step", nonlinear=("arm.coulomb_friction",),
    )  # fmt: skip


def shape(robot: Any) -> Shape:
    """What a recording draws: the joints of the robot's parameters, in order."""

    def rows(*names: str) -> np.ndarray:
        return np.column_stack([robot.channels(f"arm.{name}") for name in names])

    tip = np.array([robot[f"arm.tip_{axis}"] for axis in "xyz"])
    column = next(c for c in robot.machine.columns if c.kind.endswith("position") and c.signal != "position_ref")
    origins = rows("x", "y", "z")
    return Shape(
        robot.machine.axes.joints, origins, rows("roll", "pitch", "yaw"),
        rows("axis_x", "axis_y", "axis_z"), robot.channels("arm.sliding"), np.vstack([origins[1:], tip]),
        np.array([robot["arm.base_roll"], robot["arm.base_pitch"]]), column.kind, robot.machine.compared[-1],
    )  # fmt: skip
