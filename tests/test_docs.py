"""What the README and the docs name is there: commands, options, Python names, files; and the site builds."""

import re
import shlex
import subprocess
import sys
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path

import click
import numpy as np
import pytest
import yaml

import exodrake as exo
from exodrake.cli.main import cli

ROOT = Path(__file__).parent.parent
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


def resolved(words: list[str]) -> tuple[click.Command, click.Context, list[str]]:
    """The innermost command of a line, and what is left for it."""
    command, context, rest = cli, click.Context(cli, info_name="exodrake"), words
    while isinstance(command, click.Group) and rest and not rest[0].startswith("-"):
        name, found, rest = command.resolve_command(context, rest)
        assert found is not None, words
        command, context = found, click.Context(found, info_name=name, parent=context)
    return command, context, rest


COMMANDS = [(page, line) for page in PAGES for line in commands(page)]
MENTIONED = [(page, line) for page in PAGES for line in mentioned(page)]


@pytest.mark.parametrize(("page", "line"), COMMANDS, ids=lambda value: value if isinstance(value, str) else "")
def test_a_command_is_one_that_the_command_line_takes(page, line):
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


def test_the_robot_and_the_first_simulation_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("howto/robot.md", "guide/simulate.md"):
        for text in blocks(ROOT / "docs" / name, "python"):
            exec(compile(text, name, "exec"), {})
    assert exo.load_robot("wearer.yaml")["tendon.slack.length.AF"] == 1e-3
    assert float(capsys.readouterr().out) > 0.5  # rad, a closed finger


def test_the_effect_to_add_is_one():
    space: dict = {}
    exec(blocks(ROOT / "docs" / "howto" / "effect.md", "python")[0], space)
    law, effect = space["EFFECT"].at["tendon.transmit"], space["EFFECT"]
    assert law(5.0, 1.0, 0.0, 0.05, effect.parameters[0].null) == 5.0
    assert law(5.0, 1.0, 0.0, 0.05, 100.0) == pytest.approx(5.0 - 100.0 * 0.05**2)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_yaml_blocks_are_yaml(page):
    for text in blocks(page, "yaml"):
        assert isinstance(yaml.safe_load(text), dict)


def test_files_in_the_how_tos_are_read(tmp_path):
    """The robot, and the recording with its mapping and result."""
    robot = blocks(ROOT / "docs" / "howto" / "robot.md", "yaml")[0]
    (tmp_path / "wearer.yaml").write_text(robot)
    assert exo.load_robot(tmp_path / "wearer.yaml")["finger.kappa.MCP"] == 0.09
    from exodrake.data.foreign.import_log import import_log

    page = ROOT / "docs" / "howto" / "import.md"
    (tmp_path / "map.yaml").write_text(blocks(page, "yaml")[0])
    table, recording, _, result = blocks(page, "text")[:4]
    for name, text in (("log.csv", table), ("drive.csv", recording), ("result.csv", result)):
        (tmp_path / name).write_text(text)
    log = import_log(tmp_path / "drive.csv", tmp_path / "map.yaml")
    assert log.equals(exo.read_log(tmp_path / "result.csv", required=()))
    np.testing.assert_allclose(exo.read_log(tmp_path / "log.csv", required=())["tension_AF"], [1.012, 0.998])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_to_files(page):
    made = ("reference/",)
    for target in re.findall(r"\]\(([^)#]+)", FENCE.sub("", page.read_text())):
        if "://" in target or any(part in target for part in made):
            continue
        assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_every_page_is_in_the_nav():
    nav = (ROOT / "mkdocs.yml").read_text()
    assert not [p for p in (ROOT / "docs").rglob("*.md") if f": {p.relative_to(ROOT / 'docs')}" not in nav]


BUILDS = all(find_spec(name) for name in ("mkdocs", "material", "mkdocstrings"))


@pytest.mark.skipif(not BUILDS, reason="the extra `docs` is not installed")
def test_the_site_builds_without_a_warning(tmp_path):
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", tmp_path / "site"]
    run = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=900)
    assert run.returncode == 0, run.stderr[-2000:]
    effects = (tmp_path / "site" / "reference" / "effects.html").read_text()
    assert all(f'id="{effect.id.replace(".", "-")}"' in effects for effect in exo.load_robot().machine.effects)
    python = (tmp_path / "site" / "reference" / "python.html").read_text()
    assert all(f">{name}<" in python or f".{name}" in python for name in exo.PUBLIC)


@pytest.mark.skipif(not BUILDS, reason="the extra `docs` is not installed")
def test_a_page_for_each_command():
    spec = spec_from_file_location("pages", ROOT / "docs" / "_pages.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    made = dict(module.pages())
    for name in cli.list_commands(click.Context(cli)):
        assert f"exodrake {name}" in made[f"reference/commands/{name}.md"]
