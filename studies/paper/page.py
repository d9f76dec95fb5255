"""The page: results, the register of claims, a chapter per figure; and the register as CSV."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

from exodrake import __version__
from exodrake.report.page import render
from studies.paper.claim import AGREES, DOES_NOT, UNKNOWN, Claim, count
from studies.paper.reproduce import Reproduction
from studies.paper.study import DATA, MODEL

SOURCE = (
    "B. Kim, J. Ryu, K.-J. Cho: Joint Angle Estimation of a Tendon-Driven Soft Wearable Robot through a Tension and"
    " Stroke Measurement. Sensors 20(10), 2852, 2020, doi 10.3390/s20102852."
)
MARKS = {AGREES: "yes", DOES_NOT: "no", UNKNOWN: "open"}
HEADER = ("", "claim", "printed", "ours", "verdict", "reason")


def page(found: Reproduction) -> str:
    """The whole page as HTML that needs nothing from outside."""
    study, counts = found.study, count(found.claims)
    tiles = [
        (f"{study.ratio:.1f} ×", "smaller RMSE on whole sweeps held out (Fig. 11, simulated)"),
        *((str(counts[verdict]), f"of {len(found.claims)} claims: {verdict}") for verdict in MARKS),
    ]
    return render(
        "paper.html", Path(__file__).parent / "templates",
        title="Exo-Index: the paper beside its simulation", colour="#1d4ed8", version=__version__, source=SOURCE,
        found=found, data=study.error(DATA), model=study.error(MODEL), tiles=tiles, header=HEADER, marks=MARKS,
        minus=minus,
    )  # fmt: skip


def minus(words: str) -> str:
    """Negative numbers with a true minus sign."""
    return re.sub(r"(?<!\w)-(?=\d)", "−", words)


def claims_csv(claims: tuple[Claim, ...]) -> str:
    """The register as CSV."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("where", *HEADER[1:]))
    for claim in claims:
        writer.writerow((claim.where, claim.what, claim.printed, claim.ours, claim.verdict, claim.reason))
    return stream.getvalue()
