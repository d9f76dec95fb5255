"""The page: what came out, the register of claims, a chapter per figure; and the register as CSV."""

from __future__ import annotations

import csv
import io
import re
from html import escape

from exodrake.report.template import PAGE, STYLE

from exodrake import __version__
from exodrake.report import markup
from studies.paper.claim import AGREES, DOES_NOT, UNKNOWN, Chapter, Claim, count
from studies.paper.reproduce import Reproduction
from studies.paper.study import DATA, MODEL

SOURCE = (
    "B. Kim, J. Ryu, K.-J. Cho: Joint Angle Estimation of a Tendon-Driven Soft Wearable Robot through a Tension and"
    " Stroke Measurement. Sensors 20(10), 2852, 2020, doi 10.3390/s20102852."
)
CAVEAT = (
    "Nothing on this page was measured. Every curve is computed or simulated, and what the paper leaves out (motor,"
    " spool, stiffness, gains, size of friction) is assumed. “As printed” means in our copy, a text without its"
    " figures: a misprint below may be an artefact of that copy, and should be held against the publisher's PDF before"
    " anyone calls it an erratum."
)
MARKS = {AGREES: "yes", DOES_NOT: "no", UNKNOWN: "open"}
EXTRA = """
.register { width: 100%; font-size: 13px; } .register td { padding-right: 16px; }
.register col.where { width: 7%; } .register col.what { width: 19%; } .register col.number { width: 15%; }
.register col.mark { width: 10%; }
.register th.group { color: var(--ink); font-weight: 650; padding: 22px 0 5px 8px; border-bottom: 1px solid #98a2b3; }
.register th.group a { color: inherit; text-decoration: none; border-bottom: 1px dotted #98a2b3; }
.register td:nth-child(1) { color: var(--soft); white-space: nowrap; } .register td:nth-child(4) { font-weight: 550; }
.register td:last-child { color: #475467; }
.mark { display: inline-block; white-space: nowrap; font-size: 11.5px; font-weight: 600; border-radius: 99px;
  padding: 1px 9px; }
.mark.yes { color: #14603f; background: #e3f4ea; } .mark.no { color: #9a1c13; background: #fdeae8; }
.mark.open { color: #475467; background: #eef0f3; }
@media (max-width: 700px) { .register { min-width: 820px; } }
"""


def page(found: Reproduction) -> str:
    """The whole page."""
    parts = [header(), verdict_box(found), markup.heading(2, "Register of claims"), register(found.chapters)]
    parts += [chapter_html(chapter) for chapter in found.chapters]
    made = f"exodrake {__version__}, seed {found.seed}, {found.seconds:.0f} s. Made by make paper."
    parts.append(f"<footer>{escape(made)} {escape(SOURCE)}</footer>")
    title = "Exo-Index: the paper beside its simulation"
    return PAGE.format(title=title, style=STYLE + EXTRA, colour="#1d4ed8", body="\n".join(parts))


def header() -> str:
    """Title and source."""
    heading = markup.heading(1, "The paper beside its simulation")
    return f"<header><p>exodrake, the paper</p>{heading}<p>{escape(SOURCE)}</p></header>"


def verdict_box(found: Reproduction) -> str:
    """What came out, in one sentence and a few numbers."""
    study, counts = found.study, count(found.claims)
    data, model = study.error(DATA), study.error(MODEL)
    verb = "beats" if data < model else "does not beat"
    headline = (
        f"On a simulated robot with friction and creep, the data-driven estimate {verb} the model with constant"
        f" stiffness: {data:.3f} against {model:.3f} rad."
    )
    tiles = [
        (f"{study.ratio:.1f} ×", "smaller RMSE on whole sweeps held out (Fig. 11, simulated)"),
        *((str(counts[verdict]), f"of {len(found.claims)} claims: {verdict}") for verdict in MARKS),
    ]
    inner = f'<p class="headline">{markup.text(headline)}</p>{markup.tiles(tiles)}'
    return f'<section class="verdict">{inner}</section><p class="note">{markup.text(CAVEAT)}</p>'


def register(chapters: tuple[Chapter, ...]) -> str:
    """The table of all claims, grouped by chapter."""
    columns = "".join(f'<col class="{kind}">' for kind in ("where", "what", "number", "number", "mark", "why"))
    names = ("", "claim", "printed", "ours", "verdict", "reason")
    head = "".join(f"<th>{name}</th>" for name in names)
    body = "".join(group(chapter) for chapter in chapters if chapter.claims)
    table = f'<table class="register"><colgroup>{columns}</colgroup><thead><tr>{head}</tr></thead>{body}</table>'
    return f'<div class="scroll">{table}</div>'


def group(chapter: Chapter) -> str:
    """One chapter's rows."""
    title = f'<a href="#{chapter.anchor}">{markup.text(chapter.title)}</a>'
    head = f'<tr><th class="group" colspan="6">{title}</th></tr>'
    return f"<tbody>{head}{''.join(row(claim) for claim in chapter.claims)}</tbody>"


def row(claim: Claim) -> str:
    """One claim."""
    mark = f'<span class="mark {MARKS[claim.verdict]}">{claim.verdict}</span>'
    words = (markup.text(minus(part)) for part in (claim.where, claim.what, claim.printed, claim.ours))
    cells = [*words, mark, markup.text(claim.reason)]
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def minus(words: str) -> str:
    """Negative numbers with a true minus sign."""
    return re.sub(r"(?<!\w)-(?=\d)", "−", words)


def chapter_html(chapter: Chapter) -> str:
    """A chapter with its figures."""
    head = markup.heading(2, chapter.title)
    return f'<section id="{chapter.anchor}">{head}{markup.paragraph(chapter.lead)}{chapter.body}</section>'


def claims_csv(claims: tuple[Claim, ...]) -> str:
    """The register as CSV."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("where", "claim", "printed", "ours", "verdict", "reason"))
    for claim in claims:
        writer.writerow((claim.where, claim.what, claim.printed, claim.ours, claim.verdict, claim.reason))
    return stream.getvalue()
