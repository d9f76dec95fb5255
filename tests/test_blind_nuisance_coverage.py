"""Where the nominal numbers of a robot of the reference simulator are, in the model's words."""

import numpy as np
import pytest

from exodrake.blind.nuisance_coverage import truth
from exodrake.blind.parameters import draw_parameters
from exodrake.diagnosis.nuisance import coordinates
from exodrake.machines.robot_file import load_robot


@pytest.fixture(scope="module")
def machine():
    return load_robot().machine


def true_numbers(machine, numbers):
    channels = machine.axes.tendons, machine.axes.joints
    found = truth(coordinates(machine), channels, numbers)
    return {coordinate.name.split()[0]: value for coordinate, value in zip(coordinates(machine), found, strict=True)}


def test_a_nominal_robot_errs_nowhere(machine):
    found = true_numbers(machine, draw_parameters())
    lacking = {name for name, value in found.items() if np.isnan(value)}
    assert lacking == {"finger.beta.MCP", "finger.beta.PIP", "finger.beta.DIP", "tendon.presliding"}
    assert all(value == pytest.approx(0.0, abs=1e-12) for name, value in found.items() if name not in lacking)


@pytest.mark.parametrize(
    "number, place, name, error",
    [
        ("wire_stiffness", 2, "tendon.k.AE", 0.04),
        ("stiffness_joint", 1, "finger.kappa.PIP", -0.03),
        ("axial", (1, 0), "router.a_e.MCP", 0.02),
        ("spool", 1, "motor.r.MF", 0.01),
        ("tau_cell", (), "sensor.tau_F", 0.05),
    ],
)
def test_one_number_that_errs_is_found_under_its_name(machine, number, place, name, error):
    numbers = draw_parameters()
    numbers[number] = np.array(numbers[number])
    numbers[number][place] *= 1.0 + error
    found = true_numbers(machine, numbers)
    assert found.pop(name) == pytest.approx(error)
    assert np.nansum(np.abs(list(found.values()))) == pytest.approx(0.0, abs=1e-12)


def test_angles_err_in_radians(machine):
    numbers = draw_parameters()
    numbers["rest"] = numbers["rest"] + np.array([0.0, 0.012, 0.0])
    assert true_numbers(machine, numbers)["finger.q0.PIP"] == pytest.approx(0.012)
