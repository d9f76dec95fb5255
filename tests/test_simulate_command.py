"""`exodrake simulate` and `exodrake effects`: files, repeatability, messages."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run

import exodrake as exo
from exodrake.machines.exo_index.machine import machine as exo_index
from exodrake.simulation.scenario import parse_effect, read_scenario

EFFECTS = exo_index().effects
NEGATIVE, ONE_ROW = "negative.yaml", "one_row.csv"
SHORT = "caging:rest=0.1,approach=0.2,hold=0.2,release=0.2"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    options = ["--effect", "tendon.capstan_friction:mu_phi=0.3@AF,AE", "--set", "finger.kappa.MCP=0.09"]
    result = run("simulate", SHORT, *options, "--seed", 3, "--out", folder / "out")
    assert result.exit_code == 0, result.output
    return folder / "out", result.output


def test_files_and_summary(made):
    folder, output = made
    names = {"log.csv", "nominal.csv", "scenario.yaml", "figure.png", "recording.html"}
    assert {path.name for path in folder.iterdir()} == names
    words = ("tendon.capstan_friction: mu_phi 0.3 on AF, AE", "finger.kappa.MCP = 0.09 N m/rad", "RMS from", "nominal")
    assert all(word in output for word in (*names, *words, "angle MCP", "tension AF"))
    assert (folder / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_the_log_is_lossless(made):
    robot = exo.load_robot().with_parameters({"finger.kappa.MCP": 0.09})
    robot = robot.splice("tendon.capstan_friction", {"mu_phi": 0.3}, ["AF", "AE"])
    assert exo.read_log(made[0] / "log.csv").equals(exo.simulate(robot, exo.protocol(SHORT), seed=3))


def test_the_nominal_run_is_the_same_without_the_options(made):
    """The same references and noise; the ghost and the heading of the recording say so."""
    nominal = exo.read_log(made[0] / "nominal.csv")
    assert nominal.equals(exo.simulate(exo.load_robot(), SHORT, seed=3))
    page = (made[0] / "recording.html").read_text()
    assert "grey: nominal" in page and "mu_phi 0.3 on AF, AE" in page and "noise of seed 3" in page


def test_the_folder_of_a_run_stands_for_its_log(made, tmp_path):
    assert run("export", made[0], "--out", tmp_path / "log.csv").exit_code == 0
    assert (tmp_path / "log.csv").read_bytes() == (made[0] / "log.csv").read_bytes()
    assert run("show", made[0], "--out", tmp_path / "run.html").exit_code == 0
    assert "<title>out</title>" in (tmp_path / "run.html").read_text()
    assert run("simulate", SHORT, "--out", tmp_path / "log.csv").exit_code == 2  # a file is no folder
    assert (tmp_path / "log.csv").read_bytes() == (made[0] / "log.csv").read_bytes()
    refused = run("show", tmp_path / "none", "--out", tmp_path / "none.html")
    assert refused.exit_code == 2 and "none: no such file" in refused.stderr


def test_values_outside_their_range_are_noted_with_the_unit_meant(tmp_path):
    result = run("simulate", SHORT, "--effect", "tendon.slack:length=2@AF", "--out", tmp_path / "out")
    assert "tendon.slack.length (AF) = 2 m" in result.output and "did you mean 2 mm?" in result.output


@pytest.mark.parametrize(
    "words", [["caging:hold=0.3,hold=0.4"], [SHORT, "--effect", "tendon.slack:length=1 mm,length=2 mm@AF"]]
)
def test_an_option_with_two_values_is_refused(words, tmp_path):
    result = run("simulate", *words, "--out", tmp_path / "out")
    assert result.exit_code == 2 and "comes twice" in result.stderr and not (tmp_path / "out").exists()


def test_the_scenario_makes_the_same_log_again(made, tmp_path):
    assert run("simulate", "--scenario", made[0] / "scenario.yaml", "--out", tmp_path).exit_code == 0
    for name in ("log.csv", "scenario.yaml"):
        assert (tmp_path / name).read_bytes() == (made[0] / name).read_bytes()


def test_references_of_a_log_and_options_over_a_scenario(made, tmp_path):
    result = run("simulate", "--reference", made[0] / "log.csv", "--no-noise", "--no-quantisation", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    again = read_scenario(tmp_path / "scenario.yaml")
    assert again.seed is None and not again.quantisation
    assert again.run()[1].equals(exo.read_log(tmp_path / "log.csv"))
    assert not (tmp_path / "nominal.csv").exists() and "grey: " not in (tmp_path / "recording.html").read_text()
    for text in ("- 1", "a: b", "protocol: caging\nseed: x", "protocol: caging\neffects: {tendon.slack: 1}"):
        (tmp_path / "bad.yaml").write_text(text)
        with pytest.raises(exo.InputError, match=r"bad\.yaml"):
            read_scenario(tmp_path / "bad.yaml")


def test_a_robot_file_is_embedded(tmp_path):
    exo.write_robot(exo.load_robot().with_parameters({"tendon.k": 2000.0}), tmp_path / "soft.yaml")
    assert run("simulate", SHORT, "--robot", tmp_path / "soft.yaml", "--out", tmp_path / "out").exit_code == 0
    (tmp_path / "soft.yaml").unlink()
    robot, log = read_scenario(tmp_path / "out" / "scenario.yaml").run()
    assert robot["tendon.k.AF"] == 2000.0 and log.equals(exo.read_log(tmp_path / "out" / "log.csv"))


@pytest.mark.parametrize(
    "arguments, word",
    [
        (["cagin"], "did you mean caging"), ([], "nothing to follow"),
        ([SHORT, "--set", "finger.kapa.MCP=1"], "finger.kapa"),
        ([SHORT, "--set", "finger.kappa.XX=1"], "finger.kappa.XX"), ([SHORT, "--set", "tendon.k=nan"], "NaN"),
        ([SHORT, "--set", "tendon.k=2.7 N/furlong"], "N/furlong"), ([SHORT, "--set", "tendon.k=2 mm"], "[mm]"),
        ([SHORT, "--set", "tendon.k"], "name=number"), ([SHORT, "--effect", "tendon.capstan"], "tendon.capstan"),
        ([SHORT, "--effect", "tendon.capstan_friction:mu=1"], "'mu'"), ([SHORT, "--engine", "fast"], "'fast'"),
        ([SHORT, "--effect", "tendon.capstan_friction@XX"], "'XX'"), ([SHORT, "--effect", "tendon.slack@"], "after @"),
        ([SHORT, "--effect", "tendon.capstan_friction:mu_phi=nan"], "NaN"), ([SHORT, "--part", "nothing"], "'nothing'"),
        ([SHORT, "--robot", "absent.yaml"], "absent.yaml"), (["--reference", "absent.csv"], "absent.csv"),
        ([SHORT, "--reference", "x.csv"], "one of them"), (["--scenario", "absent.yaml"], "absent.yaml"),
        ([SHORT, "--seed", "-1"], "seed is -1"), ([SHORT, "--set", "tendon.k=1e308"], "diverges"),
        ([SHORT, "--set", "finger.mass=-1"], "below 0"), ([SHORT, "--set", "motor.N=0"], "divide by"),
        ([SHORT, "--set", "finger.length.MCP=0"], "no finger to draw"),
        ([SHORT, "--robot", NEGATIVE], "F_max.AF is -1"),
        (["--reference", ONE_ROW], "two rows"),
    ],
)  # fmt: skip
def test_wrong_input_ends_in_a_line_and_leaves_nothing(arguments, word, made, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path(NEGATIVE).write_text("base: exo_index\nlimits: {F_max: {AF: -1, MF: 8, AE: 8}}\n")
    Path(ONE_ROW).write_text("".join((made[0] / "log.csv").read_text().splitlines(keepends=True)[:2]))
    result = run("simulate", *arguments, "--out", tmp_path / "out")
    assert result.exit_code == 2 and "Traceback" not in result.output
    assert word in result.output.replace("\n", " ")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("engine", ["compiled", "drake"])
@pytest.mark.parametrize("parameters", [{"tendon.k": "inf"}, {"tendon.k": "1e300 N/m"}, {"motor.Kp": "inf"}])
def test_python_refuses_a_run_that_diverges_in_the_words_of_the_command(parameters, engine, tmp_path):
    robot = exo.load_robot().with_parameters(parameters)
    options = [word for name, value in parameters.items() for word in ("--set", f"{name}={value}")]
    said = run("simulate", SHORT, *options, "--engine", engine, "--out", tmp_path / "out").stderr
    for function in (exo.simulate, exo.record):
        with pytest.raises(exo.InputError, match=r"the simulation diverges: [a-z]+_[A-Z]+ is not finite") as refused:
            function(robot, SHORT, engine=engine)
        assert " ".join(said.split()) == f"error: {refused.value}"


def test_a_clock_that_runs_infinitely_fast_is_refused_and_a_limit_at_infinity_is_none(tmp_path):
    result = run("simulate", SHORT, "--effect", "timing.mocap_clock_skew:skew=inf", "--out", tmp_path / "out")
    assert result.exit_code == 2 and "diverges" in result.stderr
    unlimited = exo.load_robot().splice("motor.current_limit", {"limit": "inf"})
    assert exo.simulate(unlimited, SHORT).equals(exo.simulate(exo.load_robot(), SHORT))


def test_the_effect_library_is_printed():
    output = run("effects").output
    assert all(effect.id in output for effect in EFFECTS)
    described = json.loads(run("effects", "--json").output)
    assert [item["id"] for item in described] == [effect.id for effect in EFFECTS]


def test_each_effect_has_a_page_and_an_example_that_parses():
    for effect in EFFECTS:
        page = json.loads(run("effects", effect.id, "--json").output)
        assert page["equation"] and page["parameters"] and page["signature"] and page["source"]
        identity, given = parse_effect(page["example"].split("--effect ")[1], exo.load_robot())
        assert identity == effect.id and np.size(list(given)) == len(effect.parameters)
    assert effect.id in run("effects", effect.id).output
    result = run("effects", "tendon.capstan_frictin")
    assert result.exit_code == 2 and "did you mean tendon.capstan_friction" in result.output
