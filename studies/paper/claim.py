"""A printed number beside ours, and a chapter of the page."""

from dataclasses import dataclass

from exodrake.report.blocks import Block

AGREES, DOES_NOT, UNKNOWN = "agrees", "does not follow", "cannot be checked"
VERDICTS = (AGREES, DOES_NOT, UNKNOWN)


@dataclass(frozen=True)
class Claim:
    """A claim of the paper and its verdict here, one of `VERDICTS`."""

    where: str  # equation, figure, table or section
    what: str
    printed: str
    ours: str
    verdict: str
    reason: str


@dataclass(frozen=True)
class Chapter:
    """A part of the page."""

    anchor: str
    title: str
    lead: str  # a paragraph, `code` in backticks
    body: tuple[Block, ...]
    claims: tuple[Claim, ...]
    beside: tuple[Block, ...] = ()  # a second column, if any


@dataclass(frozen=True)
class Effort:
    """Size of the computation."""

    points: int = 500  # of the estimator's training on the worn robot, and on the clean one
    clean_points: int = 250
    every: int = 1  # one row in so many of the logs is used
    marker_seconds: float = 40.0
    tensions: int = 25  # per tendon in the assisted workspace


FULL = Effort()
QUICK = Effort(points=120, clean_points=80, every=6, marker_seconds=20.0, tensions=9)


def count(claims: tuple[Claim, ...]) -> dict[str, int]:
    """Number of claims with each verdict."""
    return {verdict: sum(claim.verdict == verdict for claim in claims) for verdict in VERDICTS}
