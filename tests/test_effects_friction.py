"""Friction that takes its work from somewhere: closed forms, energy, and an integrator of scipy's."""

from math import exp, pi

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from exodrake.effects import friction, motor, sensor, tendon
from exodrake.physics.tendon import move_slide

K, MU, DT = 2700.0, 0.6, 0.002  # N/m, -, s


def sheath(strokes, takens, mu=MU) -> np.ndarray:
    """Tensions (steps, 2) [N] at cell and finger, and elastic energy [J], of a wire whose ends move [m]."""
    pieces, before, rows = (0.0,) * 5, 0.0, []
    for stroke, taken in zip(strokes, takens, strict=True):
        stretched, travel = max(0.0, stroke - taken), taken - before
        near = tendon.near_end(K * stretched, stretched, travel, mu, *pieces)
        far = tendon.far_end(near, stretched, travel, mu, *pieces)
        pieces = tendon.settle_sheath(0.002, stretched, travel, mu, *pieces)
        assert sum(pieces) == pytest.approx(stretched, abs=1e-15)
        rows.append((near, far, 2.5 * K * sum(piece**2 for piece in pieces)))
        before = taken
    return np.array(rows)


def test_sheath_in_full_slip_is_a_capstan() -> None:
    s = np.linspace(0.0, 0.004, 200)
    near, far, _ = sheath(s, 0.0 * s).T
    assert far[1:] / near[1:] == pytest.approx(np.full(199, exp(-MU)))


def test_sheath_pulled_at_a_held_finger_is_stiffer_as_in_the_continuum() -> None:
    """T = T_c exp(-mu x) all along and the stretches add up: T_c = k s mu / (1 - exp(-mu))."""
    near = sheath([0.004], [0.0])[0, 0]
    assert near == pytest.approx(K * 0.004 * MU / (1.0 - exp(-MU)), rel=0.01)


def test_a_spool_that_reverses_at_a_blocked_finger_shows_hysteresis() -> None:
    """On the way back the tension is lower, the finger keeps its own at first, and a cycle costs work."""
    there = np.linspace(0.003, 0.005, 400)
    course = np.concatenate([np.linspace(0, 0.003, 100), *(there, there[::-1]) * 2])
    near, far, _ = sheath(course, 0.0 * course).T
    up, down = near[900:1300], near[1300:][::-1]
    assert up[200] - down[200] > 1.0
    assert far[1300] == pytest.approx(far[1301]) and near[1300] - near[1301] > 0.02
    assert np.sum(0.5 * (near[900:] + near[899:-1]) * np.diff(course[899:])) > 1e-3  # J; of a lumped capstan: none


@pytest.mark.parametrize("seed", range(6))
def test_sheath_never_gives_energy(seed: int) -> None:
    """Work at both ends covers the change of elastic energy in every step of a random motion, slack spells included."""
    rng = np.random.default_rng(seed)
    courses = [np.cumsum(np.repeat(rng.normal(0.0, 2e-6, 60), 100)) for _ in range(2)]
    strokes, takens = 0.003 + courses[0], courses[1]
    near, far, energy = sheath(strokes, takens).T
    ratio = near[far > 0] / far[far > 0]
    assert ratio.min() > exp(-MU) - 1e-9 and ratio.max() < exp(MU) + 1e-9
    work = 0.5 * (near[1:] + near[:-1]) * np.diff(strokes) - 0.5 * (far[1:] + far[:-1]) * np.diff(takens)
    assert (work - np.diff(energy)).min() > -1e-6 * np.abs(work).max() - 1e-9
    assert np.sum(work - np.diff(energy)) > 1e-3


def test_pulley_takes_its_work_from_the_motor() -> None:
    """Strands in the ratio of a capstan over half a turn, the reading their mean; a cycle costs the motor its loop."""
    mu, tension, reach, state = 0.04, 6.0, 0.01, (0.0, 0.0)
    course = reach * np.sin(np.linspace(0.0, 4 * pi, 8001))
    work = 0.0
    for k, step in enumerate(np.diff(course)):
        state = sensor.settle_pulley(0.002, 0.0, tension, step, mu, 5e-5, *state)
        near = sensor.pull_at_spool(tension, mu, 5e-5, *state)
        assert sensor.average_strands(tension, mu, 5e-5, *state) == pytest.approx(0.5 * (near + tension))
        work += near * step * (k >= 4000)
    assert work == pytest.approx(2.0 * reach * tension * (exp(mu * pi) - exp(-mu * pi)), rel=1e-2)


def capstan(load, travel, state):
    """Friction [N] after a travel under a load, and the states; so are the next ones."""
    force = load - tendon.capstan(load, travel, 0.3, *state)
    return force, (tendon.settle_capstan(DT, load, travel, 0.3, *state),)


def pulley(load, travel, state):
    state = sensor.settle_pulley(DT, state[1] + travel, load, 0.0, 0.15, 5e-5, *state)
    return sensor.pull_at_spool(load, 0.15, 5e-5, *state) - load, state


def gear(load, travel, state):
    felt, *state = motor.lose_in_gear(load, state[1] + travel, 0.65, *state)
    return felt - load, state


def coulomb(load, travel, state):
    slide = move_slide(state[0], travel, 5e-5, load)
    return load - tendon.coulomb(load, slide, 0.4), (slide,)


def dahl(load, travel, state):
    force = load - tendon.dahl(load, travel, 0.4, 8000.0, *state)
    return force, (tendon.settle_dahl(DT, load, travel, 0.4, 8000.0, *state),)


def stops(load, travel, state):
    force = load - tendon.prandtl_ishlinskii(load, travel, 0.4, 5e-5, *state)
    return force, tendon.settle_stops(DT, load, travel, 0.4, 5e-5, *state)


def lugre_law(load, travel, state):
    law = (0.4, 1.4, 0.005, 8000.0, 5.0, *state)
    force = load - tendon.lugre(load, travel, travel / DT, *law)
    return force, (tendon.settle_lugre(DT, load, travel, *law),)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "law, states, heaviest",
    [
        (capstan, 1, 12.0), (pulley, 2, 12.0), (gear, 2, 12.0),
        (coulomb, 1, 0.12), (dahl, 1, 0.12), (stops, 3, 0.12), (lugre_law, 1, 0.12),
    ],
)  # fmt: skip
def test_no_cycle_of_load_and_motion_gains_energy(law, states, heaviest, seed) -> None:
    """What was never loaded has nothing to give: in under a light load and out under a heavy one, at random."""
    rng, state, work, least = np.random.default_rng(seed), (0.0,) * states, 0.0, 0.0
    for _ in range(400):
        light, heavy = np.sort(rng.uniform(0.0, heaviest, 2))
        there = rng.uniform(1e-6, 6e-5) * rng.choice([-1.0, 1.0])
        for load, way in ((light, there), (heavy, -there), (rng.uniform(0.0, heaviest), 0.0)):
            for step in np.diff(np.linspace(0.0, way, 60)):
                force, state = law(load, step, state)
                work += force * step
                least = min(least, work)
    assert least > -1e-12 and work > 1e-5


LUGRE = {"coulomb": 0.4, "ratio": 1.5, "stribeck_speed": 0.005}
SIGMA_0, SIGMA_1 = 1000.0, 5.0


def lugre_run(speeds, dt: float) -> np.ndarray:
    """Friction [N] at the end of each step of a course of speeds [m/s]."""
    z, forces = 0.0, []
    for v in speeds:
        after = friction.deflect_bristle(z, v * dt, friction.level(v, **LUGRE), SIGMA_0)
        forces.append(SIGMA_0 * after + SIGMA_1 * (after - z) / dt)
        z = after
    return np.array(forces)


def test_lugre_agrees_with_an_integrator() -> None:
    """A speed that swings through zero twice, against LSODA on the published equations."""

    def speed(t):
        return 0.02 * np.sin(2 * pi * 2.0 * t)

    def rate(t, z):
        return speed(t) - SIGMA_0 * abs(speed(t)) * z / friction.level(speed(t), **LUGRE)

    dt = 1e-4
    t = dt * np.arange(1, 10001)
    exact = solve_ivp(rate, (0.0, 1.0), [0.0], "LSODA", t_eval=t, rtol=1e-9, atol=1e-12, max_step=1e-3)
    wanted = SIGMA_0 * exact.y[0] + SIGMA_1 * np.array([rate(*row) for row in zip(t, exact.y[0], strict=True)])
    assert lugre_run(speed(t - 0.5 * dt), dt) == pytest.approx(wanted, abs=0.01)
    assert wanted.max() > 1.04 * LUGRE["coulomb"]


def test_lugre_slides_at_its_level_and_starts_as_a_spring_with_a_damper() -> None:
    for v in (1e-3, 0.005, 0.1, -0.1):
        assert lugre_run([v] * 5000, 0.002)[-1] == pytest.approx(np.sign(v) * friction.level(v, **LUGRE), rel=1e-6)
    v, dt = 1e-3, 1e-7
    assert lugre_run([v], dt)[0] == pytest.approx(SIGMA_1 * v + SIGMA_0 * v * dt, rel=1e-3)
    assert tendon.lugre(5.0, 1.0, 500.0, 0.4, 1.5, 0.005, SIGMA_0, SIGMA_1, 4e-4) == pytest.approx(4.6)


@pytest.mark.parametrize("amplitude", [1e-4, 1e-3, 1e-2])
def test_lugre_takes_energy_in_a_closed_cycle(amplitude: float) -> None:
    t = np.linspace(0.0, 4 * pi, 8001)
    steps = np.diff(amplitude * np.sin(t))
    forces = lugre_run(steps / 1e-3, 1e-3)
    assert np.sum(forces[4000:] * steps[4000:]) > 0.0
