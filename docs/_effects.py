"""Pages of the effects: an index, and a page with a figure for each, where nominal and changed robot differ most."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from io import BytesIO

import matplotlib
import numpy as np

from exodrake.cli.new_machine import ARM_SCAFFOLD
from exodrake.cli.robot import describe
from exodrake.data.log import Log, find_first
from exodrake.data.plot import MEASURED, NOMINAL, STYLE, new_figure
from exodrake.engine.inputs import Reference
from exodrake.machines.position_servos import motor_machine
from exodrake.machines.robot_file import load_robot, machine_folders
from exodrake.machines.serial_arm import FORMS, arm_machine
from exodrake.model.display import find_display
from exodrake.model.effect import Effect
from exodrake.model.machine import Machine
from exodrake.model.robot import Robot
from exodrake.simulation.protocols import protocol
from exodrake.simulation.simulate import simulate

SEED = 1  # of the noise, the same with and without the effect
SLOW = "caging:approach=2.5,hold=1.5,release=2.5"  # one tendon pulls and lets go, where a loop is seen
PROTOCOLS = (SLOW, "wide-pinch", "short-sweeps:period=4", "chirp:span=8", "holds:count=3,dwell=3")
SWINGS = (2.6, 1.9, 1.4, 2.2, 1.7, 3.1)  # of each joint within the window, where a machine has no protocols
APART = {"figure.constrained_layout.w_pad": 0.1}  # inches beside a panel: labels keep off the panel before them
REACH = {"m": 0.04, "rad": 0.5}  # amplitude of these swings
BEND = 2.0  # [rad] of a sheath
DIVERGED = 10.0  # times the largest value of the nominal robot: an unstable loop is drawn until then
WINDOW, FRAMES, POINTS = 8.0, 300, 800  # drawn where the difference is largest: seconds, frames at least, points
LOOP = re.compile(r"loops? of (\w+) against (\w+)")  # in the signature of an effect

INDEX = """\
# The effects

Physics that the nominal models leave out, generated from the effect libraries; `exodrake effects` prints the same. An
effect is absent, bit for bit, where its first parameter has its null value. Each page has a figure: the nominal robot
and the robot with the effect, on the motion and in the signals in which they differ most. *Clearest in* is that signal,
with the RMS difference in noise standard deviations. Where the effect makes the loop unstable, the figure
ends soon after.
"""


ARMS_PATH = "reference/effects/arms/index.md"
ARMS = """\
# Effects of serial arms and of servos with motors

What an arm of `exodrake new-machine DIR --urdf FILE` may have beyond its model, in the forms `inverse`, `closed-loop`
and `cable`; channels and ranges are those of the `cable_arm`. Then (`servo.*`) what servos of `--servo motor` may have.
Their sensors have the errors of any signal as well. `exodrake effects --machine DIR` lists those of one arm.
"""


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
            log, kind = simulate(changed, reference, SEED), machine.compared[0]
            unstable = np.abs(log.array(kind)) > DIVERGED * np.abs(nominal.array(kind)).max()
            rows = slice(find_first(unstable.any(axis=1)))
            nominal, log = nominal.rows(rows), log.rows(rows)
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
    with matplotlib.rc_context(STYLE | {"font.size": 8.5, "svg.fonttype": "none", "svg.hashsalt": effect.id, **APART}):
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


def effect_paths() -> dict[str, list[str]]:
    """Machine -> paths of the pages of its effects."""
    found = {name: [path_of(name, effect) for effect in load_robot(name).machine.effects] for name in machine_folders()}
    return found | {"serial arms": [ARMS_PATH]}


def path_of(machine: str, effect: Effect) -> str:
    """Path of the page of an effect."""
    return f"reference/effects/{machine}/{effect.id}.md"


def effect_pages() -> Iterator[tuple[str, str | bytes]]:
    """Generate (path, content) of the index, and of the page and figure of each effect."""
    index = INDEX
    for name in machine_folders():
        robot = load_robot(name)
        index += f"\n## {name}\n\n| effect | what it is | clearest in |\n|---|---|---|\n"
        for effect in robot.machine.effects:
            shown, svg = effect_figure(robot, effect)
            label = axis_label(robot.machine, next(iter(shown.columns))).partition(" [")[0]
            link = f"[`{effect.id}`](effects/{name}/{effect.id}.md)"
            size = f"{shown.size:.2g}" if shown.size < 100 else f"{shown.size:,.0f}"
            index += f"| {link} | {effect.summary} | {label}, {size} |\n"
            yield path_of(name, effect), effect_page(robot, effect, shown)
            yield path_of(name, effect).removesuffix("md") + "svg", svg
    index += "\n## Arms and servos\n\n[Effects](effects/arms/index.md) of what `exodrake new-machine` makes.\n"
    yield ARMS_PATH, arms_page()
    yield "reference/effects.md", index


def arms_page() -> str:
    """Effects of arms in all forms and of servos on a page, but for those of their sensors, which any signal has."""
    found: dict[str, tuple[Machine, Effect]] = {}
    sections = ({"urdf": "cable_arm.urdf", "form": form} for form in FORMS)
    arms = [arm_machine("cable_arm", section, ARM_SCAFFOLD, "cable_arm") for section in sections]
    for machine in (*arms, motor_machine("servos", ("joint",), frame=0.02, max_effects=1)):
        own = (effect for effect in machine.effects if effect.block in ("arm", "cable", "gear_motor", "servo"))
        found = {effect.id: (machine, effect) for effect in own} | found
    page = ARMS
    for machine, effect in (found[name] for name in sorted(found)):
        page += "\n".join([f"\n## {effect.id}", "", sentence(effect.summary), "", *body(machine, effect, "###")])
    return page


def effect_page(robot: Robot, effect: Effect, shown: Shown) -> str:
    """Format one effect: figure, equation, parameters, signature and source."""
    machine = robot.machine
    page = describe(machine, effect)
    title = " ".join(titled(page)[0].split())
    values = ", ".join(f"`{p.name}` {p.initial:.4g}{'' if p.unit == '-' else ' ' + p.unit}" for p in effect.parameters)
    at = f" on {shown.channel}" if shown.channel else ""
    lines = [f"# {effect.id}", "", title[:1].upper() + title[1:], ""]
    lines += [f"![nominal and with {effect.id}]({effect.id}.svg)", ""]
    lines += [f"Solid: with {values}{at}. Dotted: the nominal robot of `{machine.name}`; same motion, same noise."]
    lines += ["Below: the difference; the grey band is two noise standard deviations to either side.", ""]
    if shown.motion != "swings":
        lines += [f"    exodrake simulate {shown.motion} --effect {effect.id}{'@' * bool(at)}{shown.channel}", ""]
    return "\n".join([*lines, *body(machine, effect, "##")])


def titled(page: dict) -> tuple[str, str]:
    """Title and text of an effect's equation."""
    title, _, rest = page["equation"].partition("\n\n")
    if not title.lower().startswith(page["summary"].lower()):
        return f"{page['summary']}.", page["equation"]
    return title, rest or title


def body(machine: Machine, effect: Effect, level: str) -> list[str]:
    """Equation, parameters, signature and source of an effect, under headings of a level."""
    page = describe(machine, effect)
    rest = page["equation"].partition("\n\n")[2] or page["equation"]
    lines = [f"{level} Equation", "", "```{.text .wrap}", rest, "```", ""]
    lines += [
        f"{level} Parameters",
        "",
        "| parameter | range | initial | null value | one per |",
        "|---|---|---|---|---|",
    ]
    for number, row in zip(effect.parameters, page["parameters"], strict=True):
        absent = f"{number.null:g}" if number is effect.parameters[0] else ""
        per = ", ".join(row["channels"]) or "robot"
        ends = f"{number.low:.5g} to {number.high:.5g} {number.unit}".removesuffix(" -")
        lines.append(f"| `{number.name}` | {ends} | {number.initial:.4g} | {absent} | {per} |")
    lines += ["", f"{level} In logs", "", sentence(page["signature"]), ""]
    if effect.not_tried:
        lines += [f"A diagnosis tries it only where `--effects` names it ({effect.not_tried}).", ""]
    return [*lines, f"{level} Source", "", sentence(linked(page["source"])), ""]


def sentence(text: str) -> str:
    """The text with a capital letter and a full stop."""
    return text[:1].upper() + text[1:].rstrip(".") + "."


def linked(source: str) -> str:
    """A source with links to the sections and keys of the page on physics."""
    physics = "../../../explain/physics.md"
    source = re.sub(r"\[S:(\w+)\]", lambda key: f"[[S:{key[1]}]]({physics}#{key[1].lower()})", source)
    named = re.sub(r"physics\.md ((?:\d\.\w)(?:, \d\.\w| and \d)*)", lambda found: sections(found[1], physics), source)
    return named.replace("[A]", f"[[A]]({physics}#provenance)").replace("[D]", f"[[D]]({physics}#provenance)")


def sections(numbers: str, page: str) -> str:
    """`3.1, 4.A` as links to the sections of a page."""
    return re.sub(r"\d(\.\w)?", lambda found: f"[physics {found[0]}]({page}#{anchor(found[0])})", numbers)


def anchor(number: str) -> str:
    """Anchor of a numbered section: `4.A` -> `s4a`."""
    return "s" + number.replace(".", "").lower()
