"""Robots that wear, loosen, are donned anew, drift or stay, session by session.

The sheath's robots come from exodrake's own engine; those of the Exo-Index from the reference simulator of the blind
package, which shares no equation with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np

import exodrake as exo
from exodrake.data.case import Case, CaseLog
from exodrake.data.log import Log
from exodrake.diagnosis.healthy import healthy_robot
from exodrake.reference.cases import wander
from exodrake.reference.make import round_columns
from exodrake.reference.robot import InjectedFault, RobotSpec, draw_parameters
from exodrake.reference.simulator import simulate as simulate_reference
from exodrake.simulation import protocols
from exodrake.simulation.references import on_machine

START = datetime(2026, 1, 1, tzinfo=UTC)
SESSIONS, SECONDS = 10, 10.0
EARLIEST, LATEST = 1.5, 6.0  # d, of the begin
EXO_SHARE = 0.3  # of the random motion of a blind case


@dataclass(frozen=True)
class Kind:
    """A kind of robot.

    Attributes:
        name: what happens to it.
        effect, parameter: of the change.
        value: at t [d], with its begin [d].
        changes: whether it changes at all.
        same_law: whether the parameter means the same in the simulator and in the library.
        alike: other effects that do the same to the logs.
    """

    name: str
    effect: str
    parameter: str
    value: Callable[[float, float], float]
    changes: bool = True
    same_law: bool = True
    alike: tuple[str, ...] = ()


def ramp(first: float, rate: float) -> Callable[[float, float], float]:
    """A value that grows by `rate` a day from the begin on."""
    return lambda t, begin: first + rate * max(t - begin, 0.0)


def step(first: float, second: float) -> Callable[[float, float], float]:
    """A value that changes at the begin."""
    return lambda t, begin: second if t > begin else first


KINDS = (
    Kind("wear: play grows from 3° by 0.2° a day", "sheath.play", "half_width", ramp(0.052, 0.0035)),
    Kind("the same by 0.05° a day", "sheath.play", "half_width", ramp(0.052, 0.0009)),
    Kind("loosening: play from 3° to 3.6°", "sheath.play", "half_width", step(0.052, 0.063)),
    Kind("the same to 3.1°", "sheath.play", "half_width", step(0.052, 0.054)),
    Kind("donned anew: zero moves by 0.6°", "sheath.offset", "offset", step(0.0, 0.01)),
    Kind("the same from 3° to 3.1°", "sheath.offset", "offset", step(0.052, 0.054)),
    Kind("temperature: gain drifts by 1 % a day", "sheath.gain", "gain", ramp(0.0, -0.01)),
    Kind("the same from -15 % by 0.2 % a day", "sheath.gain", "gain", ramp(-0.15, -0.002)),
    Kind("steady, play 3°", "sheath.play", "half_width", ramp(0.052, 0.0), changes=False),
    Kind("steady, gain -15 %", "sheath.gain", "gain", ramp(-0.15, 0.0), changes=False),
    Kind("steady, healthy", "sheath.offset", "offset", ramp(0.0, 0.0), changes=False),
)


EXO_KINDS = (
    Kind(
        "wear: friction grows from 0.15 by 0.03 a day",
        "tendon.capstan_friction",
        "mu_phi",
        ramp(0.15, 0.03),
        same_law=False,
    ),
    Kind(
        "loosening: slack from 1 to 3 mm",
        "tendon.slack",
        "length",
        step(0.001, 0.003),
        alike=("encoder.homing_offset",),
    ),
    Kind("steady, friction 0.2", "tendon.capstan_friction", "mu_phi", ramp(0.2, 0.0), changes=False, same_law=False),
)


def sheath_case(kind: Kind, seed: int) -> tuple[Case, exo.Robot, float]:
    """Sessions of a drawn sheath, its nominal robot, and the begin of the change [d]."""
    rng, nominal, logs = np.random.default_rng(seed), exo.load_robot("tendon_sheath"), []
    begin, base = rng.uniform(EARLIEST, LATEST), healthy_robot(nominal, rng)
    for k in range(SESSIONS):
        value = kind.value(float(k), begin)
        robot = base.splice(kind.effect, {kind.parameter: value}) if value else base
        own = int(rng.integers(1 << 31))
        motion = on_machine(protocols.random_motion, nominal, duration=SECONDS, seed=own, fastest=1.0)
        date = START + timedelta(days=k)
        logs.append(CaseLog(exo.simulate(robot, motion, seed=own), "random", "fit", None, f"{k}.csv", date))
    return Case("sheath", {}, tuple(logs), nominal.machine.frame), nominal, begin


def exo_case(kind: Kind, seed: int) -> tuple[Case, exo.Robot, float]:
    """Sessions of a drawn Exo-Index from the reference simulator, and the begin of the change [d]."""
    rng, logs = np.random.default_rng(seed), []
    begin, parameters = rng.uniform(EARLIEST, LATEST), draw_parameters(rng)
    for k in range(SESSIONS):
        fault = InjectedFault(kind.effect, wires=("AF",), parameters={kind.parameter: kind.value(float(k), begin)})
        motion = wander(rng, EXO_SHARE)
        columns = round_columns(simulate_reference(RobotSpec(parameters, (fault,)), motion, [seed, k]))
        log = Log(columns.pop("time"), columns, {}, f"{k}.csv")
        logs.append(CaseLog(log, "random", "fit", None, f"{k}.csv", START + timedelta(days=k)))
    return Case("exo", {}, tuple(logs)), exo.load_robot(), begin
