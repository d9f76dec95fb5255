"""The report: a diagnosis as one HTML page that needs nothing from outside.

problem = make_problem(read_case(folder), load_robot())
write_text("report.html", report_html(diagnosis, problem))
"""

from __future__ import annotations

from html import escape

from exodrake import __version__
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.result import Diagnosis
from exodrake.report import assumed, how_far, markup, where_which
from exodrake.report.evidence import Evidence, gather
from exodrake.report.template import PAGE, STYLE
from exodrake.report.words import COLOURS


def report_html(diagnosis: Diagnosis, problem: Problem) -> str:
    """The page of a diagnosis. problem: from `make_problem`; its held-out logs are simulated once more."""
    return page(diagnosis, gather(diagnosis, problem))


def page(diagnosis: Diagnosis, evidence: Evidence) -> str:
    """The page from a diagnosis and runs that were simulated already."""
    sections = (
        header(diagnosis),
        how_far.verdict_box(diagnosis),
        how_far.how_far(diagnosis, evidence),
        where_which.where(diagnosis, evidence),
        where_which.which(diagnosis),
        assumed.next_steps(diagnosis),
        assumed.assumed(diagnosis, evidence),
        f"<footer>exodrake {escape(__version__)}. Shown in mm, degrees and mA where SI is hard to read.</footer>",
    )
    colour = COLOURS.get(diagnosis.verdict, "#1d4ed8")
    body = "\n".join(section for section in sections if section)
    return PAGE.format(title=escape(f"{diagnosis.case}: diagnosis"), style=STYLE, colour=colour, body=body)


def header(diagnosis: Diagnosis) -> str:
    """Name of the case, and the three questions."""
    asked = "Where the gap between robot and simulator lies, which effect causes it, and how far it shrinks."
    seconds = f"Diagnosed in {diagnosis.seconds:.0f} s."
    return f"<header><p>exodrake diagnosis</p>{markup.heading(1, diagnosis.case)}<p>{asked} {seconds}</p></header>"
