"""A printed number beside ours, and a chapter of the page."""

from dataclasses import dataclass

AGREES, DOES_NOT, UNKNOWN = "agrees", "does not follow", "cannot be checked"
VERDICTS = (AGREES, DOES_NOT, UNKNOWN)


@dataclass(frozen=True)
class Claim:
    """What the paper says and what came of it.

    where: equation, figure, table or section; what: the claim; printed, ours: numbers with units; verdict: one of
    `VERDICTS`; reason: why, in a sentence or two.
    """

    where: str
    what: str
    printed: str
    ours: str
    verdict: str
    reason: str


@dataclass(frozen=True)
class Chapter:
    """A part of the page. anchor: its id; title; lead: a paragraph, `code` in backticks; body: HTML of figures and
    tables; claims: rows of the register."""

    anchor: str
    title: str
    lead: str
    body: str
    claims: tuple[Claim, ...]


@dataclass(frozen=True)
class Effort:
    """How much is computed: training points of the estimator on the worn and on the clean robot; every so many rows of
    the logs; seconds of marker recording; tensions per wire in the assisted workspace."""

    points: int = 500
    clean_points: int = 250
    every: int = 1
    marker_seconds: float = 40.0
    tensions: int = 25


FULL = Effort()
QUICK = Effort(points=120, clean_points=80, every=6, marker_seconds=20.0, tensions=9)


def count(claims: tuple[Claim, ...]) -> dict[str, int]:
    """How many claims have each verdict."""
    return {verdict: sum(claim.verdict == verdict for claim in claims) for verdict in VERDICTS}
