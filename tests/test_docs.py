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
from command_line import run

import exodrake as exo
from exodrake.cli.main import cli
from exodrake.core import plugins
from exodrake.data.import_log import import_recording, read_mapping
from exodrake.machines.robot_file import machine_folders

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "docs"))
import _notebook  # noqa: E402
import _pages  # noqa: E402
from _effects import effect_figure, effect_paths, linked  # noqa: E402

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.M | re.S)


def blocks(page: Path, language: str) -> list[str]:
    """Fenced blocks of a language."""
    return [text for name, text in FENCE.findall(page.read_text()) if name == language]


def commands(page: Path) -> list[str]:
    """Lines of indented code and of sh blocks that start with `exodrake`."""
    lines = [line[4:] for line in FENCE.sub("", page.read_text()).splitlines() if line.startswith("    ")]
    lines += [line for text in blocks(page, "sh") for line in text.splitlines()]
    return [line.strip() for line in lines if line.strip().startswith("exodrake ")]


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


def test_commands_of_the_pages_are_taken_by_the_command_line(tmp_path, monkeypatch):
    """From a folder with the machines that the pages speak of; of inline code the options are known."""
    monkeypatch.setenv(plugins.VARIABLE, "")
    monkeypatch.chdir(tmp_path)
    servos = ["my_servos", "--joints", "shoulder,elbow", "--servo", "motor"]
    for options in (["my_arm"], ["cable_arm", "--urdf", "cable_arm"], servos):
        assert run("new-machine", *options).exit_code == 0
    lines = [line for page in PAGES for line in commands(page)]
    for line in lines:
        command, context, rest = resolved(shlex.split(line, comments=True)[1:])
        command.make_context(context.info_name, rest, parent=context.parent)
    mentioned = [
        line for page in PAGES for line in re.findall(r"`(exodrake [a-z][^`]*)`", FENCE.sub("", page.read_text()))
    ]
    for line in mentioned:
        command, _, rest = resolved(shlex.split(line)[1:])
        options = {name for parameter in command.params for name in parameter.opts} | {"--help"}
        assert {word for word in rest if word.startswith("-")} <= options, line
    assert len(lines) > 25 and len(mentioned) > 12


def test_blocks_of_the_pages_compile_and_links_lead_to_files():
    """Python names what is public, YAML is a mapping; a link of the site stays in the site."""
    for page in PAGES:
        for text in blocks(page, "python"):
            compile(text, str(page), "exec")
            assert set(re.findall(r"\bexo\.(\w+)", text)) <= set(exo.PUBLIC), page
        assert all(isinstance(yaml.safe_load(text), dict) for text in blocks(page, "yaml")), page
        for target in re.findall(r"\]\(([^)#]+)", FENCE.sub("", page.read_text())):
            if "://" not in target and not any(part in target for part in ("reference/", "guide/tutorial.md")):
                found = (page.parent / target).resolve()
                in_site = not page.is_relative_to(ROOT / "docs") or found.is_relative_to(ROOT / "docs")
                assert found.exists() and in_site, f"{page.name}: {target}"


@pytest.mark.parametrize("name", ["README.md", "docs/howto/drake.md", "docs/howto/robot.md", "docs/guide/simulate.md"])
def test_python_blocks_print_what_the_page_says(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    play(ROOT / name, capsys)


def test_the_commands_of_the_readme_print_and_leave_what_it_says(tmp_path, short_cases, monkeypatch):
    """All lines of its sh blocks, one after the other; a text block after one is part of what its last line prints.

    The drawn case has shorter logs.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(plugins.VARIABLE, "")
    found = FENCE.findall((ROOT / "README.md").read_text())
    for (language, source), (after, text) in zip(found, [*found[1:], ("", "")]):
        printed = ""
        for line in source.splitlines() if language == "sh" else ():
            result = run(*shlex.split(line)[1:])
            printed = result.output
            assert result.exit_code == 0, f"{line}\n{printed}"
        assert language != "sh" or after != "text" or text in printed, printed
    assert (tmp_path / "rusty" / "recording.html").stat().st_size > 1e5
    assert (tmp_path / "my_answer" / "improved.yaml").is_file()
    assert "<svg" in (tmp_path / "answer" / "report.html").read_text()
    truth = json.loads((tmp_path / "cases-labels.json").read_text())["cases"]["case_00"]["effects"]
    assert [effect["id"] for effect in truth] == ["tendon.capstan_friction"]  # as the page says
    assert "tendon.capstan_friction" in exo.load_robot("answer/improved.yaml").effects()


def test_the_readme_is_short_and_names_every_command():
    """900 words outside code, those of tables included; a task takes at most three commands, or 15 lines of Python."""
    text = (ROOT / "README.md").read_text()
    words = re.sub(r"^    .*$", "", FENCE.sub("", text), flags=re.M)
    assert len(re.sub(r"\]\([^)]*\)", "]", words).replace("|", " ").split()) <= 900
    for language, source in FENCE.findall(text):
        assert len([line for line in source.splitlines() if line]) <= {"sh": 3, "python": 15}.get(language, 99), source
    table = text.partition("## Commands")[2].partition("\n## ")[0]
    table += "demo draw warm-up"  # run by make, or beside the point there
    assert not [name for name in cli.list_commands(click.Context(cli)) if name not in table]


NOTEBOOKS = sorted((ROOT / "docs").rglob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_prints_what_is_stored(path):
    cells = list(_notebook.run(path))
    assert any(hasattr(value, "savefig") for _, _, value in cells)
    for cell, printed, _ in cells:
        assert cell["cell_type"] != "code" or _notebook.stored(cell) == printed


def test_pages_are_in_the_nav_and_every_command_and_effect_has_one():
    nav = (ROOT / "mkdocs.yml").read_text()
    assert not [p for p in (ROOT / "docs").rglob("*.md") if f": {p.relative_to(ROOT / 'docs')}" not in nav]
    made = dict(_pages.command_pages())
    for name in cli.list_commands(click.Context(cli)):
        assert f"exodrake {name}" in made[f"reference/commands/{name}.md"]
    found = effect_paths()
    paths = [path for name in machine_folders() for path in found[name]]
    robots = [exo.load_robot(name) for name in machine_folders()]
    assert len(set(paths)) == len(paths) == sum(len(robot.machine.effects) for robot in robots)
    assert found.keys() - machine_folders() == {"serial arms"}
    for robot in robots:  # a figure shows an effect beyond the noise
        shown, svg = effect_figure(robot, robot.machine.effects[0])
        assert shown.size > 2.0 and b"<svg" in svg


def test_sources_of_effects_lead_into_the_page_on_physics():
    physics = (ROOT / "docs" / "explain" / "physics.md").read_text()
    anchors = set(re.findall(r"\{ #([\w-]+) \}", physics))
    sources = [effect.source for name in machine_folders() for effect in exo.load_robot(name).machine.effects]
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


def test_files_in_the_how_tos_are_read(tmp_path):
    """The robot, and the recording with its mapping and result."""
    robot = blocks(ROOT / "docs" / "howto" / "robot.md", "yaml")[0]
    (tmp_path / "wearer.yaml").write_text(robot)
    assert exo.load_robot(tmp_path / "wearer.yaml")["finger.kappa.MCP"] == 0.09
    page = ROOT / "docs" / "howto" / "import.md"
    (tmp_path / "map.yaml").write_text(blocks(page, "yaml")[0])
    table, recording, _, result = blocks(page, "text")[:4]
    for name, text in (("log.csv", table), ("drive.csv", recording), ("result.csv", result)):
        (tmp_path / name).write_text(text)
    log = import_recording(tmp_path / "drive.csv", read_mapping(tmp_path / "map.yaml")).log
    assert log.equals(exo.read_log(tmp_path / "result.csv"))
    np.testing.assert_allclose(exo.read_log(tmp_path / "log.csv")["tension_AF"], [1.012, 0.998])
