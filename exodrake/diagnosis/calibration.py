"""Calibration: how often verdicts on a machine err, as `exodrake calibrate` measured it on simulated robots.

A machine's folder holds them in `calibration.yaml`. No number of the diagnosis comes from there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from exodrake.core.confidence import binomial_interval
from exodrake.core.provenance import configuration
from exodrake.core.schema import dump_yaml, mapping, number, read_yaml, text
from exodrake.machines.robot_file import machine_folders
from exodrake.model.machine import Machine

FILE = "calibration.yaml"  # in the folder of the machine
ALARM, NAMED, CLASS = "healthy: a cause", "one effect: named alone", "one effect: in class"
UNKNOWN, UNSEEN, COVERED = "one effect: UNKNOWN", "one effect: not seen", "90 % intervals: hold the truth"
RATES = {
    ALARM: "healthy robots that were given a cause",
    NAMED: "robots with one effect whose effect is the only cause, without a rival",
    CLASS: "robots with one effect whose effect is a cause, a rival of one, or another law of its family and block",
    UNKNOWN: "robots with one effect whose cause stays unknown",
    UNSEEN: "robots with one effect that show no gap, or one that retuning closes",
    COVERED: "parameters of rightly named effects that lie in their 90 % intervals",
}


@dataclass(frozen=True)
class Calibration:
    """Error rates of a machine's verdicts."""

    source: str = ""  # command and date; empty if nothing was measured
    code: str = ""  # first digits of the SHA-256 of the code that was measured
    rates: Mapping[str, tuple[int, int]] | None = None  # rate of `RATES` -> count k of n


RATE = mapping({name: number(low=0.0) for name in ("k", "n", "low", "high")}, required=("k", "n"))
SCHEMA = mapping(
    {"source": text(), "code": text(), "rates": mapping(dict.fromkeys(RATES, RATE), required=tuple(RATES))},
    required=("source", "code", "rates"),
)


def read_calibration(machine: Machine) -> Calibration:
    """The calibration of a machine; an empty one if it has none. InputError for a malformed file."""
    folder = machine_folders().get(machine.name)
    if folder is None or not (folder / FILE).is_file():
        return Calibration()
    content = SCHEMA(read_yaml(folder / FILE), str(folder / FILE))
    rates = {name: (int(rate["k"]), int(rate["n"])) for name, rate in content["rates"].items()}
    return Calibration(content["source"], content["code"], rates)


def calibration_notes(machine: Machine) -> tuple[str, ...]:
    """A sentence on missing tolerances, and one on the error rates of verdicts where they were measured."""
    notes, found = [], read_calibration(machine)
    if not machine.tolerances:
        notes.append(f"{machine.name} states no tolerances: its nominal parameters count as exact and are not retuned")
    if found.rates is not None:
        (alarms, healthy), (named, ill) = (
            (f"{k} {'was' if k == 1 else 'were'}", n) for k, n in (found.rates[ALARM], found.rates[NAMED])
        )
        other = "" if found.code == configuration()["code"] else " (measured on another version)"
        notes.append(
            f"of {healthy} healthy robots of this kind {alarms} given a cause; "
            f"of {ill} with one effect {named} named rightly{other}"
        )
    return tuple(notes)


def calibration_text(found: Calibration) -> str:
    """The file of a calibration: each count k of n with its exact 95 % interval, the whole range for n = 0."""
    rates = {}
    for name, (k, n) in (found.rates or {}).items():
        low, high = binomial_interval(k, n)
        rates[name] = {"k": k, "n": n, "low": round(low, 4), "high": round(high, 4)}
    return dump_yaml({"source": found.source, "code": found.code, "rates": rates})
