"""The page about missing laws: a row for each case, their counts, and the limit of the lead that follows from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from exodrake.diagnosis.discovery.discover import LEAD, lead
from exodrake.report.wording import closure, percent, rounds_below
from studies.page_text import made, share

ERROR = 0.1  # share of robots in which a law in a wrong part may count as distinguished from one in the right part
PAGE = """# The missing law

Robots of the [blind check](howto/blind.md)'s reference simulator, with all parameters drawn anew and one effect each,
are diagnosed with **no effect in the library**: no injected law is known to it. One free law is searched over every
point of every part ([how](explain/missing_law.md)). Logs are half as long as usual, held-out ones
of another motion than the fitted ones. A slack tendon and a wrong zero of an encoder count as right in encoder,
motor or tendon, which meet at the spool. The runner-up is the best law in another block. It is distinguished where the
law takes up more of what it leaves above noise than a law in a wrong part takes up of what the best one in the right
part leaves, in {held:.0%} of these robots. Where the
search has not come upon either, it is fitted for this study alone. "Fitted" is the share of what retuning leaves that
the law removes, what nominal parameters use of their tolerances included.

    {command}

Measured on {made}.

{summary}

Wanted were a right part for 80 % or more, 80 % closed or more in the median, and nothing discovered in 98 % of healthy
robots. What falls short, and why:

- Where the robot without an effect leaves no more than it may, the gap lies within the tolerances of the nominal
  parameters, and no law is missing: a miss all the same.
- Friction that depends on posture looks like friction of the tendons, since three tendons and three
  joints span the same forces on the finger. Of a finger that is pushed sideways
  no law of one variable removes a tenth. A cell that sticks and a wire that snags are events: the block is right,
  and the law removes little.
- Hysteresis, which stands for a dead zone or for a finger that snaps over, may make held-out motions worse: the data
  under a curve are those of the fitted motions. Nothing refuses a law by its held-out closure; the answer states it.
- With no effect in the library nothing leads a retuned robot out of a minimum where it is stuck, which then looks like
  a missing law.

Since then retuning follows the prediction errors, which leave fewer minima. 150 other healthy robots (seed 663071,
commit `3f6a1fa`, `--healthy 150` with their names in `--cases`): something is found in one (0.7 %, 0.0 to 3.7 %), a
torque of the finger that removes half of what retuning leaves; in another one a law that removes 3 % is refused.

{tables}

## Formulas unknown to the diagnosis

A carriage that a few lines of their own simulate (`tests/test_missing_law.py`), its law in no library:

| injected | found, SI |
|---|---|
| a spring that saturates, 60 tanh(x / 0.015) N | force over place, 60.1 tanh(u / 0.015) |
| a drive whose force depends on place, factor 1 - 6 x | gain over place, - 6 u |
| LuGre friction, 20 N sliding, 34 N at break-away | dry friction over speed: 27 N at 20 to 40 mm/s, falling to 19 N |
| nothing | no law |
"""


@dataclass(frozen=True)
class Row:
    """Row of the table: one case and its missing law."""

    name: str
    kind: str
    blocks: tuple[str, ...]
    gap: float
    found: bool
    block: str
    law: str
    channels: tuple[str, ...]
    share: float
    closure: float
    runner_up: str
    lead: float
    formula: str
    reason: str
    seconds: float
    right_share: float
    wrong_share: float

    @property
    def right(self) -> bool:
        """Whether the right part is named."""
        return self.block in self.blocks

    @property
    def apart(self) -> bool:
        """Whether the runner-up counts as distinguished."""
        return self.lead > LEAD

    @property
    def wrong_lead(self) -> float:
        """Share of what the best law in the right part leaves that the best law elsewhere takes up."""
        return lead(self.wrong_share, self.right_share)


def restored(stored: dict[str, Any]) -> Row:
    """A row as it was kept."""
    kept: dict[str, Any] = stored | {name: tuple(stored[name]) for name in ("blocks", "channels")}
    return Row(**kept)


def table(rows: list[Row]) -> str:
    """A table of cases in Markdown."""
    head = (
        "| injected | gap | law found | channels | fitted | held out | runner-up distinguished |\n" + 7 * "|---" + "|\n"
    )
    lines = []
    for r in rows:
        gap = f"{r.gap:.1f}" if np.isfinite(r.gap) else "-"
        law = f"{'' if r.right or not r.blocks else '**wrong part** '}`{r.law.split(':')[0]}`{r.law.partition(':')[2]}"
        apart = f"{'yes' if r.apart else 'no'}, `{r.runner_up}`" if r.runner_up else "none fitted"
        found = f"{law} | {', '.join(r.channels)} | {percent(r.share)} | {closure(r.closure)} | {apart}"
        lines.append(f"| `{r.name}` | {gap} | {found if r.found else r.reason + ' | | | | '} |")
    formulas = [f"- `{r.name}`: {r.formula}" for r in rows if r.formula]
    return head + "\n".join(lines) + ("\n\nPlain formulas, SI:\n\n" + "\n".join(formulas) if formulas else "")


def summary(rows: list[Row]) -> str:
    """Counts of each kind."""
    lines = []
    for kind, title in (
        ("library", "Effects taken from the library"),
        ("outside", "Effects that no library ever held"),
    ):
        own = [r for r in rows if r.kind == kind]
        if own:
            closed = float(np.median([r.closure if r.found else 0.0 for r in own]))
            right = share(sum(r.found and r.right for r in own), len(own))
            gap = "the gap that retuning leaves"
            held = f"{gap} {closure(closed)}" if rounds_below(closed) else f"the law closes {closure(closed)} of {gap}"
            lines.append(
                f"- {title}: right part {right}; {held} on held-out motions of another "
                f"kind (median; nothing found counts as 0)."
            )
    lines += distinction([r for r in rows if r.kind in ("library", "outside")])
    healthy = [r for r in rows if r.kind == "healthy"]
    if healthy:
        false = share(sum(r.found for r in healthy), len(healthy))
        lines.append(f"- Healthy robots: something is discovered in {false}.")
    seconds = [r.seconds for r in rows if r.kind in ("library", "outside")]
    if seconds:
        lines.append(f"- Processor time: {np.median(seconds):.0f} s a case (median).")
    return "\n".join(lines)


def limit(leads: Sequence[float]) -> float:
    """Lead that one more robot exceeds with probability `ERROR` at most, drawn as those of these leads (conformal
    prediction; Vovk, Gammerman & Shafer 2005)."""
    rank = int(np.ceil((1.0 - ERROR) * (len(leads) + 1)))
    return sorted(leads)[rank - 1] if rank <= len(leads) else 1.0


def distinction(rows: list[Row]) -> list[str]:
    """Lines about the runner-up: the limit of the lead, and how often what is said of it holds."""
    named = [r for r in rows if r.found and r.runner_up]
    if len(named) < 2:
        return []
    whole = limit([r.wrong_lead for r in rows])
    limits = {r.name: limit([other.wrong_lead for other in rows if other is not r]) for r in named}
    apart = [r for r in named if r.lead > limits[r.name]]
    both = [r for r in named if r not in apart]
    held = sum(r.right or r.runner_up.split(".")[0] in r.blocks for r in both)
    return [
        f"- Lead of the best law in a wrong part over the best one in the right part: at most {whole:.2f} in "
        f"{1.0 - ERROR:.0%} of such robots (conformal quantile of {len(rows)}). In use: {LEAD:g}.",
        f"- The runner-up is distinguished in {len(apart)} of {len(named)}, each by the limit of the others: the part "
        f"is right in {share(sum(r.right for r in apart), len(apart))}. Where it is not, the law or the runner-up is "
        f"in the right part in {share(held, len(both))}.",
    ]


def page(rows: list[Row], command: str) -> str:
    """The page."""
    titles = {
        "library": "Effects of the library, taken away", "outside": "Effects outside the library",
        "healthy": "Healthy robots in which something is found", "real": "Real machines, beside their whole library",
    }  # fmt: skip
    shown = [r for r in rows if r.found or r.kind != "healthy"]
    parts = [(title, [r for r in shown if r.kind == kind]) for kind, title in titles.items()]
    tables = "\n\n".join(f"## {title}\n\n{table(own)}" for title, own in parts if own)
    return PAGE.format(command=command, made=made(), held=1.0 - ERROR, summary=summary(rows), tables=tables)
