"""The recovery exam: a fit to a noise-free log finds the parameters of every effect of every machine again."""

from math import exp, log

import numpy as np
import pytest
from effects_motion import motion_of
from scipy.optimize import least_squares

import exodrake as exo
from exodrake.effects import LIBRARY
from exodrake.machines.robot_file import machine_folders
from exodrake.model.effect import EffectParameter

SEED = 20  # of the packets that arrive; the noise itself is switched off
MOTIONS = {"tendon_sheath": (1, 3)}  # seeds: play that grows with the bend shows at two bends only
SPREAD = (1.0, 1.15, 0.9)  # the channels of an effect differ by these factors
AWAY = 0.75  # of its true value: where a parameter starts
TOLERANCE = 0.01

# injected where the effect's defaults hide a parameter
INJECTED = {
    "motor.slow_velocity_loop": {"share": 0.4, "order": 1.5},
    "motor.current_limit": {"limit": 0.03},
    "motor.speed_droop": {"limit": 0.024},  # slow enough that each drive is held in as well as out
    "finger.gravity": {"pitch": 0.4},
    "motor.spool_layers": {"pitch": 0.004},
    "finger.voluntary_torque": {"growth": 0.02},
}
# parameters with several minima (frequencies, lengths of a period) or that act from a threshold on start closer
CLOSER = {
    ("finger.tremor", "frequency"): 0.996,
    ("motor.spool_layers", "pitch"): 1.02,
    ("motor.speed_droop", "limit"): 0.97,
    ("scale.backlash", "half_width"): 0.98,
}
# channels that show nothing: a joint without that neighbour, a tendon that takes in less than a layer
SILENT = {
    "cable.coupling_to_next": "q6", "cable.coupling_to_previous": "q4",
    "cable.drag_by_next": "q6", "cable.drag_by_previous": "q4", "motor.spool_layers": "AE",
}  # fmt: skip
# the log changes in steps with the parameter: it is scanned, for all channels at once
STEPWISE = {"motor.dead_zone", "timing.dropped_commands", "reading.quantisation", "reading.packet_loss"}


# rounding at another step agrees only where both give the same multiple: scanned near the truth
NEAR = {"reading.quantisation": 0.03}


def every() -> list[tuple[str, str]]:
    """Machine and effect; a generic effect once, on the machine with the fewest channels."""
    machines = [exo.load_robot(name).machine for name in machine_folders()]
    machines.sort(key=lambda machine: (len(machine.axes.joints), machine.frame < 0.01))
    generic = {e.signature for e in LIBRARY.values() if e.block == "signal"}
    found = {
        (e.signature if e.signature in generic else (m.name, e.id)): (m.name, e.id)
        for m in machines[::-1]
        for e in m.effects
    }
    return list(found.values())


EVERY = every()
SMOOTH = [pytest.param(*case, id=case[1]) for case in EVERY if case[1] not in STEPWISE]
STEPS = [case for case in EVERY if case[1] in STEPWISE]

INWARD = {"linear": float, "log": log, "reciprocal": lambda x: 1.0 / x}
OUTWARD = {"linear": float, "log": exp, "reciprocal": lambda u: 1.0 / u}


class Exam:
    """A machine with one effect injected, and what its log shows in units of the noise."""

    def __init__(self, name: str, identity: str) -> None:
        robot = exo.load_robot(name)
        machine, self.effect = robot.machine, robot.machine.effect(identity)
        self.robot = robot.with_parameters(dict.fromkeys(machine.noise, 0.0))
        self.motions = [exo.Reference(motion_of(name, seed)) for seed in MOTIONS.get(name, (1,))]
        noise, self.noise_std = machine.noise_std(lambda name: robot[name]), {}
        for kind in machine.compared:
            channels = machine.axes.of(machine.signal[machine.column(kind).signal].axis)
            self.noise_std |= {f"{kind}_{channel}": noise[kind] for channel in channels}
        self.fitted = [
            (parameter, channel)
            for parameter in self.effect.parameters
            if parameter.fitted
            for channel in machine.axes.of(parameter.axis)
            if channel != SILENT.get(identity)
        ]
        self.truth = [self.injected(p, machine.axes.of(p.axis).index(channel)) for p, channel in self.fitted]

    def injected(self, parameter: EffectParameter, channel: int) -> float:
        value = INJECTED.get(self.effect.id, {}).get(parameter.name, parameter.initial)
        return min(max(value * SPREAD[channel % 3] if parameter.axis else value, parameter.low), parameter.high)

    def log(self, values) -> np.ndarray:
        """Compared columns of all motions (samples,), in units of their noise, with the effect at these values."""
        given: dict = {}
        for (parameter, channel), value in zip(self.fitted, values, strict=True):
            if channel:
                given.setdefault(parameter.name, {})[channel] = value
            else:
                given[parameter.name] = value
        ill = self.robot.splice(self.effect.id, given)
        logs = [exo.simulate(ill, motion, seed=SEED, quantisation=False) for motion in self.motions]
        return np.concatenate([found[column] / std for found in logs for column, std in self.noise_std.items()])

    def start(self, parameter: EffectParameter, value: float) -> float:
        """Where a parameter starts, as the fit sees it."""
        share = CLOSER.get((self.effect.id, parameter.name), AWAY)
        near = share * value if value != 0.0 else 0.1 * (parameter.high - parameter.low)
        return INWARD[parameter.transform](min(max(near, parameter.low), parameter.high))

    def fit(self) -> list[float]:
        """Parameters found by bounded Gauss-Newton steps (trust region)."""
        measured, parameters = self.log(self.truth), [parameter for parameter, _ in self.fitted]
        ends = [sorted(INWARD[p.transform](x) for x in (p.low, p.high)) for p in parameters]

        def outward(u) -> list[float]:
            return [OUTWARD[p.transform](x) for p, x in zip(parameters, u, strict=True)]

        found = least_squares(
            lambda u: self.log(outward(u)) - measured,
            [self.start(p, value) for p, value in zip(parameters, self.truth, strict=True)],
            bounds=(np.array(ends)[:, 0] - 1e-9, np.array(ends)[:, 1] + 1e-9),
            x_scale="jac", diff_step=1e-4, max_nfev=40, xtol=1e-6,
        )  # fmt: skip
        return outward(found.x)


@pytest.mark.parametrize("name, identity", SMOOTH)
def test_a_fit_finds_the_injected_parameters_again(name: str, identity: str) -> None:
    exam = Exam(name, identity)
    assert exam.fit() == pytest.approx(exam.truth, rel=TOLERANCE)


@pytest.mark.parametrize("name, identity", STEPS)
def test_a_scan_finds_the_injected_parameter_again(name: str, identity: str) -> None:
    """The best of 60 values over the plausible range, or near the truth, is one of the two next to it."""
    exam = Exam(name, identity)
    parameter = exam.fitted[0][0]
    truth, near = parameter.initial, NEAR.get(identity)
    low, high = ((1.0 - near) * truth, (1.0 + near) * truth) if near else (parameter.low, parameter.high)
    grid = np.geomspace(low, high, 60)

    def log(value: float) -> np.ndarray:
        return exam.log([value if p is parameter else p.initial for p, _ in exam.fitted])

    measured = log(truth)
    costs = [np.sum((log(value) - measured) ** 2) for value in grid]
    nearest = np.argsort(np.abs(np.log(grid / truth)))[:2]
    assert np.argmin(costs) in nearest


def test_the_exam_is_for_every_effect() -> None:
    assert len(EVERY) == len(SMOOTH) + len(STEPWISE) >= 90
