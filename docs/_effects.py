"""Pages of the effects: an index, and a page with a figure for each."""

import re
from collections.abc import Iterator

from _figures import Shown, effect_figure

from exodrake.cli.new_machine import ARM_SCAFFOLD
from exodrake.cli.robot import describe, word_range
from exodrake.machines.library import machine_folders
from exodrake.machines.position_servos import motor_machine
from exodrake.machines.robot_file import load_robot
from exodrake.machines.serial_arm import FORMS, arm_machine
from exodrake.model.display import find_display
from exodrake.model.effect import Effect
from exodrake.model.machine import Machine
from exodrake.model.robot import Robot

INDEX = """\
# The effects

Physics that the nominal models leave out, generated from the effect libraries; `exodrake effects` prints the same. An
effect is absent, bit for bit, where its first parameter has its null value. Each page has a figure: the nominal robot
and the robot with the effect, on the motion and in the signals in which they differ most. *Clearest in* is that signal,
with the RMS difference in noise standard deviations.
"""


ARMS_PATH = "reference/effects/arms/index.md"
ARMS = """\
# Effects of serial arms and of servos with motors

What an arm of `exodrake new-machine DIR --urdf FILE` may have beyond its model, in the forms `inverse`, `closed-loop`
and `cable`; channels and ranges are those of the `cable_arm`. Then (`servo.*`) what servos of `--servo motor` may have.
Their sensors have the errors of any signal as well. `exodrake effects --machine DIR` lists those of one arm.
"""


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
            column = max(shown.columns, key=lambda name: shown.columns[name][0] / shown.columns[name][1])
            link = f"[`{effect.id}`](effects/{name}/{effect.id}.md)"
            size = f"{shown.size:.2g}" if shown.size < 100 else f"{shown.size:.0f}"
            index += f"| {link} | {effect.summary} | {words_of(robot, column)}, {size} |\n"
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


def words_of(robot: Robot, column: str) -> str:
    """`joint angle MCP`."""
    kind, _, channel = column.rpartition("_")
    return f"{find_display(kind, robot.machine).label.lower()} {channel}"


def effect_page(robot: Robot, effect: Effect, shown: Shown) -> str:
    """Format one effect: figure, equation, parameters, signature and source."""
    machine = robot.machine
    page = describe(machine, effect)
    title = " ".join(titled(page)[0].split())
    values = ", ".join(f"`{p.name}` {p.initial:.3g}{'' if p.unit == '-' else ' ' + p.unit}" for p in effect.parameters)
    at = f" on {shown.channel}" if shown.channel else ""
    lines = [f"# {effect.id}", "", title[:1].upper() + title[1:], ""]
    lines += [f"![nominal and with {effect.id}]({effect.id}.svg)", ""]
    lines += [f"Grey: the nominal robot of `{machine.name}`. Blue: with {values}{at}; same motion, same noise."]
    lines += ["Below: the difference, with a band of two noise standard deviations.", ""]
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
        lines.append(f"| `{number.name}` | {word_range(number)} | {number.initial:.4g} | {absent} | {per} |")
    lines += ["", f"{level} In logs", "", sentence(page["signature"]), ""]
    if effect.not_tried:
        lines += [f"A diagnosis does not try it unless `--effects` names it: {effect.not_tried}.", ""]
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
