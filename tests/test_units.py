"""Units: every spelling, product and quotient in SI; a quantity of another kind is refused."""

from dataclasses import replace

import numpy as np
import pytest

import exodrake as exo
from exodrake.model.robot import implausible
from exodrake.model.units import quantity, read_unit, to_si


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("N/mm", "N/m", 1e3), ("N mm", "N m", 1e-3), ("mNm/rad", "N m/rad", 1e-3), ("g cm2", "kg m2", 1e-7),
        ("m/(s N)", "m/(s N)", 1.0), ("mm/(s N)", "m/(s N)", 1e-3), ("1/min", "1/s", 1 / 60), ("µm", "m", 1e-6),
        ("deg/s^2", "rad/s2", np.pi / 180), ("rev/min", "rad/s", np.pi / 30), ("rev/s", "rad/s", 2 * np.pi),
        ("N·m", "N m", 1.0), ("kgf mm", "N m", 9.80665e-3), ("°/s", "rad/s", np.pi / 180), ("", "-", 1.0),
        ("N m / rad", "N m/rad", 1.0), ("m/s/s", "m/s/s", 1.0),
    ],
)  # fmt: skip
def test_units_convert(unit, si, factor):
    assert read_unit(unit).si == si and to_si(1.0, unit) == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize("unit", ["lbf", "N/m s", "m//s", "/s", "()", "m/", "2", "m0", "%/s", "N mm)", "furlong/s"])
def test_what_is_no_unit_or_may_mean_two_things_is_refused(unit):
    with pytest.raises(exo.InputError, match="unknown unit"):
        read_unit(unit)


@pytest.mark.parametrize("text", ["2.5 N/mm", "2.5N/mm", "2500", "2.5e3 N/m", "0.25 kgf/mm"])
def test_a_quantity_is_the_same_in_every_notation(text):
    wanted = 2451.6625 if "kgf" in text else 2500.0
    assert quantity(text, "N/m", "k") == pytest.approx(wanted, rel=1e-15)


@pytest.mark.parametrize("value", ["x", "2 mm", "nan", "2.5 N/milimetre", True, None, 10**400, "", "2 2", "1e5e5 N/m"])
def test_what_is_no_such_quantity_is_refused_by_name(value):
    with pytest.raises(exo.InputError, match=r"tendon\.k"):
        quantity(value, "N/m", "tendon.k")


@pytest.mark.parametrize("value", ["0.05-0.06", ".5 - 1", "1 -2"])
def test_a_span_is_no_number_with_a_unit(value):
    with pytest.raises(exo.InputError, match="wanted a number"):
        quantity(value, "-", "ratio")
    assert quantity("0.5 -", "-", "ratio") == 0.5


def test_python_command_line_and_file_take_the_same_notation():
    robot = exo.load_robot()
    np.testing.assert_array_equal(robot.with_parameters({"tendon.k": "2.5 N/mm"})["tendon.k"], 2500.0)
    assert robot.splice("tendon.slack", {"length": {"AF": "2 mm"}})["tendon.slack.length.AF"] == 2e-3
    with pytest.raises(exo.InputError, match="does not sit on 'XX'"):
        robot.splice("tendon.slack", {"length": {"XX": 2e-3}})
    short = exo.protocol("caging:hold=500 ms", robot)
    assert len(short.values) == len(exo.protocol("caging:hold=0.5", robot).values)


@pytest.mark.parametrize(
    ("name", "value", "meant"),
    [
        ("tendon.k", 2.7, "2.7 N/mm"), ("finger.q0.PIP", 30, "30 deg"), ("finger.length.MCP", 42, "42 mm"),
        ("sensor.tau_F", 16, "16 ms"), ("motor.i_max", 300, "300 mA"), ("finger.mass", 12, "12 g"),
    ],
)  # fmt: skip
def test_a_value_outside_its_range_names_the_unit_that_was_meant(name, value, meant):
    (note,) = implausible(exo.load_robot().with_parameters({name: value}))
    assert name.rsplit(".", 1)[0] in note and f"did you mean {meant}?" in note


def test_values_of_effects_have_ranges_too():
    robot = exo.load_robot().splice("tendon.slack", {"length": 2}, ["AF", "MF"])
    (note,) = implausible(robot)
    assert note.startswith("tendon.slack.length (AF, MF) = 2 m lies outside 0.0001 to 0.005 m; did you mean 2 mm?")
    sources = dict.fromkeys(("tendon.slack.length.AF", "tendon.slack.length.MF"), "fitted to case on 2026-11-26")
    assert not implausible(replace(robot, sources=robot.sources | sources))  # what a diagnosis found itself
    assert not implausible(exo.load_robot()) and not implausible(exo.load_robot("emps"))


def test_tolerances_of_the_robot_file_are_stated():
    stated = exo.load_robot().parameters()
    assert stated["motor.r.AF"].texts["tolerance"] == "±1 %, at most 10 %"
    assert stated["finger.q0.DIP"].texts["tolerance"] == "±0.01 rad, at most 0.03"
    assert stated["motor.N"].tolerance is None and stated["motor.N"].source == "[P] gear 69:1"
