"""The second reality's numerics against Drake's MultibodyPlant and scipy's Radau."""

import numpy as np
import pytest

from exodrake.blind.layout import INPUT_SIZE, STATE_SIZE, tolerance_vector
from exodrake.blind.numbers import draw_numbers
from exodrake.blind.reality import Planted, RealitySpec, assemble, initial_state


def test_rigid_body_terms_equal_drakes():
    from exodrake.blind.chain import numeric_plant
    from exodrake.blind.chain_generated import gravity_torque, mass_matrix, velocity_bias

    record = assemble(RealitySpec(draw_numbers(np.random.default_rng(1))), 2, None).record
    length, mass, centre, inertia = (record[name] for name in ("length", "mass", "centre", "unit_inertia"))
    plant = numeric_plant(length, mass, centre, inertia, (1.5, -9.0, 0.0))
    context = plant.CreateDefaultContext()
    rng = np.random.default_rng(2)
    for _ in range(20):
        q, v = rng.uniform(-0.5, 2.0, 3), rng.uniform(-9.0, 9.0, 3)
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        shape = (length[0], length[1], *mass, *centre)
        upper = mass_matrix(q[1], q[2], *shape, *inertia)
        assert upper == pytest.approx(plant.CalcMassMatrix(context)[np.triu_indices(3)], rel=1e-12)
        assert velocity_bias(q[1], q[2], *v, *shape, *inertia) == pytest.approx(plant.CalcBiasTerm(context), rel=1e-9)
        pull = np.array(gravity_torque(*q, *shape))
        wanted = plant.CalcGravityGeneralizedForces(context)
        assert 1.5 * pull[:3] - 9.0 * pull[3:] == pytest.approx(wanted, rel=1e-9)


def test_generated_source_is_up_to_date(tmp_path):
    from exodrake.blind import chain, chain_generated

    chain.generate(tmp_path / "again.py")
    with open(chain_generated.__file__) as stream:
        assert (tmp_path / "again.py").read_text() == stream.read()


def test_integrator_agrees_with_radau():
    from scipy.integrate import solve_ivp

    from exodrake.blind.field import derivative
    from exodrake.blind.integrate import advance, workspace

    effects = (
        Planted("tendon.capstan_friction", parameters={"mu_phi": 0.3}),
        Planted("tendon.creep", parameters={"stiffness": 6000.0, "time_constant": 5.0}),
        Planted("tendon.compliance", parameters={"stiffness": 2000.0}),
        Planted("finger.viscoelasticity", parameters={"fraction": 0.3, "time_constant": 2.0}),
    )
    build = assemble(RealitySpec(effects=effects, noisy=False), 10, None)
    command = np.array([0.05, 0.02, 0.01])
    y = initial_state(build.record)
    scratch = np.zeros(INPUT_SIZE), np.zeros(3), np.zeros((3, 3))

    def slope(time, state):
        rate = np.zeros(STATE_SIZE)
        derivative(time, state, rate, build.record, command, build.inputs, *scratch)
        return rate

    wanted = solve_ivp(slope, (0.0, 0.1), y, method="Radau", rtol=1e-7, atol=1e-9).y[:, -1]
    tolerance = tolerance_vector()
    assert advance(0.0, 0.1, y, 1e-4, build.record, command, build.inputs, tolerance, workspace(STATE_SIZE)) > 0
    assert np.all(np.abs(y - wanted) < 10 * (tolerance + 1e-3 * np.abs(wanted)))
