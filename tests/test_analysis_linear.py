"""The frame map, its derivatives and poles, with the simulated loop as witness; the sign of kd (`physics.md` 1.3)."""

import numpy as np
import pytest

import exodrake as exo
from exodrake.analysis import margins
from exodrake.analysis.closed_loop import list_remarks
from exodrake.analysis.linear_model import (
    FrameMap,
    Pole,
    linearise,
    linearise_robot,
    operating_point,
    resolve_references,
)
from exodrake.analysis.margins import latency_sweep, stability_map
from exodrake.analysis.responses import returns
from exodrake.cli.control import describe_course
from exodrake.physics import controller


def test_poles_read_as_in_continuous_time():
    """exp(s T) of s = +-4 1/s changes e-fold in 0.25 s; what rounding leaves of |z| = 1 is no time constant."""
    pole = Pole.from_z(np.exp(complex(-3.0, 4.0) * 0.02), 0.02)
    assert pole.frequency == pytest.approx(5.0 / (2.0 * np.pi))
    assert (pole.damping, pole.time_constant) == (pytest.approx(0.6), pytest.approx(1.0 / 3.0))
    for z, said in (
        (np.exp(0.08 + 0.3j), "grows in 0.25 s"), (np.exp(-0.08), "decays in 0.25 s"), (1.0 - 2.5e-13, "stays"),
        (1.0 + 2.5e-13, "stays"), (np.exp(0.7j) * (1.0 + 1e-15), "stays"),
    ):  # fmt: skip
        assert describe_course(Pole.from_z(complex(z), 0.02).time_constant) == said


def test_differences_at_rest_have_converged(point, model):
    assert point.output == pytest.approx([4.0, 3.0, 1.0], abs=1e-6)
    assert point.steady and not point.slack and point.residual < 1e-7
    assert model.convergence < 1e-4 and model.kink < 1e-3
    assert not any("clock" in s or "history" in s or "pictures" in s for s in model.system.state_labels)


def test_the_slowest_pole_is_the_decay_of_a_small_perturbation(loop, point, model):
    state = point.state.copy()
    names = [n for _, _, n in loop.states]
    state[names.index("motor.theta.AF")] += 1e-5
    rows = np.tile(point.references, (200, 1))
    away = (loop.run(state, rows)[1] - loop.run(point.state, rows)[1])[:, loop.signals["tension"]][:, 0]
    slow = model.poles()[0].z
    assert slow.imag == 0.0
    assert (away[160] / away[100]) ** (1.0 / 60.0) == pytest.approx(slow.real, abs=1e-5)


def test_the_linear_model_follows_a_small_step(loop, point, model):
    rows = np.tile(point.references, (80, 1))
    rows[:, 1] += 1e-3
    _, wires = loop.run(point.state, rows)
    x, push = np.zeros(model.system.nstates), np.array([0.0, 1e-3, 0.0])
    for n in range(80):
        y = model.system.C @ x + model.system.D @ push
        seen = wires[n, loop.signals["tension_read"]] - point.output
        assert seen == pytest.approx(y[:3], abs=1e-6)
        x = model.system.A @ x + model.system.B @ push


def test_radius_above_one_is_divergence(loop, point):
    """Random gains: the nonlinear simulation leaves its rest exactly where the spectral radius exceeds 1."""
    rng, decided = np.random.default_rng(3), []
    for _ in range(12):
        late = loop.with_values({"controller.kp": rng.uniform(1e-3, 0.03), "controller.kd": rng.uniform(-4e-4, 4e-4)})
        here = linearise(late, point)
        if abs(here.spectral_radius - 1.0) < 0.01:
            continue
        rows = np.tile(point.references, (600, 1))
        rows[0] += 1e-4
        _, wires = late.run(point.state, rows)
        away = np.abs(wires[:, loop.signals["tension"]] - point.output).max(axis=1)
        assert (away[-50:].max() > away[:50].max()) == (here.spectral_radius > 1.0)
        decided.append(here.spectral_radius > 1.0)
    assert 2 < sum(decided) < len(decided) - 2


def test_the_map_agrees_with_single_linearisations(loop, point, model, monkeypatch):
    monkeypatch.setattr(margins, "GAINS", 4)
    found = stability_map(model)
    for i, d in enumerate(found.second):
        for j, p in enumerate(found.first):
            there = loop.with_values({"controller.kp": p, "controller.kd": d})
            assert found.radius[i, j] == pytest.approx(linearise(there, point).spectral_radius, abs=1e-5)
    assert found.limit[2] > found.limit[1] > 0.012


def test_latency_ends_stability(loop, point, model):
    sweep = latency_sweep(model)
    assert sweep is not None
    assert 4.0 < sweep.limit < 6.0
    late = loop.with_values({"timing.command_latency.frames": 6.0})
    rows = np.tile(point.references, (800, 1))
    rows[0] += 1e-4
    away = np.abs(late.run(point.state, rows)[1][:, loop.signals["tension"]] - point.output).max(axis=1)
    assert away[-50:].max() > away[50:100].max()


@pytest.mark.parametrize(
    ("at", "word"),
    [
        ({"AF": 4.0}, "names AF; wanted AF, MF, AE"),
        ({"AF": 1, "MF": 1, "AE": 1, "XX": 1}, "XX"),
        ({"AF": 99, "MF": 1, "AE": 1}, "99"),
    ],
)
def test_bad_operating_points_are_named(at, word):
    with pytest.raises(exo.InputError, match=word):
        resolve_references(FrameMap.from_robot(exo.load_robot()), at)


def test_friction_is_reported_as_a_kink_and_simulation_decides():
    """Stuck wires make one-sided slopes differ and the poles meaningless; the loop itself returns to rest."""
    model = linearise_robot(exo.load_robot().splice("tendon.coulomb_friction"))
    assert model.kink > 0.1
    assert any("kink" in note for note in list_remarks(model))
    assert returns(model.loop, model.point)


def test_creep_leaves_no_operating_point():
    with pytest.raises(exo.InputError, match=r"does not come to rest.*\(tendon\.creep\)"):
        operating_point(FrameMap.from_robot(exo.load_robot().splice("tendon.creep")))


@pytest.mark.parametrize("effect", ["finger.tremor", "sensor.drift"])
def test_what_acts_from_outside_moves_no_pole(effect):
    robot = exo.load_robot()
    model, nominal = (linearise_robot(one) for one in (robot.splice(effect), robot))
    assert model.loop.outside == (effect,) and np.array_equal(model.system.A, nominal.system.A)


@pytest.mark.parametrize(("kd", "radius"), [(1e-4, 0.9621), (-1e-4, 0.9596), (3.75e-4, None), (-3.75e-4, None)])
def test_the_printed_sign_of_kd_on_the_robot(kd, radius):
    """Both are stable at nominal gains; three times the damping is stable as corrected, unstable as printed."""
    found = linearise_robot(exo.load_robot().with_parameters({"controller.kd": kd})).spectral_radius
    assert found == pytest.approx(radius, abs=1e-3) if radius else (found < 1.0) == (kd > 0.0)
    assert controller.damping_as_printed(1.7, kd) == controller.damping(1.7, -kd)


@pytest.mark.parametrize("gain", [-1.0, -0.05])
def test_a_loop_of_the_wrong_sign_that_comes_to_rest_at_its_limits_is_not_stable(gain):
    """Tensions run away until commands and stops hold them, far off their references."""
    model = linearise_robot(exo.load_robot().with_parameters({"controller.kp": gain}, source="test"))
    assert not returns(model.loop, model.point) and model.spectral_radius > 1.0
