"""The page: results, the register of claims, a chapter per figure; and the register as CSV."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

from exodrake import __version__
from exodrake.estimator.validate import HELD_OUT, RANDOM
from exodrake.report.blocks import render
from studies.paper.claim import AGREES, DOES_NOT, UNKNOWN, Claim, count
from studies.paper.estimation import methods_table
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
        (
            f"{study.ratio:.1f} ×",
            "smaller RMSE on whole sweeps held out (Fig. 11, simulated, with assumed friction; "
            f"{study.clean_ratio:.1f} × without)",
        ),
        *((str(counts[verdict]), f"of {len(found.claims)} claims: {verdict}") for verdict in MARKS),
    ]
    return render(
        "paper.html", Path(__file__).parent / "templates",
        title="Exo-Index: the paper beside its simulation", colour="#1d4ed8", version=__version__, source=SOURCE,
        found=found, data=study.error(DATA), model=study.error(MODEL), tiles=tiles, header=HEADER, marks=MARKS,
        minus=minus,
    )  # fmt: skip


def docs_page(found: Reproduction) -> str:
    """The page of the documentation as Markdown: the comparison of Fig. 11, and the claims by verdict."""
    study = found.study
    table = methods_table(study)
    by_verdict = {verdict: [one for one in found.claims if one.verdict == verdict] for verdict in MARKS}
    return render(
        "docs.md", Path(__file__).parent / "templates", study=study, header=table.header, rows=table.rows,
        few=study.recorded[1], half=study.recorded[2], claims=by_verdict, count=len(found.claims), seed=found.seed,
        minus=minus,
        process=study.split(RANDOM), nearest=[study.split(name, "nearest row") for name in (RANDOM, HELD_OUT)],
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
