"""Rehearsal of a fleet on a Dask cluster of two workers: a sample of its cases, extrapolated to all of them.

    python -m benchmarks.fleet --out fleet               # 60 of 10,000 cases (10 robots x 1,000 sessions)

Writes cases of a machine whose diagnosis is cheap, and diagnoses them on two worker processes. One of these is killed
on the way. The same command again skips what is answered; table and page follow. Every third robot wears: the play of
its sheath grows from a session on.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from time import perf_counter
from typing import Any

import click
import numpy as np

import exodrake as exo
from exodrake.core.files import write_bytes, write_text
from exodrake.data.case import Case, CaseLog, write_case
from exodrake.diagnosis.fleet import read_answers, read_table, table_bytes
from exodrake.diagnosis.many import FAILURE, diagnose_all
from exodrake.model.robot import drawn_robot
from exodrake.report.fleet import fleet_html
from exodrake.simulation import protocols
from exodrake.simulation.protocols import on_machine

MACHINE, EFFECT, PARAMETER = "tendon_sheath", "sheath.play", "half_width"
START = datetime(2026, 1, 1, tzinfo=UTC)
FIRST, GROWTH = 0.04, 0.08  # rad, play at its begin and what it grows by until the last session
LOGS, SECONDS = 2, 8.0  # of a case, and of a log


def session_case(robot: int, session: int, sessions: int) -> Case:
    """A session of a robot; every third robot has a play that grows from 40 % of its sessions on."""
    nominal = exo.load_robot(MACHINE)
    found, passed = drawn_robot(nominal, np.random.default_rng(robot)), session / sessions
    if robot % 3 == 0 and passed > 0.4:
        found = found.splice(EFFECT, {PARAMETER: FIRST + GROWTH * (passed - 0.4) / 0.6})
    logs, date = [], START + timedelta(days=session)
    for k in range(LOGS):
        seed = (robot * sessions + session) * LOGS + k
        motion = on_machine(protocols.random_motion, nominal, duration=SECONDS, seed=seed, fastest=1.0)
        logs.append(CaseLog(exo.simulate(found, motion, seed=seed), "random", "fit", None, f"{k}.csv.gz", date))
    name = f"sheath-{robot:02d}-{session:04d}"
    return Case(name, {}, tuple(replace(log, role="fit") for log in logs), nominal.machine.frame, serial=name[:9])


def sample(cases: int, robots: int, sessions: int) -> Iterator[tuple[int, int]]:
    """Robots and sessions of a sample, the sessions of a robot spread evenly."""
    each = max(cases // robots, 1)
    for robot in range(robots):
        for k in range(each):
            yield robot, int((k + 0.5) * sessions / each)


@click.command()
@click.option("--cases", default=60, show_default=True, help="Of the sample.")
@click.option("--robots", default=10, show_default=True)
@click.option("--sessions", default=1000, show_default=True, help="Of each robot in the whole fleet.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder of cases, answers, table and page.")
def main(cases: int, robots: int, sessions: int, out: Path) -> None:
    """Rehearse a fleet."""
    import distributed

    client_of: Any = distributed.Client  # their types are those of coroutines
    cluster_of: Any = distributed.LocalCluster
    began, places = perf_counter(), {}
    for robot, session in sample(cases, robots, sessions):
        case = session_case(robot, session, sessions)
        write_case(case, out / "cases" / case.name)
        places[out / "cases" / case.name] = out / "answers" / case.name
    click.echo(f"{len(places)} cases written in {perf_counter() - began:.1f} s")
    with cluster_of(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster:
        with client_of(cluster.scheduler_address, set_as_default=False) as client:
            victims = sorted(client.run(os.getpid).values())[:1]
        began, counted = perf_counter(), []

        def progress(done: int, failed: int, total: int) -> None:
            counted.append((done, failed))
            if done >= total // 3 and victims:
                os.kill(victims.pop(), signal.SIGKILL)

        failed = diagnose_all(places, cluster=cluster.scheduler_address, progress=progress, robot=MACHINE)
        took = perf_counter() - began
        click.echo(f"diagnosed in {took:.1f} s on two workers, one killed on the way; {len(failed)} failed")
        began = perf_counter()
        diagnose_all(places, cluster=cluster.scheduler_address, robot=MACHINE)
        click.echo(f"the same command again: {perf_counter() - began:.1f} s, nothing diagnosed twice")
    began, rows = perf_counter(), read_answers(out / "answers")
    write_bytes(out / "fleet.parquet", table_bytes(rows))
    write_text(out / "fleet.html", fleet_html(read_table(out / "fleet.parquet"), "rehearsal"))
    click.echo(
        f"table and page in {perf_counter() - began:.1f} s; {sum(r.verdict == FAILURE for r in rows)} unanswered"
    )
    processor, whole = sum(row.run_time for row in rows), robots * sessions
    size = sum(path.stat().st_size for path in (out / "answers").rglob("*") if path.is_file()) / len(rows)
    click.echo(
        f"{processor / len(rows):.2f} s a case on a worker, {took / len(places):.2f} s in all; {whole:,} cases: "
        f"{whole * took / len(places) / 3600:.1f} h on two workers, {whole * size / 1e9:.2f} GB of answers"
    )


if __name__ == "__main__":
    main()
