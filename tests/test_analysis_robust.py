"""Disk margins, singular values, coupling, noise and delays against python-control, identities and simulation."""

import json
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import control
import numpy as np
import pytest

import exodrake as exo
from exodrake.analysis.linear_model import linearise_robot, spectral_radius
from exodrake.analysis.margins import close, delay_budget, disk_margin, margins, open_channel, open_loop, open_responses
from exodrake.analysis.robustness import (
    band,
    points_band,
    relative_gains,
    robustness,
    within_intervals,
    within_tolerances,
)


@pytest.fixture(scope="module")
def whole(model):
    return open_loop(model)


@pytest.fixture(scope="module")
def found(model):
    return robustness(model)


def test_disk_margin_of_one_loop_is_that_of_python_control(whole):
    one = open_channel(whole, 1)
    f = np.geomspace(0.05, 24.9, 300)
    system = control.ss(one.A, one.B, -one.C[:1], 0.0, whole.dt)
    expected, gain, phase = control.disk_margins(system, 2.0 * np.pi * f, skew=0.0)
    alpha = disk_margin(1.0 / (1.0 + open_responses(one, f)[0])).min()
    assert alpha == pytest.approx(float(expected), rel=1e-6)
    assert 20.0 * np.log10((2.0 + alpha) / (2.0 - alpha)) == pytest.approx(float(gain), rel=1e-5)
    assert 2.0 * np.degrees(np.arctan(0.5 * alpha)) == pytest.approx(float(phase), rel=1e-5)


def structured(m, points=60):
    """mu for three complex scalars from below: the largest spectral radius of M U over diagonal unitary U."""
    turns = np.exp(2j * np.pi * np.arange(points) / points)
    return max(spectral_radius(m * np.array([1.0, a, b])) for a, b in product(turns, turns))


@pytest.mark.parametrize("seed", range(3))
def test_disk_margin_of_three_loops_is_exact(seed):
    """For up to three channels the scaled bound equals mu, which the unitary search reaches from below."""
    rng = np.random.default_rng(seed)
    s = rng.standard_normal((3, 3)) + 1j * rng.standard_normal((3, 3))
    assert 1.0 / disk_margin(s[None])[0] == pytest.approx(structured(s - 0.5 * np.eye(3)), rel=5e-3)


def test_disk_margin_of_the_loops_is_that_of_commands_that_err_together(whole, found):
    """That of separate loops is the least; gains (1 + d/2) / (1 - d/2) of real d below the margin keep it stable."""
    s = np.array([1.2 + 0.3j, 0.4 - 1.0j, 2.0 + 0.1j])
    assert disk_margin(np.diag(s)[None])[0] == pytest.approx(min(disk_margin(v.reshape(1, 1, 1))[0] for v in s))
    for d in np.random.default_rng(0).uniform(-1.0, 1.0, (40, 3)) * 0.98 * found.numbers["disk margin"]:
        assert spectral_radius(close(whole, (1.0 + d / 2.0) / (1.0 - d / 2.0))) < 1.0


def test_relative_gains_follow_bristol(found):
    """1 / (1 - G12 G21 / (G11 G22)); antagonists couple, and the third tendon hardly."""
    g = np.array([[[2.0, 0.5], [0.8, 1.0]]])
    assert relative_gains(g)[0] == pytest.approx([1.0 / (1.0 - 0.5 * 0.8 / 2.0)] * 2)
    assert found.numbers["relative gain AF"] > 1.8 and found.numbers["relative gain MF"] < 1.15


def test_singular_values_are_those_of_python_control(whole, found):
    sensitivity = control.ss(close(whole), whole.B, whole.C[:3], np.eye(3), whole.dt)
    values = control.singular_values_response(sensitivity, 2.0 * np.pi * found.frequency[:-1]).magnitude
    assert found.sigma_s[:-1] == pytest.approx(np.asarray(values).squeeze()[0], rel=1e-6)
    assert 1.66 < found.numbers["max sigma(S)"] < 1.76 and 0.78 < found.numbers["disk margin"] < 0.85


def test_margins_do_not_depend_on_the_grid_of_frequencies(whole, found):
    """240 frequencies here, 1800 there."""
    for j, name in enumerate(("AF", "MF", "AE")):
        fine = margins(whole, j)
        assert found.numbers[f"gain margin {name} [dB]"] == pytest.approx(fine.gain_margin_db, rel=1e-5)
        assert found.numbers[f"delay margin {name} [s]"] == pytest.approx(fine.delay_margin, rel=1e-5)


def test_noise_of_commands_is_that_of_the_simulation(loop, point, found):
    """Readings unrounded, 400 s after a transient."""
    _, signals = loop.run(point.state, np.tile(point.references, (20000, 1)), seed=4)
    simulated = signals[200:, loop.signals["speed_cmd"]].std(axis=0)
    noise = [found.numbers[f"noise of speed_cmd {c} [m/s]"] for c in loop.channels]
    assert noise == pytest.approx(simulated, rel=0.03)


def test_the_delay_budget_reads_the_schedule(loop, whole):
    """Slots of 2 ms: cells read in 1, 2, 3, the law in 4, drives written in 5, 6, 7, a frame of 20 ms held."""
    found = delay_budget(loop, tuple(margins(whole, i) for i in range(3)))
    assert [d.slots for d in found] == [(1, 4, 5), (2, 4, 6), (3, 4, 7)]
    assert [1e3 * d.total for d in found] == pytest.approx([18.0] * 3)
    assert found[1].spare_slots == pytest.approx(found[1].margin / 2e-3)


def test_a_law_that_runs_before_its_reading_has_that_of_the_frame_before(loop, whole):
    """Cells read in slots 5, 6, 7 of ten serve the law in slot 4 of the next frame, whose drives have 1, 2, 3 after."""
    machine, slots = loop.robot.machine, {"sensor": (5, 6, 7), "bus": (1, 2, 3)}
    parts = tuple(
        replace(p, tasks=tuple(replace(t, slots=slots[p.name]) if t.slots else t for t in p.tasks))
        if p.name in slots
        else p
        for p in machine.parts
    )
    other = SimpleNamespace(robot=SimpleNamespace(machine=replace(machine, parts=parts)), loop=loop.loop)
    found = delay_budget(other, tuple(margins(whole, i) for i in range(3)))
    assert [1e3 * d.to_control for d in found] == pytest.approx([18.0, 16.0, 14.0])
    assert [1e3 * d.to_write for d in found] == pytest.approx([14.0, 16.0, 18.0])


def test_bands_over_tolerances_and_points_hold_the_nominal_robot(found):
    robot = exo.load_robot()
    drawn = band("tolerances", within_tolerances(robot, 6))
    assert not drawn.failures and drawn.unstable == 0
    low, high = drawn.range("max sigma(S)")
    assert 1.6 < low < found.numbers["max sigma(S)"] < high < 1.8
    points = points_band(robot)
    assert [m.label for m in points.members] == ["middle", "small", "full"]
    assert points.members[0].numbers == pytest.approx(found.numbers, rel=1e-6, abs=1e-9)


def test_an_unstable_member_has_no_numbers_and_is_counted():
    robot = exo.load_robot()
    fast = robot.with_parameters({"controller.kp": 0.03})
    mixed = band("two", [("own", robot), ("fast", fast), ("shaky", robot.splice("tendon.creep"))])
    assert mixed.unstable == 1 and np.isnan(mixed.members[1].numbers["disk margin"])
    assert len(mixed.failures) == 1 and "shaky" in mixed.failures[0]
    assert mixed.range("disk margin")[0] == mixed.members[0].numbers["disk margin"]


def interval(value, low, high):
    return {"value": value, "low": low, "high": high, "unit": "m/s"}


def test_robots_within_the_intervals_of_a_diagnosis():
    channels = {"width": {"AF": interval(1e-3, 9e-4, 1.2e-3)}}
    effect = {"id": "motor.dead_zone", "wires": ["AF"], "joints": [], "parameters": {}, "channels": channels}
    answer = json.loads(json.dumps({"effects": [effect]}))
    drawn = [r["motor.dead_zone.width.AF"] for _, r in within_intervals(exo.load_robot(), answer, 400)]
    assert drawn[:2] == pytest.approx([9e-4, 1.2e-3])
    assert np.median(drawn) == pytest.approx(1e-3, rel=0.01)
    assert min(drawn) >= 9e-4 and max(drawn) <= 1.2e-3  # a stiffness just above 0 never turns negative
    assert all(r["motor.dead_zone.width.MF"] == 0.0 for _, r in within_intervals(exo.load_robot(), answer, 3))


@pytest.mark.parametrize(
    ("answer", "word"),
    [([], "no effect"), ({"effects": []}, "no effect"), ({"effects": [{"id": "x"}]}, "without id")],
)
def test_what_is_no_diagnosis_is_refused(answer, word):
    with pytest.raises(exo.InputError, match=word):
        list(within_intervals(exo.load_robot(), answer, 1))


def test_the_loop_of_another_machine_has_a_robustness():
    numbers = robustness(linearise_robot(exo.load_robot("emps"))).numbers
    assert numbers["disk margin"] == pytest.approx(numbers["disk margin carriage"])
    assert numbers["relative gain carriage"] == pytest.approx(1.0)
