"""A printed number beside ours, and a chapter of the page."""

from dataclasses import dataclass

from exodrake.report.blocks import Block

AGREES, DOES_NOT, UNKNOWN = "agrees", "does not follow", "cannot be checked"
VERDICTS = (AGREES, DOES_NOT, UNKNOWN)


@dataclass(frozen=True)
class Claim:
    """A claim of the paper and its verdict here.

    Attributes:
        where: equation, figure, table or section. what: the claim. printed, ours: values with units.
        verdict: one of `VERDICTS`. reason: why, in a sentence or two.
    """

    where: str
    what: str
    printed: str
    ours: str
    verdict: str
    reason: str


@dataclass(frozen=True)
class Chapter:
    """A part of the page.

    Attributes:
        anchor: its id. title: its heading. lead: a paragraph, `code` in backticks.
        body: headings, drawings and tables. beside: a second column of them, if any.
        claims: rows of the register.
    """

    anchor: str
    title: str
    lead: str
    body: tuple[Block, ...]
    claims: tuple[Claim, ...]
    beside: tuple[Block, ...] = ()


@dataclass(frozen=True)
class Effort:
    """Size of the computation.

    Attributes:
        points, clean_points: training points of the estimator on the worn and on the clean robot.
        every: one row in so many of the logs is used. marker_seconds: length of the marker recording [s].
        tensions: per tendon in the assisted workspace.
    """

    points: int = 500
    clean_points: int = 250
    every: int = 1
    marker_seconds: float = 40.0
    tensions: int = 25


FULL = Effort()
QUICK = Effort(points=120, clean_points=80, every=6, marker_seconds=20.0, tensions=9)


def count(claims: tuple[Claim, ...]) -> dict[str, int]:
    """Number of claims with each verdict."""
    return {verdict: sum(claim.verdict == verdict for claim in claims) for verdict in VERDICTS}
