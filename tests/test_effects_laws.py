"""The own law of each effect, where it has a closed form: the modules' functions called directly."""

from math import cos, exp, pi, sin

import numpy as np
import pytest

import exodrake as exo
from exodrake.effects import (
    finger_co_activation,
    finger_contact,
    finger_coupling,
    finger_gravity,
    finger_hardening,
    finger_hysteresis,
    finger_router_migration,
    finger_spasticity,
    finger_stiffness,
    finger_tremor,
    finger_viscoelasticity,
    finger_voluntary_torque,
    motor_slow_velocity_loop,
    motor_speed_droop,
    motor_spool_growth,
    motor_spool_layers,
    tendon_bouc_wen,
    tendon_compliance,
    tendon_creep,
    tendon_slack,
    tendon_stiffening,
)
from exodrake.effects.friction import (
    motor_friction,
    motor_gear_efficiency,
    sensor_pulley_friction,
    stribeck,
    tendon_capstan_friction,
    tendon_coulomb_friction,
    tendon_prandtl_ishlinskii,
    tendon_presliding,
    tendon_viscous_friction,
)
from exodrake.effects.signal import (
    encoder_homing_offset,
    mocap_skin_artefact,
    motor_current_limit,
    motor_dead_zone,
    sensor_creep,
    sensor_crosstalk,
    sensor_drift,
    sensor_gain,
    sensor_hysteresis,
    sensor_lag,
    sensor_nonlinearity,
    sensor_offset,
    timing_command_latency,
    timing_dropped_commands,
    timing_jitter,
    timing_mocap_clock_skew,
    timing_mocap_delay,
)
from exodrake.physics.finger import inertia
from exodrake.physics.routers import EXTENSOR, FLEXOR, path
from exodrake.physics.sensor import followed
from exodrake.physics.tendon import slid

DT = 0.002
LENGTH, MASS, RADIUS = (0.04264, 0.02014, 0.01872), (0.0119, 0.0045, 0.0032), (0.009, 0.008, 0.007)
NOTHING, STILL = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
BONES = (LENGTH, inertia(LENGTH, MASS, RADIUS)[2])


def test_dead_zone_starts_above_its_width_and_stops_below_its_release() -> None:
    moving, followed = 0.0, []
    for speed in (0.9e-3, -1.1e-3, -0.9e-3, 0.7e-3, 0.9e-3):
        moving = motor_dead_zone.follow(DT, speed, 0.0, 1e-3, 0.8, moving)
        followed.append(motor_dead_zone.command(speed, 5.0, 1e-3, 0.8, moving))
    assert followed == [0.0, -1.1e-3, -0.9e-3, 0.0, 0.0]


def test_speed_droop_falls_with_load_that_is_pulled_and_rises_with_one_that_pulls() -> None:
    assert motor_speed_droop.command(0.2, 10.0, 0.1, 0.002) == pytest.approx(0.08)
    assert motor_speed_droop.command(0.2, 60.0, 0.1, 0.002) == 0.0
    assert motor_speed_droop.command(-0.2, 60.0, 0.1, 0.002) == -0.2
    assert motor_speed_droop.command(-0.3, 60.0, 0.1, 0.002) == pytest.approx(-0.22)


def test_no_load_locks_a_wire_that_is_let_out() -> None:
    """Flexor at 11 N, of which the supply can pull none (0.02 m/s, 2 mm/s per N), let go to 0.3 N for 2 s."""
    slow = exo.load_robot().splice("motor.speed_droop", {"limit": 0.02, "coefficient": 0.0})
    drooping = exo.load_robot().splice("motor.speed_droop", {"limit": 0.02, "coefficient": 0.002})
    reference = np.full((300, 3), 0.3)
    reference[:200, 0] = np.minimum(11.0, np.linspace(0.3, 20.0, 200))
    slow, drooping = (exo.simulate(robot, exo.Reference(reference), seed=1) for robot in (slow, drooping))
    assert drooping["tension_AF"][199] > 8.0
    assert drooping["tension_AF"][-1] < slow["tension_AF"][-1] + 0.1 and drooping["tension_AF"][-1] < 2.0


def test_current_limit_never_raises_it() -> None:
    assert motor_current_limit.current_limit(0.3, 0.1, 0.1) == 0.1
    assert motor_current_limit.current_limit(0.3, 0.5, 0.1) == 0.3


def test_current_bends_to_its_limit() -> None:
    """Half a limit at a knee of 1 where the drive wants the limit; 2^-knee of it at any; a clip for a knee of 0."""

    def current(wanted, knee):
        return motor_current_limit.current(min(max(wanted, -0.1), 0.1), wanted, 0.1, 0.1, knee)

    assert current(0.1, 1.0) == pytest.approx(0.05)
    assert current(-0.1, 0.2) == pytest.approx(-0.1 * 2.0**-0.2)
    assert current(100.0, 0.2) == pytest.approx(0.1, rel=1e-6)
    assert current(1e-3, 0.2) == pytest.approx(1e-3, rel=1e-6)
    assert [current(w, 0.0) for w in (-0.2, 0.05, 0.2)] == [-0.1, 0.05, 0.1]


def test_motor_friction_saturates_at_its_torque() -> None:
    bristle = 0.0
    for _ in range(2000):
        bristle = motor_friction.settle(DT, 100.0, 3e-4, bristle)
    assert motor_friction.drag(0.0, 3e-4, bristle) == pytest.approx(3e-4)


def test_gear_loop_is_the_square_of_efficiency() -> None:
    winding, *wound = motor_gear_efficiency.load(8.0, 0.01, 0.65, 0.0, 0.0)
    unwinding, *_ = motor_gear_efficiency.load(8.0, 0.0, 0.65, *wound)
    assert winding == pytest.approx(8.0 / 0.65)
    assert unwinding / winding == pytest.approx(0.65**2)


@pytest.mark.parametrize("module, parameters", [(motor_spool_growth, (2.0,)), (motor_spool_layers, (0.06, 0.008))])
def test_spool_winds_without_loss_of_power(module, parameters) -> None:
    """Speed is the derivative of the wire wound, and load times nominal speed is tension times wire speed."""
    for spool in (-0.004, 0.003, 0.0125, 0.031):
        slope = (module.wound(spool + 1e-7, *parameters) - module.wound(spool - 1e-7, *parameters)) / 2e-7
        assert module.winding(1.0, spool, *parameters) == pytest.approx(slope, rel=1e-6)
        assert module.load(5.0, spool, *parameters) == pytest.approx(5.0 * slope, rel=1e-6)


def test_capstan_ratio_in_a_slow_pull() -> None:
    pull = tendon_capstan_friction.transmit(6.0, 0.0, 0.01, 1e-4, 0.3, 0.0)
    release = tendon_capstan_friction.transmit(6.0, 0.0, -0.01, -1e-4, 0.3, 0.0)
    assert pull / 6.0 == pytest.approx(exp(-0.3))
    assert release / pull == pytest.approx(exp(0.6))


def test_coulomb_loop_has_twice_the_force_at_every_load() -> None:
    for tension in (1.0, 4.0, 12.0):
        pull = tendon_coulomb_friction.transmit(tension, 1.0, 0.0, 0.0, 0.4)
        assert tendon_coulomb_friction.transmit(tension, -1.0, 0.0, 0.0, 0.4) - pull == pytest.approx(0.8)


def test_friction_fades_on_a_slack_wire() -> None:
    slide = slid(-1.0, 0.0, 5e-5, 0.0)
    assert tendon_coulomb_friction.transmit(0.0, slide, 0.0, 0.0, 0.4) == 0.0


def test_stribeck_levels() -> None:
    level = stribeck.level
    assert level(0.0, 0.3, 2.0, 0.005) == pytest.approx(0.6)
    assert level(1.0, 0.3, 2.0, 0.005) == pytest.approx(0.3)
    assert level(-0.005, 0.3, 2.0, 0.005) == pytest.approx(0.3 * (1.0 + exp(-1.0)))


def test_viscous_force() -> None:
    assert tendon_viscous_friction.transmit(5.0, 1.0, 0.0, 0.04, 5.0) == pytest.approx(4.8)


def test_presliding_initial_slope_and_level() -> None:
    force, stiffness = 0.4, 500.0
    slope = (tendon_presliding.transmit(5.0, 0.0, 1e-8, 0.0, force, stiffness, 0.0) - 5.0) / 1e-8
    assert slope == pytest.approx(-stiffness, rel=1e-4)
    assert tendon_presliding.transmit(5.0, 0.0, 0.1, 0.0, force, stiffness, 0.0) == pytest.approx(4.6)


def closed_loop_work(step, amplitude: float) -> float:
    """Work done on a friction force `step(travel)` [N] in the second of two cycles of travel [J]."""
    x = amplitude * np.sin(np.linspace(0.0, 4 * pi, 20001))
    forces = np.array([step(float(dx)) for dx in np.diff(x)])
    return float(np.sum((forces * np.diff(x))[10000:]))


@pytest.mark.parametrize("amplitude", [1e-4, 1e-3, 1e-2])
def test_stops_dissipate(amplitude: float) -> None:
    """A closed loop takes energy or none; a large one takes 4 amplitude force less the turning round."""
    force, distance, stops = 0.4, 5e-4, [0.0, 0.0, 0.0]

    def step(travel: float) -> float:
        stops[:] = tendon_prandtl_ishlinskii.moved(5.0, travel, distance, *stops)
        return force * tendon_prandtl_ishlinskii.mean_stop(*stops)

    work = closed_loop_work(step, amplitude)
    exact = 4.0 * force * np.mean([max(amplitude - k * distance, 0.0) for k in (1, 2, 3)])
    assert work == pytest.approx(exact, rel=1e-2, abs=1e-8)


@pytest.mark.parametrize("amplitude", [2e-4, 1e-3, 4e-3])
def test_bouc_wen_dissipates_and_yields(amplitude: float) -> None:
    z = [0.0]

    def step(change: float) -> float:
        z[0] = tendon_bouc_wen.yielded(z[0], change, 5e-4)
        return z[0]

    assert closed_loop_work(step, amplitude) > 0.0
    assert tendon_bouc_wen.yielded(0.0, 1.0, 5e-4) == pytest.approx(5e-4)
    assert tendon_bouc_wen.yielded(4e-4, -3e-4, 5e-4) == pytest.approx(1e-4)


def test_bouc_wen_steps_add_up() -> None:
    """One large step equals many small ones, through the change of sign too."""
    z = 4e-4
    for _ in range(100):
        z = tendon_bouc_wen.yielded(z, -1e-5, 5e-4)
    assert z == pytest.approx(tendon_bouc_wen.yielded(4e-4, -1e-3, 5e-4))


def test_compliance_is_two_springs_in_series() -> None:
    tension = tendon_compliance.elastic(2700.0 * 0.004, 0.004, 2700.0, 3000.0)
    assert tension / 2700.0 + tension / 3000.0 == pytest.approx(0.004)


def test_creep_asymptote_and_time() -> None:
    y = 0.0
    for _ in range(5000):
        y = tendon_creep.settle(DT, 0.0, 6.0, 6.0, 0.0, 8000.0, 10.0, y)
    assert y == pytest.approx(6.0 / 8000.0 * (1.0 - exp(-1.0)))
    assert tendon_creep.settle(1e3, 0.0, 6.0, 6.0, 0.0, 8000.0, 10.0, y) == pytest.approx(6.0 / 8000.0)
    assert tendon_creep.stretch(0.003, 6.0, 8000.0, 10.0, y) == pytest.approx(0.003 - y)


def test_slack() -> None:
    assert tendon_slack.stretch(0.003, 0.0, 0.001, 1e-4) == pytest.approx(0.002)
    assert tendon_slack.stretch(0.0005, 0.0, 0.001, 1e-4) < 0.0
    assert tendon_slack.stretch(0.003, 0.0, 0.0, 1e-4) == 0.003 and tendon_slack.stretch(-1e-5, 0.0, 0.0, 1e-4) == -1e-5


def test_slack_comes_taut_smoothly() -> None:
    """Over the toe the slope rises from 0 to 1 in proportion; a toe is no longer than the slack."""
    length, toe, h = 0.001, 4e-4, 1e-9
    for share in (0.05, 0.25, 0.5, 0.75, 0.95):
        x = length + (share - 0.5) * toe
        around = [tendon_slack.stretch(x + d, 0.0, length, toe) for d in (-h, h)]
        assert (around[1] - around[0]) / (2.0 * h) == pytest.approx(share, abs=1e-5)
    for end in (-0.5, 0.5):
        below, above = (tendon_slack.stretch(length + end * toe + d, 0.0, length, toe) for d in (-h, h))
        assert below == pytest.approx(above, abs=3e-9)
    assert tendon_slack.stretch(1e-3, 0.0, 1e-3, 1.0) == tendon_slack.stretch(1e-3, 0.0, 1e-3, 1e-3)


def test_stiffening_tangent() -> None:
    """dT/dx = soft + stiffening T, and the curve goes on straight and smoothly beyond its limit."""
    soft, grows, h = 1200.0, 200.0, 1e-8
    for x in (0.0, 0.002, 0.01):
        here = tendon_stiffening.elastic(0.0, x, 2700.0, soft, grows)
        slope = (tendon_stiffening.elastic(0.0, x + h, 2700.0, soft, grows) - here) / h
        assert slope == pytest.approx(soft + grows * here, rel=1e-4)
    edge = tendon_stiffening.LIMIT / grows
    around = [tendon_stiffening.elastic(0.0, edge + d, 2700.0, soft, grows) for d in (-1e-6, 0.0, 1e-6)]
    assert around[2] - around[1] == pytest.approx(around[1] - around[0], rel=1e-3)


def test_contact_force_rises_by_the_power_of_its_depth() -> None:
    """Far deeper than its onset: Hertz's law has the exponent 3/2."""
    shallow, deep = (finger_contact.pressed(depth, 2000.0, 1.5) for depth in (0.01, 0.04))
    assert deep / shallow == pytest.approx(8.0, rel=0.01)


@pytest.mark.parametrize("stretch", [0.001, 0.005])
def test_stiffening_comes_to_the_nominal_wire_as_it_fades(stretch) -> None:
    """Neither a jump nor a wire stiffer than both its parts, however little a wire is affected."""
    wire, nominal = 2700.0, 2700.0 * stretch

    def tension(soft):
        return tendon_stiffening.elastic(nominal, stretch, wire, soft, 200.0)

    assert tension(float("inf")) == tension(1e6) == tension(wire) == nominal
    assert tension(wire * (1.0 - 1e-7)) == pytest.approx(nominal, rel=1e-6)
    assert tension(1000.0) < nominal


def test_sensor_errors_are_what_they_say() -> None:
    assert sensor_gain.reading(8.0, 0.0, 0.05) == pytest.approx(8.4)
    assert sensor_offset.reading(8.0, 0.0, -0.2) == pytest.approx(7.8)
    assert sensor_drift.reading(8.0, 60.0, 0.005) == pytest.approx(8.3)
    assert sensor_crosstalk.mixed(8.0, 5.0, 0.03) == pytest.approx(8.15)
    assert sensor_lag.lag(0.0016, 0.02, 0.25, 0.0, 0.0, 0.0) == 0.015


@pytest.mark.parametrize("share", [0.0, 0.02, 0.2, 0.5])
@pytest.mark.parametrize("time_constant", [0.003, 0.02])
def test_two_filters_lag_by_the_time_constant_behind_a_ramp(time_constant, share) -> None:
    """Behind a steady ramp the lags of filters in series add up, however fast the second one is."""
    cell, states, slope = 0.0, (0.0, 0.0, 0.0), 20.0
    first = sensor_lag.lag(0.0, time_constant, share, *states)
    for k in range(400):
        load = slope * (k + 1) * DT
        reading = followed(cell, slope * k * DT, load, DT, first)  # of this instant; the states are a tick behind
        behind = (load - sensor_lag.reading(reading, 0.0, time_constant, share, *states)) / slope
        cell = reading
        states = sensor_lag.settle(DT, load, cell, 0.0, time_constant, share, *states)
    assert behind == pytest.approx(time_constant, rel=1e-6)


def test_nonlinearity_vanishes_at_both_ends() -> None:
    full = sensor_nonlinearity.FULL_SCALE
    assert [sensor_nonlinearity.reading(x, 0.0, 0.2) - x for x in (0.0, full)] == [0.0, 0.0]
    assert sensor_nonlinearity.reading(0.5 * full, 0.0, 0.2) - 0.5 * full == pytest.approx(0.2)


def test_pulley_friction_over_half_a_turn() -> None:
    ends = [sensor_pulley_friction.settle(DT, 0.0, 8.0, 8.0, way, 0.04, 1e-4, 0.0, 0.0) for way in (0.01, -0.01)]
    pull, release = (sensor_pulley_friction.at_cell(8.0, 0.04, 1e-4, *state) for state in ends)
    assert pull == pytest.approx(4.0 * (1.0 + exp(0.04 * pi)))
    assert (release - 4.0) * (pull - 4.0) == pytest.approx(16.0)


def test_cell_creep_and_hysteresis() -> None:
    crept = sensor_creep.settle(10.0, 8.0, 8.0, 0.0, 0.05, 10.0, 0.0)
    assert sensor_creep.reading(8.0, 0.0, 0.05, 10.0, crept) == pytest.approx(8.0 + 0.4 * (1.0 - exp(-1.0)))
    up = sensor_hysteresis.settle(DT, 8.0, 8.0, 0.0, 0.1, 1.0, 0.0, 0.0)
    down = sensor_hysteresis.settle(DT, 1.0, 1.0, 0.0, 0.1, 1.0, *up)
    assert (up[1], down[1]) == (8.0, 1.0)
    readings = [sensor_hysteresis.reading(4.0, 0.0, 0.1, 1.0, *state) for state in (up, down)]
    assert readings[0] - readings[1] == pytest.approx(0.2, rel=2e-3)


def test_finger_stiffness_and_hardening() -> None:
    kappa, bend = 0.08, 0.7
    assert finger_stiffness.passive(kappa * bend, bend, 0.0, kappa * bend, 0.0, 1.4) == pytest.approx(
        1.4 * kappa * bend
    )
    assert finger_hardening.passive(0.0, bend, 0.0, 0.0, 0.0, 0.04) == pytest.approx(0.04 * bend**3)


def test_viscoelastic_relaxation() -> None:
    """At a held angle the extra torque falls to 1/e in one time constant."""
    elastic, fraction, tau, relaxed = 0.05, 0.3, 2.0, 0.0
    at_once = finger_viscoelasticity.passive(elastic, 0.0, 0.0, elastic, 0.0, fraction, tau, relaxed)
    for _ in range(round(tau / DT)):
        relaxed = finger_viscoelasticity.relax(DT, 0.0, 0.0, elastic, fraction, tau, relaxed)
    later = finger_viscoelasticity.passive(elastic, 0.0, 0.0, elastic, 0.0, fraction, tau, relaxed)
    assert at_once == pytest.approx(1.3 * elastic)
    assert (later - elastic) / (at_once - elastic) == pytest.approx(exp(-1.0))


def test_hysteresis_loop_area() -> None:
    """A wide loop takes 4 torque amplitude, less what the bristle needs to turn round."""
    torque, width, amplitude, state = 3e-3, 0.05, 1.0, (0.0, 0.0)
    bends = amplitude * np.sin(np.linspace(0.0, 4 * pi, 40001))
    work = 0.0
    for k, bend in enumerate(bends[1:]):
        held = finger_hysteresis.passive(0.0, float(bend), 0.0, 0.0, 0.0, torque, width, *state)
        work += held * (bend - bends[k]) * (k >= 20000)
        state = finger_hysteresis.relax(DT, float(bend), 0.0, 0.0, torque, width, *state)
    assert work == pytest.approx(4.0 * torque * (amplitude - width), rel=2e-3)


def test_spasticity_only_in_fast_flexion() -> None:
    rates = (-5.0, 0.0, 0.5, 2.5)
    assert [finger_spasticity.passive(0.0, 0.0, r, 0.0, 0.0, 0.01, 0.5) for r in rates] == pytest.approx(
        [0, 0, 0, 0.02]
    )


def test_co_activation_comes_and_goes() -> None:
    at = [finger_co_activation.passive(0.05, 0.0, 0.0, 0.05, t, 0.5, 0.2) for t in (0.0, 2.5, 5.0)]
    assert at == pytest.approx([0.05, 0.075, 0.05])


def test_gravity_of_the_straight_horizontal_finger() -> None:
    """Static torques are weight times lever, bone by bone; palm up turns them round."""
    own = [m * 9.81 for m in MASS]
    third = own[2] * LENGTH[2] / 2
    second = own[1] * LENGTH[1] / 2 + own[2] * LENGTH[1] + third
    first = own[0] * LENGTH[0] / 2 + (own[1] + own[2]) * LENGTH[0] + second
    down = finger_gravity.external(NOTHING, NOTHING, STILL, BONES, 0.0, 9.81, 0.0)
    assert down == pytest.approx((first, second, third))
    assert finger_gravity.external(NOTHING, NOTHING, STILL, BONES, 0.0, 9.81, pi) == pytest.approx([-x for x in down])
    assert finger_gravity.external(NOTHING, NOTHING, STILL, BONES, 0.0, 9.81, pi / 2) == pytest.approx(NOTHING)


def energy_slope(energy, angle: tuple[float, ...]) -> list[float]:
    """-dE/dq by central differences [N m]."""
    h, slopes = 1e-6, []
    for i in range(3):
        up, down = list(angle), list(angle)
        up[i] += h
        down[i] -= h
        slopes.append((energy(down) - energy(up)) / (2 * h))
    return slopes


def height(angle) -> float:
    """Palmar distance of the fingertip from the MCP axis [m]."""
    return sum(length * sin(sum(angle[: i + 1])) for i, length in enumerate(LENGTH))


def test_contact_pushes_by_virtual_work() -> None:
    angle, stiffness = (0.5, 0.7, 0.4), 2000.0
    distance = height(angle) - 0.001
    torque = finger_contact.external(NOTHING, angle, STILL, BONES, 0.0, distance, stiffness, 1.5)
    force = finger_contact.pressed(0.001, stiffness, 1.5)
    assert force == pytest.approx(2.0, rel=0.03)
    assert torque == pytest.approx(energy_slope(lambda q: force * height(q), angle), rel=1e-5)
    assert finger_contact.external(NOTHING, angle, STILL, BONES, 0.0, distance + 0.002, stiffness, 1.5) == NOTHING


def test_contact_force_is_smooth_at_its_onset() -> None:
    onset = finger_contact.ONSET
    around = [finger_contact.pressed(onset + d, 2000.0, 1.3) for d in (-1e-9, 0.0, 1e-9)]
    assert around[2] - around[1] == pytest.approx(around[1] - around[0], rel=1e-3)


def test_coupling_is_a_spring() -> None:
    angle, stiffness, ratio = (0.5, 0.7, 0.2), 0.02, 0.67
    torque = finger_coupling.external(NOTHING, angle, STILL, BONES, 0.0, stiffness, ratio)
    assert torque == pytest.approx(
        energy_slope(lambda q: 0.5 * stiffness * (q[2] - ratio * q[1]) ** 2, angle), rel=1e-6
    )
    assert torque[2] > 0.0


def test_tremor_and_voluntary_torque() -> None:
    torque = finger_tremor.external(NOTHING, NOTHING, STILL, BONES, 0.125, (0.006, 0.0, 0.002), 2.0)
    assert torque == pytest.approx((0.006, 0.0, 0.002))
    pushed = finger_voluntary_torque.external(NOTHING, NOTHING, STILL, BONES, 10.0, (0.01, 0.0, 0.0), (0.1, 0.0, 0.0))
    assert pushed == pytest.approx((0.02, 0.0, 0.0))


def test_routers_follow_the_tension() -> None:
    settled = 0.0
    for _ in range(100):
        settled = finger_router_migration.settle(DT, 0.0, 8.0, 8.0, 0.0, 1e-4, 1.0, settled)
    assert finger_router_migration.worn_height(0.003, 8.0, 1e-4, 1.0, settled) == pytest.approx(0.0038)


@pytest.mark.parametrize("side", [FLEXOR, EXTENSOR])
@pytest.mark.parametrize("stored", [1.0, 0.0])
def test_a_garment_that_yields_stores_its_work(side: float, stored: float) -> None:
    """Work of a cycle in tension and angle is nil (stroke at the spool, torque at the joint), unless none is stored."""
    t = np.linspace(0.0, 2 * pi, 20001)
    tension, angle = 6.0 + 4.0 * np.cos(t), 0.6 + 0.5 * np.sin(t)
    stroke, torque = [], []
    for pull, q in zip(tension, angle, strict=True):
        high = finger_router_migration.worn_height(0.003, pull, 1e-4, stored, pull)
        turn = finger_router_migration.lever_height(high, 1e-4, stored, pull)
        stroke.append(pull / 2700.0 + path(cos(q), sin(q), 0.005, 0.005, high, high, side)[0])
        torque.append(pull * path(cos(q), sin(q), 0.005, 0.005, turn, turn, side)[1])
    given = np.sum(0.5 * (tension[1:] + tension[:-1]) * np.diff(stroke))
    taken = np.sum(0.5 * (np.array(torque[1:]) + np.array(torque[:-1])) * np.diff(angle))
    assert abs(given - taken) < 1e-9 if stored else abs(given - taken) > 1e-4


def test_a_slow_drive_lags_by_its_own_loop_time() -> None:
    """A command that rises at 1 m/s2 comes share (1 / factor - 1) loop times late, whatever the drive."""
    for loop_time in (9.74e-3, 2e-2):
        filtered = 0.0
        for k in range(1, 2000):
            filtered = motor_slow_velocity_loop.follow(DT, k * DT, loop_time, 0.4, 0.8, 1.0, filtered)
        assert 1999 * DT - filtered == pytest.approx(0.8 * 1.5 * loop_time, abs=DT)


def test_latency_counts_frames() -> None:
    history = np.arange(36.0)
    for frames, wanted in ((1.0, 13.0), (3.0, 15.0), (2.5, 14.5), (99.0, 22.0)):
        assert timing_command_latency.sent(12.0, history, 12, 0.0, 0.5, 0.5, frames) == pytest.approx(wanted)


def test_uniform_draws_decide_on_lost_frames() -> None:
    assert timing_dropped_commands.sent(1.0, (), 0, 0.5, 0.1, 0.9, 0.15) == 0.5
    assert timing_dropped_commands.sent(1.0, (), 0, 0.5, 0.2, 0.0, 0.15) == 1.0
    assert timing_jitter.sent(1.0, (1.0, 0.0), 0, 0.0, 0.9, 0.5, 0.5) == pytest.approx(0.75)


def test_late_pictures_add_up() -> None:
    late = timing_mocap_clock_skew.late(timing_mocap_delay.late(0.0, 40.0, 0.02), 40.0, 1e-3)
    assert late == pytest.approx(0.06)


def test_readings_with_other_zeros() -> None:
    assert encoder_homing_offset.wound(0.01, -0.001) == pytest.approx(0.009)
    assert mocap_skin_artefact.seen(pi / 4, 0.03) == pytest.approx(pi / 4 + 0.03)
