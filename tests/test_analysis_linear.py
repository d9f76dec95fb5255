"""The frame map, its derivatives and its poles: a toy of known poles, and the simulated loop as witness."""

from types import SimpleNamespace

import numpy as np
import pytest

import exodrake as exo
from exodrake.analysis.closed_loop import list_remarks
from exodrake.analysis.linear_model import (
    FrameMap,
    Pole,
    differentiate_best,
    find_observed,
    linearise,
    name_states,
    operating_point,
    resolve_references,
)
from exodrake.analysis.margins import latency_sweep, stability_limit, stability_map
from exodrake.analysis.responses import returns
from exodrake.cli.analyse import course

KNOWN = np.array([0.95, 0.6 + 0.5j, 0.6 - 0.5j])


def toy():
    """A loop of known poles with a quadratic term, badly scaled, and a clock as fourth state."""
    block = np.array([[0.95, 0.3, 0.0], [0.0, 0.6, 0.5], [0.0, -0.5, 0.6]])
    scale = np.array([1e-3, 1.0, 1e3])
    a = block * scale[:, None] / scale

    def step(x, r, e):
        after = a @ x[:3] + scale * (0.1 * r[0] + 0.01 * (x[:3] / scale) ** 2)
        return np.append(after, x[3] + 0.02), after[:1]

    nothing = SimpleNamespace(step=1.0)
    return SimpleNamespace(stepper=lambda: step, noises=(), loop=nothing), np.append(scale, 1.0)


def test_a_toy_loop_has_its_known_poles():
    loop, size = toy()
    central, _, _, gap = differentiate_best(loop, np.zeros(4), np.zeros(1), 0.1 * size)
    a, c = central[:4, :4], central[4:, :4]
    keep = find_observed(a, c)
    assert list(keep) == [0, 1, 2]
    found = np.linalg.eigvals(a[np.ix_(keep, keep)])
    assert max(np.abs(found - p).min() for p in KNOWN) < 1e-9
    assert gap < 1e-9


def test_poles_read_as_in_continuous_time():
    s, period = complex(-3.0, 4.0), 0.02
    pole = Pole.from_z(np.exp(s * period), period)
    assert pole.frequency == pytest.approx(5.0 / (2.0 * np.pi))
    assert (pole.damping, pole.time_constant) == (pytest.approx(0.6), pytest.approx(1.0 / 3.0))


def test_a_mode_on_the_unit_circle_neither_decays_nor_grows():
    """exp(s T) of s = +4 1/s grows e-fold in 0.25 s; what rounding leaves of |z| = 1 is no time constant."""
    assert course(Pole.from_z(np.exp(4.0 * 0.02 + 0.3j), 0.02).time_constant) == "grows in 0.25 s"
    assert course(Pole.from_z(np.exp(-4.0 * 0.02 + 0j), 0.02).time_constant) == "decays in 0.25 s"
    for z in (1.0 - 2.5e-13, 1.0 + 2.5e-13, np.exp(0.7j) * (1.0 + 1e-15)):
        assert course(Pole.from_z(complex(z), 0.02).time_constant) == "stays"


def test_operating_point_is_at_rest(loop, point):
    assert point.output == pytest.approx([4.0, 3.0, 1.0], abs=1e-6)
    assert point.steady and not point.slack and point.residual < 1e-7


def test_differences_have_converged(model):
    assert model.convergence < 1e-4 and model.kink < 1e-3
    assert not any("clock" in s or "history" in s or "pictures" in s for s in model.system.state_labels)


def test_the_slowest_pole_is_the_decay_of_a_small_perturbation(loop, point, model):
    state = point.state.copy()
    names = [n for _, n in name_states(loop.robot.machine)]
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
    for _ in range(24):
        late = loop.with_values({"controller.kp": rng.uniform(1e-3, 0.03), "controller.kd": rng.uniform(-4e-4, 4e-4)})
        here = linearise(late, point.state, point.references)
        if abs(here.spectral_radius - 1.0) < 0.01:
            continue
        rows = np.tile(point.references, (600, 1))
        rows[0] += 1e-4
        _, wires = late.run(point.state, rows)
        away = np.abs(wires[:, loop.signals["tension"]] - point.output).max(axis=1)
        assert (away[-50:].max() > away[:50].max()) == (here.spectral_radius > 1.0)
        decided.append(here.spectral_radius > 1.0)
    assert 4 < sum(decided) < len(decided) - 4


def test_the_map_agrees_with_single_linearisations(loop, point):
    kp, kd = np.array([4e-3, 1.2e-2, 2.4e-2]), np.array([-2e-4, 1e-4])
    found = stability_map(loop, point, kp, kd)
    for i, d in enumerate(kd):
        for j, p in enumerate(kp):
            there = loop.with_values({"controller.kp": p, "controller.kd": d})
            assert found.radius[i, j] == pytest.approx(
                linearise(there, point.state, point.references).spectral_radius, abs=1e-5
            )
    assert found.limit[1] > found.limit[0] > 0.012


def test_latency_ends_stability(loop, point):
    sweep = latency_sweep(loop, point, np.array([0.0, 2.0, 4.0, 5.0, 6.0]))
    assert sweep is not None
    assert 4.0 < sweep.limit < 6.0
    late = loop.with_values({"timing.command_latency.frames": 6.0})
    rows = np.tile(point.references, (800, 1))
    rows[0] += 1e-4
    away = np.abs(late.run(point.state, rows)[1][:, loop.signals["tension"]] - point.output).max(axis=1)
    assert away[-50:].max() > away[50:100].max()


def test_an_unstable_loop_is_linearised_where_it_would_rest():
    loop = FrameMap.from_robot(exo.load_robot().with_parameters({"controller.kp": 0.03}))
    point = operating_point(loop)
    assert not point.steady
    assert linearise(loop, point.state, point.references).spectral_radius > 1.0


@pytest.mark.parametrize(
    ("at", "word"),
    [({"AF": 4.0}, "lacks"), ({"AF": 1, "MF": 1, "AE": 1, "XX": 1}, "XX"), ({"AF": 99, "MF": 1, "AE": 1}, "99")],
)
def test_bad_operating_points_are_named(at, word):
    with pytest.raises(exo.InputError, match=word):
        resolve_references(FrameMap.from_robot(exo.load_robot()), at)


def test_stability_limit():
    x = np.array([1.0, 2.0, 3.0])
    assert stability_limit(x, np.array([0.5, 0.9, 1.1])) == pytest.approx(2.5)
    assert stability_limit(x, np.array([1.5, 1.9, 2.1])) == 0.0
    assert np.isnan(stability_limit(x, np.array([0.5, 0.6, 0.7])))


def test_friction_is_reported_as_a_kink_and_simulation_decides():
    """Stuck wires make one-sided slopes differ and the poles meaningless; the loop itself returns to rest."""
    loop = FrameMap.from_robot(exo.load_robot().splice("tendon.coulomb_friction"))
    point = operating_point(loop)
    model = linearise(loop, point.state, point.references)
    assert model.kink > 0.1
    assert any("kink" in note for note in list_remarks(loop, point, model, ()))
    assert returns(loop, point)


def test_a_tremor_leaves_no_operating_point():
    with pytest.raises(exo.InputError, match="does not come to rest"):
        operating_point(FrameMap.from_robot(exo.load_robot().splice("finger.tremor")))
