"""A robot file: what is written is what is read, and what is wrong is refused by file and key."""

import subprocess
import sys

import numpy as np
import pytest
import yaml
from command_line import run

import exodrake as exo
from exodrake.core.errors import InputError
from exodrake.core.provenance import robot_digest
from exodrake.diagnosis.many import get_configuration
from exodrake.machines.robot_file import robot_files


def refusal(path, content) -> str:
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    with pytest.raises(InputError) as caught:
        exo.load_robot(path)
    assert path.name in str(caught.value)
    return str(caught.value)


def test_round_trip(tmp_path):
    """0.1 + 0.2 and a third have no short decimal; an infinite stiffness is an absent one."""
    robot = exo.load_robot().with_parameters({"tendon.k.MF": 0.1 + 0.2, "finger.kappa": 1 / 3})
    robot = robot.splice("tendon.capstan_friction", {"mu_phi": 0.1}, ["AE"]).with_part("controller_as_printed")
    exo.write_robot(robot, tmp_path / "robot.yaml")
    back = exo.load_robot(tmp_path / "robot.yaml")
    np.testing.assert_array_equal(back.values, robot.values)
    assert back.machine is robot.machine and [p.name for p in tmp_path.iterdir()] == ["robot.yaml"]


def test_limits_and_grasps_of_a_wearer_come_back(tmp_path):
    text = "base: exo_index\nlimits: {F_max: {value: {AF: 5.0, MF: 4.0, AE: 4.0}, unit: N}}\n"
    (tmp_path / "wearer.yaml").write_text(text + "grasps: {caging: {AF: 4.0, MF: 2.0, AE: 0.5}, own: {AF: 1.0}}\n")
    wearer = exo.load_robot(tmp_path / "wearer.yaml")
    exo.write_robot(wearer.with_parameters({"controller.kp": 0.002}), tmp_path / "tuned.yaml")
    tuned = exo.load_robot(tmp_path / "tuned.yaml")
    assert tuned.limits == wearer.limits and tuned.grasps == wearer.grasps
    assert tuned.limits["F_max"] == {"AF": 5.0, "MF": 4.0, "AE": 4.0} and tuned.grasps["caging"]["MF"] == 2.0
    assert tuned.grasps["narrow-pinch"] == exo.load_robot().grasps["narrow-pinch"]


def test_tolerances_and_ranges_of_a_robots_own_file_come_back(tmp_path):
    """A fitted robot differs from the next one of its kind by as much as the nominal one."""
    mine = yaml.safe_load(robot_files()["exo_index"].read_text())
    own = {"parameters": ["tendon.k.{w}"], "transform": "log", "prior_std": 0.3, "max_deviation": 0.9}
    mine["tolerances"] = [own, *mine["tolerances"][1:]]
    mine["parameters"] |= {
        "controller.kp": {"value": 0.003, "unit": "m/(N.s)", "range": [0.001, 0.007], "source": "me"}
    }
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(mine))
    robot = exo.load_robot(tmp_path / "mine.yaml").splice("tendon.slack")
    exo.write_robot(robot, tmp_path / "improved.yaml")
    back = exo.load_robot(tmp_path / "improved.yaml")
    np.testing.assert_array_equal(back.values, robot.values)
    assert back.machine.tolerances == robot.machine.tolerances != exo.load_robot().machine.tolerances
    assert back.ranges == robot.ranges and back.limits == robot.limits and back.grasps == robot.grasps
    assert back.sources["controller.kp"] == "me" and robot_digest(back) == robot_digest(robot)


@pytest.mark.parametrize("order", [("tendon.k.AF", "tendon.k"), ("tendon.k", "tendon.k.AF")])
def test_value_of_one_channel_holds_in_whatever_order_values_come(order, tmp_path):
    values = {"tendon.k": 2500.0, "tendon.k.AF": 2600.0}
    robot = exo.load_robot().with_parameters({name: values[name] for name in order})
    assert robot.channels("tendon.k").tolist() == [2600.0, 2500.0, 2500.0]
    stated = {name: {"value": values[name], "source": name} for name in order}
    page = {"base": "exo_index", "parameters": stated, "limits": {"F_max": {"AF": 5.0}}}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(page, sort_keys=False))
    robot = exo.load_robot(tmp_path / "robot.yaml")
    sources = [robot.sources[f"tendon.k.{tendon}"] for tendon in ("AF", "MF", "AE")]
    assert sources == ["tendon.k.AF", "tendon.k", "tendon.k"]
    assert robot.limits["F_max"] == exo.load_robot().limits["F_max"] | {"AF": 5.0}


def test_no_folder_is_refused_and_nothing_written(tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        exo.write_robot(exo.load_robot(), tmp_path / "nowhere" / "robot.yaml")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        ("base: absent.yaml", ["no robot file"]),
        ("[1, 2", ["line 1", "not YAML"]),
        ("\x00", ["not YAML"]),
        ("", ["nothing"]),
        ("5", ["5"]),
        ({"base": 5}, ["base", "5"]),
        ({"base": "exo_index", "machine": "subprocess:Popen"}, ["'machine'", "of its base"]),
        ({"base": "so101", "servos": {"frame": 0.05}}, ["'servos'", "of its base"]),
        ({"machine": "mine", "servos": {"frame": 0.05}}, ["a folder of its name, mine/robot.yaml"]),
        ({"base": "exo_index", "paramters": {}}, ["'paramters'", "parameters"]),
        ({"base": "exo_index", "parameters": [1]}, ["parameters", "[1]"]),
        ({"base": "exo_index", "parameters": {"tendon": {"k": "soft"}}}, ["tendon.k", "'soft'"]),
        ({"base": "exo_index", "parameters": {"tendon": {"k": 10**400}}}, ["tendon.k", "too large"]),
        ({"base": "exo_index", "parameters": {"tendon": {"q": 1}}}, ["tendon.q", "tendon.k"]),
        ({"base": "exo_index", "parameters": {"tendon": {"k": {"value": 1, "unit": "N"}}}}, ["[N]", "[N/m]"]),
        ({"base": "exo_index", "parameters": {"tendon": {"k": {"value": 1, "range": 3}}}}, ["tendon.k.range", "3"]),
        ({"base": "exo_index", "effects": {"tendon.slack": 0.1}}, ["tendon.slack", "0.1"]),
        ({"base": "exo_index", "effects": {"tendon.slick": {}}}, ["tendon.slick", "tendon.slack"]),
        ({"base": "exo_index", "parts": "controller_as_printed"}, ["parts", "list"]),
        ({"base": "exo_index", "limits": {"F_max": 12}}, ["limits.F_max", "12"]),
        ({"base": "exo_index", "limits": {"F_max": {"AF": "much"}}}, ["limits.F_max.AF", "'much'"]),
        ({"base": "exo_index", "grasps": {"caging": [7, 1, 1]}}, ["grasps.caging"]),
        ({"base": "exo_index", "parameters": {"tendon.k": {"value": 1, "range": [3, 2]}}}, ["3 exceeds 2"]),
        ({"base": "exo_index", "effects": {"sensor.pulley_capstan": {}}}, ["did you mean sensor.pulley_fric"]),
        ({"machine": "exo_thumb"}, ["exo_thumb"]),
        ({"machine": "exo_index"}, ["is missing"]),
    ],
)
def test_what_is_wrong_is_named(tmp_path, content, parts):
    message = refusal(tmp_path / "robot.yaml", content)
    for part in parts:
        assert part in message


def test_a_ring_of_bases(tmp_path):
    a, b = tmp_path / "a.yaml", tmp_path / "b.yaml"
    a.write_text(f"base: {b}\n")
    assert "comes back to itself" in refusal(b, {"base": str(a)})


def test_units_may_stand_with_the_number_or_beside_it(tmp_path):
    """2.5 N/mm is 2500 N/m and 42 mm are 0.042 m in every form."""
    path = tmp_path / "robot.yaml"
    for k in ("2.5 N/mm", {"value": 2.5, "unit": "N/mm", "range": [1, 14], "source": "tensile test"}):
        path.write_text(
            yaml.safe_dump({"base": "exo_index", "parameters": {"tendon.k": k, "finger.length.MCP": "42mm"}})
        )
        robot = exo.load_robot(path)
        np.testing.assert_array_equal(robot["tendon.k"], 2500.0)
        assert robot["finger.length.MCP"] == pytest.approx(0.042)
    stated = robot.parameters()["tendon.k.MF"]
    assert (stated.low, stated.high, stated.unit, stated.source) == (1000.0, 14000.0, "N/m", "tensile test")
    path.write_text("base: exo_index\nlimits: {F_max: {value: {AF: 2, MF: 1, AE: 1}, unit: kgf}}\n")
    assert exo.load_robot(path).reference_limits()[1] == pytest.approx([19.6133, 9.80665, 9.80665])
    assert "F_max.AF is in [N], not in [m]" in refusal(path, {"base": "exo_index", "limits": {"F_max": {"AF": "2 m"}}})


@pytest.mark.parametrize(
    "change",
    [
        {"parts": ["controller_as_printed"]},
        {"limits": {"F_max": {"value": {"AF": 5.0, "MF": 4.0, "AE": 4.0}, "unit": "N"}}},
        {"tolerances": [{"parameters": ["tendon.k.{w}"], "transform": "log", "prior_std": 0.2, "max_deviation": 0.6}]},
    ],
    ids=lambda change: next(iter(change)),
)
def test_answers_are_told_apart_for_robots_that_differ_in_more_than_parameters(tmp_path, change):
    """Each of these changes what is simulated or fitted, and leaves the vector of parameters as it is."""
    nominal = yaml.safe_load(robot_files()["exo_index"].read_text())
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(nominal))
    (tmp_path / "b.yaml").write_text(yaml.safe_dump(nominal | change))
    one, again, other = (exo.load_robot(tmp_path / name) for name in ("a.yaml", "a.yaml", "b.yaml"))
    np.testing.assert_array_equal(one.values, other.values)
    assert robot_digest(one) == robot_digest(again) != robot_digest(other)
    assert get_configuration(str(tmp_path / "a.yaml")) != get_configuration(str(tmp_path / "b.yaml"))


def test_a_robot_of_a_machine_of_ones_own_stands_alone_beside_its_folder(tmp_path, monkeypatch):
    """In another process, which knows of the machine by its folder alone; a fitted effect keeps its source."""
    monkeypatch.setenv("EXODRAKE_PLUGINS", "")
    assert run("new-machine", tmp_path / "lone_servo", "--joints", "J1,J2").exit_code == 0
    (tmp_path / "worn.yaml").write_text(
        "base: lone_servo\neffects: {servo.play: {half_width: {value: {J2: 0.02}, source: fitted to b}}}\n"
    )
    (tmp_path / "far.yaml").write_text("base: worn.yaml\nparameters: {servo.ratio.J1: 0.9}\n")
    code = f"import exodrake as exo; exo.write_robot(exo.load_robot({str(tmp_path / 'far.yaml')!r}), 'all.yaml')"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)
    back = exo.load_robot(tmp_path / "all.yaml")
    assert back.effects() == {"servo.play": {"half_width": {"J1": 0.0, "J2": 0.02}}} and back["servo.ratio.J1"] == 0.9
    assert back.parameters()["servo.play.half_width.J2"].source == "fitted to b"


@pytest.mark.parametrize("given", ["arm_at_home", "arm_at_home/robot.yaml", "arm_at_home/mine.yaml"])
def test_a_machines_folder_or_a_robot_file_beside_its_code_loads_it_without_more(tmp_path, given):
    assert run("new-machine", tmp_path / "arm_at_home", "--joints", "J1").exit_code == 0
    (tmp_path / "arm_at_home" / "mine.yaml").write_bytes((tmp_path / "arm_at_home" / "robot.yaml").read_bytes())
    code = f"import exodrake as exo; print(exo.load_robot({given!r}).machine.axes.joints)"
    python = (sys.executable, "-c", code)
    command = (sys.executable, "-m", "exodrake", "robot", given)
    for words, said in ((python, "('J1',)"), (command, "machine arm_at_home")):
        found = subprocess.run(words, check=True, cwd=tmp_path, capture_output=True, text=True)
        assert said in found.stdout, found.stderr


def test_a_robot_file_that_is_not_there_is_answered_by_those_nearby(tmp_path):
    (tmp_path / "answer").mkdir()
    exo.write_robot(exo.load_robot("emps"), tmp_path / "answer" / "improved.yaml")
    for name in ("improved.yaml", "answer/improved.yml"):
        with pytest.raises(exo.InputError, match=r"no robot file .*; did you mean .*answer/improved\.yaml\?"):
            exo.load_robot(tmp_path / name)
