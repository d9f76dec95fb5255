"""Calibration: the numbers of the tests, for a machine.

`exodrake calibrate` measures them on simulated robots of the machine and writes `calibration.yaml` into its folder. A
machine without that file has those of `UNCALIBRATED`, and its verdict says so.
"""

from __future__ import annotations

from dataclasses import dataclass

from exodrake.core.machine import Machine
from exodrake.core.schema import anything, mapping, number, text
from exodrake.core.yaml_file import read_yaml
from exodrake.machines.library import machine_folders

FILE = "calibration.yaml"  # in the folder of the machine


@dataclass(frozen=True)
class Calibration:
    """Upper quantiles of what simulated robots show.

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


# from development robots of the Exo-Index; 40 healthy ones of them moved by 0.24 to 0.89
UNCALIBRATED = Calibration(
    law_error=0.4, same_meaning=0.05, taken=0.7, moved=2.0
)  # development robots of the Exo-Index
SCHEMA = mapping(
    {
        "law_error": number(above=0.0),
        "same_meaning": number(above=0.0),
        "taken": number(above=0.0),
        "moved": number(above=0.0),
        "source": text(),
        "rates": anything,
    },
    required=("law_error", "same_meaning", "taken", "moved", "source"),
)


def calibration_of(machine: Machine) -> Calibration:
    """The calibration of a machine; `UNCALIBRATED` without one. Raises InputError for a malformed file."""
    folder = machine_folders().get(machine.name)
    if folder is None or not (folder / FILE).is_file():
        return UNCALIBRATED
    content = SCHEMA(read_yaml(folder / FILE), str(folder / FILE))
    return Calibration(**{key: content[key] for key in ("law_error", "same_meaning", "taken", "moved", "source")})
