"""What follows from a URDF file alone: units, parameters, efforts of moderate motions, gains."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from exodrake.machines.urdf import Chain
from exodrake.machines.urdf_elements import Joint
from exodrake.physics import rigid_arm

GRAVITY = 9.81  # m/s2, as Drake has it
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
    """Parameters of the arm as the URDF states them, by full name [SI]."""
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
        rigid_arm.move(w, j, rate[j], acceleration[j], (0.0, 0.0, -GRAVITY))
    rigid_arm.gather(w, n, rigid_arm.WRENCH, rigid_arm.WIDTH - rigid_arm.WRENCH)
    efforts = np.array([rigid_arm.effort(w, j) for j in range(n)])
    rigid_arm.mass_matrix(w, n, rigid_arm.WIDTH * n)
    return efforts, w[rigid_arm.WIDTH * n :].reshape(n, n)


def stops(joint: Joint, channel: str) -> dict[str, float]:
    """Positions of the end stops of a joint [rad]; far away for one without limits."""
    there = np.isfinite(joint.upper - joint.lower) and joint.upper > joint.lower
    return {f"arm.stop_low.{channel}": joint.lower if there else -FAR,
            f"arm.stop_high.{channel}": joint.upper if there else FAR}  # fmt: skip


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


def inertias(chain: Chain) -> np.ndarray:
    """Inertia that the drive of each joint moves (n,), the arm in the middle of its ranges [kg m2] or [kg]."""
    rest = np.zeros(len(chain.names))
    return np.diag(moved(chain, middle(chain), rest, rest)[1])


def drive_defaults(chain: Chain, efforts: np.ndarray, frame: float) -> dict[str, float]:
    """Gains of a moderate bandwidth, a controller that knows the arm, motors that reach its efforts and limits."""
    found = stated(chain, "drive") | {"drive.kp": 1.0, "drive.kd": 1.0, "drive.period": frame}
    for channel, joint, m, most in zip(chain.names, chain.joints, inertias(chain), efforts, strict=True):
        limit = joint.effort if 0.0 < joint.effort < np.inf else 10.0 * most
        found |= {
            f"drive.stiffness.{channel}": m * BANDWIDTH**2, f"drive.viscosity.{channel}": 2.0 * m * BANDWIDTH,
            f"drive.feedforward.{channel}": 1.0, f"arm.stop_stiffness.{channel}": m * STOP**2,
            f"arm.stop_damping.{channel}": m * STOP, **stops(joint, channel), f"arm.compliance.{channel}": 0.0,
            f"motor.torque_constant.{channel}": 1.0, f"motor.ratio.{channel}": 1.0,
            f"motor.current_max.{channel}": limit, f"motor.time_constant.{channel}": 0.0,
        }  # fmt: skip
    return {name: float(value) for name, value in found.items()}
