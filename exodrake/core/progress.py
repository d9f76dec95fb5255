"""Progress of a long command: stages of a diagnosis, counted loops, and a clean end on Ctrl-C or SIGTERM."""

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from typing import Any

import click

INTERRUPTED = 130  # exit status, as shells have it for Ctrl-C
STEP = 3.0  # % of a bar for a further step of the same stage


class Stage(Enum):
    """Stage of a diagnosis: what it does, and the part of the work that lies before it [%]."""

    CHECK = "measuring the gap", 2
    RETUNE = "retuning the nominal parameters", 5
    LINEARISE = "linearising every effect", 20
    FIT = "fitting", 50
    CLOSURE = "measuring closure", 90
    LOCALISE = "localising the gap", 95

    def __init__(self, text: str, begins: float) -> None:
        self.text, self.begins = text, begins


StageProgress = Callable[[Stage, str], None]  # stage, and what it works on ("" if there is nothing to add)
Count = Callable[[int, int, int], None]  # done, failed, total


def no_progress(*_: Any) -> None:
    """Report nothing."""


def show_bar(*columns: str, transient: bool = False) -> Any:
    """A progress display of rich on standard error, nothing where that is no terminal; columns by name or as text."""
    from rich import progress as rich
    from rich.console import Console

    known = {
        "spinner": rich.SpinnerColumn(), "bar": rich.BarColumn(), "count": rich.MofNCompleteColumn(),
        "elapsed": rich.TimeElapsedColumn(), "remaining": rich.TimeRemainingColumn(),
    }  # fmt: skip
    made, hidden = [known.get(name, name) for name in columns], not sys.stderr.isatty()
    return rich.Progress(*made, console=Console(stderr=True), transient=transient, disable=hidden)


@contextmanager
def waiting(text: str) -> Iterator[Callable[[str], None]]:
    """Show on a terminal what a command works on, and for how long; yields the function that changes the text."""
    with show_bar("spinner", "{task.description}", "elapsed", transient=True) as bar:
        task = bar.add_task(text)
        yield lambda text: bar.update(task, description=text)


@contextmanager
def stages(spent: dict[Stage, float] | None = None) -> Iterator[StageProgress]:
    """Show a bar of a diagnosis, yield the function to call at its steps, and put the time [s] of each in `spent`."""
    with show_bar("spinner", "bar", "elapsed", "{task.description}", transient=True) as bar:
        task, done, times = bar.add_task("reading", total=100), 0.0, {} if spent is None else spent
        current, began = Stage.CHECK, time.process_time()

        def close() -> None:
            nonlocal began
            now = time.process_time()
            times[current], began = times.get(current, 0.0) + now - began, now

        def report(stage: Stage, detail: str = "") -> None:
            nonlocal done, current
            close()
            current = stage
            done = stage.begins if stage.begins > done else max(done, min(done + STEP, 97.0))
            bar.update(task, completed=done, description=f"{stage.text} {detail}".strip())

        yield report
        close()


def where_to_run(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --jobs and --cluster to a command."""
    jobs = click.option(
        "--jobs", default=1, show_default=True, type=click.IntRange(min=-1), help="Processes; -1 for one a core."
    )
    cluster = click.option("--cluster", default=None, metavar="ADDRESS", help="Dask scheduler to run on instead.")
    return jobs(cluster(command))


@contextmanager
def show_count(title: str, resume: str = "the same command resumes the run") -> Iterator[Count]:
    """Show a bar of a loop and yield the function that is called with (done, failed, total).

    Ctrl-C and SIGTERM end with status 130 and a line that says how much is done and how to `resume`.
    """
    columns = ("{task.description}", "bar", "count", "[red]{task.fields[failed]}", "elapsed", "remaining")
    reached, before = "", signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with show_bar(*columns) as bar:
            task = bar.add_task(title, total=None, failed="")

            def count(done: int, failed: int, total: int) -> None:
                nonlocal reached
                reached = f"{done} of {total} done"
                bar.update(task, completed=done, total=total, failed=f"{failed} failed" if failed else "")

            yield count
    except KeyboardInterrupt:
        click.echo("; ".join(filter(None, ("interrupted", reached, resume))), err=True)
        raise SystemExit(INTERRUPTED) from None
    finally:
        signal.signal(signal.SIGTERM, before)
