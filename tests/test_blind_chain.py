"""The reference simulator's rigid-body terms against Drake's MultibodyPlant."""

import numpy as np
import pytest

from exodrake.reference.dynamics import inverse_dynamics, mass_matrix
from exodrake.reference.robot import RobotSpec, draw_parameters
from exodrake.reference.simulator import assemble

GRAVITY = (1.5, -9.0)


def plant_of(record):
    """MultibodyPlant of the finger with the record's lengths, centres, masses and unit inertias."""
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia, UnitInertia

    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector([*GRAVITY, 0.0])
    parent = plant.world_frame()
    for index in range(3):
        unit = UnitInertia(*[record["unit_inertia"][index]] * 3)
        centre = np.array([record["centre"][index], 0.0, 0.0])
        spatial = SpatialInertia(record["mass"][index], centre, unit, skip_validity_check=True)
        body = plant.AddRigidBody(f"phalanx_{index}", spatial)
        plant.AddJoint(RevoluteJoint(f"joint_{index}", parent, body.body_frame(), [0, 0, -1]))
        tip = RigidTransform([record["length"][index], 0, 0])
        parent = plant.AddFrame(FixedOffsetFrame(f"tip_{index}", body.body_frame(), tip))
    plant.Finalize()
    return plant


def test_rigid_body_terms_equal_those_of_multibody_plant():
    record = assemble(RobotSpec(draw_parameters(np.random.default_rng(1))), 2, None).record
    plant = plant_of(record)
    context, rng = plant.CreateDefaultContext(), np.random.default_rng(2)
    for _ in range(20):
        q, v, a = rng.uniform(-0.5, 2.0, 3), rng.uniform(-9.0, 9.0, 3), rng.uniform(-100.0, 100.0, 3)
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        matrix = plant.CalcMassMatrix(context)
        sine, cosine = tuple(np.sin(np.cumsum(q))), tuple(np.cos(np.cumsum(q)))
        assert np.array(mass_matrix(record, sine, cosine)) == pytest.approx(matrix, rel=1e-10)
        spins = tuple(np.cumsum(v)), tuple(np.cumsum(a))
        found = inverse_dynamics(record, sine, cosine, *spins, -GRAVITY[0], -GRAVITY[1])
        wanted = matrix @ a + plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
        assert found == pytest.approx(wanted, rel=1e-9)
