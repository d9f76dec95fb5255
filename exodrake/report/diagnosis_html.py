"""The report: a diagnosis as one HTML file that needs nothing from outside.

problem = make_problem(read_case(folder), load_robot())
write_text("report.html", report_html(diagnosis, problem))
"""

from __future__ import annotations

from exodrake import __version__
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import AMBIGUOUS, NAMED, NO_GAP, PARTLY, RETUNE, UNKNOWN, Diagnosis
from exodrake.report import number_format, wording
from exodrake.report.assumed import assumed
from exodrake.report.blocks import render
from exodrake.report.how_far import how_far
from exodrake.report.missing_law import missing_law
from exodrake.report.simulated_logs import SimulatedLogs, simulate_logs
from exodrake.report.since import since
from exodrake.report.where import where
from exodrake.report.which import which

COLOURS = {
    NO_GAP: "#18794e", RETUNE: "#0b7285", NAMED: "#1d4ed8", AMBIGUOUS: "#a15c00", PARTLY: "#7a3e9d", UNKNOWN: "#b42318",
}  # fmt: skip


def report_html(diagnosis: Diagnosis, problem: Problem) -> str:
    """The report of a diagnosis.

    Args:
        diagnosis: the answer.
        problem: from `make_problem`; its logs are simulated once more.
    """
    return html_of(diagnosis, simulate_logs(diagnosis, problem))


def html_of(diagnosis: Diagnosis, runs: SimulatedLogs) -> str:
    """The report from a diagnosis and logs that were simulated already."""
    sections = {**how_far(diagnosis, runs), **where(diagnosis, runs), **which(diagnosis, runs), **since(diagnosis)}
    return render(
        "diagnosis.html",
        title=f"{diagnosis.case}: diagnosis", version=__version__, colour=COLOURS.get(diagnosis.verdict, "#1d4ed8"),
        found=diagnosis, runs=runs, w=wording, n=number_format, **sections, **assumed(diagnosis, runs),
        **missing_law(diagnosis),
    )  # fmt: skip
