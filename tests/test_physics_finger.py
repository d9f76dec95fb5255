"""The finger's equations against Drake's MultibodyPlant, closed forms and the power balance."""

import math

import numpy as np
import pytest
from diagram_runs import nominal
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, SpatialInertia

from exodrake.engine.inputs import Reference
from exodrake.physics import finger_statics, tendon_finger
from exodrake.physics.finger import coriolis, inertia, mass_matrix
from exodrake.physics.tendon_finger import PART, Parameters
from exodrake.physics.wire_paths import EXTENSOR, FLEXOR, heights, path, paths
from exodrake.simulation.simulate import record

RNG = np.random.default_rng(7)
SAMPLES = [(RNG.uniform(-0.3, 1.5, 3), RNG.uniform(-15, 15, 3)) for _ in range(40)]


def finger_numbers():
    """The nominal finger block's own numbers as its NamedTuple."""
    robot = nominal()
    groups = {field.name: robot.channels(f"{field.group}.{field.name}") for field in PART.fields}
    return Parameters(**{name: tuple(v) if len(v) > 1 else float(v[0]) for name, v in groups.items()})


def chain():
    """The finger as bodies and joints of a MultibodyPlant, without gravity."""
    parameters, plant = finger_numbers(), MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector([0, 0, 0])
    parent, offset = plant.world_frame(), 0.0
    for i, (length, mass, radius) in enumerate(zip(parameters.length, parameters.mass, parameters.radius)):
        centred = SpatialInertia.SolidCylinderWithMass(mass, radius, length, [1, 0, 0])
        body = plant.AddRigidBody(f"bone_{i}", centred.Shift([-length / 2, 0, 0]))
        hinge = plant.AddFrame(fixed_frame(parent, i, offset))
        plant.AddJoint(RevoluteJoint(f"joint_{i}", hinge, body.body_frame(), [0, 0, 1]))
        parent, offset = body.body_frame(), length
    plant.Finalize()
    return plant


def fixed_frame(parent, i, offset):
    from pydrake.multibody.tree import FixedOffsetFrame

    return FixedOffsetFrame(f"hinge_{i}", parent, RigidTransform([offset, 0, 0]))


def test_mass_matrix_and_coriolis_terms_against_multibody_plant():
    parameters, plant = finger_numbers(), chain()
    context = plant.CreateDefaultContext()
    diagonal, coupling, _ = inertia(parameters.length, parameters.mass, parameters.radius)
    for q, rate in SAMPLES:
        plant.SetPositions(context, q)
        plant.SetVelocities(context, rate)
        m11, m12, m13, m22, m23, m33 = mass_matrix(diagonal, coupling, *map(math.cos, (q[1], q[2], q[1] + q[2])))
        ours = np.array([[m11, m12, m13], [m12, m22, m23], [m13, m23, m33]])
        spin = coriolis(coupling, *map(math.sin, (q[1], q[2], q[1] + q[2])), tuple(rate))
        np.testing.assert_allclose(ours, plant.CalcMassMatrix(context), rtol=1e-10, atol=1e-18)
        np.testing.assert_allclose(spin, plant.CalcBiasTerm(context), rtol=1e-10, atol=1e-15)


@pytest.mark.parametrize(
    ("degrees", "flexor", "extensor"), [(0, 3.000, 5.000), (30, 4.192, 3.536), (60, 5.098, 1.830), (90, 5.657, 0.0)]
)
def test_moment_arms_of_the_paper(degrees, flexor, extensor):
    """Flexor over h = 3 mm and long extensor over h = 5 mm routers, a = 5 mm [mm]."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    assert 1e3 * path(c, s, 0.005, 0.005, 0.003, 0.003, FLEXOR)[1] == pytest.approx(flexor, abs=5e-4)
    assert -1e3 * path(c, s, 0.005, 0.005, 0.005, 0.005, EXTENSOR)[1] == pytest.approx(extensor, abs=5e-4)


def test_general_routers_keep_arm_and_slope_consistent():
    a, b, m, n, step = 0.0043, 0.0061, 0.0035, 0.0022, 1e-5
    for q in np.linspace(-0.3, 1.4, 18):
        low, here, high = (path(math.cos(x), math.sin(x), a, b, m, n, FLEXOR) for x in (q - step, q, q + step))
        assert here[1] == pytest.approx((high[0] - low[0]) / (2 * step), abs=1e-11)
        assert here[2] == pytest.approx((high[1] - low[1]) / (2 * step), abs=1e-10)


def test_power_balance():
    """T dl/dt = (P^T T) q': what the wires do is what the joints get."""
    parameters, step = finger_numbers(), 1e-5
    high = heights(None, None, parameters, (0.0, 0.0, 0.0))

    def taken(q):
        return np.array(paths(parameters, tuple(np.cos(q)), tuple(np.sin(q)), high)[0])

    for q, rate in SAMPLES:
        tension = RNG.uniform(0, 10, 3)
        wires = paths(parameters, tuple(np.cos(q)), tuple(np.sin(q)), high)
        unit = rate / np.linalg.norm(rate)
        flow = tension @ (taken(q + step * unit) - taken(q - step * unit)) / (2 * step)
        assert (np.array(wires[1]).T @ tension) @ unit == pytest.approx(flow, rel=1e-7)


@pytest.mark.parametrize("offset", [0.5e-3, 1e-3, 2e-3])
def test_a_finger_homed_with_taut_wires_is_switched_on_at_rest(monkeypatch, offset):
    """Under the tension of wires wound in too far, it stands where statics put it, and stays there."""
    parameters, x, z, e = finger_numbers(), np.zeros(22), np.zeros(0), np.zeros(0)
    monkeypatch.setattr(tendon_finger, "rests_before", tendon_finger.rests_at_switch_on)
    stroke = np.zeros(3)
    tendon_finger.start(x, z, parameters, e, stroke)
    stroke += offset * np.array((1.0, 0.0, 1.0))
    for _ in range(5):
        tendon_finger.update(x, z, parameters, e, 0.002, stroke, np.zeros(3))
        tension = x[tendon_finger.PULL : tendon_finger.PULL + 3]
        posture = finger_statics.posture(tension[None, :], parameters)[0]
        assert np.abs(posture - parameters.q0).max() > 0.015
        assert x[:3] == pytest.approx(posture, abs=1e-4)
    assert np.abs(x[3:6]).max() < 1e-3 and x[tendon_finger.CLOCK] == pytest.approx(0.01)


def test_a_finger_homed_right_starts_in_its_rest_posture():
    robot = nominal().with_parameters(dict.fromkeys(nominal().machine.noise, 0.0))
    found = record(robot, Reference(np.full((2, 3), 0.0)), quantisation=False).signals
    assert found["angle"][0] == pytest.approx(np.array(finger_numbers().q0), abs=1e-6)
