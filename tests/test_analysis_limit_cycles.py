"""Describing functions against closed forms, and limit cycles as simulated."""

import numpy as np
import pytest

import exodrake as exo
from exodrake.analysis.limit_cycles import (
    WINDOW,
    CommandedLoop,
    describing_function,
    find_crossing,
    find_dead_band,
    limit_cycles,
)
from exodrake.analysis.linear_model import FrameMap, operating_point
from exodrake.analysis.margins import open_channel, open_loop, open_responses


@pytest.fixture(scope="module")
def commanded(point, model):
    """The loop of a robot with the command of its second channel set from outside."""
    return lambda robot: CommandedLoop(
        FrameMap.from_robot(robot), point.references, model.system.D[model.rows("speed_cmd")], 1
    )


def test_without_a_nonlinearity_it_is_the_linear_plant(loop, model, commanded, point):
    plant, one = commanded(loop.robot), open_channel(open_loop(model), 1)
    for cycles in (2, 8, 15):
        found = describing_function(plant, point.state, 1e-4, cycles)
        expected = open_responses(one, np.array([cycles / (WINDOW * 0.02)]))[1][0, 0, 0]
        assert found == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("ratio", [1.5, 3.0, 8.0])
def test_of_a_dead_zone_that_passes_what_exceeds_it(loop, commanded, point, ratio):
    """N(a) = 1 - 2/pi (asin u - u sqrt(1 - u^2)), u = width / a; sampled, 60 values a cycle."""
    width = 1e-3
    robot = loop.robot.splice("motor.dead_zone", {"width": width})
    u = 1.0 / ratio
    with_zone = describing_function(commanded(robot), point.state, ratio * width, 1)
    plain = describing_function(commanded(loop.robot), point.state, ratio * width, 1)
    expected = 1.0 - 2.0 / np.pi * (np.arcsin(u) - u * np.sqrt(1.0 - u**2))
    assert abs(with_zone / plain) == pytest.approx(expected, rel=0.06)


def test_crossing_of_a_relay_with_a_triple_lag():
    """L = 1 / (1 + j w)^3 crosses -1/8 at w = sqrt 3: factor 8."""
    f = np.linspace(0.05, 1.0, 400)
    factor, where = find_crossing(f, 1.0 / (1.0 + 2j * np.pi * f) ** 3)
    assert factor == pytest.approx(8.0, rel=1e-3) and 2.0 * np.pi * where == pytest.approx(np.sqrt(3.0), rel=1e-3)
    assert np.isnan(find_crossing(f, 1.0 / (1.0 + 2j * np.pi * f))).all()


def predict(cycles, factor=1.0):
    """Amplitude and frequency of the smallest limit cycle at a factor, where the factor grows with the amplitude."""
    k = int(np.flatnonzero((cycles.factor[:-1] <= factor) & (factor < cycles.factor[1:]))[0])
    share = (factor - cycles.factor[k]) / (cycles.factor[k + 1] - cycles.factor[k])
    size = cycles.amplitude[k] ** (1.0 - share) * cycles.amplitude[k + 1] ** share
    return size, cycles.frequency[k] * (1.0 - share) + cycles.frequency[k + 1] * share


def test_rounding_makes_the_predicted_limit_cycle_and_dead_zone_and_friction_none():
    found = {c.label: c for c in limit_cycles(exo.load_robot())}
    rounding = found["rounding, sensor.q_F"]
    size, frequency = predict(rounding)
    swing, beat = rounding.read_simulation()
    assert size == pytest.approx(swing, rel=0.5) and frequency == pytest.approx(beat, rel=0.25)
    near = np.flatnonzero(rounding.factors > 0.9 * rounding.limit)[0]
    assert predict(rounding, rounding.factors[near])[0] == pytest.approx(rounding.swing[near], rel=0.7)
    for name in ("motor.dead_zone", "tendon.coulomb_friction"):
        assert not (found[name].factor <= 1.0).any() and found[name].read_simulation() == (0.0, 0.0)
        beyond = found[name].factors > 1.1 * found[name].limit
        assert (found[name].swing[beyond] > 0.0).all()


def test_a_machine_without_saturation_has_no_bounded_motion_beyond_its_linear_limit():
    """Roundings of 1 um and friction are small against a motion that grows for a second."""
    cycles = limit_cycles(exo.load_robot("emps"))
    assert cycles
    for found in cycles:
        assert np.isinf(found.swing[found.factors > found.limit]).all() and found.read_simulation() == (0.0, 0.0)
        assert np.isfinite(found.swing[found.factors < 0.9 * found.limit]).all()


def test_smooth_effects_belong_to_the_linear_loop(monkeypatch):
    """The linear limit is the gain margin of the robot itself: of a soft tendon's, thrice the nominal one's."""
    import exodrake.analysis.limit_cycles as module

    robot = exo.load_robot().splice("tendon.compliance", {"stiffness": 1200.0})
    monkeypatch.setattr(module, "compare_cycles", lambda label, robot, model, channel, limit, *others: (label, limit))
    soft = dict(limit_cycles(robot))
    assert "tendon.compliance" not in soft and 7.0 < soft["motor.dead_zone"] < 9.5
    stuck = [pair for pair in limit_cycles(exo.load_robot().splice("tendon.coulomb_friction")) if "coulomb" in pair[0]]
    assert len(stuck) == 3 and 2.5 < min(limit for _, limit in stuck) < 2.8
    spoilt = robot.splice("tendon.coulomb_friction").without_effects()
    assert np.array_equal(spoilt.values, exo.load_robot().values)


def test_a_p_loop_rests_within_the_dead_zone_over_its_gain():
    """w / kp on either side: 0.5 mm/s over 6 mm/(s N); the derivative and the integral rest."""
    robot = exo.load_robot().splice("motor.dead_zone", {"width": 5e-4, "release": 1.0}, ["MF"])
    loop = FrameMap.from_robot(robot)
    band = find_dead_band(loop, operating_point(loop))
    assert band["tension_MF"] == pytest.approx(5e-4 / robot["controller.kp"], rel=0.05)


def test_the_channel_is_the_one_that_the_robots_own_effects_weaken():
    """A dead band of a servo lets no small command through; lines reach below the crossover of its slow outer loop."""
    robot = exo.load_robot("so101").splice("servo.dead_band", {"half_width": 0.02}, ["Elbow"])
    (found,) = limit_cycles(robot, own_only=True)
    assert found.channel == "Elbow" and found.line_frequency[0] < 0.5 * 0.796  # Hz, where ki / (2 pi f) = 1
    passed = np.abs(found.measured[:, 0])
    assert passed[found.amplitude < 0.02].max() < 1e-9 and (passed[found.amplitude > 0.05] > 0.3).all()
