"""What machines of serial arms share: signals, sensors, log columns, and the parameters that a URDF file implies."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from exodrake.core.effect import Effect
from exodrake.core.machine import Column, Controller, Gain, Loop
from exodrake.core.mechanism import GRAVITY, Body, Chain, Drive, Joint, Mechanism, Shape
from exodrake.core.part import JOINTS, NORMAL, UNIFORM, Part, Signal
from exodrake.core.robot import Robot
from exodrake.effects import effects_of
from exodrake.physics import arm
from exodrake.physics.reading import sensor


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


def reading(name: str, signal: str, unit: Mapping[str, str], slot: int, frame: float, size: float, count: int) -> Part:
    """A sensor of a signal of the joints."""
    joined = (signal, f"noise_{signal}", f"arrival_{signal}", f"{signal}_read")
    return sensor(name, joined, unit[signal], slot, frame, size, count)


def effects_in(unit: Mapping[str, str], parts: tuple[Part, ...], without: tuple[str, ...]) -> tuple[Effect, ...]:
    """The effects of the parts but for some, those that are made for turning joints in the units of these."""
    own = {TURNS["position"]: unit["position"], TURNS["inertia"]: unit["inertia"], "rad/(N m)": unit["position/effort"]}
    return tuple(
        replace(e, parameters=tuple(replace(p, unit=own.get(p.unit, p.unit)) for p in e.parameters))
        for e in effects_of(parts)
        if e.id not in without
    )


def shape(robot: Robot) -> Shape:
    """Geometry that a recording draws: the joints of the robot's parameters, in order."""

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
        believed = value(f"drive.mass.{j}") * value(f"drive.feedforward.{j}")
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
        notes.append(
            f"the robot's controller computes once in {robot.machine.frame:g} s and differentiates the error: "
            "send q_ref + (kv / kp) dq_ref/dt"
        )
        if any(robot.channels("motor.time_constant")):
            notes.append("the time constant of the motors' current loops is left out")
    names = ("x", "y", "z")
    stated = ("payload", "link_mass", "rotor_inertia", "viscous_friction", "coulomb_friction", "joint_compliance")
    return Mechanism(
        Chain(joints, tuple(chain), tuple(bodies), np.array([robot[f"arm.tip_{axis}"] for axis in names])),
        tuple(drives), min(robot.machine.slot, robot.machine.frame / 4), frozenset(f"arm.{name}" for name in stated),
        payload=payload,
        borne=value("drive.tip_mass") * value(f"drive.feedforward.{joints[-1]}") / payload if payload else 0.0,
        tilt=(robot["arm.base_roll"], robot["arm.base_pitch"]), gravity=robot["arm.gravity"], notes=tuple(notes),
    )  # fmt: skip


STEP = 0.02  # rad or m, of a reference for the analysis: assumed
SWING, SPEED, BRISK = 1.0, 0.5, 2.0  # rad, rad/s, rad/s2 of a moderate motion: assumed
SHARE = 0.05  # of friction in the largest effort: assumed
BANDWIDTH = 2.0 * np.pi * 2.0  # rad/s of the nominal position loops: assumed
STOP = 2.0 * np.pi * 20.0  # rad/s of a link on its end stop, half of critically damped: assumed, stiff rubber
FAR = 1e6  # rad or m: no end stop
POSTURES = 20  # at which efforts are evaluated
TURNS = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s2", "effort": "N m", "inertia": "kg m2"}
SLIDES = {"position": "m", "velocity": "m/s", "acceleration": "m/s2", "effort": "N", "inertia": "kg"}


def units(chain: Chain) -> dict[str, str]:
    """Units of the signals, and of gains and damping; none ("-") where joints of both kinds share a signal."""
    kinds = set(chain.sliding)
    found = TURNS if kinds == {0.0} else SLIDES if kinds == {1.0} else dict.fromkeys(TURNS, "-")
    mixed = len(kinds) > 1
    force, per = found["effort"], found["position"]
    ratios = {"effort/speed": f"{force} s/{per}", "effort/position": f"{force}/{per}"}
    ratios["position/effort"] = f"{per}/({force})" if " " in force else f"{per}/{force}"
    return found | (dict.fromkeys(ratios, "-") if mixed else ratios)


def stated(chain: Chain, part: str) -> dict[str, float]:
    """Bodies, axes and gravity as the URDF states them, by full name of the parameters of a part [SI]."""
    names = ("x", "y", "z")
    found = {f"{part}.gravity": GRAVITY, f"{part}.tip_mass": 0.0, f"{part}.base_roll": 0.0, f"{part}.base_pitch": 0.0}
    found |= {f"{part}.tip_{name}": float(value) for name, value in zip(names, chain.tip, strict=True)}
    for channel, joint, body in zip(chain.names, chain.joints, chain.bodies, strict=True):
        values = {"mass": body.mass, "sliding": float(joint.kind == "prismatic")}
        for i, axis in enumerate(names):
            values |= {f"com_{axis}": body.centre[i], axis: joint.origin[i], f"axis_{axis}": joint.axis[i]}
            values |= {axis + names[k]: body.inertia[i, k] for k in range(i, 3)}
        values |= dict(zip(("roll", "pitch", "yaw"), joint.angles, strict=True))
        found |= {f"{part}.{name}.{channel}": float(value) for name, value in values.items()}
    return found


def arm_values(chain: Chain) -> dict[str, float]:
    """Parameters of the arm as the URDF states them, with its damping and dry friction, and rotors without inertia."""
    found = stated(chain, "arm")
    for channel, joint in zip(chain.names, chain.joints, strict=True):
        found |= {f"arm.damping.{channel}": joint.damping, f"arm.dry_friction.{channel}": joint.friction}
        found[f"arm.rotor_inertia.{channel}"] = 0.0
    return found


def compute_dynamics(
    chain: Chain, q: np.ndarray, rate: np.ndarray, acceleration: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Efforts (n,) and mass matrix (n, n) of the bare arm at a motion (n,) each [SI], by the equations themselves."""
    n = len(q)
    w = np.zeros((arm.WIDTH + n) * n)
    for j, (joint, body) in enumerate(zip(chain.joints, chain.bodies, strict=True)):
        arm.place(w, j, joint.origin, joint.angles, joint.axis, chain.sliding[j], q[j])
        arm.load(w, j, body.mass, body.centre, body.inertia[np.triu_indices(3)])
        arm.move(w, j, rate[j], acceleration[j], (0.0, 0.0, -GRAVITY))
    arm.gather(w, n, arm.WRENCH, arm.WIDTH - arm.WRENCH)
    efforts = np.array([arm.effort(w, j) for j in range(n)])
    arm.mass_matrix(w, n, arm.WIDTH * n)
    return efforts, w[arm.WIDTH * n :].reshape(n, n)


def middle(chain: Chain) -> np.ndarray:
    """Middle of each joint's range (n,); 0 of one without limits."""
    ends = [(j.lower, j.upper) if np.isfinite(j.upper - j.lower) else (0.0, 0.0) for j in chain.joints]
    return np.array([0.5 * (low + high) for low, high in ends])


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
    found = stated(chain, "drive") | {"drive.kp": 1.0, "drive.kd": 1.0, "drive.period": frame}
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
