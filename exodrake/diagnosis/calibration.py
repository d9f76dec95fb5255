"""Calibration: the numbers of the tests, for a machine.

`exodrake calibrate` measures them on simulated robots of the machine (`calibrate`). In the file `calibration.yaml` of
its folder they are used by every diagnosis. A machine without that file has those of `UNCALIBRATED`, and its verdict
says so.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from exodrake.core.errors import InputError
from exodrake.core.machine import Machine
from exodrake.core.plugins import single_machines
from exodrake.core.schema import anything, listing, mapping, number, text, whole
from exodrake.core.yaml_file import dump_yaml, read_yaml
from exodrake.diagnosis.parameter import expanded
from exodrake.machines.library import machine_folders

FILE = "calibration.yaml"  # in the folder of the machine
DIGITS = 4  # significant ones of a number in the file


@dataclass(frozen=True)
class RicherLaw:
    """What an effect with a richer law takes up where a simpler one is there, or another law of that (`Effect.law_of`).

    Attributes:
        law, richer: ids of the simpler and the richer effect.
        taken: share of a significant excess over noise, the upper quantile over robots [-].
        robots: how many.
        source: command and date.
    """

    law: str
    richer: str
    taken: float
    robots: int
    source: str


@dataclass(frozen=True)
class Calibration:
    """Upper quantiles of what simulated robots show.

    Attributes:
        law_error: rho, relative standard deviation of the law of an effect [-].
        same_meaning: the same of a parameter that means the same in every law [-].
        taken: share of the excess over noise that an effect which is not there takes up [-].
        moved: mean square of the changes of nominal parameters in standard deviations of their tolerances [-].
        source: command and date; empty if nothing was measured.
        richer: what richer laws of an effect take up where it is there, or another law of it.
    """

    law_error: float
    same_meaning: float
    taken: float
    moved: float
    source: str = ""
    richer: tuple[RicherLaw, ...] = ()

    def taken_by(self, rival: Collection[str], effects: Collection[str]) -> float | None:
        """Share that a rival takes up at most which has a richer law of one of the true effects; None if not known."""
        changed = (set(effects) - set(rival), set(rival) - set(effects))
        return next((r.taken for r in self.richer if ({r.law}, {r.richer}) == changed), None)


# from development robots of the Exo-Index with 50 tolerances: 40 healthy ones moved by 0.24 to 0.89; absent effects
# took up 0.59 at most in the first cases, and nearly all of a small excess beside an offset later
UNCALIBRATED = Calibration(law_error=0.4, same_meaning=0.05, taken=0.6, moved=1.0)
FEW = 0.98  # quantile of chi-square by which `moved` is larger for a machine with fewer tolerances
NUMBERS = tuple(name for name in asdict(UNCALIBRATED) if name not in ("source", "richer"))
RICHER = {"law": text(), "richer": text(), "taken": number(low=0.0), "robots": whole(low=1), "source": text()}
SCHEMA = mapping(
    {
        **dict.fromkeys(NUMBERS, number(above=0.0)),
        "source": text(),
        "rates": anything,
        "rests_on": anything,
        "richer_laws": listing(mapping(RICHER, required=tuple(RICHER))),
    },
    required=(*NUMBERS, "source"),
)


def calibration_of(machine: Machine) -> Calibration:
    """The calibration of a machine; `UNCALIBRATED` without one, scaled to its number of tolerances.

    Raises:
        InputError: for a malformed file.
    """
    folder = machine_folders().get(machine.name)
    if folder is None or not (folder / FILE).is_file():
        return replace(UNCALIBRATED, moved=UNCALIBRATED.moved * spread(tolerances(machine)) / spread(50))
    content = SCHEMA(read_yaml(folder / FILE), str(folder / FILE))
    richer = tuple(RicherLaw(**entry) for entry in content.get("richer_laws", ()))
    return Calibration(**{key: content[key] for key in (*NUMBERS, "source")}, richer=richer)


def tolerances(machine: Machine) -> int:
    """Number of nominal parameters with a tolerance."""
    names = (name for group in machine.tolerances for name in group.parameters)
    return sum(len(expanded(name, machine.axes)) for name in names)


def spread(count: int) -> float:
    """Upper quantile of the mean square of so many standard normal numbers."""
    from scipy.stats import chi2

    return float(chi2.ppf(FEW, count)) / count if count else 1.0


def calibration_notes(machine: Machine) -> tuple[str, ...]:
    """What a verdict says of a machine whose tests are not calibrated; nothing of others."""
    found = []
    if not tolerances(machine):
        found.append(f"{machine.name} states no tolerances: its nominal parameters count as exact and are not retuned")
    if not calibration_of(machine).source:
        folder = single_machines().get(machine.name)
        option = f"--machine {folder.name}" if folder else f"--robot {machine.name}"
        found.append(f"the tests of {machine.name} are not calibrated; `exodrake calibrate {option}`")
    return tuple(found)


def calibration_text(found: Calibration, rests_on: Mapping[str, int], rates: Mapping[str, Any]) -> str:
    """The file of a calibration.

    Args:
        found: its numbers and source.
        rests_on: number -> count of simulated robots that it comes from.
        rates: error rates of the tests.
    """
    numbers = {name: float(f"{getattr(found, name):.{DIGITS}g}") for name in NUMBERS}
    content = {**numbers, "source": found.source, "rests_on": dict(rests_on), "rates": dict(rates)}
    return dump_yaml(content | ({"richer_laws": [asdict(r) for r in found.richer]} if found.richer else {}))


def with_richer_laws(machine: Machine, found: Sequence[RicherLaw]) -> str:
    """The calibration in use of a machine, as a file, with other richer laws of the same effects.

    Raises:
        InputError: for a machine without a calibration, or a malformed one.
    """
    folder, used = machine_folders().get(machine.name), calibration_of(machine)
    if folder is None or not (folder / FILE).is_file():
        raise InputError(f"{machine.name} has no {FILE} yet: `exodrake calibrate` without --law makes it")
    content = SCHEMA(read_yaml(folder / FILE), str(folder / FILE))
    kept = [r for r in used.richer if r.law not in {new.law for new in found}]
    rounded = [replace(r, taken=float(f"{r.taken:.{DIGITS}g}")) for r in found]
    return calibration_text(
        replace(used, richer=(*kept, *rounded)), content.get("rests_on", {}), content.get("rates", {})
    )
