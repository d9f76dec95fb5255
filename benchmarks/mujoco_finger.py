"""For the bench: MuJoCo's finger with the same tendons, under a tension controller in Python every 20 ms."""

from __future__ import annotations

from time import thread_time
from typing import Any

import numpy as np

from exodrake.compiled.inputs import Reference
from exodrake.core.robot import Robot


def site(name: str, x: float, y: float) -> str:
    """A router as MJCF."""
    return f'<site name="{name}" pos="{x:.9g} {y:.9g} 0"/>'


def phalanx(robot: Robot, i: int, before: float) -> str:
    """Phalanx i and all beyond it as MJCF; `before`: length of the phalanx before it [m]."""
    at = robot.machine.axes.joints
    if i == len(at):
        return ""
    value = {name: robot[f"{name}.{at[i]}"] for name in ("finger.length", "finger.mass", "finger.radius", "finger.q0")}
    half = 0.5 * value["finger.length"]
    following = ""
    if i + 1 < len(at):
        following = proximal(robot, i + 1, 2.0 * half)
    return (
        f'<body pos="{before:.9g} 0 0">'
        f'<joint name="q{i}" axis="0 0 1" stiffness="{robot[f"finger.kappa.{at[i]}"]:.9g}" '
        f'springref="{value["finger.q0"]:.9g}" damping="{robot[f"finger.B.{at[i]}"]:.9g}" limited="true" '
        f'range="{robot[f"finger.q_e.{at[i]}"]:.9g} {robot[f"finger.q_f.{at[i]}"]:.9g}"/>'
        f'<geom type="cylinder" fromto="0 0 0 {2 * half:.9g} 0 0" size="{value["finger.radius"]:.9g}" '
        f'mass="{value["finger.mass"]:.9g}" contype="0" conaffinity="0"/>'
        + site(f"fA{i}", robot[f"router.a_f.{at[i]}"], robot[f"router.n_f.{at[i]}"])
        + site(f"eA{i}", robot[f"router.a_e.{at[i]}"], -robot[f"router.n_e.{at[i]}"])
        + following
        + phalanx(robot, i + 1, 2.0 * half)
        + "</body>"
    )


def proximal(robot: Robot, i: int, joint_at: float) -> str:
    """The routers before joint i, on the phalanx before it."""
    name = robot.machine.axes.joints[i]
    return site(f"fB{i}", joint_at - robot[f"router.b_f.{name}"], robot[f"router.m_f.{name}"]) + site(
        f"eB{i}", joint_at - robot[f"router.b_e.{name}"], -robot[f"router.m_e.{name}"]
    )


def mjcf(robot: Robot) -> str:
    """The finger as MJCF: hinges, spatial tendons over the routers, elastic one-sided wires wound in at a speed."""
    paths = {"AF": ("f", range(3)), "MF": ("f", range(1)), "AE": ("e", range(3))}
    tendons = "".join(
        f'<spatial name="{name}">'
        + "".join(f'<site site="{side}B{i}"/><site site="{side}A{i}"/>' for i in joints)
        + "</spatial>"
        for name, (side, joints) in paths.items()
    )
    wires = "".join(
        f'<intvelocity tendon="{name}" kp="{robot[f"tendon.k.{name}"]:.9g}" actrange="-1 1" '
        'forcelimited="true" forcerange="-1000 0"/>'
        for name in paths
    )
    return (
        f'<mujoco><option timestep="{robot.machine.slot:.9g}" gravity="0 0 0"/><compiler angle="radian"/>'
        f"<worldbody>{proximal(robot, 0, 0.0)}{phalanx(robot, 0, 0.0)}</worldbody>"
        f"<tendon>{tendons}</tendon><actuator>{wires}</actuator></mujoco>"
    )


def mujoco_speed(robot: Robot, reference: Reference, seconds: float, pieces: int = 5) -> tuple[float, np.ndarray]:
    """Simulates the finger; its tendons wind in at the commanded speed, without motor, sensor and bus.

    Each frame the nominal tension law sets the speeds, and tension, stroke, command and angle go into a log.

    Returns:
        Simulated seconds per second on one core, the best of some pieces; and the log, a (frames, channels) array at
        frames' ends [N], [m], [m/s], [rad].
    """
    import mujoco  # pyright: ignore[reportMissingImports]  # of the group `bench`

    mj: Any = mujoco
    model = mj.MjModel.from_xml_string(mjcf(robot))
    data = mj.MjData(model)
    data.qpos[:] = robot.channels("finger.q0")
    mj.mj_forward(model, data)
    slack = data.ten_length.copy()
    data.act[:] = slack
    steps, period = robot.machine.slots, robot.machine.frame
    kp, kd, fastest = robot["controller.kp"], robot["controller.kd"], robot["controller.v_max"]
    frames = round(seconds / period)
    log, before, best = np.zeros((frames, 3 * model.nu + model.nq)), np.zeros(model.nu), np.inf
    for piece in np.array_split(np.arange(frames), pieces):
        start = thread_time()
        for frame in piece:
            tension = -data.actuator_force
            command = kp * (reference.values[frame] - tension) - kd * (tension - before) / period
            command = np.clip(command, -fastest, fastest)
            data.ctrl[:] = -command
            before = tension
            mj.mj_step(model, data, steps)
            log[frame] = np.concatenate([tension, slack - data.act, command, data.qpos])
        best = min(best, (thread_time() - start) / len(piece))
    return period / best, log
