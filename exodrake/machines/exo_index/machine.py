"""The Exo-Index robot: signals, parts in order, log columns, segments, control loop and drawing.

The slots of its tasks: `physics.md`, Timing.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

from exodrake.core.errors import InputError
from exodrake.effects import collect_effects
from exodrake.model.machine import (
    Column,
    CommandLink,
    Controller,
    Gain,
    Imposed,
    Loop,
    Machine,
    Observer,
    Regime,
    Segment,
)  # fmt: skip
from exodrake.model.mechanism import Body, Chain, Drive, Joint, Mechanism, Piece, Skeleton, Tendon
from exodrake.model.part import JOINTS, NORMAL, SCALAR, TENDONS, UNIFORM, Axes, Delay, Signal
from exodrake.model.robot import Robot
from exodrake.physics import bus, controller, encoder, mocap, motor, sensor, tendon_finger, wire_paths

# A tendon is stiff: a micrometre turns into millinewtons. So a measured tension acts on the finger as a force, through
# tendons so soft that a stroke is one, and a measured angle as a hold.
SOFT = 1e-3  # N/m
READ = 0.005  # s after the start of a frame: middle of the three bus reads
STILL = 2e-4  # m/s: slower tendons count as at rest; a few encoder counts a second
SLACK = 0.15  # N: a tendon below half the anti-slack tension of 0.3 N counts as slack
SEGMENTS = (
    Segment("controller", "speed_cmd", ("tension",), exact=True),
    Segment("motor", "stroke", ("tension",), (Imposed("stroke"), Imposed("wire_speed", rate=True)), sampled=READ,
            contents="bus, drive, encoder"),
    Segment("tendon", "tension", ("stroke", "angle"),
            (Imposed("tension", low=0.0), Imposed("tension_spool", low=0.0),
             Imposed("stroke", gain=1.0 / SOFT, low=0.0, part="finger"),
             Imposed("wire_speed", rate=True, gain=1.0 / SOFT, part="finger")),
            parameters={"tendon.k": SOFT}, sampled=READ, contents="cable, load cell"),
    Segment("finger", "angle", ("tension",), (Imposed("angle"),), hold=("finger", "hold"), sampled=READ,
            contents="sheath, joints, motion capture"),
)  # fmt: skip
REGIME = Regime("stroke", "tension", "angle", STILL, SLACK)
COMMAND_LINK = CommandLink("speed_cmd", "stroke", "speed_applied", "motor", "stroke")


PALMAR, DORSAL = -1.0, 1.0
# tendon -> (suffix of its router parameters, side, lateral position [m], joints that it passes; None: all)
ROUTES = {"AF": ("f", PALMAR, 0.0016, None), "MF": ("f", PALMAR, -0.0016, 1), "AE": ("e", DORSAL, 0.0, None)}
HAND_END = -0.055  # [m] where the tendons leave the hand


def route(robot: Robot, tendon: str) -> list[tuple[int, np.ndarray]]:
    """Routers of a tendon from the hand to its end: (segment, point (3,) [m]) each."""
    suffix, side, lateral, count = ROUTES[tendon]
    a, b, m, n = (robot.channels(f"router.{letter}_{suffix}") for letter in "abmn")
    lengths = np.concatenate([[0.0], robot.channels("finger.length")])
    points = []
    for i in range(count or len(a)):
        points.append((i, np.array([lengths[i] - b[i], lateral, side * m[i]])))
        points.append((i + 1, np.array([a[i], lateral, side * n[i]])))
    return points


def skeleton(robot: Robot) -> Skeleton:
    """Bones, routers and tendons of a robot. InputError for a phalanx without size."""
    for name in ("finger.length", "finger.radius"):
        if not (np.isfinite(robot.channels(name)) & (robot.channels(name) > 0)).all():
            raise InputError(f"{robot.source}: a {name} is not above 0, so there is no finger to draw")
    pieces, routers = [], []
    for tendon in robot.machine.axes.tendons:
        points = route(robot, tendon)
        routers += points
        parameter = np.array([HAND_END, *points[0][1][1:]])
        for (first, start), (last, end) in zip([(0, parameter), *points], points, strict=False):
            pieces.append(Piece(tendon, first, start, last, end))
    lengths, radii = robot.channels("finger.length"), robot.channels("finger.radius")
    joints = robot.machine.axes.joints
    return Skeleton(joints, lengths, radii, HAND_END, tuple(pieces), tuple(routers), "angle", "tension")


def mechanism(robot: Robot) -> Mechanism:
    """The finger under its elastic tendons, which ideal motors wind in at the commanded speed."""
    joints, tendons = robot.machine.axes.joints, robot.machine.axes.tendons
    along, about = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    lengths, radii, masses = (robot.channels(f"finger.{name}") for name in ("length", "radius", "mass"))
    ends = dict(zip(("lower", "upper"), (robot.channels("finger.q_e"), robot.channels("finger.q_f")), strict=True))
    chain, bodies, drives = [], [], []
    for i, (j, length, radius, mass) in enumerate(zip(joints, lengths, radii, masses, strict=True)):
        across = mass * (radius**2 / 4.0 + length**2 / 12.0)  # of a solid cylinder
        bodies.append(Body(mass, 0.5 * length * along, np.diag([0.5 * mass * radius**2, across, across])))
        origin = lengths[i - 1] * along if i else np.zeros(3)
        limits = {name: float(end[i]) for name, end in ends.items()}
        chain.append(Joint(j, "revolute", "", j, origin, np.zeros(3), about, **limits, damping=robot[f"finger.B.{j}"]))
        spring = robot[f"finger.kappa.{j}"] * robot[f"finger.stiffness.factor.{j}"]
        drives.append(Drive(spring=spring, rest=robot[f"finger.q0.{j}"]))
    winding = []
    for j in tendons:
        current = min(robot[f"motor.i_max.{j}"], robot[f"motor.current_limit.limit.{j}"])
        winding.append(Tendon(
            j, tuple(route(robot, j)), robot[f"tendon.k.{j}"], robot[f"tendon.viscous_friction.coefficient.{j}"],
            robot[f"tendon.coulomb_friction.force.{j}"],
            current * robot[f"motor.kM.{j}"] * robot["motor.N"] / robot[f"motor.r.{j}"],
            robot["timing.command_latency.frames"] * robot.machine.frame,
        ))  # fmt: skip
    stated = ("finger.stiffness", "tendon.viscous_friction", "tendon.coulomb_friction", "motor.current_limit")
    return Mechanism(
        Chain(joints, tuple(chain), tuple(bodies), lengths[-1] * along), tuple(drives), robot.machine.slot,
        frozenset((*stated, "timing.command_latency")), tuple(winding), radii=radii,
        notes=(
            "a motor winds its tendon in at the commanded speed at once: rotor, speed loop and sensors are left out",
            "the end stops are hard at q_e and q_f, where those of the robot grow exponentially",
            "the tension law is the user's: once a frame, speed = kp (reference - tension) - kd d(tension)/dt",
        ),
    )  # fmt: skip


KP, KD = Gain("controller.kp", 1e-3, 0.03), Gain("controller.kd", 1e-6, 5e-4)  # m/(s N), m/N: range of the robot file
KI = Gain("controller.ki", 3e-4, 0.3)  # m/(s2 N)
TAU_D, TAU_R = Gain("controller.tau_D", 2e-3, 0.2), Gain("controller.tau_R", 0.01, 1.0)  # s
FEED = Gain("controller.feed", 0.1, 1.5)
PLAIN = {f"controller.{name}": 0.0 for name in ("kd", "ki", "tau_D", "tau_R", "feed")}
COMPLIANCE = tuple(f"controller.compliance_{k}" for k in (1, 2, 3))

LOOP = Loop(
    reference="tension_ref", command="speed_cmd", output="tension", measured="tension_read", part="controller",
    held="command", actuated="stroke_read", latency="timing.command_latency.frames", resolution="sensor.q_F",
    gains=(Gain("controller.kp", 0.0, 0.03), Gain("controller.kd", -5e-4, 5e-4)),  # kd < 0: the sign as printed
    gentle={**PLAIN, "controller.kp": 3e-3, "controller.ki": 1e-3},  # ki empties the integral
    step=1.0,
    points={
        "middle": {"AF": 4.0, "MF": 3.0, "AE": 1.0},
        "small": {"AF": 0.3, "MF": 0.3, "AE": 0.3},  # F_min
        "full": {"AF": 12.0, "MF": 8.0, "AE": 8.0},  # F_max
    },
    controllers=(
        Controller("PD", (KP, KD), PLAIN),
        Controller("PD, filtered", (KP, KD, TAU_D), PLAIN),
        Controller("PI, reference filter", (KP, KI, TAU_R), PLAIN),
        Controller("PID, both filters", (KP, KI, KD, TAU_D, TAU_R), PLAIN),
        Controller("P, feed-forward", (KP, TAU_R, FEED), PLAIN, COMPLIANCE),
        Controller("PI, feed-forward", (KP, KI, TAU_R, FEED), PLAIN, COMPLIANCE),
    ),
    nonlinear={"motor.dead_zone": {}, "tendon.coulomb_friction": {}},
)  # fmt: skip

SIGNALS = (
    Signal("tension_ref", "N", TENDONS), Signal("noise_tension", "-", TENDONS, NORMAL),
    Signal("noise_angle", "-", JOINTS, NORMAL), Signal("packet_arrival", "-", TENDONS, UNIFORM),
    Signal("speed_cmd", "m/s", TENDONS), Signal("speed_applied", "m/s", TENDONS), Signal("stroke", "m", TENDONS),
    Signal("wire_speed", "m/s", TENDONS), Signal("spool_angle", "rad", TENDONS), Signal("tension", "N", TENDONS),
    Signal("tension_spool", "N", TENDONS), Signal("tension_finger", "N", TENDONS), Signal("angle", "rad", JOINTS),
    Signal("rate", "rad/s", JOINTS), Signal("cell", "N", TENDONS), Signal("tension_read", "N", TENDONS),
    Signal("stroke_read", "m", TENDONS), Signal("angle_read", "rad", JOINTS), Signal("mocap_delay", "s", SCALAR),
)  # fmt: skip
PARTS = (tendon_finger.PART, motor.PART, sensor.PART, encoder.PART, mocap.PART, controller.PART, bus.PART)

LATE = Delay("mocap_delay", "noise_angle", ("mocap.sigma_q",))
COLUMNS = (
    Column("tension_ref", "tension_ref"),
    Column("tension", "tension_read", required=False),
    Column("stroke", "stroke_read"),
    Column("speed_cmd", "speed_cmd", required=False, label="Speed command"),
    Column("angle", "angle_read", required=False, label="Joint angle", delay=LATE),
)


def noise_std(parameter: Callable[[str], float]) -> dict[str, float]:
    """Noise standard deviation of each kind [N, m, m/s, rad], from the sensors' parameters."""
    tension = np.sqrt(parameter("sensor.sigma_F") ** 2 + TWELFTH * parameter("sensor.q_F") ** 2)
    period, kd = parameter("controller.period"), parameter("controller.kd")
    share = period / (period + parameter("controller.tau_D"))  # of the filtered derivative that is new in a frame
    now, later = parameter("controller.kp") + kd * share / period, kd * share**2 / period
    damped = np.hypot(now, later / np.sqrt(1.0 - (1.0 - share) ** 2))  # the command's own sum of squares, ki aside
    step = parameter("encoder.q_theta") * parameter("encoder.radius")
    noise = {"tension": tension, "stroke": np.sqrt(TWELFTH) * step, "speed_cmd": tension * damped}
    return {kind: float(std) for kind, std in noise.items()} | {"angle": parameter("mocap.sigma_q")}


COLOURS = {
    **{"AF": "#0072b2", "MF": "#009e73", "AE": "#d55e00"},  # Okabe and Ito: distinct to all eyes
    **{"MCP": "#332288", "PIP": "#aa4499", "DIP": "#999933"},  # Tol's muted scheme
}
TWELFTH = 1.0 / 12.0  # variance of a rounding error in units of its step squared


@cache
def machine() -> Machine:
    """The nominal machine with every effect of the library at its null value."""
    return Machine(
        name="exo_index", axes=Axes(("AF", "MF", "AE"), ("MCP", "PIP", "DIP")), signals=SIGNALS, parts=PARTS,
        inputs=("tension_ref", "noise_tension", "noise_angle", "packet_arrival"), columns=COLUMNS,
        effects=collect_effects(PARTS), noise=("sensor.sigma_F", "mocap.sigma_q"),
        resolution=("sensor.q_F", "encoder.q_theta"), compared=("tension", "stroke", "speed_cmd", "angle"),
        noise_std=noise_std, segments=SEGMENTS, regime=REGIME, command_link=COMMAND_LINK,
        observer=Observer("speed_cmd", "stroke", ("motor", "theta"), "motor.r", gain=0.2),
        variants_available={
            "controller_as_printed": ("controller.damping", controller.damping_as_printed),
            "finger_at_rest": ("tendon_finger.rests_before", tendon_finger.rests_at_switch_on),
            "routers_as_printed": ("wire_paths.applied_arm", wire_paths.applied_arm_as_printed),
        },
        reference_limits=("F_min", "F_max"),
        experiments={"steps": "steps", "multisine": "multisine", "chirp": "chirp", "holds": "holds",
                     "random motion": "random-motion:seed=0"},
        colours=COLOURS, skeleton=skeleton, mechanism=mechanism, loop=LOOP,
    )  # fmt: skip
