"""What the README and the docs name is there, does what it says and prints what they print; `make docs` builds."""

import json
import re
import shlex
import sys
from pathlib import Path

import click
import numpy as np
import pytest
import yaml
from click.testing import CliRunner

import exodrake as exo
from exodrake.cli.main import cli
from exodrake.core import plugins
from exodrake.machines.library import machine_names

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "docs"))
import _figures  # noqa: E402
import _notebook  # noqa: E402
import _pages  # noqa: E402
from _effects import effect_paths, linked  # noqa: E402

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.M | re.S)


def blocks(page: Path, language: str) -> list[str]:
    """Fenced blocks of a language."""
    return [text for name, text in FENCE.findall(page.read_text()) if name == language]


def commands(page: Path) -> list[str]:
    """Lines of indented code and of sh blocks that start with `exodrake`."""
    bare = FENCE.sub("", page.read_text())
    lines = [line[4:] for line in bare.splitlines() if line.startswith("    ")]
    lines += [line for text in blocks(page, "sh") for line in text.splitlines()]
    return [line.strip() for line in lines if line.strip().startswith("exodrake ")]


def mentioned(page: Path) -> list[str]:
    """Inline code that starts with `exodrake` and a command."""
    return re.findall(r"`(exodrake [a-z][^`]*)`", FENCE.sub("", page.read_text()))


def play(page: Path, capsys) -> dict:
    """Runs the Python blocks of a page in one namespace; the text block after one is what it prints."""
    space: dict = {}
    found = FENCE.findall(page.read_text())
    for (language, source), (after, text) in zip(found, [*found[1:], ("", "")]):
        if language != "python":
            continue
        exec(compile(source, page.name, "exec"), space)
        printed = capsys.readouterr().out
        assert printed == (text if after == "text" else ""), f"{page.name}:\n{source}"
    return space


def resolved(words: list[str]) -> tuple[click.Command, click.Context, list[str]]:
    """The innermost command of a line, and what is left for it."""
    command, context = cli, click.Context(cli, info_name="exodrake")
    rest = words[2:] if words[:1] == ["--plugin"] else words
    while isinstance(command, click.Group) and rest and not rest[0].startswith("-"):
        name, found, rest = command.resolve_command(context, rest)
        assert found is not None, words
        command, context = found, click.Context(found, info_name=name, parent=context)
    return command, context, rest


COMMANDS = [(page, line) for page in PAGES for line in commands(page)]
MENTIONED = [(page, line) for page in PAGES for line in mentioned(page)]


@pytest.fixture(scope="module")
def place_with_a_machine(tmp_path_factory):
    """A folder with the machines that the pages speak of."""
    folder = tmp_path_factory.mktemp("place")
    servos = ["my_servos", "--joints", "shoulder,elbow", "--servo", "motor"]
    for options in (["my_arm"], ["cable_arm", "--urdf", "cable_arm"], servos):
        made = CliRunner().invoke(cli, ["new-machine", str(folder / options[0]), *options[1:]])
        assert made.exit_code == 0, made.output
    return folder


@pytest.mark.parametrize(("page", "line"), COMMANDS, ids=lambda value: value if isinstance(value, str) else "")
def test_a_command_is_one_that_the_command_line_takes(page, line, place_with_a_machine, monkeypatch):
    if "--machine" in line:
        monkeypatch.setenv(plugins.VARIABLE, "")
        monkeypatch.chdir(place_with_a_machine)
    command, context, rest = resolved(shlex.split(line, comments=True)[1:])
    command.make_context(context.info_name, rest, parent=context.parent)


@pytest.mark.parametrize(("page", "line"), MENTIONED, ids=lambda value: value if isinstance(value, str) else "")
def test_a_command_mentioned_is_there_with_its_options(page, line):
    command, _, rest = resolved(shlex.split(line)[1:])
    options = {name for parameter in command.params for name in parameter.opts} | {"--help"}
    assert {word for word in rest if word.startswith("-")} <= options


def test_there_are_commands_to_check():
    assert len(COMMANDS) > 25 and len(MENTIONED) > 12


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_python_blocks_compile_and_name_what_is_public(page):
    for text in blocks(page, "python"):
        compile(text, str(page), "exec")
        assert set(re.findall(r"\bexo\.(\w+)", text)) <= set(exo.PUBLIC), page


@pytest.mark.parametrize("name", ["README.md", "docs/howto/drake.md", "docs/howto/robot.md", "docs/guide/simulate.md"])
def test_python_blocks_print_what_the_page_says(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    play(ROOT / name, capsys)


def test_the_commands_of_the_readme_print_and_leave_what_it_says(tmp_path, monkeypatch):
    """All lines of its sh blocks, one after the other; a text block after one is part of what its last line prints."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(plugins.VARIABLE, "")
    found = FENCE.findall((ROOT / "README.md").read_text())
    for (language, source), (after, text) in zip(found, [*found[1:], ("", "")]):
        printed = ""
        for line in source.splitlines() if language == "sh" else ():
            run = CliRunner().invoke(cli, shlex.split(line)[1:])
            printed = run.output
            assert run.exit_code == 0, f"{line}\n{printed}"
        assert language != "sh" or after != "text" or text in printed, printed
    assert (tmp_path / "rusty" / "recording.html").stat().st_size > 1e5
    assert (tmp_path / "my_answer" / "improved.yaml").is_file() and "<svg" in (
        tmp_path / "answer" / "report.html"
    ).read_text()
    truth = json.loads((tmp_path / "cases-labels.json").read_text())["cases"]["case_00"]["effects"]
    assert [effect["id"] for effect in truth] == ["tendon.capstan_friction"]  # as the page says
    assert "tendon.capstan_friction" in exo.load_robot("answer/improved.yaml").effects()


def test_the_readme_is_short():
    """900 words outside code, those of tables included; one sentence in twenty may have more than 25 words."""
    text = re.sub(r"^    .*$", "", FENCE.sub("", (ROOT / "README.md").read_text()), flags=re.M)
    words = re.sub(r"\]\([^)]*\)", "]", text).replace("|", " ")
    assert len(words.split()) <= 900
    prose = [
        line for line in re.split(r"(?<=[.:;!?])\s|\n\n", re.sub(r"^[|#].*$", "", words, flags=re.M)) if line.strip()
    ]
    assert sum(len(sentence.split()) > 25 for sentence in prose) <= len(prose) / 20


def test_each_task_of_the_readme_is_short():
    """At most three commands, or 15 lines of Python."""
    text = (ROOT / "README.md").read_text()
    tasks = text[text.index("## Five things") : text.index("## How well it diagnoses")]
    found = [FENCE.findall(task) for task in re.split(r"^\*\*\d\. ", tasks, flags=re.M)[1:]]
    assert len(found) == 5
    for language, source in (block for task in found for block in task):
        lines = [line for line in source.splitlines() if line]
        assert len(lines) <= {"sh": 3, "python": 15}.get(language, 99), source


def test_the_readme_names_every_command():
    table = (ROOT / "README.md").read_text().partition("## Commands")[2].partition("\n## ")[0]
    table += "demo draw warm-up"  # run by make, or beside the point there
    assert not [name for name in cli.list_commands(click.Context(cli)) if name not in table]


NOTEBOOKS = sorted((ROOT / "docs").rglob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_prints_what_is_stored(path):
    cells = list(_notebook.run(path))
    assert any(hasattr(value, "savefig") for _, _, value in cells)
    for cell, printed, _ in cells:
        assert cell["cell_type"] != "code" or _notebook.stored(cell) == printed


@pytest.mark.parametrize("name", machine_names())
def test_a_figure_shows_an_effect_beyond_the_noise(name):
    robot = exo.load_robot(name)
    shown, svg = _figures.effect_figure(robot, robot.machine.effects[0])
    assert shown.size > 2.0 and b"<svg" in svg


def test_every_effect_of_every_machine_has_a_page_of_its_own():
    found = effect_paths()
    paths = [path for name in machine_names() for path in found[name]]
    assert len(set(paths)) == len(paths) == sum(len(exo.load_robot(name).machine.effects) for name in machine_names())
    assert found.keys() - machine_names() == {"serial arms"}


def test_sources_of_effects_lead_into_the_page_on_physics():
    physics = (ROOT / "docs" / "explain" / "physics.md").read_text()
    anchors = set(re.findall(r"\{ #([\w-]+) \}", physics))
    sources = [effect.source for name in machine_names() for effect in exo.load_robot(name).machine.effects]
    assert sum("physics.md" in source for source in sources) > 30
    for source in sources:
        found = re.findall(r"physics\.md#([\w-]+)\)", linked(source))
        assert set(found) <= anchors, source
        assert len(found) >= source.count("physics.md ") + source.count("[S:"), source


def test_the_effect_to_add_is_one():
    space: dict = {}
    exec(blocks(ROOT / "docs" / "howto" / "effect.md", "python")[0], space)
    law, effect = space["WINDAGE"].at["tendon.transmit"], space["WINDAGE"]
    assert law(5.0, 0.05, effect.parameters[0].null) == 5.0
    assert law(5.0, 0.05, 100.0) == pytest.approx(5.0 - 100.0 * 0.05**2)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_yaml_blocks_are_yaml(page):
    for text in blocks(page, "yaml"):
        assert isinstance(yaml.safe_load(text), dict)


def test_files_in_the_how_tos_are_read(tmp_path):
    """The robot, and the recording with its mapping and result."""
    robot = blocks(ROOT / "docs" / "howto" / "robot.md", "yaml")[0]
    (tmp_path / "wearer.yaml").write_text(robot)
    assert exo.load_robot(tmp_path / "wearer.yaml")["finger.kappa.MCP"] == 0.09
    from exodrake.data.import_log import import_log

    page = ROOT / "docs" / "howto" / "import.md"
    (tmp_path / "map.yaml").write_text(blocks(page, "yaml")[0])
    table, recording, _, result = blocks(page, "text")[:4]
    for name, text in (("log.csv", table), ("drive.csv", recording), ("result.csv", result)):
        (tmp_path / name).write_text(text)
    log = import_log(tmp_path / "drive.csv", tmp_path / "map.yaml")
    assert log.equals(exo.read_log(tmp_path / "result.csv"))
    np.testing.assert_allclose(exo.read_log(tmp_path / "log.csv")["tension_AF"], [1.012, 0.998])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_to_files(page):
    made = ("reference/", "guide/tutorial.md")
    for target in re.findall(r"\]\(([^)#]+)", FENCE.sub("", page.read_text())):
        if "://" in target or any(part in target for part in made):
            continue
        found = (page.parent / target).resolve()
        assert found.exists(), f"{page.name}: {target}"
        in_site = not page.is_relative_to(ROOT / "docs") or found.is_relative_to(ROOT / "docs")
        assert in_site, f"{page.name}: {target} is no page of the site"


def test_every_page_is_in_the_nav():
    nav = (ROOT / "mkdocs.yml").read_text()
    assert not [p for p in (ROOT / "docs").rglob("*.md") if f": {p.relative_to(ROOT / 'docs')}" not in nav]


def test_a_page_for_each_command():
    made = dict(_pages.command_pages())
    for name in cli.list_commands(click.Context(cli)):
        assert f"exodrake {name}" in made[f"reference/commands/{name}.md"]
