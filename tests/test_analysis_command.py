"""`exodrake analyse`: files, tables, and bad input."""

import json

import numpy as np
import pytest
from arm_folders import MIXED, made
from command_line import run

import exodrake as exo
from exodrake.analysis.figures import plot_bode
from exodrake.analysis.linear_model import KINK
from exodrake.machines.robot_file import load_robot

FIGURES = {
    f"{name}.png"
    for name in (
        "steps", "stability", "bode", "margins", "nyquist", "robust", "root_locus", "delays", "limit_cycles"
    )
}  # fmt: skip


def test_it_writes_figures_numbers_and_the_model(tmp_path, few_cycles):
    files = ("--out", tmp_path / "a", "--json", tmp_path / "b.json", "--to-control", tmp_path / "m.npz")
    found = run("analyse", "--draws", 2, *files)
    assert found.exit_code == 0, found.output
    assert "spectral radius 0.96" in found.output and "stable up to" in found.output
    names = {path.name for path in (tmp_path / "a").iterdir()}
    assert names == FIGURES | {"analysis.json"}
    assert (tmp_path / "a" / "bode.png").read_bytes().startswith(b"\x89PNG")
    parameters = json.loads((tmp_path / "b.json").read_text())
    assert parameters["stable"] and parameters["margins"]["MF"]["gain_margin_db"] > 6.0
    assert parameters["steps"]["AF"]["overshoot"] < 0.02 and abs(parameters["steps"]["AF"]["steady_error"]) < 1e-3
    limit = parameters["stability_map"]["limit of the first"]
    assert max(v for v in limit if v) == pytest.approx(0.0209, abs=0.001)
    ranges = parameters["bands"]["tolerances"]["range over stable members"]
    assert ranges["max sigma(S)"][0] < parameters["robustness"]["max sigma(S)"] < ranges["max sigma(S)"][1]
    with np.load(tmp_path / "m.npz") as model:
        assert float(model["dt"]) == 0.02 and model["A"].shape[0] == len(model["states"])


def test_a_gain_outside_its_range_is_noted_and_a_loop_in_its_dead_zone_is_stable():
    low, high = load_robot("exo_index").ranges["finger.kappa.MCP"]
    found = run("analyse", "--draws", 0, "--set", f"finger.kappa.MCP={1.1 * high}", "--effect", "motor.dead_zone")
    assert found.exit_code == 0, found.output
    assert f"lies outside {low:g} to {high:g}" in found.stderr
    assert "stable: simulated, a kick dies out" in found.output and "growing" not in found.output


def test_a_channel_whose_command_does_not_act_is_named_and_has_no_frame_map():
    """A joint in the dead band of its servo; the other joints have one, and the margins 2 / 0.1 of the integral."""
    found = exo.analyse(exo.load_robot("so101").splice("servo.dead_band", channels=["Rotation"]))
    assert [m.channel for m in found.margins if not m.acts] == ["Rotation"]
    assert any(note.startswith("the command of Rotation does not act on its reading here") for note in found.notes)
    assert found.margins[1].gain_margin_db == pytest.approx(20.0 * np.log10(20.0), abs=0.02)
    lines = [[line.get_label() for line in axes.lines] for axes in plot_bode(found).axes[:2]]
    assert ["frame map" in labels for labels in lines] == [False, True]


def test_a_machine_without_a_loop_is_refused_in_one_sentence(arm_folder):
    made(arm_folder, "measured", "--urdf", "rotary_axis")
    for name in ("analyse", "tune"):
        result = run(name, "--robot", "measured")
        assert result.exit_code == 2
        assert "no closed loop to analyse" in result.output and len(result.output.splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--at", "AF=4"], "MF"), (["--at", "AF:4"], "AF:4"), (["--at", "AF=4,AF=3"], "'AF' comes twice"),
        (["--set", "controller.kpp=1"], "kpp"), (["--effect", "no.such"], "no.such"), (["--part", "x"], "'x'"),
        (["--robot", "absent.yaml"], "absent.yaml"), (["--set", "controller.kp=0"], "kp = 0"),
        (["--at", "AF=nan,MF=1,AE=1"], "AF"), (["--at", "smal"], "did you mean small"),
        (["--diagnosis", "absent.json"], "absent.json"), (["--diagnosis", __file__], "not JSON"),
    ],
)  # fmt: skip
def test_bad_input_is_a_line_and_leaves_nothing(tmp_path, arguments, word):
    found = run("analyse", *arguments, "--out", tmp_path / "a")
    assert found.exit_code == 2
    assert word in found.output and len(found.output.strip().splitlines()) == 1
    assert not (tmp_path / "a").exists()


def test_what_new_machine_made_is_analysed_and_tuned(arm_folder):
    """The held integral about servos without dynamics: L = ki T / (z - 1), so a gain margin of 2 / 0.1 and 26 dB."""
    made(arm_folder, "servos", "--joints", "J1")
    (arm_folder / "mixed.urdf").write_text(MIXED)
    made(arm_folder, "arm", "--urdf", arm_folder / "mixed.urdf", "--form", "closed-loop")
    servos, arm = (exo.analyse(exo.load_robot(name)) for name in ("servos", "arm"))
    assert [m.gain_margin_db for m in servos.margins] == pytest.approx([20.0 * np.log10(20.0)], abs=0.02)
    assert servos.steps[0].overshoot < 1e-9 and servos.steps[0].settling < 0.021
    assert arm.stable and all(margin.gain_margin_db > 6.0 for margin in arm.margins)
    axis = made(arm_folder, "axis", "--urdf", "linear_axis", "--form", "closed-loop")
    turning = made(arm_folder, "turning", "--urdf", "rotary_axis", "--form", "closed-loop")
    stuck = exo.analyse(turning.splice("arm.coulomb_friction"))  # slopes differ by step size, not by side
    assert stuck.stable and not stuck.model.decides and stuck.model.kink <= KINK
    cable = made(arm_folder, "cabled", "--urdf", "cable_arm", "--form", "cable")
    assert all(robot.machine.loop.command == "effort_ref" for robot in (axis, cable))
