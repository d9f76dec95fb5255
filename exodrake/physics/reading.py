"""Sensor of any signal: samples it once a frame, with white noise and rounding, and delivers the readings.

The generic effects of a signal (`signal.*`: gain, delay, backlash, packet loss, ...) act here. A machine takes a sensor
of its own for each signal that it measures: `sensor("reading", "angle", unit="rad", ...)`.
"""

from dataclasses import replace

from exodrake.model.part import JOINTS, SCALAR, Output, Part, Point, State, Task, module_of_file, parameter_class
from exodrake.physics.arithmetic import round_to

mix_channels = Point("mixed", JOINTS, "value, other",
                     "value [SI] of channel j as the sensor sees it; other: of the next channel, last the first",
                     standard="signal.mixed")  # fmt: skip
show_value = Point("shown", JOINTS, "value, clock, period",
                   "value [SI] of channel j before noise; clock, period [s]: since the first sample and since the last",
                   standard="signal.shown")  # fmt: skip
deliver = Point("delivered", JOINTS, "value, held, arrival",
                "reading [SI] of channel j as the log gets it; held: the one before; arrival: uniform in 0 .. 1",
                standard="signal.delivered")  # fmt: skip


def age(x, z, n, e, dt):
    """Time goes on from the first sample [s]."""
    if x[-1] > 0.0:
        x[-3] += dt


def read(x, z, n, e, value, noise, arrival):
    """One sample of all channels; signals [SI], standard normal, uniform draws. x: readings, clock, its last value."""
    count = value.shape[0]
    for j in range(count):
        seen = mix_channels(e, z, j, value[j], value[j + 1 if j + 1 < count else 0])
        noisy = show_value(e, z, j, seen, x[-3], x[-3] - x[-2]) + n.sigma[j] * noise[j]
        x[j] = deliver(e, z, j, round_to(noisy, n.step[j]), x[j], arrival[j])
    x[-2], x[-1] = x[-3], 1.0


def sensor(
    name: str, signals: tuple[str, str, str, str], unit: str, slot: int, frame: float, size: float, channels: int
) -> Part:
    """A sensor of one machine.

    Args:
        name: of the part.
        signals: the signal that it measures, its noise, its uniform draws of lost readings, and its readings.
        unit: SI unit of the signal.
        slot: in which it samples.
        frame: time between samples [s].
        size: by how much the signal typically moves [SI]; ranges of the generic effects scale with it.
        channels: how many the signal has; crosstalk takes two.
    """
    return Part(
        name=name,
        module=module_of_file(f"{__name__}_{name}", __file__),  # its own, since points of two parts cannot share one
        parameters=parameter_class((JOINTS, {"sigma": unit, "step": unit}), (SCALAR, {"repeatability": unit})),
        states=(State("reading", JOINTS, unit=unit), State("clock", unit="s", width=2), State("started")),
        tasks=(Task("age", ()), Task("read", signals[:3], slots=(slot,))),
        outputs=(Output.of_states(reading=signals[3]),),
        points=(mix_channels if channels > 1 else replace(mix_channels, standard=""), show_value, deliver),
        scales={"value": (size, unit), "value/s": (size, f"{unit}/s"), "period": (frame, "s")},
    )
