"""Replay of each segment between measured wires, frame by frame: the same ticks and tasks as `diagnosis.loop.Loop`,
compiled.

This page is printed behind an import of the machine's leaf functions (`live.compiled`), so that numba can cache it.
Feeds are values in the middle of the bus reads and their rates, (frames, 3) each; a wire within a frame runs straight.
Part states and wires go on from call to call.
"""

from math import cos, sin
from typing import Any

from numba import njit

# bound when the page is printed
motor__leaf__update: Any = None
motor__leaf__hold: Any = None
encoder__leaf__read: Any = None
bus__leaf__write: Any = None
controller__leaf__control: Any = None
finger__leaf__update: Any = None
finger__leaf__output_tension: Any = None
sensor__leaf__update: Any = None
sensor__leaf__output: Any = None
sensor__leaf__read: Any = None
mocap__leaf__sample: Any = None
routers__path: Any = None

Q, RATE, TAKEN, THETA = (
    0,
    3,
    12,
    6,
)  # places in the states of finger and motor (`systems.tendon_finger`, `systems.motor`)

EASE = 0.9  # a log may begin in motion; the drive settles in a few frames


@njit(cache=True)
def fed(now, feed, rate, frame, later):
    """`now` (3,) of a wire, `later` [s] after the middle of the bus reads."""
    for j in range(3):
        now[j] = feed[frame, j] + later * rate[frame, j]


@njit(cache=True)
def controller_frames(state, speed_cmd, p, reference, tension, out):
    """Commands [m/s] of the controller from references and readings [N]."""
    for frame in range(len(out)):
        controller__leaf__control(state, speed_cmd, p, reference[frame], tension[frame])
        out[frame, :] = speed_cmd


@njit(cache=True)
def motor_frames(
    states, wires, parameters, slots, clock, command, tension, rate, packet_arrival, measured, pull, share, out
):
    """Strokes [m] of bus, drive and encoder from commands [m/s] and tensions [N].

    states, numbers: of motor, encoder, bus; wires: stroke, wire_speed, spool_angle, stroke_read, speed_applied,
    tension; slots: of the encoder's and of the bus' tasks; clock: slot [s], slots in a frame, middle of the reads [s].
    The spools are pulled to the measured strokes by the shares `pull` (3,) of the difference, 1 at first, `EASE` of the
    last a frame, then `share`: a motor integrates, so that a replay would wander.
    """
    motor, encoder, bus = states
    motor_p, encoder_p, bus_p = parameters
    stroke, wire_speed, spool_angle, stroke_read, speed_applied, load = wires
    for frame in range(len(out)):
        for slot in range(clock[1]):
            motor__leaf__update(motor, stroke, wire_speed, spool_angle, motor_p, clock[0], speed_applied, load)
            fed(load, tension, rate, frame, (slot + 0.5) * clock[0] - clock[2])
            for j in range(3):
                load[j] = max(load[j], 0.0)
            for channel in range(3):
                if slot == slots[0][channel]:
                    encoder__leaf__read(encoder, stroke_read, encoder_p, channel, spool_angle)
                if slot == slots[1][channel]:
                    bus__leaf__write(bus, speed_applied, bus_p, channel, command[frame], packet_arrival)
        out[frame, :] = stroke_read
        for j in range(3):
            off = measured[frame, j] - stroke_read[j]
            if off == off:
                motor[THETA + j] += pull[j] * off / encoder_p[1]
                pull[j] = max(EASE * pull[j], share)
        motor__leaf__hold(motor, stroke, wire_speed, spool_angle, motor_p)


@njit(cache=True)
def posture(finger, angle, rate, now, arms):
    """Puts the finger into the posture `now` [rad] at rest; arms: a, b, m, n of the flexors and of the extensors (8, 3)
    [m]."""
    taken = (0.0, 0.0, 0.0)
    for i in range(3):
        c, s = cos(now[i]), sin(now[i])
        flexor = routers__path(c, s, arms[0, i], arms[1, i], arms[2, i], arms[3, i], 1.0)[0]
        extensor = routers__path(c, s, arms[4, i], arms[5, i], arms[6, i], arms[7, i], -1.0)[0]
        taken = (taken[0] + flexor, taken[1] + (flexor if i == 0 else 0.0), taken[2] + extensor)
        finger[Q + i], finger[RATE + i], angle[i] = now[i], 0.0, now[i]
    finger[TAKEN], finger[TAKEN + 1], finger[TAKEN + 2] = taken


@njit(cache=True)
def tendon_frames(states, wires, parameters, slots, clock, stroke_in, stroke_rate, angle_in, angle_rate, arms, out):
    """Readings of the cells [N] from strokes [m] and angles [rad]; `out` (frames, 3).

    states, numbers: of finger, sensor; wires: angle, rate, tension_finger, stroke, wire_speed, tension, cell,
    tension_read, quiet, now.
    """
    finger, sensor = states
    finger_p, sensor_p = parameters
    angle, rate, tension_finger, stroke, wire_speed, tension, cell, tension_read, quiet, now = wires
    for frame in range(len(out)):
        for slot in range(clock[1]):
            later = (slot + 0.5) * clock[0] - clock[2]
            finger__leaf__update(finger, angle, rate, tension_finger, finger_p, clock[0], stroke, wire_speed)
            sensor__leaf__update(sensor, tension_read, sensor_p, clock[0], tension, wire_speed)
            fed(now, angle_in, angle_rate, frame, later)
            posture(finger, angle, rate, now, arms)
            fed(stroke, stroke_in, stroke_rate, frame, later)
            wire_speed[:] = stroke_rate[frame]
            finger__leaf__output_tension(finger, finger_p, stroke, tension)
            sensor__leaf__output(sensor, sensor_p, tension, cell)
            for channel in range(3):
                if slot == slots[channel]:
                    sensor__leaf__read(sensor, tension_read, sensor_p, channel, cell, quiet)
        out[frame, :] = tension_read


@njit(cache=True)
def finger_frames(states, wires, parameters, slot_seen, clock, tension_in, tension_rate, soft, out):
    """Pictures [rad] of the finger under given tensions [N], and how late they are [s]; `out` (frames, 4).

    states, numbers: of finger (its wires as soft as `soft` [N/m], so that a stroke is a force) and mocap; wires: angle,
    rate, tension_finger, stroke, wire_speed, angle_read, mocap_delay, quiet.
    """
    finger, mocap = states
    finger_p, mocap_p = parameters
    angle, rate, tension_finger, stroke, wire_speed, angle_read, lateness, quiet = wires
    for frame in range(len(out)):
        for slot in range(clock[1]):
            fed(stroke, tension_in, tension_rate, frame, (slot + 0.5) * clock[0] - clock[2])
            for j in range(3):
                stroke[j] = max(stroke[j], 0.0) / soft
                wire_speed[j] = tension_rate[frame, j] / soft
            finger__leaf__update(finger, angle, rate, tension_finger, finger_p, clock[0], stroke, wire_speed)
            if slot == slot_seen:
                mocap__leaf__sample(mocap, angle_read, lateness, mocap_p, angle, quiet)
        out[frame, :3] = angle_read
        out[frame, 3] = lateness[0]
