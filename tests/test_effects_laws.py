"""The own law of each effect in closed form, and friction that takes its work from somewhere."""

from math import cos, exp, pi, sin

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import exodrake as exo
from exodrake.effects import LIBRARY, finger, friction, motor, sensor, servo, signal, tendon, timing
from exodrake.physics.finger import inertia
from exodrake.physics.sensor import lag_ramp
from exodrake.physics.tendon import move_slide
from exodrake.physics.wire_paths import EXTENSOR, FLEXOR, path

DT = 0.002
# effects whose laws serve several: value, what else the law takes of its point, parameters; then the value that is left
SHARED = {
    "sensor.gain": ((8.0, 0.05), 8.4), "sensor.offset": ((8.0, -0.2), 7.8), "sensor.drift": ((8.0, 60.0, 0.005), 8.3),
    "sensor.crosstalk": ((8.0, 5.0, 0.03), 8.15), "mocap.gain": ((0.5, -0.1), 0.45), "mocap.offset": ((0.5, 0.1), 0.6),
    "encoder.homing_offset": ((0.01, -0.001), 0.009), "timing.mocap_delay": ((0.01, 0.02), 0.03),
    "timing.mocap_clock_skew": ((0.02, 40.0, 1e-3), 0.06), "finger.router_height": ((3e-3, 5e-4), 3.5e-3),
    "signal.gain": ((2.0, -0.1), 1.8), "signal.offset": ((2.0, 0.3), 2.3), "signal.drift": ((2.0, 30.0, 0.01), 2.3),
    "signal.crosstalk": ((2.0, 5.0, -0.1), 1.5), "signal.dead_zone": ((-1.0, 0.25), -0.75),
    "signal.saturation": ((-1.0, 0.4), -0.4), "signal.packet_loss": ((2.0, 1.0, 0.05, 0.1), 1.0),
    "joint.gain": ((0.5, -0.1), 0.45), "joint.offset": ((0.5, -0.1), 0.4), "joint.play": ((1.0, 0.0, 0.1), 0.9),
    "cable.backlash": ((-0.05, 0.02), -0.03), "cable.ratio_error": ((2.0, 0.05), 2.1),
    "cable.coupling_to_next": ((0.5, 2.0, 0.1), 0.7), "cable.coupling_to_previous": ((0.5, 2.0, 0.1), 0.7),
    "gear_motor.torque_gain": ((10.0, -0.1), 9.0), "arm.encoder_offset": ((1.0, 0.05), 1.05),
    "arm.joint_compliance": ((1e-4, 5e-4), 6e-4), "arm.link_mass": ((2.0, 0.2), 2.4), "arm.payload": ((1.0, 0.5), 1.5),
    "arm.rotor_inertia": ((0.2, 0.1), 0.3),
}  # fmt: skip
LENGTH, MASS, RADIUS = (0.04264, 0.02014, 0.01872), (0.0119, 0.0045, 0.0032), (0.009, 0.008, 0.007)
NOTHING, STILL = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
BONES = (LENGTH, inertia(LENGTH, MASS, RADIUS)[2])


@pytest.mark.parametrize("identity", SHARED)
def test_an_effect_has_the_law_that_it_names(identity: str) -> None:
    arguments, left = SHARED[identity]
    assert next(iter(LIBRARY[identity].at.values()))(*arguments) == pytest.approx(left)


FULL, HISTORY = sensor.FULL_SCALE, np.arange(36.0)
# laws of one state of affairs: function, arguments, result
LAWS = [
    (motor.limit_by_load, (0.2, 10.0, 0.1, 0.002), 0.08), (motor.limit_by_load, (0.2, 60.0, 0.1, 0.002), 0.0),
    (motor.limit_by_load, (-0.2, 60.0, 0.1, 0.002), -0.2), (motor.limit_by_load, (-0.3, 60.0, 0.1, 0.002), -0.22),
    (motor.current_limit, (0.3, 0.1, 0.1), 0.1), (motor.current_limit, (0.3, 0.5, 0.1), 0.3),
    (tendon.capstan, (6.0, 0.01, 0.3, 0.0), 6.0 * exp(-0.3)), (tendon.capstan, (6.0, -0.01, 0.3, 0.0), 6.0 * exp(0.3)),
    (tendon.coulomb, (4.0, 1.0, 0.4), 3.6), (tendon.coulomb, (12.0, -1.0, 0.4), 12.4),
    (tendon.coulomb, (0.0, move_slide(-1.0, 0.0, 5e-5, 0.0), 0.4), 0.0), (tendon.viscous, (5.0, 0.04, 5.0), 4.8),
    (tendon.plastic, (0.0, 1.0, 5e-4), 5e-4), (tendon.plastic, (4e-4, -3e-4, 5e-4), 1e-4),
    (tendon.add_garment, (10.8, 2700.0, 3000.0), 0.004 / (1.0 / 2700.0 + 1.0 / 3000.0)),
    (tendon.take_up_slack, (0.003, 0.001, 1e-4), 0.002), (tendon.take_up_slack, (0.0, 0.0, 1e-4), 0.0),
    (tendon.take_up_slack, (0.003, 0.0, 1e-4), 0.003), (tendon.take_up_slack, (-1e-5, 0.0, 1e-4), -1e-5),
    (friction.level, (0.0, 0.3, 2.0, 0.005), 0.6), (friction.level, (1.0, 0.3, 2.0, 0.005), 0.3),
    (friction.level, (-0.005, 0.3, 2.0, 0.005), 0.3 * (1.0 + exp(-1.0))), (friction.viscous, (10.0, 0.1, 50.0), 5.0),
    (friction.subtract_force, (10.0, -3.0), 13.0), (friction.resist_by_direction, (0.0, 0.2, 30.0), -6.0),
    (friction.resist_by_direction, (0.0, -0.2, 30.0), -6.0),
    (sensor.lag, (0.0016, 0.02, 0.25, 0.0, 0.0, 0.0), 0.015), (sensor.bend_reading, (0.0, 0.2), 0.0),
    (sensor.bend_reading, (FULL, 0.2), FULL), (sensor.bend_reading, (0.5 * FULL, 0.2), 0.5 * FULL + 0.2),
    (finger.scale_stiffness, (0.056, 0.056, 1.4), 1.4 * 0.056), (finger.harden_joint, (0.0, 0.7, 0.04), 0.04 * 0.7**3),
    (finger.spastic, (0.0, -5.0, 0.01, 0.5), 0.0), (finger.spastic, (0.0, 0.5, 0.01, 0.5), 0.0),
    (finger.spastic, (0.0, 2.5, 0.01, 0.5), 0.02),  # in fast flexion only
    (finger.stiffen_in_bouts, (0.05, 0.05, 2.5, 0.5, 0.2), 0.075),
    (finger.stiffen_in_bouts, (0.05, 0.05, 5.0, 0.5, 0.2), 0.05),
    (finger.add_tremor, ((0.0, 0.0, 0.0), 0.125, (0.006, 0.0, 0.002), 2.0), (0.006, 0.0, 0.002)),
    (finger.add_voluntary_torque, ((0.0, 0.0, 0.0), 10.0, (0.01, 0.0, 0.0), (0.1, 0.0, 0.0)), (0.02, 0.0, 0.0)),
    (signal.clip, (-1.0, 0.4), -0.4), (signal.clip, (0.3, 0.4), 0.3), (signal.cut_dead_zone, (-1.0, 0.25), -0.75),
    (signal.cut_dead_zone, (0.2, 0.25), 0.0), (signal.round_to, (-0.3, 0.25), -0.25),
    (signal.round_to, (0.2, 0.25), 0.25),
    (signal.lose_sample, (2.0, 1.0, 0.05, 0.1), 1.0), (signal.lose_sample, (2.0, 1.0, 0.15, 0.1), 2.0),
    (signal.slip_skin, (pi / 4, 0.03), pi / 4 + 0.03),  # skin slides most at half flexion
    (timing.jitter_command, (1.0, (1.0, 0.0), 0, 0.5, 0.5), 0.75),
    (timing.delay_command, (12.0, HISTORY, 12, 12, 0.0, 1.0, 1.0), 13.0),
    (timing.delay_command, (12.0, HISTORY, 12, 12, 0.0, 1.0, 2.5), 14.5),
    (timing.delay_command, (12.0, HISTORY, 12, 12, 0.0, 1.0, 99.0), 22.0),
    (timing.delay_command, (12.0, HISTORY, 12, 12, 0.25, 0.25, 2.5), 15.0),
    (timing.delay_command, (12.0, HISTORY, 12, 12, 0.375, 0.25, 2.5), 14.5),
    (timing.delay_command, (12.0, HISTORY, 12, 12, 0.5, 0.25, 2.5), 14.0),
    (servo.lose_in_bends, (0.5, pi, 0.1), 0.5 * exp(-0.1 * pi)), (servo.sag_level, (0.0, 0.03), 0.03),
    (servo.sag_level, (pi / 2, 0.03), pi / 2),
    (servo.drag_along, (0.01, 0.1, 0.2, 0.1, 0.05), 0.07), (servo.drag_along, (0.01, -1.0, 0.2, 0.1, 0.05), -0.1),
    (servo.half_width, (0.0, 0.3, 0.17), 0.3),
    (servo.half_width, (pi, 0.3, 0.17), 0.3 * exp(0.17 * pi)),  # round a capstan
    (servo.drop_voltage, (7.4, 0.8, 2.0, 2.75, 0.5), (7.4 + 0.5 * 0.8 * 2.0 / 2.75) / (1.0 + 0.5 * 0.64 / 2.75)),
    (friction.brake_by_load, (1.0, 0.1, -2.0, 0.25), 0.95),
    (servo.brake_by_shared_load, (1.0, 0.1, 2.5, 2.0, 0.4), 0.99),  # motor 0.5, load 2 against it
    (servo.brake_by_shared_load, (1.0, 0.1, 2.5, 0.5, 0.4), 0.99),
    (servo.brake_by_shared_load, (1.0, 0.1, 1.5, -2.0, 0.4), 1.0),
]  # fmt: skip


def test_laws_of_one_state_have_their_closed_forms() -> None:
    for law, arguments, result in LAWS:
        assert law(*arguments) == pytest.approx(result), (law.__name__, arguments)


def test_dead_zone_starts_above_its_width_and_stops_below_its_release() -> None:
    moving, followed = 0.0, []
    for speed in (0.9e-3, -1.1e-3, -0.9e-3, 0.7e-3, 0.9e-3):
        moving = motor.release_drive(DT, speed, 1e-3, 0.8, moving)
        followed.append(motor.moving_command(speed, 1e-3, 0.8, moving))
    assert followed == [0.0, -1.1e-3, -0.9e-3, 0.0, 0.0]


def test_no_load_locks_a_wire_that_is_let_out() -> None:
    """Flexor at 11 N, of which the supply can pull none (0.02 m/s, 2 mm/s per N), let go to 0.3 N for 2 s."""
    slow = exo.load_robot().splice("motor.speed_droop", {"limit": 0.02, "coefficient": 0.0})
    drooping = exo.load_robot().splice("motor.speed_droop", {"limit": 0.02, "coefficient": 0.002})
    reference = np.full((300, 3), 0.3)
    reference[:200, 0] = np.minimum(11.0, np.linspace(0.3, 20.0, 200))
    slow, drooping = (exo.simulate(robot, exo.Reference(reference), seed=1) for robot in (slow, drooping))
    assert drooping["tension_AF"][199] > 8.0
    assert drooping["tension_AF"][-1] < slow["tension_AF"][-1] + 0.1 and drooping["tension_AF"][-1] < 2.0


def test_current_bends_to_its_limit() -> None:
    """Half a limit at a knee of 1 where the drive wants the limit; 2^-knee of it at any; a clip for a knee of 0."""

    def current(wanted, knee):
        return motor.current(min(max(wanted, -0.1), 0.1), wanted, 0.1, 0.1, knee)

    assert current(0.1, 1.0) == pytest.approx(0.05)
    assert current(-0.1, 0.2) == pytest.approx(-0.1 * 2.0**-0.2)
    assert current(100.0, 0.2) == pytest.approx(0.1, rel=1e-6)
    assert current(1e-3, 0.2) == pytest.approx(1e-3, rel=1e-6)
    assert [current(w, 0.0) for w in (-0.2, 0.05, 0.2)] == [-0.1, 0.05, 0.1]


def test_motor_friction_saturates_at_its_torque() -> None:
    bristle = 0.0
    for _ in range(2000):
        bristle = motor.settle_rotor(DT, 100.0, 3e-4, bristle)
    assert motor.drag(0.0, 3e-4, bristle) == pytest.approx(3e-4)


def test_gear_loop_is_the_square_of_efficiency() -> None:
    winding, *wound = motor.lose_in_gear(8.0, 0.01, 0.65, 0.0, 0.0)
    unwinding, *_ = motor.lose_in_gear(8.0, 0.0, 0.65, *wound)
    assert winding == pytest.approx(8.0 / 0.65)
    assert unwinding / winding == pytest.approx(0.65**2)


@pytest.mark.parametrize("identity, parameters", [("growth", (2.0,)), ("layers", (0.06, 0.008))])
def test_spool_winds_without_loss_of_power(identity, parameters) -> None:
    """Speed is the derivative of the wire wound, and load times nominal speed is tension times wire speed."""
    wound, winding, load = LIBRARY[f"motor.spool_{identity}"].at.values()
    for spool in (-0.004, 0.003, 0.0125, 0.031):
        slope = (wound(spool + 1e-7, *parameters) - wound(spool - 1e-7, *parameters)) / 2e-7
        assert winding(1.0, spool, *parameters) == pytest.approx(slope, rel=1e-6)
        assert load(5.0, spool, *parameters) == pytest.approx(5.0 * slope, rel=1e-6)


def test_presliding_initial_slope_and_level() -> None:
    force, stiffness = 0.4, 500.0
    slope = (tendon.dahl(5.0, 1e-8, force, stiffness, 0.0) - 5.0) / 1e-8
    assert slope == pytest.approx(-stiffness, rel=1e-4)
    assert tendon.dahl(5.0, 0.1, force, stiffness, 0.0) == pytest.approx(4.6)


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
        stops[:] = tendon.settle_stops(0.0, 5.0, travel, force, distance, *stops)
        return 5.0 - tendon.prandtl_ishlinskii(5.0, 0.0, force, distance, *stops)

    work = closed_loop_work(step, amplitude)
    exact = 4.0 * force * np.mean([max(amplitude - k * distance, 0.0) for k in (1, 2, 3)])
    assert work == pytest.approx(exact, rel=1e-2, abs=1e-8)


@pytest.mark.parametrize("amplitude", [2e-4, 1e-3, 4e-3])
def test_bouc_wen_dissipates_and_yields(amplitude: float) -> None:
    z = [0.0]

    def step(change: float) -> float:
        z[0] = tendon.plastic(z[0], change, 5e-4)
        return z[0]

    assert closed_loop_work(step, amplitude) > 0.0
    z[0] = 4e-4
    for _ in range(100):
        step(-1e-5)
    assert z[0] == pytest.approx(tendon.plastic(4e-4, -1e-3, 5e-4))  # many steps add up to one


def test_creep_asymptote_and_time() -> None:
    y = 0.0
    for _ in range(5000):
        y = tendon.settle_creep(DT, 6.0, 8000.0, 10.0, y)
    assert y == pytest.approx(6.0 / 8000.0 * (1.0 - exp(-1.0)))
    assert tendon.settle_creep(1e3, 6.0, 8000.0, 10.0, y) == pytest.approx(6.0 / 8000.0)
    assert tendon.subtract_creep(0.003, 8000.0, 10.0, y) == pytest.approx(0.003 - y)


def test_slack_comes_taut_smoothly() -> None:
    """Over the toe the slope rises from 0 to 1 in proportion; a toe is no longer than the slack."""
    length, toe, h = 0.001, 4e-4, 1e-9
    for share in (0.05, 0.25, 0.5, 0.75, 0.95):
        x = length + (share - 0.5) * toe
        around = [tendon.take_up_slack(x + d, length, toe) for d in (-h, h)]
        assert (around[1] - around[0]) / (2.0 * h) == pytest.approx(share, abs=1e-5)
    for end in (-0.5, 0.5):
        below, above = (tendon.take_up_slack(length + end * toe + d, length, toe) for d in (-h, h))
        assert below == pytest.approx(above, abs=3e-9)
    assert tendon.take_up_slack(1e-3, 1e-3, 1.0) == tendon.take_up_slack(1e-3, 1e-3, 1e-3)


def test_stiffening_tangent() -> None:
    """dT/dx = soft + stiffening T, and the curve goes on straight and smoothly beyond its limit."""
    soft, grows, h = 1200.0, 200.0, 1e-8
    for x in (0.0, 0.002, 0.01):
        here = tendon.stiffen_wire(0.0, x, 2700.0, soft, grows)
        slope = (tendon.stiffen_wire(0.0, x + h, 2700.0, soft, grows) - here) / h
        assert slope == pytest.approx(soft + grows * here, rel=1e-4)
    edge = tendon.LIMIT / grows
    around = [tendon.stiffen_wire(0.0, edge + d, 2700.0, soft, grows) for d in (-1e-6, 0.0, 1e-6)]
    assert around[2] - around[1] == pytest.approx(around[1] - around[0], rel=1e-3)


@pytest.mark.parametrize("stretch", [0.001, 0.005])
def test_stiffening_comes_to_the_nominal_wire_as_it_fades(stretch) -> None:
    """Neither a jump nor a wire stiffer than both its parts, however little a wire is affected."""
    wire, nominal = 2700.0, 2700.0 * stretch

    def tension(soft):
        return tendon.stiffen_wire(nominal, stretch, wire, soft, 200.0)

    assert tension(float("inf")) == tension(1e6) == tension(wire) == nominal
    assert tension(wire * (1.0 - 1e-7)) == pytest.approx(nominal, rel=1e-6)
    assert tension(1000.0) < nominal


@pytest.mark.parametrize("share", [0.0, 0.02, 0.2, 0.5])
@pytest.mark.parametrize("time_constant", [0.003, 0.02])
def test_two_filters_lag_by_the_time_constant_behind_a_ramp(time_constant, share) -> None:
    """Behind a steady ramp the lags of filters in series add up, however fast the second one is."""
    cell, states, slope = 0.0, (0.0, 0.0, 0.0), 20.0
    first = sensor.lag(0.0, time_constant, share, *states)
    for k in range(400):
        load = slope * (k + 1) * DT
        reading = lag_ramp(cell, slope * k * DT, load, DT, first)  # of this instant; the states are a tick behind
        behind = (load - sensor.filtered_reading(reading, time_constant, share, *states)) / slope
        cell = reading
        states = sensor.settle_filter(DT, cell, time_constant, share, *states)
    assert behind == pytest.approx(time_constant, rel=1e-6)


def test_pulley_friction_over_half_a_turn() -> None:
    ends = [sensor.settle_pulley(DT, 0.0, 8.0, way, 0.04, 1e-4, 0.0, 0.0) for way in (0.01, -0.01)]
    pull, release = (sensor.average_strands(8.0, 0.04, 1e-4, *state) for state in ends)
    assert pull == pytest.approx(4.0 * (1.0 + exp(0.04 * pi)))
    assert (release - 4.0) * (pull - 4.0) == pytest.approx(16.0)


def test_cell_creep_and_hysteresis() -> None:
    crept = sensor.settle_creep(10.0, 8.0, 0.05, 10.0, 0.0)
    assert sensor.crept_reading(8.0, 0.05, 10.0, crept) == pytest.approx(8.0 + 0.4 * (1.0 - exp(-1.0)))
    up = friction.settle_bristle(DT, 8.0, 0.1, 1.0, 0.0, 0.0)
    down = friction.settle_bristle(DT, 1.0, 0.1, 1.0, *up)
    assert (up[1], down[1]) == (8.0, 1.0)
    readings = [sensor.hysteretic_reading(4.0, 0.1, 1.0, *state) for state in (up, down)]
    assert readings[0] - readings[1] == pytest.approx(0.2, rel=2e-3)


def test_viscoelastic_relaxation() -> None:
    """At a held angle the extra torque falls to 1/e in one time constant."""
    elastic, fraction, tau, relaxed = 0.05, 0.3, 2.0, 0.0
    at_once = finger.viscoelastic(elastic, elastic, fraction, tau, relaxed)
    for _ in range(round(tau / DT)):
        relaxed = finger.relax_tissue(DT, elastic, fraction, tau, relaxed)
    later = finger.viscoelastic(elastic, elastic, fraction, tau, relaxed)
    assert at_once == pytest.approx(1.3 * elastic)
    assert (later - elastic) / (at_once - elastic) == pytest.approx(exp(-1.0))


def test_hysteresis_loop_area() -> None:
    """A wide loop takes 4 torque amplitude, less what the bristle needs to turn round."""
    torque, width, amplitude, state = 3e-3, 0.05, 1.0, (0.0, 0.0)
    bends = amplitude * np.sin(np.linspace(0.0, 4 * pi, 40001))
    work = 0.0
    for k, bend in enumerate(bends[1:]):
        held = finger.hysteretic(0.0, float(bend), torque, width, *state)
        work += held * (bend - bends[k]) * (k >= 20000)
        state = friction.settle_bristle(DT, float(bend), torque, width, *state)
    assert work == pytest.approx(4.0 * torque * (amplitude - width), rel=2e-3)


def test_gravity_of_the_straight_horizontal_finger() -> None:
    """Static torques are weight times lever, bone by bone; palm up turns them round."""
    own = [m * 9.81 for m in MASS]
    third = own[2] * LENGTH[2] / 2
    second = own[1] * LENGTH[1] / 2 + own[2] * LENGTH[1] + third
    first = own[0] * LENGTH[0] / 2 + (own[1] + own[2]) * LENGTH[0] + second
    down = finger.add_weight(NOTHING, NOTHING, BONES, 9.81, 0.0)
    assert down == pytest.approx((first, second, third))
    assert finger.add_weight(NOTHING, NOTHING, BONES, 9.81, pi) == pytest.approx([-x for x in down])
    assert finger.add_weight(NOTHING, NOTHING, BONES, 9.81, pi / 2) == pytest.approx(NOTHING)


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


def test_contact_pushes_by_virtual_work_and_the_power_of_its_depth() -> None:
    angle, stiffness = (0.5, 0.7, 0.4), 2000.0
    distance = height(angle) - 0.001
    torque = finger.meet_object(NOTHING, angle, BONES, distance, stiffness, 1.5)
    force = finger.press_object(0.001, stiffness, 1.5)
    assert force == pytest.approx(2.0, rel=0.03)
    assert torque == pytest.approx(energy_slope(lambda q: force * height(q), angle), rel=1e-5)
    assert finger.meet_object(NOTHING, angle, BONES, distance + 0.002, stiffness, 1.5) == NOTHING
    deep = [finger.press_object(depth, stiffness, 1.5) for depth in (0.01, 0.04)]
    assert deep[1] / deep[0] == pytest.approx(8.0, rel=0.01)  # Hertz's exponent 3/2
    onset = [finger.press_object(finger.ONSET + d, stiffness, 1.3) for d in (-1e-9, 0.0, 1e-9)]
    assert onset[2] - onset[1] == pytest.approx(onset[1] - onset[0], rel=1e-3)  # is smooth


def test_coupling_is_a_spring() -> None:
    angle, stiffness, ratio = (0.5, 0.7, 0.2), 0.02, 0.67
    torque = finger.tie_joints(NOTHING, angle, stiffness, ratio)
    assert torque == pytest.approx(
        energy_slope(lambda q: 0.5 * stiffness * (q[2] - ratio * q[1]) ** 2, angle), rel=1e-6
    )
    assert torque[2] > 0.0


def test_routers_follow_the_tension() -> None:
    settled = 0.0
    for _ in range(100):
        settled = finger.settle_garment(DT, 8.0, 1e-4, 1.0, settled)
    assert finger.worn_height(0.003, 1e-4, 1.0, settled) == pytest.approx(0.0038)


@pytest.mark.parametrize("side", [FLEXOR, EXTENSOR])
@pytest.mark.parametrize("stored", [1.0, 0.0])
def test_a_garment_that_yields_stores_its_work(side: float, stored: float) -> None:
    """Work of a cycle in tension and angle is nil (stroke at the spool, torque at the joint), unless none is stored."""
    t = np.linspace(0.0, 2 * pi, 20001)
    tension, angle = 6.0 + 4.0 * np.cos(t), 0.6 + 0.5 * np.sin(t)
    stroke, torque = [], []
    for pull, q in zip(tension, angle, strict=True):
        high = finger.worn_height(0.003, 1e-4, stored, pull)
        turn = finger.lever_height(high, 1e-4, stored, pull)
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
            filtered = motor.filter_command(DT, k * DT, loop_time, 0.4, 0.8, 1.0, filtered)
        assert 1999 * DT - filtered == pytest.approx(0.8 * 1.5 * loop_time, abs=DT)


def test_a_latency_is_told_in_words_that_hold_for_any_machine():
    latency = exo.load_robot("so101").machine.effect("servo.latency")
    words = set(f"{latency.summary} {latency.signature} {latency.equation}".replace(":", " ").split())
    assert not words & {"stroke", "Speed", "[m/s]", "motor", "whole", "tension"}


K, MU = 2700.0, 0.6  # N/m, -


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
