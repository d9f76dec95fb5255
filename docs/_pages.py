"""Pages generated when the site is built: commands, effects, tutorial, Python, numbers of the decisions; formulas."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import unescape
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import click
from _effects import ARMS_PATH, effect_pages, effect_paths
from _notebook import page as notebook_page

from exodrake import PUBLIC
from exodrake.cli.main import COMMANDS, GROUPS as COMMAND_GROUPS, cli
from exodrake.report.diagnosis_html import decision_numbers

if TYPE_CHECKING:
    from mkdocs.structure.files import Files

NUMBERS = "<!-- numbers -->"  # where a page wants the numbers of the decisions
# heading -> names on the Python page, in order; names in no group come last
GROUPS = {
    "Robots": ("load_robot", "write_robot", "Robot"),
    "Simulation": ("simulate", "record", "Reference", "Recording"),
    "References": (
        *("grasp", "sweeps", "short_sweeps", "maximum_tension", "find_maximum_tension", "chirp", "holds", "steps"),
        *("multisine", "random_motion", "protocol", "from_log", "plan_grasp"),
    ),
    "Logs and cases": ("Log", "read_log", "write_log", "regularise", "Case", "CaseLog", "read_case", "write_case"),
    "Diagnosis": ("diagnose", "Diagnosis"),
    "The closed loop": ("analyse", "ClosedLoop", "tune", "Requirements", "Tuning"),
    "The Drake Diagram": (
        *("add_exo_index", "build_diagram", "diagram_log", "logged_signals", "find_parameter", "set_parameters"),
    ),
    "Drake systems": (
        *("TendonFinger", "MotorDynamics", "TensionSensor", "Encoder", "MotionCapture", "AdmittanceController", "Bus"),
        *("MachinePart", "GPEstimator", "PostureController", "posture_controller", "Playback", "Noise"),
        *("MultibodyFinger", "FingerView"),
    ),
}


def on_config(config):
    """Fill the lists of generated pages in the navigation."""
    for section in config.nav:
        for title, entries in section.items():
            if title == "Reference":
                commands = [{name: f"reference/commands/{name}.md"} for name in cli.list_commands(click.Context(cli))]
                entries.append({"Commands": ["reference/commands/index.md", *commands]})
                libraries = [{machine: paths} for machine, paths in effect_paths().items()]
                entries.append({"Effects": ["reference/effects.md", *libraries]})
    return config


def on_files(files: Files, config):
    """Add the generated pages."""
    from mkdocs.structure.files import File

    for path, content in pages():
        files.append(File.generated(config, path, content=content))
    return files


def on_page_markdown(markdown: str, page, config, files):
    """Insert the numbers of the decisions where a page has the placeholder."""
    return markdown.replace(NUMBERS, numbers())


def on_page_content(html: str, page, config, files):
    """Put MathML, which browsers draw without a script, in place of TeX, and keep numbers of tables with their %."""
    html = re.sub(r"<td.*?</td>", lambda found: re.sub(r"(?<=\d) ?%", "\u00a0%", found[0]), html, flags=re.DOTALL)
    return re.sub(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', mathml, html, flags=re.DOTALL)


def on_post_build(config):
    """Refuse a site without a formula, a figure or a public name, which no link shows."""
    from mkdocs.exceptions import PluginError

    site = Path(config.site_dir)
    physics, python = ((site / page).read_text() for page in ("explain/physics.html", "reference/python.html"))
    missing = [] if "<math" in physics and 'class="arithmatex"' not in physics else ["formulas in MathML"]
    missing += [name for name in PUBLIC if f">{name}<" not in python and f".{name}" not in python]
    drawn = ["guide/tutorial_1.md", *(path for paths in effect_paths().values() for path in paths if path != ARMS_PATH)]
    figures = [site / Path(path).with_suffix(".svg") for path in drawn]
    missing += [str(path) for path in figures if not path.exists() or "<svg" not in path.read_text()]
    if missing:
        raise PluginError(f"the site lacks {', '.join(missing)}")


def mathml(found: re.Match) -> str:
    """MathML of a formula in TeX, in the line or displayed."""
    from latex2mathml.converter import convert

    return convert(unescape(found[3]), display="inline" if found[2] == "(" else "block")


def pages() -> Iterator[tuple[str, str | bytes]]:
    """Generate (path, content) of every page and figure."""
    yield from command_pages()
    yield from effect_pages()
    for name, content in notebook_page(Path(__file__).with_name("guide") / "tutorial.ipynb"):
        yield f"guide/{name}", content
    yield "reference/python.md", python_page()


def command_pages() -> Iterator[tuple[str, str]]:
    """Generate (path, Markdown) of the list of commands, and of the page of each."""
    context = click.Context(cli, info_name="exodrake")
    names = cli.list_commands(context)
    text = "# Commands\n\n`--out` names the folder of a command's files, or the file of one that writes one. "
    text += "`--json` prints the numbers alone.\n"
    for heading, group in COMMAND_GROUPS.items():
        lines = [f"| [`exodrake {name}`]({name}.md) | {COMMANDS[name][1]} |" for name in group]
        text += f"\n## {heading}\n\n| | |\n|---|---|\n" + "\n".join(lines) + "\n"
    yield "reference/commands/index.md", text
    for name in names:
        yield f"reference/commands/{name}.md", command_page(cli.get_command(context, name), name, context)


def command_page(command: click.Command, name: str, parent: click.Context, level: int = 1) -> str:
    """Format the help of a command, followed by its sub-commands."""
    context = click.Context(command, info_name=name, parent=parent, max_content_width=100, terminal_width=100)
    text = f"{'#' * level} `{context.command_path}`\n\n```text\n{command.get_help(context).strip()}\n```\n"
    for below in getattr(command, "commands", {}).values():
        text += "\n" + command_page(below, below.name, context, level + 1)
    return text


def python_page() -> str:
    """List the public names by group."""
    named = {name for group in GROUPS.values() for name in group}
    groups = GROUPS | {"Others": tuple(name for name in PUBLIC if name not in named)}
    text = "# Python\n\n`import exodrake as exo`; a module is imported when one of its names is first used.\n"
    for heading, names in groups.items():
        text += f"\n## {heading}\n\n" + "".join(f"::: {where(name)}\n\n" for name in names if name in PUBLIC)
    return text


def where(name: str) -> str:
    """Find the full name of a public name in the module that defines it."""
    found = getattr(import_module(PUBLIC[name]), name)
    return f"{getattr(found, '__module__', PUBLIC[name])}.{getattr(found, '__qualname__', name)}"


def numbers() -> str:
    """Format the numbers of the decisions."""
    return "| number | value |\n|---|---|\n" + "\n".join(f"| {a} | {b} |" for a, b in decision_numbers())
