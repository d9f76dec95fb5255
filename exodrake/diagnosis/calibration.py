"""Calibration: the numbers of the tests, for a machine.

`exodrake calibrate` measures them on simulated robots of the machine (`calibrate`). Every diagnosis reads them from the
file `calibration.yaml` in the machine's folder. A machine without that file has the numbers of `UNCALIBRATED`, and its
verdict says so.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from exodrake.core.effect import Effect
from exodrake.core.machine import Machine
from exodrake.core.plugins import single_machines
from exodrake.core.schema import anything, mapping, number, text
from exodrake.core.yaml_file import dump_yaml, read_yaml
from exodrake.diagnosis.parameter import expanded
from exodrake.machines.library import machine_folders

FILE = "calibration.yaml"  # in the folder of the machine
DIGITS = 4  # significant ones of a number in the file


@dataclass(frozen=True)
class Calibration:
    """Numbers of the tests: upper quantiles of statistics of simulated robots.

    Attributes:
        law_error: rho, relative standard deviation of the law of an effect [-].
        same_meaning: the same of a parameter that means the same in every law [-].
        taken: share of the excess over noise that an effect which is not there takes up [-].
        moved: mean square of the changes of nominal parameters in standard deviations of their tolerances [-].
        source: command and date; empty if nothing was measured.
    """

    law_error: float
    same_meaning: float
    taken: float
    moved: float
    source: str = ""

    def rho(self, effect: Effect, decoded: Collection[str]) -> float:
        """Relative standard deviation of the law of an effect [-]; `decoded`: ids of effects whose size was decoded."""
        return self.same_meaning if effect.same_meaning and effect.id not in decoded else self.law_error


# from development robots of the Exo-Index with 50 tolerances: 40 healthy ones moved by 0.24 to 0.89; absent effects
# took up 0.59 at most in the first cases, and nearly all of a small excess beside an offset later
UNCALIBRATED = Calibration(law_error=0.4, same_meaning=0.05, taken=0.6, moved=1.0)
FEW = 0.98  # quantile of chi-square by which `moved` is larger for a machine with fewer tolerances
NUMBERS = tuple(name for name in asdict(UNCALIBRATED) if name != "source")
SCHEMA = mapping(
    {**dict.fromkeys(NUMBERS, number(above=0.0)), "source": text(), "rates": anything, "rests_on": anything},
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
    return Calibration(**{key: content[key] for key in (*NUMBERS, "source")})


def tolerances(machine: Machine) -> int:
    """Number of nominal parameters with a tolerance."""
    names = (name for group in machine.tolerances for name in group.parameters)
    return sum(len(expanded(name, machine.axes)) for name in names)


def spread(count: int) -> float:
    """Upper quantile of the mean square of so many standard normal numbers."""
    from scipy.stats import chi2

    return float(chi2.ppf(FEW, count)) / count if count else 1.0


def calibration_notes(machine: Machine) -> tuple[str, ...]:
    """Notes on missing tolerances and a missing calibration, a sentence each; none for other machines."""
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
    return dump_yaml({**numbers, "source": found.source, "rests_on": dict(rests_on), "rates": dict(rates)})
