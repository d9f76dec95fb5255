"""Sensor resolution, encoder resolution and the schedule of a frame (section 2.1.2, Fig. 5)."""

from dataclasses import dataclass

import numpy as np

from exodrake.data.plot import new_figure
from exodrake.engine.inputs import Reference
from exodrake.report.blocks import AFTER, BEFORE, RULE, Drawing, Table, house_style, render_svg
from exodrake.simulation.simulate import simulate
from exodrake.systems.gp_estimator import LISTENS
from studies.paper.claim import AGREES, DOES_NOT, Chapter, Claim

CELL, CELL_NONLINEARITY = 0.002, 0.1  # N, load cell as printed
UNIT, UNIT_NONLINEARITY = 0.004, 0.2  # N, tension unit as printed
LINES, GEAR, QUADRATURE = 16, 69, 4
RISE, SECONDS = 0.5, 5.0  # N and s of the slow ramp that shows the steps
WINDOW = (2.0, 2.8)  # s of it in which steps of tension are drawn
BASE = 2.0  # N


@dataclass(frozen=True, eq=False)
class Staircase:
    """Readings during a slow ramp without noise: tension (n,) [N] and spool angle (n,) [rad], time (n,) [s]."""

    time: np.ndarray
    tension: np.ndarray
    angle: np.ndarray


def staircase(robot, resolution: float, encoder: float) -> Staircase:
    """A slow ramp of all wires, read with a tension resolution [N] and an encoder resolution [rad]."""
    changed = robot.with_parameters({"sensor.q_F": resolution, "encoder.q_theta": encoder})
    rest, frames = round(1.0 / robot.machine.frame), round(SECONDS / robot.machine.frame)
    ramp = BASE + np.concatenate([np.zeros(2 * rest), np.linspace(0.0, RISE, frames)])
    log = simulate(changed, Reference(np.tile(ramp[:, None], (1, 3)), "ramp"), seed=None)
    shown = slice(2 * rest, None)
    time = log.time[shown] - log.time[2 * rest]
    return Staircase(time, log["tension_AF"][shown], log["stroke_AF"][shown] / robot["encoder.radius"])


def chapter(robot, rate: float) -> Chapter:
    """Resolution and timing. robot: nominal; rate: fastest joint rate in the protocol [rad/s]."""
    line = 2 * np.pi / (LINES * GEAR)
    coarse, fine = staircase(robot, UNIT, line), staircase(robot, CELL / 2, line / QUADRATURE)
    caption = (
        f"Simulated, without noise: all wires rise by {RISE} N in {SECONDS:.0f} s. Left: the load cell reads twice the"
        " tension, so the unit resolves half, not double, what the cell does. Right: spool angle from 16 lines, and"
        " with four edges counted per line."
    )
    lead = (
        "The load cell sits where the wire turns back on itself and feels F = 2T. One step of the cell is therefore"
        " half a step of tension; the paper doubles where it should halve. exodrake keeps the printed 0.004 N as its"
        " default resolution, which is the cautious choice, and takes `sensor.q_F=0.001` for the corrected one."
    )
    slots = Table(("slot", "runs at [ms]", "task"), schedule(robot.machine), words=3, wide=False)
    body = (Drawing(figure(coarse, fine), caption), "A frame of 20 ms (Fig. 5)", slots)
    claims = (*sensor_claims(coarse, fine), *timing_claims(robot.machine, rate))
    return Chapter("hardware", "Sensors and timing: Fig. 1c, 5", lead, body, claims)


def schedule(machine) -> list[tuple[str, str, str]]:
    """Slot, time in the frame [ms], tasks."""
    tendons, rows = machine.axes.tendons, []
    for slot in range(machine.slots):
        tasks = []
        for block in machine.parts:
            for task in block.tasks:
                if slot in task.slots:
                    channel = f" {tendons[task.slots.index(slot)]}" if task.per_channel else ""
                    tasks.append(f"{block.name}: {task.function}{channel}")
        at = 1e3 * machine.slot * (slot + 0.5)
        idle = "joint-angle estimator, if one is fitted" if slot == LISTENS else "idle"
        rows.append((str(slot), f"{at:.0f}", "; ".join(tasks) or idle))
    return rows


def sensor_claims(coarse: Staircase, fine: Staircase) -> tuple[Claim, ...]:
    """Resolutions, printed and ours."""
    line = 2 * np.pi / (LINES * GEAR)
    readings = (fine.tension, coarse.angle, fine.angle)
    seen = [float(np.diff(np.unique(values.round(9))).min()) for values in readings]  # smallest steps
    why = "The cell feels F = 2T, so an error of the cell is half that error in T."
    return (
        Claim(
            "2.1.2", "resolution of the tension unit (cell 0.002 N)", f"{UNIT} N", f"{CELL / 2:g} N", DOES_NOT,
            f"{why} Smallest step in simulation: {seen[0]:.4f} N.",
        ),
        Claim(
            "2.1.2", "non-linearity of the tension unit (cell 0.1 N)", f"{UNIT_NONLINEARITY} N",
            f"{CELL_NONLINEARITY / 2:g} N", DOES_NOT, why,
        ),
        Claim(
            "2.1.2", "encoder: 16 lines, gear 69:1", "about 0.006 rad", f"{line:.5f} rad",
            AGREES if round(line, 3) == 0.006 else DOES_NOT,
            f"Smallest step in simulation {seen[1]:.5f} rad. Counting both edges of both channels gives"
            f" {line / QUADRATURE:.6f} rad ({seen[2]:.6f} simulated). Gear backlash is not stated.",
        ),
    )  # fmt: skip


def timing_claims(machine, rate: float) -> tuple[Claim, ...]:
    """Frame, slots, and what one bus means for synchronisation."""
    frame, frequency = 1e3 * machine.frame, 1.0 / machine.slot
    exact = (round(frame, 9), machine.slots, round(frequency, 6)) == (20.0, 10, 500.0)
    read = {b.name: t.slots for b in machine.parts for t in b.tasks if t.slots}
    skew = [1e3 * machine.slot * (slot - read["mocap"][0]) for slot in read["sensor"]]
    return (
        Claim(
            "2.1.2", "control period, sub-intervals, chip rate", "20 ms, 10, 500 Hz",
            f"{frame:.0f} ms, {machine.slots}, {frequency:.0f} Hz", AGREES if exact else DOES_NOT, "20 ms / 10 = 2 ms.",
        ),
        Claim(
            "2.1.2", "one CAN bus, so data are properly synchronised", "synchronised",
            f"wires read {skew[0]:.0f} to {skew[-1]:.0f} ms after the cameras", AGREES,
            f"Within a frame of {frame:.0f} ms, with a skew of {skew[0]:.0f} to {skew[-1]:.0f} ms from the order on the"
            f" bus. In the simulated sweeps joints reach {rate:.1f} rad/s, so the skew is up to"
            f" {1e-3 * skew[-1] * rate:.3f} rad: harmless here, not in fast motion.",
        ),
    )  # fmt: skip


def figure(coarse: Staircase, fine: Staircase) -> str:
    """The staircases of both resolutions as SVG."""
    names = (("0.004 N, as printed", "0.001 N, corrected"), ("0.00569 rad, 16 lines", "0.001423 rad, quadrature"))
    with house_style():
        drawn = new_figure(9.6, 2.7)
        panels = drawn.subplots(1, 2)
        for axes, kind, labels in zip(panels, ("tension", "angle"), names):
            for stairs, colour, label in zip((coarse, fine), (BEFORE, AFTER), labels):
                axes.step(stairs.time, getattr(stairs, kind), where="post", color=colour, lw=1.2, label=label)
            axes.set_xlabel("time [s]")
            axes.grid(color=RULE, lw=0.5)
            axes.legend(loc="upper left")
        panels[0].set_ylabel("tension read [N]")
        inside = coarse.tension[(coarse.time >= WINDOW[0]) & (coarse.time <= WINDOW[1])]
        panels[0].set_xlim(*WINDOW)  # in which steps of tension can be distinguished
        panels[0].set_ylim(inside.min() - UNIT, inside.max() + UNIT)
        panels[1].set_ylabel("spool angle read [rad]")
        return render_svg(
            drawn, "stairs", "tension and spool angle as read during a slow ramp, at two resolutions each"
        )
