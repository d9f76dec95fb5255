"""Table of the tests of an explanation: question, value and level of each."""

from __future__ import annotations

from dataclasses import dataclass

from exodrake.core.confidence import ALPHA
from exodrake.core.machine import Machine
from exodrake.diagnosis.calibration import Calibration, calibration_of
from exodrake.diagnosis.isolation import Tested
from exodrake.diagnosis.levels import LOCAL

P, SHARE, SQUARE = "p-value", "share", "mean square"
MEANINGS = {  # of the numbers of a calibration
    "law_error": "rho, relative error of a law",
    "same_meaning": "rho of a parameter that means the same in every law, and between two simulators of one law",
    "taken": "share of the excess that an absent effect takes up at most",
    "moved": "mean square change of nominal parameters, in tolerances, at most",
}
VIEWS = ("in closed loop", "as prediction error")


@dataclass(frozen=True)
class LevelTest:
    """A test of the explanation behind the verdict, at its level.

    Attributes:
        asks: what it asks, in words.
        measure: what is compared: "p-value", "share" or "mean square".
        value: what was found.
        limit: the level; p-values must be larger, all else at most as large.
        passed: whether the explanation stands the test.
    """

    asks: str
    measure: str
    value: float
    limit: float
    passed: bool


def level_table(t: Tested, limits: Calibration) -> tuple[LevelTest, ...]:
    """The tests of an explanation that was held against all others."""
    p = t.levels
    law = "noise and the error of its law" if t.explanation.effects else "noise"
    rows = [LevelTest(f"Would {law} leave so much, in all?", P, p.fit, ALPHA, p.fit > ALPHA)]
    for view, value in zip(VIEWS, p.views):
        rows.append(LevelTest(f"Would {law} leave so much {view}?", P, value, ALPHA, value > ALPHA))
    if not t.explanation.effects:
        asks = "Would noise leave so much in any window of 2 s?"
        rows.append(LevelTest(asks, P, p.local, LOCAL, p.local > LOCAL))
    asks = "How far do nominal parameters have to move, in standard deviations of their tolerances?"
    rows.append(LevelTest(asks, SQUARE, p.moved, p.most_moved, p.moved <= p.most_moved))
    asks = "How much of what it leaves does the best other explanation take up?"
    rows.append(LevelTest(asks, SHARE, p.share, limits.taken, not p.beaten_by))
    return tuple(rows)


def decision_numbers(machine: Machine) -> list[tuple[str, str, str]]:
    """The numbers of the tests of an explanation: meaning, value and source. The search for it has its own."""
    limits = calibration_of(machine)
    source = limits.source or "development robots of the Exo-Index"
    return [
        ("level of each test", f"{ALPHA:g}", "chosen"),
        ("level of the scan over time", f"{LOCAL:g}", "chosen"),
        *((meaning, f"{getattr(limits, name):g}", source) for name, meaning in MEANINGS.items()),
    ]
