"""Section "what was assumed" of the report: every log of the case, the numbers of the decisions, the provenance."""

from __future__ import annotations

from typing import Any

import numpy as np

from exodrake.data.case import Case, CaseLog
from exodrake.diagnosis.isolation import SAMPLING
from exodrake.diagnosis.result import Diagnosis
from exodrake.diagnosis.search import GAIN, LAW, NATS, NEGLIGIBLE
from exodrake.diagnosis.verdict import EXPLAINED, LARGE, MOST
from exodrake.report import number_format as n, wording as w
from exodrake.report.blocks import Table
from exodrake.report.simulated_logs import ROBOTS, SimulatedLogs

DIGITS = 12  # of a file's hash that are shown; the JSON has them all


def assumed(diagnosis: Diagnosis, runs: SimulatedLogs) -> dict[str, Any]:
    """Values of the section's template."""
    return {
        "logs": log_table(diagnosis, runs),
        "numbers": Table(("Number", "Value"), decision_numbers(), words=1, folded="The numbers of the decisions"),
        "provenance": provenance_table(diagnosis),
    }


def log_table(diagnosis: Diagnosis, runs: SimulatedLogs) -> Table:
    """Every log of the case: role, length, missing samples, RMS error with each robot, hash of its file."""
    case, simulated = runs.problem.case, {log.trial.name: log for log in runs.logs}
    titles = w.robot_titles(diagnosis)
    robots = ROBOTS[: len(titles)]
    rows = []
    for item in case.logs:
        log = simulated.get(item.file)
        errors = ["–"] * len(robots) if log is None else [n.digits(runs.rms(log, robot)) for robot in robots]
        length = f"{len(item.log) * runs.period:.0f} s"
        rows.append((f"`{item.file}`", role(item, case), length, missing(item, runs), *errors, digest(case, item.file)))
    header = ("Log", "Role", "Length", "Missing", *titles, "SHA-256")
    return Table(header, rows, words=2)


def role(item: CaseLog, case: Case) -> str:
    """Use of a log in the diagnosis."""
    if case.is_copy(item):
        return f"noise: repeats {item.repeats}"
    return "held out: closure" if item.role == "holdout" else "fitted"


def missing(item: CaseLog, runs: SimulatedLogs) -> str:
    """Part of the compared samples that a log lacks."""
    samples = [item.log[column] for column in runs.problem.columns]
    share = float(np.mean(~np.isfinite(samples))) if samples else 0.0
    return "none" if share == 0.0 else f"{100 * share:.2g} %"


def digest(case: Case, file: str) -> str:
    """First digits of a file's hash."""
    found = case.hashes.get(file, "")
    return f"`{found[:DIGITS]}`" if found else "–"


def decision_numbers() -> list[tuple[str, str]]:
    """Each number of the search and of the verdict: its meaning and value with unit."""
    return [
        ("a gap is negligible below, in every channel", f"{NEGLIGIBLE:g} noise standard deviations RMS beyond noise"),
        ("and below, so that sampling shows no gap", f"{SAMPLING:g} standard errors of a mean square"),
        ("one effect more adds evidence of at least", f"{NATS:g} nats"),
        ("and takes up of what is left at least", n.percent(GAIN)),
        ("a cause takes up of the gap at least", n.percent(LARGE)),
        ("or of what is left without it at least", n.percent(MOST)),
        ("a law of an effect may err by", n.percent(LAW)),
        ("causes are named that explain of the gap at least", n.percent(EXPLAINED)),
        ("causes explain part of it (PARTLY) from", n.percent(MOST)),
    ]


def provenance_table(diagnosis: Diagnosis) -> Table | None:
    """With what, from what and when the answer was made."""
    made = diagnosis.provenance
    if made is None:
        return None
    rows = [
        ("Date", made.date.replace("T", " ").replace("+00:00", " UTC")),
        ("Command", f"`{made.command}`" if made.command else "called from Python"),
        ("exodrake", f"{made.version}, code `{made.code}`"),
        ("Robot", f"`{made.robot}`, parameters `{made.parameters}`"),
        ("Calibration", made.calibration),
    ]
    return Table((), rows, words=2, wide=False)
