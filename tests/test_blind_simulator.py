"""The reference simulator: rigid body, integrator and reference data, and each of its effects."""

from functools import cache

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia, UnitInertia
from scipy.integrate import solve_ivp
from shared_data import data_folder, needs_data

from exodrake.core.errors import InputError
from exodrake.engine.inputs import Reference
from exodrake.machines.exo_index.machine import machine as exo_index
from exodrake.reference.cases import CaseMix, CasePlan, draw_case, grasps, plan
from exodrake.reference.dynamics import (
    INPUT_SIZE,
    STATE_SIZE,
    TOLERANCE,
    advance,
    derivative,
    inverse_dynamics,
    limit_force,
    mass_matrix,
    rub_rate,
)
from exodrake.reference.faults import ENTRIES, LIBRARY, OUTSIDE, draw_effect
from exodrake.reference.make import gap_in_noise
from exodrake.reference.robot import FRAME, InjectedFault, RobotSpec, draw_parameters
from exodrake.reference.simulator import assemble, initial_state, simulate

REFERENCES = ("sweeps", "chirp", "holds", "grasps")
NEAR = {"tension": 3e-3, "stroke": 3e-6, "angle": 6e-4}  # N, m, rad
NEEDS_LONGER = {"outside.voltage_sag", "timing.mocap_clock_skew"}  # rare spells; grows with time


@cache
def short_grasps(seconds=14.0):
    return Reference(grasps(np.random.default_rng(5)).values[: round(seconds / FRAME)], "grasps")


@cache
def healthy_log():
    return simulate(RobotSpec(noisy=False), short_grasps(), 0)


@needs_data("reference")
@pytest.mark.parametrize("name", REFERENCES)
def test_reproduces_the_reference(name):
    path = data_folder("reference") / f"{name}.csv"
    names = [heading.split(" ")[0] for heading in path.open().readline().strip().split(",")]
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    wanted = dict(zip(names, table.T))
    reference = np.column_stack([wanted[f"tension_ref_{wire}"] for wire in ("AF", "MF", "AE")])
    log = simulate(RobotSpec(noisy=False), Reference(reference, name), 0)
    assert tuple(log) == tuple(names)
    for column, values in log.items():
        kind = column.rsplit("_", 1)[0]
        if kind in NEAR:
            assert np.sqrt(np.mean((values - wanted[column]) ** 2)) < NEAR[kind], column


def test_same_seed_same_log():
    spec = RobotSpec(
        draw_parameters(np.random.default_rng(1)), (draw_effect("finger.tremor", np.random.default_rng(2)),)
    )
    motion = Reference(short_grasps().values[:200], "grasps")
    first, again, other = (simulate(spec, motion, seed) for seed in (3, 3, 4))
    assert all(np.array_equal(first[name], again[name]) for name in first)
    assert not np.array_equal(first["tension_AF"], other["tension_AF"])


@pytest.mark.parametrize("effect_id", ENTRIES)
def test_every_effect_is_finite_and_seen(effect_id):
    best = 0.0
    for seed in range(4):
        effect = draw_effect(effect_id, np.random.default_rng(seed))
        log = simulate(RobotSpec(effects=(effect,), noisy=False), short_grasps(), 7)
        assert all(np.all(np.isfinite(values)) for values in log.values())
        best = max(best, max(gap_in_noise(log, healthy_log()).values()))
        if best >= 2.0:
            return
    assert effect_id in NEEDS_LONGER, f"{best:.2f} noise standard deviations"


def test_a_neutral_effect_is_absent():
    neutral = InjectedFault("tendon.capstan_friction", parameters={"mu_phi": 0.0})
    log = simulate(RobotSpec(effects=(neutral,), noisy=False), short_grasps(), 0)
    assert all(np.array_equal(log[name], healthy_log()[name]) for name in log)


def test_unknown_effect_is_refused():
    with pytest.raises(InputError, match=r"tendon\.magic"):
        simulate(RobotSpec(effects=(InjectedFault("tendon.magic"),)), short_grasps(), 0)


def test_slack_equals_a_negative_homing_offset():
    slack = InjectedFault("tendon.slack", ("MF",), parameters={"length": 1e-3})
    homing = InjectedFault("encoder.homing_offset", ("MF",), parameters={"offset": -1e-3})
    logs = [simulate(RobotSpec(effects=(effect,), noisy=False), short_grasps(), 0) for effect in (slack, homing)]
    assert max(gap_in_noise(*logs).values()) < 0.1 * max(gap_in_noise(logs[0], healthy_log()).values())


def test_protocols_are_within_the_wires_range_and_as_long_as_they_should():
    for unseen in (False, True):
        for name, protocol in draw_case(CasePlan("case", (8,), "healthy", (), unseen)).protocols.items():
            assert len(protocol.values) * FRAME == pytest.approx(
                {"sweeps_1": 60, "sweeps_2": 60, "chirp": 36}.get(name, 40)
            )
            assert protocol.values.min() >= 0.3
            assert np.all(protocol.values.max(axis=0) <= [12.0 + 1e-9, 8.0 + 1e-9, 8.0 + 1e-9])


def test_plan_follows_the_mix_and_the_seed():
    plans = plan(3, 40, CaseMix())
    kinds = [item.kind for item in plans]
    assert [kinds.count(kind) for kind in ("healthy", "single", "pair", "unknown")] == [8, 20, 6, 6]
    assert len({item.ids for item in plans if item.kind == "single"}) == 20
    assert all(set(item.ids) <= set(OUTSIDE) for item in plans if item.kind == "unknown")
    assert plans == plan(3, 40, CaseMix())
    assert draw_case(plans[0], 1).spec.effects == draw_case(plans[0], 1).spec.effects
    assert len(LIBRARY) >= 37 and len(OUTSIDE) >= 8


def test_parameters_bear_the_librarys_names():
    theirs = {effect.id: {parameter.name for parameter in effect.parameters} for effect in exo_index().effects}
    for effect_id, entry in LIBRARY.items():
        assert set(entry.ranges) <= theirs[effect_id], effect_id


def test_friction_gains_no_energy_from_a_load_that_changes():
    """In under 2 N, out under 10 N, within the presliding travel: work done on the contact never falls below 0."""
    friction, stiffness, dt = 0.2, 4000.0, 2e-5
    force = work = least = 0.0
    for k in range(20000):
        there = k // 200 % 2 == 0
        tension, speed = (2.0, 0.01) if there else (10.0, -0.01)
        work += limit_force(force, friction * tension) * speed * dt
        force += rub_rate(force, speed, tension, friction * tension, stiffness) * dt
        least = min(least, work)
    assert least > -1e-9 and work > 1e-5


GRAVITY = (1.5, -9.0)


def plant_of(record):
    """MultibodyPlant of the finger with the record's lengths, centres, masses and unit inertias."""
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


def test_integrator_agrees_with_radau_of_scipy():
    effects = (
        InjectedFault("tendon.capstan_friction", parameters={"mu_phi": 0.3}),
        InjectedFault("tendon.creep", parameters={"stiffness": 6000.0, "time_constant": 5.0}),
        InjectedFault("finger.viscoelasticity", parameters={"fraction": 0.3, "time_constant": 2.0}),
    )
    build = assemble(RobotSpec(effects=effects, noisy=False), 10, None)
    command = np.array([0.05, 0.02, 0.01])
    y = initial_state(build.record)
    scratch = np.zeros(INPUT_SIZE), np.zeros(3), np.zeros((3, 3))

    def slope(time, state):
        rate = np.zeros(STATE_SIZE)
        derivative(time, state, rate, build.record, command, build.inputs, *scratch)
        return rate

    wanted = solve_ivp(slope, (0.0, 0.05), y, method="Radau", rtol=1e-7, atol=1e-9).y[:, -1]
    work = np.zeros((6, STATE_SIZE)), *scratch
    assert advance(0.0, 0.05, y, 1e-4, build.record, command, build.inputs, TOLERANCE, work) > 0
    assert np.all(np.abs(y - wanted) < 10 * (TOLERANCE + 1e-3 * np.abs(wanted)))
