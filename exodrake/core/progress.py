"""What commands that loop share: --jobs and --cluster, a bar that counts, and a clean end on Ctrl-C or SIGTERM."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import click

Count = Callable[[int, int, int], None]
INTERRUPTED = 130  # exit status, as shells have it for Ctrl-C


def where_to_run(command: Callable[..., Any]) -> Callable[..., Any]:
    """Adds --jobs and --cluster to a command."""
    jobs = click.option(
        "--jobs", default=1, show_default=True, type=click.IntRange(min=-1), help="Processes; -1 for one a core."
    )
    cluster = click.option("--cluster", default=None, metavar="ADDRESS", help="Dask scheduler to run on instead.")
    return jobs(cluster(command))


@contextmanager
def counted(title: str, again: str = "the same command goes on from there") -> Iterator[Count]:
    """A bar on standard error; yields the function that is told (done, failed, total).

    Ctrl-C and SIGTERM end the command with status 130 and a line that says how far it came and what to do `again`.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("[red]{task.fields[failed]}"),
        TimeElapsedColumn(), TimeRemainingColumn(),
    )  # fmt: skip
    reached = ""
    with asked_to_end():
        try:
            with Progress(*columns, console=Console(stderr=True), disable=not sys.stderr.isatty()) as bar:
                task = bar.add_task(title, total=None, failed="")

                def count(done: int, failed: int, total: int) -> None:
                    nonlocal reached
                    reached = f"{done} of {total} done"
                    bar.update(task, completed=done, total=total, failed=f"{failed} failed" if failed else "")

                yield count
        except KeyboardInterrupt:
            click.echo("; ".join(["interrupted", *([reached] if reached else []), again]), err=True)
            raise SystemExit(INTERRUPTED) from None


@contextmanager
def asked_to_end() -> Iterator[None]:
    """SIGTERM is taken as Ctrl-C is."""

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
