"""The command line: one line and status 2 for bad input, never a traceback."""

from contextlib import chdir

import click
import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from command_line import run
from hypothesis import HealthCheck, given, settings, strategies as st

from exodrake import __version__
from exodrake.cli.main import COMMANDS, cli
from exodrake.data.formats import read_log, write_log
from exodrake.data.log import Log


@pytest.fixture
def log_file(tmp_path):
    write_log(Log(0.02 * np.arange(10), {"tension_AF": np.arange(10.0)}), tmp_path / "log.csv")
    return tmp_path / "log.csv"


def test_help_lists_only_what_is_there():
    """The help of --help, and of no arguments, has each command once, in a group with a heading."""
    result = run("--help")
    assert result.exit_code == 0 and run().output == result.output and run().exit_code == 0
    lists = result.output[result.output.index("Simulate:") :].splitlines()
    listed = [line.split()[0] for line in lists if line.startswith("  ")]
    assert sorted(listed) == sorted(cli.list_commands(click.Context(cli)))
    assert all(line.endswith(".") and len(line) <= 65 for _, line in COMMANDS.values())  # longer ones wrap
    assert run("--version").output.split() == ["exodrake", __version__]


def test_a_part_of_a_name_finds_it():
    for words, found in (
        (("effects", "capstan"), "tendon.capstan_friction"),
        (("robot", "tendon.k"), "tendon.k"),
        (("simulate", "caging", "--set", "kp=0.02"), "did you mean controller.kp"),
        (("simulate", "caging", "--set", "admittance.kp=0.02"), "did you mean controller.kp"),
        (("robot", "tendn.k"), "did you mean tendon.k?"),
        (("diagnose", "nofile.csv"), "nofile.csv: no such file or folder"),
        (("fit", "nofile.csv", "--free", "kp"), "nofile.csv"),
        (("limits",), "did you mean alarm-limits?"),
    ):
        assert found in run(*words).output, words


def test_unknown_command_and_option():
    for words, named in (
        (("exprot",), "export"),
        (("export", "x.csv", "--uot", "y.csv"), "'--out'"),
        (("fit", "x.csv"), "--free is missing"),
        (("simulate", "caging", "--seed", "x"), "--seed"),
        (("simulate", "caging", "--out", "/proc/x"), "/proc: takes no files"),
        (("identify", "kinematic"), "kinematics"),
        (("--nothing",), "--nothing"),
    ):
        result = run(*words)
        assert result.exit_code == 2 and named in result.stderr and len(result.stderr.splitlines()) == 1, words


def test_bad_input_is_one_line_and_status_two_and_red_in_a_terminal(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run("export", "none.csv", "--out", "x.npz")
    assert result.exit_code == 2 and not result.stdout and result.stderr == "error: none.csv: no such file\n"
    result = CliRunner().invoke(cli, ["export", "none.csv", "--out", "x.npz"], color=True)
    assert result.stderr.startswith("\x1b[31merror: ") and result.stderr.endswith("\x1b[0m\n")
    for options, named in ((("--form", "cable"), "--urdf"), (("--urdf", "linear_axis", "--servo", "motor"), "--servo")):
        result = run("new-machine", "mine", *options)
        assert result.exit_code == 2 and named in result.stderr and not list(tmp_path.iterdir())
    said = {form: run("new-machine", f"a{k}", "--urdf", "linear_axis", "--form", form).stdout
            for k, form in enumerate(("inverse", "closed-loop", "cable"))}  # fmt: skip
    assert "then import, check, fit, diagnose, export: as a0/README.md" in said["inverse"]
    assert "check, response, fit, diagnose, analyse, tune, export" in said["closed-loop"]
    assert "check, response, fit, diagnose, analyse, export" in said["cable"] and "tune" not in said["cable"]
    assert "exodrake analyse" in (tmp_path / "a2" / "README.md").read_text()


@pytest.mark.parametrize("words", [("simulate", "holds", "--out", ""), ("show", ""), ("analyse", "--out", "")])
def test_an_empty_path_is_refused_and_is_not_the_current_folder(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    result = run(*words)
    assert result.exit_code == 2 and "empty path" in result.stderr and not list(tmp_path.iterdir())


def test_the_mapping_in_the_help_of_import_is_one_that_can_be_copied():
    text = run("import", "--help").stdout
    assert yaml.safe_load(text[text.index("  time:") : text.index("Options:")])["period"] == 0.02


def test_interrupt_is_status_130(monkeypatch, log_file):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("exodrake.read_log", interrupt)
    result = run("export", log_file, "--out", "x.npz")
    assert result.exit_code == 130 and result.stderr == "interrupted\n"


def test_export_cuts_and_converts(log_file):
    out = log_file.with_suffix(".npz")
    assert run("export", log_file, "--out", out, "--start", 0.06, "--end", 0.1).exit_code == 0
    np.testing.assert_array_equal(read_log(out)["tension_AF"], [3, 4])
    assert run("export", log_file, "--out", out, "--start", 9).exit_code == 2
    assert run("export", log_file, "--out", out.with_suffix(".doc")).exit_code == 2


def test_export_writes_the_owners_names_and_units_back(tmp_path):
    """A mapping read backwards: what is imported again has the values that were there, to the 12 digits written."""
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(
        "time: {column: t, unit: ms}\nseparator: ';'\ndecimal: ','\ncolumns:\n"
        "  load: {name: tension_AF, unit: mN, scale: 0.5, offset: -12, sign: -1}\n"
        "  elbow: {name: angle_PIP, unit: deg}\n"
    )
    time, tension = 0.02 * np.arange(4), np.array([1.0, 2.0, np.nan, 3.0])
    write_log(Log(time, {"tension_AF": tension, "angle_PIP": 0.1 * time, "stroke_AF": time}), tmp_path / "log.csv")
    assert run("export", tmp_path / "log.csv", "--map", mapping, "--out", tmp_path / "own.csv").exit_code == 0
    assert (tmp_path / "own.csv").read_text().splitlines()[:2] == ["t;load;elbow", "0;-1976;0"]
    assert run("import", tmp_path / "own.csv", "--map", mapping, "--out", tmp_path / "back.csv").exit_code == 0
    back = read_log(tmp_path / "back.csv")
    np.testing.assert_allclose(back["tension_AF"], tension, rtol=1e-11)
    np.testing.assert_allclose(back["angle_PIP"], 0.1 * time, atol=1e-12)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    words=st.lists(
        st.one_of(st.text(max_size=6), st.sampled_from(["export", "import", "--out", "--map", "--start"])), max_size=5
    )
)
def test_any_words_end_well(tmp_path_factory, words):
    with chdir(tmp_path_factory.mktemp("words")):
        result = CliRunner().invoke(
            cli, [word for word in words if word in ("export", "import") or word not in COMMANDS]
        )
    assert result.exit_code in (0, 2)
