"""The missing law put to the proof: robots of the reference simulator whose effect no library holds.

    python -m studies.missing_law --out docs/missing_law.md [--cases NAME,...] [--healthy N] [--seed N] [--real FOLDER]

No effect of the library may explain anything, so that each effect of the reference simulator is a law that nobody
knows. Scored: is the right part named, how much of
the gap the learned law closes on a held-out motion of another kind, and whether anything is discovered in healthy
robots. What was measured is kept beside --out, so that a run goes on where it ended.
"""

from __future__ import annotations

import json
import time
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

import click

from exodrake.core.parallel import one_blas_thread
from exodrake.data.case import Case
from exodrake.diagnosis.discovery.discover import discover
from exodrake.diagnosis.discovery.law_code import laws_of
from exodrake.diagnosis.discovery.missing_law import MissingLaw
from exodrake.diagnosis.isolation import isolate
from exodrake.diagnosis.problem import make_problem
from exodrake.machines.robot_file import load_robot
from exodrake.reference.cases import CaseMix, CasePlan
from exodrake.reference.faults import ENTRIES, blocks_of
from exodrake.reference.make import case_and_label
from exodrake.report import wording as w
from studies.missing_law_page import Row, page, restored

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


def blind_case(name: str, seed: int) -> tuple[Case, tuple[str, ...], float]:
    """A case of the reference simulator, the blocks of its effect and the gap [noise standard deviations]."""
    healthy = name.startswith(HEALTHY)
    number = int(name.removeprefix(HEALTHY)) if healthy else 1000 + sorted(ENTRIES).index(name)
    ids = () if healthy else (name,)
    kind = "healthy" if healthy else "unknown" if name.startswith("outside") else "single"
    plan = CasePlan(name, (seed, number), kind, ids, True, CaseMix(duration=DURATION))
    case, label = case_and_label(plan)
    blocks = () if healthy else SAME_PLACE.get(name, blocks_of(name))
    return case, blocks, float(label["gap"])


@dataclass(frozen=True)
class Found:
    """Discovery of a missing law in a case.

    Attributes:
        law: the missing law.
        seconds: processor time.
        right, wrong: largest shares that laws in the right parts and elsewhere remove.
    """

    law: MissingLaw
    seconds: float
    right: float = float("nan")
    wrong: float = float("nan")


def discovered(case: Case, robot_name: str, tried: frozenset[str] | None, blocks: tuple[str, ...] = ()) -> Found:
    """What is found in a case with an effect injected in some blocks."""
    with one_blas_thread():
        started = time.process_time()
        found = isolate(make_problem(case, load_robot(robot_name), tried))
        problem = found.whole
        law = discover(problem, found)
        seconds = time.process_time() - started
        every = {point.block for point in laws_of(problem.robot.machine)}
        parts = (every.intersection(blocks), every.difference(blocks))
        shares = [most(law, part) or most(discover(problem, found, blocks=part), part) for part in parts if blocks]
    return Found(law, seconds, *shares)


def most(law: MissingLaw, blocks: Collection[str]) -> float:
    """Largest share of the excess over noise that a fitted law in some blocks removes; 0 if none was fitted."""
    return max((other.share for other in law.others if other.id.split(".")[0] in blocks), default=0.0)


def row_of(name: str, kind: str, blocks: tuple[str, ...], gap: float, found: Found) -> Row:
    """A case's row."""
    law = found.law
    formula = "; ".join(f"{c}: {curve.formula}" for c, curve in law.curves.items() if curve.formula)
    closure = float("nan") if law.closure is None else law.closure.value
    runner = "" if law.runner_up is None else law.runner_up.id
    return Row(
        name, kind, blocks, gap, law.found, law.block, f"{law.id}: {law.words}", law.channels, law.share, closure,
        runner, law.lead, formula, law.reason, found.seconds, found.right, found.wrong,
    )  # fmt: skip


def measured(name: str, seed: int, real: Path | None) -> Row:
    """One case made and searched."""
    if name in REAL:
        from exodrake.machines.library import reader

        assert real is not None
        found = discovered(reader(name)(real / REAL[name]), name, None)
        return row_of(name, "real", (), float("nan"), found)
    case, blocks, gap = blind_case(name, seed)
    found = discovered(replace(case, name=name), "exo_index", frozenset(), blocks)
    kind = "healthy" if name.startswith(HEALTHY) else "outside" if name.startswith("outside") else "library"
    return row_of(name, kind, blocks, gap, found)


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("docs/missing_law.md"), help="Page to write.")
@click.option("--cases", default="", help="Names of cases, with commas; all if empty.")
@click.option("--healthy", default=20, show_default=True, help="Number of healthy robots.")
@click.option("--seed", default=SEED, show_default=True, help="Of the robots and their logs.")
@click.option("--real", type=click.Path(path_type=Path, exists=True), default=None, help="Folder of real recordings.")
def main(out: Path, cases: str, healthy: int, seed: int, real: Path | None) -> None:
    """Measures the discovery of missing laws and writes the page."""
    every = [*LIBRARY, *OUTSIDE, *(f"{HEALTHY}{k}" for k in range(healthy)), *(REAL if real else ())]
    wanted = [n for n in cases.split(",") if n] or every
    store = out.with_name(f"{out.stem}-{seed}.jsonl")
    known = {d["name"]: d for d in map(json.loads, store.read_text().splitlines())} if store.is_file() else {}
    for name in wanted:
        if name not in known:
            row = measured(name, seed, real)
            known[name] = row.__dict__
            with store.open("a") as file:
                file.write(json.dumps(row.__dict__) + "\n")
            click.echo(
                f"{name}: {row.law} {w.percent(row.share)} {w.closure(row.closure)} {row.seconds:.0f} s {row.reason}"
            )
    rows = [restored(known[n]) for n in every if n in known]
    options = f"--seed {seed} --healthy {healthy} --out docs/missing_law.md --real DIR"
    out.write_text(page(rows, f"python -m studies.missing_law {options}"))


if __name__ == "__main__":
    main()
