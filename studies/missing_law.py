"""The missing law put to the proof: robots of the reference simulator whose effect no library holds.

    python -m studies.missing_law --out missing_law.md [--cases NAME,...] [--healthy N] [--seed N] [--real FOLDER]

No effect of the library may explain anything, so that each effect of the reference simulator is a law that nobody
knows. Scored: is the right part named, how much of the gap the learned law closes on a held-out motion of another kind,
and whether anything is discovered in healthy robots. The runner-up is the best law in another block. What was measured
is kept beside --out, so that a run goes on where it ended.
"""

from __future__ import annotations

import json
import time
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import click
import numpy as np

from exodrake.core.errors import markdown_table
from exodrake.core.parallel import one_blas_thread
from exodrake.diagnosis.discovery.discover import LEAD, MissingLaw, discover, measure_lead
from exodrake.diagnosis.discovery.law_code import law_points
from exodrake.diagnosis.isolation import isolate
from exodrake.diagnosis.problem import make_problem
from exodrake.machines.robot_file import load_robot
from exodrake.reference.cases import CaseMix, CasePlan
from exodrake.reference.faults import ENTRIES, find_blocks
from exodrake.reference.make import case_and_label
from exodrake.report.wording import closure, percent
from studies.page_text import made, share
from studies.real_machines.recordings import READERS

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
HEALTHY = "healthy-"  # followed by a number
REAL = {"tendon_sheath": "tendon_sheath", "so101": "sage_so101"}
# a spool is where motor, tendon and encoder meet: the same wire in other words
SAME_PLACE = {"encoder.homing_offset": ("encoder", "motor", "tendon"), "tendon.slack": ("encoder", "motor", "tendon")}
TITLES = {
    "library": "Effects of the library, taken away",
    "outside": "Effects outside the library",
    "healthy": "Healthy robots in which something is found",
    "real": "Real machines, beside their whole library",
}
ERROR = 0.1  # share of robots in which a law in a wrong part may count as distinguished from one in the right part


@dataclass(frozen=True)
class Row:
    """Row of the table: one case and its missing law; shares of the best laws in the right part and elsewhere."""

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
    def wrong_lead(self) -> float:
        """Share of what the best law in the right part leaves that the best law elsewhere takes up."""
        return measure_lead(self.wrong_share, self.right_share)


def measure(name: str, seed: int, real: Path | None) -> Row:
    """One case made and searched."""
    blocks, gap, tried, robot = (), float("nan"), frozenset(), "exo_index"
    if name in REAL:
        assert real is not None
        case, tried, robot, kind = READERS[name](real / REAL[name]), None, name, "real"
    else:
        kind = "healthy" if name.startswith(HEALTHY) else "outside" if name.startswith("outside") else "library"
        healthy, of_plan = kind == "healthy", {"library": "single", "outside": "unknown"}.get(kind, kind)
        number = int(name.removeprefix(HEALTHY)) if healthy else 1000 + sorted(ENTRIES).index(name)
        ids = () if healthy else (name,)
        case, label = case_and_label(CasePlan(name, (seed, number), of_plan, ids, True, CaseMix(duration=DURATION)))
        blocks, gap = () if healthy else SAME_PLACE.get(name, find_blocks(name)), float(label["gap"])
    with one_blas_thread():
        started = time.process_time()
        found = isolate(make_problem(case, load_robot(robot), tried))
        problem = found.whole
        law = discover(found)
        seconds = time.process_time() - started
        every = {point.block for point in law_points(problem.robot.machine)}
        # where the search has not come upon the right part, or another one, that is fitted for this study alone
        parts = (every.intersection(blocks), every.difference(blocks))
        shares = [most(law, part) or most(discover(found, blocks=part), part) for part in parts if blocks]
    right, wrong = shares or (float("nan"), float("nan"))
    formula = "; ".join(f"{c}: {curve.formula}" for c, curve in law.curves.items() if curve.formula)
    closed = float("nan") if law.closure is None else law.closure.value
    runner = "" if law.runner_up is None else law.runner_up.id
    return Row(
        name, kind, blocks, gap, law.found, law.block, f"{law.id}: {law.words}", law.channels, law.share, closed,
        runner, law.lead, formula, law.reason, seconds, right, wrong,
    )  # fmt: skip


def most(law: MissingLaw, blocks: Collection[str]) -> float:
    """Largest share of the excess over noise that a fitted law in some blocks removes; 0 if none was fitted."""
    return max((other.share for other in law.others if other.id.split(".")[0] in blocks), default=0.0)


def limit(leads: Sequence[float]) -> float:
    """Lead that one more robot exceeds with probability `ERROR` at most, drawn as those of these leads (conformal
    prediction; Vovk, Gammerman & Shafer 2005)."""
    rank = int(np.ceil((1.0 - ERROR) * (len(leads) + 1)))
    return sorted(leads)[rank - 1] if rank <= len(leads) else 1.0


def table(rows: list[Row]) -> str:
    """A table of cases in Markdown, and their formulas."""
    columns = ("injected", "gap", "law found", "channels", "fitted", "held out", "runner-up distinguished")
    lines = []
    for r in rows:
        place, _, words = r.law.partition(":")
        wrong = "" if r.right or not r.blocks else "**wrong part** "
        apart = f"{'yes' if r.lead > LEAD else 'no'}, `{r.runner_up}`" if r.runner_up else "none fitted"
        cells = (f"{wrong}`{place}`{words}", ", ".join(r.channels), percent(r.share), closure(r.closure), apart)
        gap = f"{r.gap:.1f}" if np.isfinite(r.gap) else "-"
        lines.append((f"`{r.name}`", gap, *(cells if r.found else (r.reason, "", "", "", ""))))
    formulas = "\n".join(f"- `{r.name}`: {r.formula}" for r in rows if r.formula)
    return markdown_table(columns, lines) + (f"\n\nPlain formulas, SI:\n\n{formulas}" if formulas else "")


def summary(rows: list[Row]) -> list[str]:
    """Counts of each kind, and how often what is said of the runner-up holds."""
    kinds = {kind: [r for r in rows if r.kind == kind] for kind in TITLES}
    lines = []
    for kind in ("library", "outside"):
        if own := kinds[kind]:
            closed = float(np.median([r.closure if r.found else 0.0 for r in own]))
            right = share(sum(r.found and r.right for r in own), len(own))
            lines.append(
                f"- {TITLES[kind]}: right part {right}; on held-out motions of another kind the law closes "
                f"{closure(closed)} of the gap that retuning leaves (median; nothing found counts as 0)."
            )
    injected = kinds["library"] + kinds["outside"]
    named = [r for r in injected if r.found and r.runner_up]
    if len(named) > 1:
        limits = {r.name: limit([other.wrong_lead for other in injected if other is not r]) for r in named}
        apart = [r for r in named if r.lead > limits[r.name]]
        both = [r for r in named if r not in apart]
        held = sum(r.right or r.runner_up.split(".")[0] in r.blocks for r in both)
        lines += [
            "- Lead of the best law in a wrong part over the best one in the right part: at most "
            f"{limit([r.wrong_lead for r in injected]):.2f} in {1.0 - ERROR:.0%} of such robots (conformal quantile of "
            f"{len(injected)}). In use: {LEAD:g}.",
            f"- The runner-up is distinguished in {len(apart)} of {len(named)}, each by the limit of the others: the "
            f"part is right in {share(sum(r.right for r in apart), len(apart))}. Where it is not, the law or the "
            f"runner-up is in the right part in {share(held, len(both))}.",
        ]
    if healthy := kinds["healthy"]:
        lines.append(f"- Healthy robots: something is found in {share(sum(r.found for r in healthy), len(healthy))}.")
    if injected:
        lines.append(f"- Processor time: {np.median([r.seconds for r in injected]):.0f} s a case (median).")
    return lines


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("missing_law.md"), help="Page to write.")
@click.option("--cases", default="", help="Names of cases, with commas; all if empty.")
@click.option("--healthy", default=20, show_default=True, help="Number of healthy robots.")
@click.option("--seed", default=SEED, show_default=True, help="Of the robots and their logs.")
@click.option("--real", type=click.Path(path_type=Path, exists=True), default=None, help="Folder of real recordings.")
def main(out: Path, cases: str, healthy: int, seed: int, real: Path | None) -> None:
    """Measures the discovery of missing laws and writes the page."""
    every = [*LIBRARY, *OUTSIDE, *(f"{HEALTHY}{k}" for k in range(healthy)), *(REAL if real else ())]
    store = out.with_name(f"{out.stem}-{seed}.jsonl")
    known = {d["name"]: d for d in map(json.loads, store.read_text().splitlines())} if store.is_file() else {}
    for name in [n for n in cases.split(",") if n] or every:
        if name not in known:
            row = measure(name, seed, real)
            known[name] = asdict(row)
            with store.open("a") as file:
                file.write(json.dumps(known[name]) + "\n")
            result = f"{percent(row.share)} {closure(row.closure)} {row.seconds:.0f} s {row.reason}"
            click.echo(f"{name}: {row.law} {result}")
    tuples = ("blocks", "channels")
    rows = [Row(**known[n] | {k: tuple(known[n][k]) for k in tuples}) for n in every if n in known]
    command = f"python -m studies.missing_law --seed {seed} --healthy {healthy} --out missing_law.md --real DIR"
    lines = ["# The missing law, measured", "", f"    {command}", "", f"Measured on {made()}.", "", *summary(rows)]
    for kind, title in TITLES.items():
        if own := [r for r in rows if r.kind == kind and (r.found or kind != "healthy")]:
            lines += ["", f"## {title}", "", table(own)]
    out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
