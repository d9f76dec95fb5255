"""Small errors of the nominal numbers, which every hypothesis may have: one knob for each number or set of numbers that errs together.

A knob multiplies its numbers by 1 + x, adds x, or multiplies by exp(x) a number that is known in order of magnitude only; x has the
standard deviation `spread`. 3 % of a number is what building and wearing scatter (`diagnosis.md`); a retune may use up to `LIMIT` of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.diagrams.machine import Machine

SCALES, ADDS, STRETCHES = "scales", "adds", "stretches"
SPREAD = 0.03  # relative scatter of the nominal numbers: diagnosis.md
SPREAD_ANGLE = 0.01  # of a rest or limit angle that is near 0 [rad]: assumed
LIMIT_ANGLE = 0.03  # rad: assumed
LIMIT = 0.10  # relative; beyond it a number is not the nominal one any more: diagnosis.md, RETUNE


@dataclass(frozen=True)
class Knob:
    """Places in the flat numbers that move together: `how` is SCALES (1 + x), ADDS (+ x) or STRETCHES (exp x)."""

    name: str
    places: tuple[int, ...]
    how: str
    spread: float
    limit: float


RELATIVE = (
    "tendon.k.{w}", "finger.kappa.{j}", "finger.B.{j}", "finger.q_f.{j}", "finger.beta.{j}", "finger.A.{j}",
    "router.a_f.{j} router.b_f.{j}", "router.m_f.{j} router.n_f.{j}", "router.a_e.{j} router.b_e.{j}", "router.m_e.{j} router.n_e.{j}",
    "motor.kM.{w}", "motor.J.{w}", "motor.Ki.{w}", "sensor.tau_F",
)  # fmt: skip
MACHINED = ("motor.r.{w}",)  # turned on a lathe: scatters less; assumed
SPREAD_MACHINED, LIMIT_MACHINED = 0.01, 0.03
ADDED = ("finger.q0.{j}", "finger.q_e.{j}")
SPREAD_LOOSE, LIMIT_LOOSE = 1.0, 2.5  # of the logarithm
LOOSE = ("tendon.presliding",)  # known in order of magnitude; acts only where a friction effect does


def knobs(machine: Machine) -> tuple[Knob, ...]:
    """All knobs of a machine."""
    table: tuple[tuple[tuple[str, ...], str, float, float], ...] = (
        (RELATIVE, SCALES, SPREAD, LIMIT),
        (MACHINED, SCALES, SPREAD_MACHINED, LIMIT_MACHINED),
        (ADDED, ADDS, SPREAD_ANGLE, LIMIT_ANGLE),
        (LOOSE, STRETCHES, SPREAD_LOOSE, LIMIT_LOOSE),
    )
    return tuple(
        make(machine, name, how, spread, limit)
        for patterns, how, spread, limit in table
        for pattern in patterns
        for name in expand(machine, pattern)
    )


def expand(machine: Machine, pattern: str) -> list[str]:
    """The pattern for each wire or joint that it names."""
    if "{w}" in pattern:
        return [pattern.replace("{w}", wire) for wire in machine.lanes.wires]
    if "{j}" in pattern:
        return [pattern.replace("{j}", joint) for joint in machine.lanes.joints]
    return [pattern]


def make(machine: Machine, names: str, how: str, spread: float, limit: float) -> Knob:
    """A knob of the numbers in `names`."""
    return Knob(names, tuple(machine.index[name] for name in names.split()), how, spread, limit)


def turned(values: np.ndarray, all_knobs: tuple[Knob, ...], x: np.ndarray) -> np.ndarray:
    """Flat numbers with each knob at x (knobs,)."""
    out = values.copy()
    for knob, amount in zip(all_knobs, x, strict=True):
        if amount != 0.0:
            for place in knob.places:
                out[place] = moved(out[place], knob.how, amount)
    return out


def moved(value: float, how: str, amount: float) -> float:
    """A number after its knob was turned by `amount`."""
    if how == ADDS:
        return value + amount
    return value * (1.0 + amount if how == SCALES else np.exp(amount))
