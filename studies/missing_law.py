"""The missing law put to the proof: robots of the reference simulator whose effect no library holds.

    python -m studies.missing_law --out docs/missing_law.md [--cases NAME,...] [--real FOLDER]

The whole library is taken away, so that each effect of the reference simulator is a law that nobody knows. Scored: is
the right part named, how much of the gap the learned law closes on a held-out motion of another kind, and whether
anything is discovered in healthy robots. What was measured is kept beside --out, so that a run goes on where it ended.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from exodrake.blind.case_mix import CaseMix, CasePlan
from exodrake.blind.catalogue import ENTRIES, blocks_of
from exodrake.blind.make import case_and_label
from exodrake.core.parallel import one_blas_thread
from exodrake.data.case import Case
from exodrake.diagnosis.discovery.discover import discover
from exodrake.diagnosis.discovery.missing_law import MissingLaw
from exodrake.diagnosis.pipeline import isolated
from exodrake.diagnosis.problem import make_problem
from exodrake.machines.robot_file import load_robot

SEED = 552031
DURATION = 0.5  # of the logs, in that of a usual blind case: for the time it takes
LIBRARY = (
    "tendon.capstan_friction", "sensor.nonlinearity", "finger.hardening", "motor.dead_zone", "tendon.stiffening",
    "mocap.gain", "finger.viscoelasticity", "sensor.gain", "tendon.creep", "tendon.viscous_friction",
    "motor.slow_velocity_loop", "finger.stiffness", "motor.spool_growth", "sensor.pulley_friction", "tendon.slack",
    "encoder.homing_offset",
)  # fmt: skip
OUTSIDE = (
    "outside.posture_friction", "outside.spool_eccentricity", "outside.snap_through", "outside.sticking_cell",
    "outside.wire_snag", "outside.leaky_integrator", "outside.warming", "outside.abduction",
)  # fmt: skip
HEALTHY = tuple(f"healthy-{k}" for k in range(6))
REAL = {"tendon_sheath": "tendon_sheath", "so101": "sage_so101"}
# a spool is where motor, tendon and encoder meet: the same wire in other words
SAME_PLACE = {"encoder.homing_offset": ("encoder", "motor", "tendon"), "tendon.slack": ("encoder", "motor", "tendon")}
PAGE = """# The missing law

Robots of the [blind check](howto/blind.md)'s reference simulator, with all parameters drawn anew and one effect each,
are diagnosed with **no effect in the library**: no injected law is known to it. One free law is searched over every
point of every part ([how](explain/diagnosis.md#the-missing-law)). Logs are half as long as usual; held-out
ones are motions of another kind than the fitted ones. A slack tendon and a wrong zero of an encoder count as right in
encoder, motor or tendon, which meet at the spool. The runner-up is distinguished where the law
takes up more of what it leaves above noise than an absent effect takes up of what a true law leaves (`taken` of the
calibration).

    {command}

{summary}

{tables}

## Formulas unknown to the diagnosis

A carriage that a few lines of their own simulate (`tests/test_missing_law.py`), its law in no library:

| planted | found, SI |
|---|---|
| a spring that saturates, 60 tanh(x / 0.015) N | force over place, 60.1 tanh(u / 0.015) |
| a drive whose force depends on place, factor 1 - 6 x | gain over place, - 6 u |
| LuGre friction, 20 N sliding, 34 N at break-away | dry friction over speed: 27 N at 20 to 40 mm/s, falling to 19 N |
| nothing | no law |
"""


@dataclass(frozen=True)
class Row:
    """What was found on a case."""

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
    apart: bool
    formula: str
    reason: str
    seconds: float

    @property
    def right(self) -> bool:
        """Whether the right part is named."""
        return self.block in self.blocks


def blind_case(name: str) -> tuple[Case, tuple[str, ...], float]:
    """A case of the reference simulator, the blocks of its effect and the gap [noise standard deviations]."""
    healthy = name in HEALTHY
    number = HEALTHY.index(name) if healthy else 100 + sorted(ENTRIES).index(name)
    ids = () if healthy else (name,)
    kind = "healthy" if healthy else "unknown" if name.startswith("outside") else "single"
    plan = CasePlan(name, (SEED, number), kind, ids, True, CaseMix(duration=DURATION))
    case, label = case_and_label(plan)
    blocks = () if healthy else SAME_PLACE.get(name, blocks_of(name))
    return case, blocks, float(label["gap"])


def discovered(case: Case, robot_name: str, tried: frozenset[str] | None) -> tuple[MissingLaw, float]:
    """The missing law of a case and the processor seconds it took."""
    started = time.process_time()
    with one_blas_thread():
        problem, found = isolated(make_problem(case, load_robot(robot_name), tried))
        law = discover(problem, found)
    return law, time.process_time() - started


def row_of(name: str, kind: str, blocks: tuple[str, ...], gap: float, law: MissingLaw, seconds: float) -> Row:
    """A case's row."""
    formula = "; ".join(f"{c}: {curve.formula}" for c, curve in law.curves.items() if curve.formula)
    closure = float("nan") if law.closure is None else law.closure.value
    runner = "" if law.runner_up is None else law.runner_up.id
    return Row(
        name, kind, blocks, gap, law.found, law.block, f"{law.id}: {law.words}", law.channels, law.share, closure,
        runner, law.lead, law.distinguished, formula, law.reason, seconds,
    )  # fmt: skip


def measured(name: str, real: Path | None) -> Row:
    """One case made and searched."""
    if name in REAL:
        from exodrake.machines.recordings import reader

        assert real is not None
        law, seconds = discovered(reader(name)(real / REAL[name]), name, None)
        return row_of(name, "real", (), float("nan"), law, seconds)
    case, blocks, gap = blind_case(name)
    law, seconds = discovered(replace(case, name=name), "exo_index", frozenset())
    kind = "healthy" if name in HEALTHY else "outside" if name.startswith("outside") else "library"
    return row_of(name, kind, blocks, gap, law, seconds)


def restored(stored: dict[str, Any]) -> Row:
    """A row as it was kept."""
    kept: dict[str, Any] = stored | {name: tuple(stored[name]) for name in ("blocks", "channels")}
    return Row(**kept)


def percent(value: float) -> str:
    """A share as text."""
    return f"{100 * value:.0f} %" if np.isfinite(value) else "-"


def table(rows: list[Row]) -> str:
    """A table of cases in Markdown."""
    head = (
        "| planted | gap | law found | channels | fitted | held out | runner-up distinguished |\n" + 7 * "|---" + "|\n"
    )
    lines = []
    for r in rows:
        gap = f"{r.gap:.1f}" if np.isfinite(r.gap) else "-"
        law = f"{'' if r.right or not r.blocks else '**wrong part** '}`{r.law.split(':')[0]}`{r.law.partition(':')[2]}"
        apart = f"{'yes' if r.apart else 'no'}, `{r.runner_up}`" if r.runner_up else "none fitted"
        found = f"{law} | {', '.join(r.channels)} | {percent(r.share)} | {percent(r.closure)} | {apart}"
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
            right = sum(r.found and r.right for r in own)
            lines.append(
                f"- {title}: right part {right} of {len(own)}; the law closes {percent(closed)} of the gap that "
                f"retuning leaves on held-out motions of another kind (median; nothing found counts as 0)."
            )
    named = [r for r in rows if r.found and r.runner_up and r.kind in ("library", "outside")]
    if named:
        shares = [[r.apart for r in named if r.right is right] for right in (True, False)]
        right, wrong = (f"{sum(some)} of {len(some)}" for some in shares)
        lines.append(f"- The runner-up counts as distinguished beside {right} right parts and {wrong} wrong ones.")
    healthy = [r for r in rows if r.kind == "healthy"]
    if healthy:
        lines.append(f"- Healthy robots: something is discovered in {sum(r.found for r in healthy)} of {len(healthy)}.")
    seconds = [r.seconds for r in rows if r.kind != "real"]
    if seconds:
        lines.append(f"- Processor time: {np.median(seconds):.0f} s a case (median).")
    return "\n".join(lines)


def page(rows: list[Row], command: str) -> str:
    """The page."""
    titles = {
        "library": "Effects of the library, taken away", "outside": "Effects outside the library",
        "healthy": "Healthy robots", "real": "Real machines, beside their whole library",
    }  # fmt: skip
    parts = [(title, [r for r in rows if r.kind == kind]) for kind, title in titles.items()]
    tables = "\n\n".join(f"## {title}\n\n{table(own)}" for title, own in parts if own)
    return PAGE.format(command=command, summary=summary(rows), tables=tables)


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("docs/missing_law.md"), help="Page to write.")
@click.option("--cases", default="", help="Names of cases, with commas; all if empty.")
@click.option("--real", type=click.Path(path_type=Path, exists=True), default=None, help="Folder of real recordings.")
def main(out: Path, cases: str, real: Path | None) -> None:
    """Measures the discovery of missing laws and writes the page."""
    every = [*LIBRARY, *OUTSIDE, *HEALTHY, *(REAL if real else ())]
    wanted = [n for n in cases.split(",") if n] or every
    store = out.with_suffix(".jsonl")
    known = {d["name"]: d for d in map(json.loads, store.read_text().splitlines())} if store.is_file() else {}
    known = {name: row for name, row in known.items() if "lead" in row}
    for name in wanted:
        if name not in known:
            row = measured(name, real)
            known[name] = row.__dict__
            with store.open("a") as file:
                file.write(json.dumps(row.__dict__) + "\n")
            click.echo(
                f"{name}: {row.law} {percent(row.share)} {percent(row.closure)} {row.seconds:.0f} s {row.reason}"
            )
    rows = [restored(known[n]) for n in every if n in known]
    out.write_text(page(rows, "python -m studies.missing_law --out docs/missing_law.md --real DIR"))


if __name__ == "__main__":
    main()
