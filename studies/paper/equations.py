"""Eq. 3, 9, 13, 16, 21, 22 and the text's sign rules, tried with numbers."""

from dataclasses import replace

import numpy as np

from exodrake.data.plot import new_figure
from exodrake.engine.inputs import Reference
from exodrake.grasping.plan import at_hold
from exodrake.identification.kinematics.rigid import Axis, chain_poses
from exodrake.identification.statics import find_maximum_tension
from exodrake.machines.robot_file import load_robot
from exodrake.physics.finger_statics import posture, read_parameters
from exodrake.report.blocks import AFTER, BEFORE, RULE, SOFT, Drawing, Table, house_style, render_svg
from exodrake.simulation.protocols import grasp, maximum_tension
from exodrake.simulation.simulate import simulate
from studies.paper.claim import AGREES, DOES_NOT, UNKNOWN, Chapter, Claim
from studies.paper.printed_equations import g_inverse, g_matrix, joint_angles, tension_map_as_printed
from studies.paper.stiffness import compliance, router_arms, tension_map

DEGREES = (5, 10, 30, 60, 89)  # angles at which Eq. 9 is tried
CENTRE = np.array([0.035, 0.005, 0.0])  # m, a joint centre in the proximal frame
SLIDE = 0.004  # m/rad along the axis
PIP_ONLY = 0.7  # rad the PIP alone is bent by
LIKELY = 1e-9  # agreement to rounding
STILL = 0.05  # rad, joints that bend less count as at rest
RAMP_TO = 30.0  # N
STIFFNESS, LAG, FRAME = 3000.0, 0.02, 0.02  # N/m, s, s; lag assumed
KP, KD = 5e-3, 1e-4  # m/(s N), m/N; assumed, none is printed
FRAMES = 60
REST, SETTLE = (4.0, 3.0, 1.0), 300  # N on AF, MF, AE before the step, as in `closed_loop.md`; frames
DRAWS, ARMS = 3000, (1e-3, 6e-3)  # random sets of moment arms, m


def chapter(robot) -> Chapter:
    """Equations that are wrong as printed."""
    rows = [
        (f"{degrees}°", f"{residue(degrees, False):.0e}", f"{residue(degrees, True):.2f}",
         f"{1e3 * centre_error(degrees):.0f} mm")
        for degrees in DEGREES
    ]  # fmt: skip
    header = ("angle", "corrected", "as printed", "joint centre off by")
    table = ("Eq. 9: ‖G G⁻¹ − I‖", Table(header, rows, wide=False))
    caption = (
        "Simulated: wire of 3 N/mm, drive lag 20 ms, one 20 ms frame late, kp 5 mm/(s N), kd 0.1 mm/N (all assumed)."
    )
    drawing = ("Eq. 3: a step of 1 N", Drawing(draw_steps(), caption))
    lead = (
        "Each equation was coded twice, as printed and corrected, and tried against an identity it must satisfy. Most"
        " of what fails is a slip of one symbol; the authors' own code evidently used the right forms, or Table 1 could"
        " not look as it does."
    )
    claims = (
        *control(robot), *screws(), *statics(read_parameters(robot), robot.limits["F_max"]), *grasps(robot),
        maximum_tensions(robot),
    )  # fmt: skip
    return Chapter("equations", "Equations: 3, 9, 13, 16, 21, 22", lead, drawing, claims, beside=table)


def control(robot) -> tuple[Claim, ...]:
    """Eq. 3 on a simple loop and on the whole robot."""
    printed, ours = (100.0 * overshoot(sign) for sign in (1.0, -1.0))
    with_printed_sign = robot.with_parameters({"controller.kd": -robot["controller.kd"]})  # as `controller_as_printed`
    whole = [100.0 * robot_overshoot(one) for one in (with_printed_sign, robot)]
    why = (
        "Neither gains nor drive are printed, and with a negative kd the printed form is right. On a simple loop with"
        f" lag (all numbers assumed) the printed sign takes damping away, {printed:.0f} % overshoot against"
        f" {ours:.0f} %; with neither lag nor delay it is harmless, and on the whole simulated robot at its assumed"
        " gains it makes no visible difference."
    )
    return (
        Claim("Eq. 3", "+ kd dF/dt in the tension law", "sign +, no gains",
              f"robot: overshoot {whole[0]:.0f} % printed, {whole[1]:.0f} % with −", UNKNOWN, why),
    )  # fmt: skip


def step(sign: float) -> tuple[np.ndarray, np.ndarray]:
    """Time (frames,) [s] and tension (frames,) [N] after a step of the reference to 1 N.

    The simplest loop that shows the sign in Eq. 3: tension F = k x, a drive with a lag, commands one frame late.

        v_ref = kp (F_ref - F) + sign kd F'        tau v' = v_ref - v        F' = k v

    Printed sign +1, corrected -1 (`physics.md` 1.3).
    """
    decay = np.exp(-FRAME / LAG)
    tension = np.zeros(FRAMES)
    place = speed = waiting = 0.0
    for frame in range(FRAMES):
        tension[frame] = STIFFNESS * place
        rate = (tension[frame] - tension[frame - 1]) / FRAME if frame else 0.0
        command, waiting = waiting, KP * (1.0 - tension[frame]) + sign * KD * rate
        place += command * FRAME + (speed - command) * LAG * (1.0 - decay)
        speed = command + (speed - command) * decay
    return FRAME * np.arange(FRAMES), tension


def overshoot(sign: float) -> float:
    """Overshoot as a share of the step."""
    return max(float(step(sign)[1].max()) - 1.0, 0.0)


def robot_overshoot(robot) -> float:
    """Largest overshoot of a tension after a step of its reference by 1 N, a share of it; simulated without noise."""
    found = []
    for wire, name in enumerate(robot.machine.axes.tendons):
        rows = np.tile(REST, (2 * SETTLE, 1))
        rows[SETTLE:, wire] += 1.0
        tension = simulate(robot, Reference(rows, "step"), seed=None)[f"tension_{name}"]
        found.append(tension[SETTLE:].max() - rows[-1, wire])
    return max(0.0, float(max(found)))


def draw_steps() -> str:
    """Both signs' steps as SVG."""
    with house_style():
        drawn = new_figure(4.6, 2.5)
        axes = drawn.subplots()
        for sign, colour, label in ((1.0, BEFORE, "+ kd dF/dt, as printed"), (-1.0, AFTER, "− kd dF/dt, corrected")):
            axes.plot(*step(sign), color=colour, lw=1.5, label=label)
        axes.axhline(1.0, color=SOFT, lw=0.6, ls=(0, (4, 2)))
        axes.set_xlabel("time [s]")
        axes.set_ylabel("tension [N]")
        axes.grid(color=RULE, lw=0.5)
        axes.legend(loc="lower right")
        return render_svg(drawn, "sign", "tension after a step with either sign of the derivative")


def residue(degrees: float, printed: bool) -> float:
    """‖G G⁻¹ − I‖ (Frobenius) about z at an angle [deg]."""
    axis, angle = np.array([0.0, 0.0, 1.0]), float(np.deg2rad(degrees))
    return float(np.linalg.norm(g_matrix(axis, angle) @ g_inverse(axis, angle, printed) - np.eye(3)))


def centre_error(degrees: float) -> float:
    """Error [m] of a joint centre by Eq. 9 as printed after a turn [deg] about z."""
    axis, angle = np.array([0.0, 0.0, -1.0]), float(np.deg2rad(degrees))
    shift = g_matrix(axis, angle) @ -np.cross(axis, CENTRE)
    return float(np.linalg.norm(np.cross(axis, g_inverse(axis, angle, printed=True) @ shift) - CENTRE))


def screws() -> tuple[Claim, ...]:
    """Eq. 9, 13, 16."""
    length, still = float(np.linalg.norm(CENTRE)), np.zeros(3)
    axes = (Axis(np.array([0.0, 1, 0]), still, still), Axis(np.array([0.0, 0, -1]), CENTRE, still))
    wanted = np.random.default_rng(0).uniform((-0.25, -0.3), (0.25, 1.3), (50, 2))
    left = float(np.abs(joint_angles(axes, chain_poses(axes, wanted)[-1]) - wanted).max())
    slid = float(np.hypot(length, SLIDE))
    return (
        Claim(
            "Eq. 9", "inverse of G", "1/θ − (1/θ) cot(θ/2)", "1/θ − ½ cot(θ/2)", DOES_NOT,
            f"At 30° ‖G G⁻¹ − I‖ is {residue(30, True):.2f} as printed, {residue(30, False):.0e} corrected; a joint"
            f" centre would come out {1e3 * centre_error(30):.0f} mm off.",
        ),
        Claim(
            "Eq. 13", "‖Q‖ = ‖v‖/‖w‖", "v normal to w", f"{1e3 * length:.2f} mm, exact", AGREES,
            f"Under its stated assumption, a pure rotation. A joint that slides along its axis by {1e3 * SLIDE:.0f}"
            f" mm/rad would read {1e3 * slid:.2f} mm; Q = w × v needs no such assumption.",
        ),
        Claim(
            "Eq. 16", "Newton step −A = J Δθ", "converges", f"error {left:.0e} rad",
            AGREES if left < LIKELY else DOES_NOT,
            "Two-axis synthetic MCP. The sign is right; with + it diverges.",
        ),
    )  # fmt: skip


def statics(parameters, limits) -> tuple[Claim, ...]:
    """Eq. 21, 22 and the sign rules of the text. limits: largest tension per wire [N]."""
    kappa, bent = np.array(parameters.kappa), np.array([0.0, PIP_ONLY, 0.0])
    arms = router_arms(bent, parameters)
    inverse = compliance(arms, kappa)
    moved = posture(np.array([[0.0, 4.0, 0.0]]), parameters)[0] - np.array(parameters.q0) + 0.0
    off = [
        float(np.linalg.norm(inverse @ made(arms, kappa) - np.eye(3))) for made in (tension_map_as_printed, tension_map)
    ]
    return (
        Claim(
            "Eq. 21", "R21 and R31 divided by κ1", "R21/κ1, R31/κ1", "R21/κ2, R31/κ3", DOES_NOT,
            "Row i is a torque balance of joint i. With the nominal (assumed) stiffnesses the printed PIP and DIP"
            f" angles under the All Flexor are {kappa[1] / kappa[0]:.2f} and {kappa[2] / kappa[0]:.2f} times what they"
            " should be.",
        ),
        Claim(
            "Eq. 22", "entry (2,1) of the inverse", f"κ1, ‖J J⁻¹ − I‖ {off[0]:.2f}", f"κ1/R12, {off[1]:.0e}", DOES_NOT,
            "The printed entry has another unit than its neighbours.",
        ),
        dip_alone(kappa),
        pip_alone(tension_map(arms, kappa) @ bent, parameters, limits),
        Claim(
            "2.2.2", "M.F. alone bends the MCP alone (narrow pinch)", "MCP only", f"{words(moved.round(9))} rad at 4 N",
            AGREES if abs(moved[1]) < LIKELY and abs(moved[2]) < LIKELY < moved[0] else DOES_NOT,
            "In the model: a real wire and garment pull on their neighbours too.",
        ),
    )  # fmt: skip


def dip_alone(kappa: np.ndarray) -> Claim:
    """The text's second condition for a bent DIP alone, on random routers."""
    rng = np.random.default_rng(0)
    able = negative = 0
    for _ in range(DRAWS):
        arms = rng.uniform(*ARMS, (3, 3))
        if np.all(tension_map(arms, kappa)[:, 2] >= 0.0):
            able += 1
            negative += int(arms[0, 2] * arms[1, 0] < arms[0, 0] * arms[1, 2])
    return Claim(
        "2.2.2", "DIP alone needs R13 R21 − R11 R23 negative", "< 0", f"> 0 in {able - negative} of {able}",
        AGREES if negative == able else DOES_NOT,
        f"The sign is reversed: of {DRAWS} random sets of arms, {able} can bend the DIP alone with T ≥ 0. And"
        " “R21R33 − R21R31” should read R21R33 − R23R31, twice.",
    )  # fmt: skip


def pip_alone(tension: np.ndarray, parameters, limits) -> Claim:
    """Wide pinch: the tensions that bend the PIP alone, from a rest posture of zero as in the paper, and from ours."""
    bent, rest = np.array([0.0, PIP_ONLY, 0.0]), np.array(parameters.q0)
    ours = (tension_map(router_arms(rest + bent, parameters), np.array(parameters.kappa)) @ bent)[1]
    why = (
        f"{PIP_ONLY} rad at the PIP, corrected Eq. 22, assumed stiffness. With nothing to spare: MCP and DIP have the"
        " same routers, so MF is zero at equal angles; from our rest posture, MCP bent more than DIP, it would be"
        f" {ours:+.1f} N."
    ).replace("-", "−")
    beyond = [wire for wire, value in zip(limits, tension) if value > limits[wire]]
    words = "AF {:.1f}, MF {:.1f}, AE {:.1f} N".format(*(tension.round(9) + 0.0))
    if beyond:
        most = " and ".join(f"{wire} {limits[wire]:g} N" for wire in beyond)
        why += f" The signs allow it, but the tensions exceed the assumed limits ({most}), and no stiffness is printed."
    good = DOES_NOT if np.any(tension < -LIKELY) else UNKNOWN if beyond else AGREES
    return Claim("2.2.2", "PIP alone is possible with these routers", "possible", words, good, why)


def grasps(robot) -> tuple[Claim, ...]:
    """Wide pinch and caging, simulated from rest: by the nominal robot, and by the one with a stiffer DIP."""
    other = load_robot("exo_index/wide_pinch")
    slight, full, curled = bend(robot, "wide-pinch"), bend(other, "wide-pinch"), bend(robot, "caging")
    # AE over AF that balances the DIP at rest, and the AF [N] at which it has no stiffness left
    n, moved = read_parameters(robot), np.array([0.0, 0.0, 1e-6])
    here, up, down = (router_arms(np.array(n.q0) + sign * moved, n)[2] for sign in (0, 1, -1))
    slope, rise = here[0] / here[2], (up - down) / (2.0 * moved[2])
    limit = n.kappa[2] / (rise[0] - slope * rise[2])
    kappa = other.channels("finger.kappa")
    pulls = [", ".join(f"{w} {one.grasps['wide-pinch'][w]:g}" for w in ("AF", "AE")) for one in (robot, other)]
    why = (
        f"At {pulls[0]} N the nominal robot does so, slightly. The resting DIP is balanced at AE = {slope:.2f} AF, and"
        f" has no stiffness left at AF = {limit:.1f} N: beyond, no order of the wires keeps it. With stiffnesses"
        f" of {kappa[1]:g} N m/rad at the PIP and {kappa[2]:g} at the DIP (robot `exo_index/wide_pinch`) {pulls[1]} N"
        f" give {words(full)} rad, and the other two grasps stay as they are. No stiffness is printed."
    )
    still = max(abs(one[i]) for one in (slight, full) for i in (0, 2))
    return (
        Claim(
            "2.2.2", "A.F. and A.E. together bend the PIP alone (wide pinch)", "PIP only", f"{words(slight)} rad",
            UNKNOWN if still < STILL < min(slight[1], full[1]) else DOES_NOT, why,
        ),
        Claim(
            "2.2.2", "A.F. alone bends all joints (caging)", "all joints", f"{words(curled)} rad at 7 N",
            AGREES if curled.min() > 0.3 else DOES_NOT, "How far each one bends follows from the assumed stiffnesses.",
        ),
    )  # fmt: skip


def bend(robot, mode: str) -> np.ndarray:
    """Angles (3,) less the rest posture [rad] near the end of the hold of a grasp, without noise."""
    log = simulate(robot, grasp(mode, robot), seed=None, quantisation=False)
    return at_hold(log, "angle", robot.machine.axes.joints) - robot.channels("finger.q0")


def words(angles: np.ndarray) -> str:
    """Angles (3,) [rad] by joint."""
    return "MCP {:+.2f}, PIP {:+.2f}, DIP {:+.2f}".format(*angles)


def maximum_tensions(robot) -> Claim:
    """The tensions that maximise the movement, measured first in section 2.3: ramps far beyond F_max, and to F_max."""
    limits = robot.limits["F_max"]
    wide = replace(robot, limits={**robot.limits, "F_max": dict.fromkeys(limits, RAMP_TO)})
    found = find_maximum_tension(simulate(wide, maximum_tension(wide), seed=0), wide)
    ours = ", ".join(f"{one.tendon} {'' if one.saturated else '> '}{one.tension:.0f}" for one in found)
    assumed = ", ".join(f"{wire} {value:g}" for wire, value in limits.items())
    return Claim(
        "2.3", "the tension that maximises the movement is measured first", "not stated", f"{ours} N", UNKNOWN,
        "By the protocol `maximum-tension`: from there on the joints gain less than a fifth of their largest movement"
        f" per newton. The nominal levels F_max ({assumed} N) are assumed, and lower.",
    )  # fmt: skip
