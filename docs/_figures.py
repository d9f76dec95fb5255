"""Figures of the effects: the nominal robot and the robot with one effect, where the two differ most.

text, svg = effect_figure(load_robot(), "tendon.capstan_friction")
"""

import re
from dataclasses import dataclass
from functools import cache
from io import BytesIO

import matplotlib
import numpy as np

from exodrake.data.log import Log
from exodrake.data.plot import MEASURED, NOMINAL, STYLE, new_figure
from exodrake.engine.inputs import Reference
from exodrake.machines.robot_file import load_robot
from exodrake.model.display import find_display
from exodrake.model.effect import Effect
from exodrake.model.machine import Machine
from exodrake.model.robot import Robot
from exodrake.simulation.references import protocol
from exodrake.simulation.simulate import simulate

SEED = 1  # of the noise, the same with and without the effect
SLOW = "caging:approach=2.5,hold=1.5,release=2.5"  # one tendon pulls and lets go, where a loop is seen
PROTOCOLS = (SLOW, "wide-pinch", "short-sweeps:period=4", "chirp:span=8", "holds:count=3,dwell=3")
SWINGS = (2.6, 1.9, 1.4, 2.2, 1.7, 3.1)  # of each joint within the window, where a machine has no protocols
REACH = {"m": 0.04, "rad": 0.5}  # amplitude of these swings
BEND = 2.0  # [rad] of a sheath
WINDOW, FRAMES, POINTS = 8.0, 300, 800  # drawn where the difference is largest: seconds, frames at least, points
LOOP = re.compile(r"loops? of (\w+) against (\w+)")  # in the signature of an effect


@dataclass(frozen=True)
class Shown:
    """Where an effect shows most: the motion, the channel it acts on, both logs, and the columns that differ."""

    motion: str
    channel: str
    nominal: Log
    log: Log
    columns: dict[str, tuple[float, float]]  # column -> RMS difference, noise standard deviation [SI]

    @property
    def size(self) -> float:
        """RMS difference of the clearest column [noise standard deviations]."""
        return max(difference / noise for difference, noise in self.columns.values())


@cache
def runs(name: str) -> dict[str, tuple[Reference, Log]]:
    """Motions of a machine: the reference, and the log of its nominal robot."""
    robot = load_robot(name)
    found = {text: protocol(text, robot) for text in PROTOCOLS} if robot.grasps else {"swings": swings(robot.machine)}
    return {text: (reference, simulate(robot, reference, SEED)) for text, reference in found.items()}


def drawn(frame: float) -> int:
    """Number of frames drawn, of `frame` [s] each."""
    return max(round(WINDOW / frame), FRAMES)


def swings(machine: Machine) -> Reference:
    """Every joint swings at a frequency of its own and doubles back on the way; starts at rest."""
    share, columns = np.linspace(0.0, 1.0, drawn(machine.frame)), []
    for column in machine.references:
        signal = machine.signal[column.signal]
        for i in range(machine.width(signal.axis)):
            phase, reach = 2 * np.pi * SWINGS[i] * share, REACH.get(signal.unit, 0.0)
            moved = reach * np.tanh(10 * share) * (0.7 * np.sin(phase) + 0.3 * np.sin(2 * phase))
            held = BEND if column.kind == "bend" else 0.0
            columns.append(moved if column.kind.endswith("_ref") else np.full_like(share, held))
    return Reference(np.column_stack(columns), "swings")


def clearest(robot: Robot, effect: Effect) -> Shown:
    """The reference and the channel on which the effect differs most from the nominal robot."""
    machine = robot.machine
    channels = [channel for channel in machine.axes.of(effect.axis) if channel]
    motions, found = runs(machine.name), []
    if LOOP.search(effect.signature) and SLOW in motions:
        motions = {SLOW: motions[SLOW]}
    for channel in channels or [""]:
        changed = robot.splice(effect.id, channels=[channel] if channel else ())
        for text, (reference, nominal) in motions.items():
            log = simulate(changed, reference, SEED)
            found.append(Shown(text, channel, nominal, log, differences(robot, nominal, log)))
    return max(found, key=lambda shown: shown.size)


def differences(robot: Robot, nominal: Log, log: Log) -> dict[str, tuple[float, float]]:
    """RMS difference and noise standard deviation [SI] of the clearest column of each compared kind, clearest first."""
    noise, best = robot.machine.noise_std(lambda name: robot[name]), {}
    for kind in robot.machine.compared:
        rms = {
            f"{kind}_{c}": np.sqrt(np.mean((log[f"{kind}_{c}"] - nominal[f"{kind}_{c}"]) ** 2)) for c in log.names(kind)
        }
        column = max(rms, key=lambda name: rms[name])
        best[column] = float(rms[column]), noise[kind]
    return dict(sorted(best.items(), key=lambda item: -item[1][0] / item[1][1]))


def effect_figure(robot: Robot, effect: Effect) -> tuple[Shown, bytes]:
    """Where an effect shows, and its figure as SVG."""
    shown = clearest(robot, effect)
    columns = [name for name, (difference, noise) in shown.columns.items() if difference > noise][:2]
    with matplotlib.rc_context(STYLE | {"font.size": 8.5, "svg.fonttype": "none", "svg.hashsalt": effect.id}):
        figure = draw(robot.machine, shown, columns or list(shown.columns)[:1], loop_of(effect, shown))
        buffer = BytesIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return shown, buffer.getvalue()


def loop_of(effect: Effect, shown: Shown) -> tuple[str, str] | None:
    """Columns (horizontal, vertical) of the loop that the signature of an effect speaks of, if it does."""
    found = LOOP.search(effect.signature)
    if not found:
        return None
    vertical = next(name for name in shown.columns if name.startswith(found[1]))
    kind = found[2].replace("command", found[1] + "_ref")
    names = shown.log.names(kind)
    return f"{kind}_{shown.channel if shown.channel in names else names[0]}", vertical


def window(shown: Shown, column: str) -> slice:
    """The rows drawn: those in which the column differs most."""
    squared = np.cumsum((shown.log[column] - shown.nominal[column]) ** 2)
    rows = min(drawn(shown.log.dt), len(squared))
    start = int(np.argmax(squared[rows - 1 :] - np.concatenate([[0.0], squared[:-rows]])))
    return slice(start, start + rows, max(1, rows // POINTS))


def draw(machine: Machine, shown: Shown, columns: list[str], loop: tuple[str, str] | None):
    """Both robots above, their difference below with two noise standard deviations in grey; a loop beside them."""
    figure, rows = new_figure(8.0, 3.2), window(shown, columns[0])
    time = shown.log.time[rows]
    logs = ((shown.log, MEASURED, "with the effect"), (shown.nominal, NOMINAL, "nominal"))
    grid = figure.add_gridspec(2, len(columns) + bool(loop), height_ratios=(2.2, 1))
    for i, column in enumerate(columns):
        display, label = find_display(column.rpartition("_")[0], machine), axis_label(machine, column)
        upper, lower = figure.add_subplot(grid[0, i], ylabel=label), figure.add_subplot(grid[1, i], ylabel="difference")
        for log, style, name in logs:
            upper.plot(time, display.factor * log[column][rows], label=name, **style)
        noise = 2 * display.factor * shown.columns[column][1]
        lower.axhspan(-noise, noise, color="#e3e6ea", lw=0)
        lower.plot(
            time, display.factor * (shown.log[column] - shown.nominal[column])[rows], color=MEASURED["color"], lw=0.9
        )
        lower.set(xlabel="Time [s]", xlim=(time[0], time[-1]))
        upper.set(xlim=lower.get_xlim(), xticklabels=[])
        figure.align_ylabels([upper, lower])
    if loop:
        axes = figure.add_subplot(grid[:, -1], xlabel=axis_label(machine, loop[0]), ylabel=axis_label(machine, loop[1]))
        factors = [find_display(name.rpartition("_")[0], machine).factor for name in loop]
        for log, style, name in logs:
            axes.plot(*(f * log[column][rows] for f, column in zip(factors, loop)), label=name, **style)
    figure.axes[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.2)
    return figure


def axis_label(machine: Machine, column: str) -> str:
    """`Joint angle MCP [°]`."""
    kind, _, channel = column.rpartition("_")
    display = find_display(kind, machine)
    return f"{display.label} {channel}" + display.axis.removeprefix(display.label)
