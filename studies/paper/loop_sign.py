"""The sign in Eq. 3 on the simplest loop that shows it: tension F = k x, a drive with a lag, frames, one frame late.

    v_ref = kp (F_ref - F) + sign kd F'        tau v' = v_ref - v        F' = k v

Printed sign +1, corrected -1 (`physics.md` 1.3). On the whole robot (`closed_loop.md`) the sign makes no such
difference, and the paper prints no gains: which of the two its robot is like cannot be checked.
"""

import numpy as np

STIFFNESS, LAG, FRAME = 3000.0, 0.02, 0.02  # N/m, s, s; lag assumed
KP, KD = 5e-3, 1e-4  # m/(s N), m/N; assumed, none is printed
FRAMES = 60
REST, SETTLE = (4.0, 3.0, 1.0), 300  # N on AF, MF, AE before the step, as in `closed_loop.md`; frames


def step(sign: float, kp: float = KP, kd: float = KD) -> tuple[np.ndarray, np.ndarray]:
    """Time (frames,) [s] and tension (frames,) [N] after a step of the reference to 1 N."""
    decay = np.exp(-FRAME / LAG)
    tension = np.zeros(FRAMES)
    place = speed = waiting = 0.0
    for frame in range(FRAMES):
        tension[frame] = STIFFNESS * place
        rate = (tension[frame] - tension[frame - 1]) / FRAME if frame else 0.0
        command, waiting = waiting, kp * (1.0 - tension[frame]) + sign * kd * rate
        place += command * FRAME + (speed - command) * LAG * (1.0 - decay)
        speed = command + (speed - command) * decay
    return FRAME * np.arange(FRAMES), tension


def overshoot(sign: float) -> float:
    """Overshoot as a share of the step."""
    return max(float(step(sign)[1].max()) - 1.0, 0.0)


def robot_overshoot(robot) -> float:
    """Largest overshoot of a tension after a step of its reference by 1 N, a share of it; simulated without noise."""
    from exodrake.engine.inputs import Reference
    from exodrake.simulation.simulate import simulate

    found = []
    for wire, name in enumerate(robot.machine.axes.tendons):
        rows = np.tile(REST, (2 * SETTLE, 1))
        rows[SETTLE:, wire] += 1.0
        tension = simulate(robot, Reference(rows, "step"), seed=None)[f"tension_{name}"]
        found.append(tension[SETTLE:].max() - rows[-1, wire])
    return max(0.0, float(max(found)))


def figure() -> str:
    """Both signs' steps as SVG."""
    from exodrake.data.plot import new_figure
    from exodrake.report.blocks import AFTER, BEFORE, RULE, SOFT, house_style, render_svg

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
