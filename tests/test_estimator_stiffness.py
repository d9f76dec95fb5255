"""Stiffness models: the corrected equations are inverse to each other, and the true stiffness is recovered."""

import numpy as np
import pytest
from estimator_sweeps import (
    KAPPA,
    REST,
    Wearer,
    arms,
    as_sweeps,
    passive,
    posture,
    reference,
    worn_sweeps,
)  # fmt: skip

from exodrake.core.errors import InputError
from exodrake.estimator.gp import condition, learn
from exodrake.physics import finger_statics as statics
from exodrake.physics.tendon_finger import Parameters
from studies.paper import stiffness
from studies.paper.printed_equations import tension_map_as_printed
from studies.paper.stiffness import compliance, router_arms, tension_map
from studies.paper.study import compare

EXACT = Wearer(stiffness=0.0, rest=0.0, zero=0.0, drift=0.0, friction=0.0)
TRIPLE = (5e-3, 5e-3, 5e-3)
N = Parameters(
    k=(2700.0,) * 3, presliding=5e-5, a_f=TRIPLE, b_f=TRIPLE, m_f=(3e-3,) * 3, n_f=(3e-3,) * 3, a_e=TRIPLE, b_e=TRIPLE,
    m_e=TRIPLE, n_e=TRIPLE, kappa=(0.080, 0.060, 0.035), q0=(0.20, 0.30, 0.15), B=(0.004, 0.002, 0.001),
    q_f=(1.30, 1.50, 0.95), q_e=(-0.30, 0.0, 0.0), beta=(12.0,) * 3, A=(0.002,) * 3, length=(0.04264, 0.02014, 0.01872),
    mass=(0.0119, 0.0045, 0.0032), radius=(0.009, 0.008, 0.007),
)  # fmt: skip


def test_equation_22_as_printed_does_not_invert_equation_21():
    r, kappa = router_arms(np.array([0.5, 1.0, 0.5]), N), np.array([0.08, 0.06, 0.035])
    np.testing.assert_allclose(compliance(r, kappa) @ tension_map(r, kappa), np.eye(3), atol=1e-12)
    assert np.linalg.norm(compliance(r, kappa) @ tension_map_as_printed(r, kappa) - np.eye(3)) > 0.1


def test_postures_balance_and_agree_with_the_tests_own_solver():
    tension = np.random.default_rng(1).uniform(0.0, [12, 8, 8], (300, 3))
    angle = statics.posture(tension, N)
    torque = np.einsum("nwj,nw->nj", arms(angle), tension)
    np.testing.assert_allclose(torque, passive(angle, KAPPA, REST), atol=1e-12)
    np.testing.assert_allclose(angle, posture(tension), atol=1e-9)
    np.testing.assert_allclose(statics.posture(np.zeros((1, 3)), N)[0], REST, atol=1e-12)


def test_true_stiffness_is_recovered_within_its_errors():
    rng = np.random.default_rng(2)
    kappa, rest = KAPPA * np.array([1.3, 0.8, 1.15]), REST + np.array([0.05, -0.1, 0.04])
    tension = np.concatenate(
        [reference(w, lv, 40) for w, lv in ((0, (0, 0)), (0, (0.6, 0.3)), (1, (0.3, 0)), (2, (0.6, 0)))]
    )
    angle = posture(tension, kappa, rest)
    exact = stiffness.fit_stiffness(tension, angle, N, statics.posture)
    np.testing.assert_allclose(exact.kappa, kappa, rtol=1e-6)
    np.testing.assert_allclose(exact.q0, rest, atol=1e-6)
    noisy = stiffness.fit_stiffness(tension, angle + rng.normal(0, 0.005, angle.shape), N, statics.posture)
    assert np.all(np.abs(np.array(noisy.kappa) - kappa) < 4 * np.array(noisy.kappa_error))
    np.testing.assert_allclose(noisy.kappa, kappa, rtol=0.02)
    np.testing.assert_allclose(noisy.rmse, 0.005, rtol=0.3)


def test_following_a_log_keeps_to_its_branch_and_agrees_where_there_is_only_one():
    data = worn_sweeps(1, seed=0, wearer=EXACT)
    angle = statics.follow(data["tension_ref"], N)
    np.testing.assert_allclose(angle, data["angle"], atol=0.01)  # marker noise is 0.002 rad
    weak = reference(0, (0.2, 0.0), 50)
    np.testing.assert_allclose(statics.follow(weak, N), statics.posture(weak, N), atol=1e-9)


def test_a_joint_that_did_not_move_is_refused():
    tension = np.tile([1.0, 1.0, 1.0], (50, 1))
    with pytest.raises(InputError, match="moved"):
        stiffness.fit_stiffness(tension, posture(tension), N)
    with pytest.raises(InputError, match="rows with tension and angle"):
        stiffness.fit_stiffness(tension[:5], posture(tension[:5]), N)


def test_data_beat_constant_stiffness_on_sweeps_held_out():
    training, held_out = as_sweeps(worn_sweeps(48, seed=0, rows=100)), as_sweeps(worn_sweeps(24, seed=1, rows=100))
    estimate = condition(learn(training, 250), training, 250).predict(held_out.tension, held_out.stroke)[0]
    found = compare(training, held_out, N, estimate)
    mean = {name: value.mean() for name, value in found.rmse.items()}
    assert mean["Gaussian process"] < mean["constant stiffness"]
    assert mean["end stops"] < mean["constant stiffness"]
