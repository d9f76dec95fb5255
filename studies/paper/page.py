"""All chapters, and the page: results, the register of claims, a chapter per figure; and the register as CSV."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from threadpoolctl import threadpool_limits

from exodrake import __version__
from exodrake.estimator.validate import HELD_OUT, RANDOM
from exodrake.machines.robot_file import load_robot
from exodrake.report.blocks import render
from studies.paper import arms, centres, equations, estimation, hardware, reach
from studies.paper.claim import AGREES, DOES_NOT, FULL, UNKNOWN, Chapter, Claim, Effort, count
from studies.paper.study import DATA, MODEL, Study, study

SOURCE = (
    "B. Kim, J. Ryu, K.-J. Cho: Joint Angle Estimation of a Tendon-Driven Soft Wearable Robot through a Tension and"
    " Stroke Measurement. Sensors 20(10), 2852, 2020, doi 10.3390/s20102852."
)
MARKS = {AGREES: "yes", DOES_NOT: "no", UNKNOWN: "open"}
HEADER = ("", "claim", "printed", "ours", "verdict", "reason")


@dataclass(frozen=True, eq=False)
class Reproduction:
    """chapters of the page, the study behind Fig. 10 and 11, the seed and the seconds it took."""

    chapters: tuple[Chapter, ...]
    study: Study
    seed: int
    seconds: float

    @property
    def claims(self) -> tuple[Claim, ...]:
        """The register, chapter by chapter."""
        return tuple(claim for chapter in self.chapters for claim in chapter.claims)


def reproduce(effort: Effort = FULL, seed: int = 0) -> Reproduction:
    """Computes every chapter from simulation, in a minute on one core; compiling the simulator takes one more."""
    start, robot = perf_counter(), load_robot()
    with threadpool_limits(1):  # many small products: a second thread only waits
        found = study(robot, effort, seed)
    chapters = (
        estimation.chapter(found),
        arms.chapter(),
        equations.chapter(robot),
        hardware.chapter(robot, found.rate),
        centres.chapter(centres.record(effort.marker_seconds, seed)),
        reach.chapter(robot, effort.tensions),
    )
    return Reproduction(chapters, found, seed, perf_counter() - start)


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
    table = estimation.methods_table(study)
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
