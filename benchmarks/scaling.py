"""Cost of a diagnosis over the length of the logs, the kind of case, the number of effects tried and of cases.

    python -m benchmarks.scaling            # some minutes; Markdown tables, as in docs/howto/cluster.md
    python -m benchmarks.scaling number     # one of them

Costs are processor seconds of one thread: other work on the machine disturbs them less than seconds on the clock. Each
figure comes from a process of its own, which simulates a moment first so that nothing is compiled or loaded in the
measured part; its peak memory is that of the whole process, Drake and numba included. Cases are from the reference
simulator, with logs cut to length.
"""

from __future__ import annotations

import os
import platform
import resource
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from time import process_time

import click
import numba
import numpy as np

from benchmarks.diagnosis import simulated_case
from exodrake.core.parallel import each, thread_limit
from exodrake.data.case import Case
from exodrake.diagnosis.closure import measure
from exodrake.diagnosis.pipeline import diagnose
from exodrake.diagnosis.problem import make_problem
from exodrake.machines.robot_file import load_robot
from exodrake.reference.cases import CasePlan
from exodrake.reference.make import case_and_label

FRICTION = ("single", ("tendon.capstan_friction",))
KINDS = {
    "healthy": ("healthy", ()),
    "one effect": FRICTION,
    "two effects": ("pair", ("tendon.capstan_friction", "sensor.gain")),
    "outside the library": ("unknown", ("outside.wire_snag",)),
}
SEED = 4711
LENGTHS = (10.0, 20.0, 40.0, 60.0)  # s, of each log at most
SHORT = 15.0  # s, for what does not need whole logs
LIBRARIES = (5, 10, 20, 37)
MANY = (4, 16)
MOMENT = 3.0  # s
MEGABYTE = 2**20 if sys.platform == "darwin" else 2**10  # of what getrusage counts in


@dataclass(frozen=True)
class Cost:
    """One diagnosis: verdict, processor time [s], peak memory of its process [MB]."""

    verdict: str
    seconds: float
    memory: float


def drawn(kind: tuple[str, tuple[str, ...]]) -> Case:
    """Draw a case of the reference simulator."""
    return case_and_label(CasePlan("case", (SEED, 1), *kind, False))[0]


def cut(case: Case, seconds: float) -> Case:
    """Cut every log of a case to a duration [s]."""
    logs = [replace(item, log=item.log.rows(item.log.time <= item.log.time[0] + seconds)) for item in case.logs]
    return replace(case, logs=tuple(logs))


def cost(case: Case, library: int | None = None) -> Cost:
    """Measure one diagnosis that may try `library` effects, all of them for None."""
    load_everything(case)
    tried = (effect.id for effect in load_robot().machine.effects if not effect.not_tried)
    begun = process_time()  # the true effect is among those that are tried
    verdict = diagnose(case, tried=frozenset(sorted(tried, key=lambda name: name not in FRICTION[1])[:library])).verdict
    return Cost(verdict, process_time() - begun, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MEGABYTE)


def cost_on_one_thread(*task) -> Cost:
    """Measure a cost with one thread."""
    numba.set_num_threads(1)
    with thread_limit():
        return cost(*task)


def load_everything(case: Case) -> None:
    """Load the compiled code and Drake by a simulation of some seconds."""
    nominal = load_robot()
    problem = make_problem(cut(case, MOMENT), nominal)
    problem.residual(problem.silent()[None], problem.fit)
    measure(problem, [np.array([problem.silent()] * 3)] * len(problem.judged))


def costs(tasks: list[tuple]) -> Iterator[Cost]:
    """Measure costs, each in a process of its own."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        yield from pool.map(cost_on_one_thread, *zip(*tasks))


def spent() -> float:
    """Sum the processor time of this process and of its ended children [s]."""
    whole = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in whole)


def throughput(case: Case, many: int, jobs: int) -> float:
    """Measure the processor time of one case diagnosed many times [s], the start of the processes included."""
    begun = spent()
    for item in each(verdict_of, ((case,) for _ in range(many)), jobs):
        assert item.reason is None, item.reason
    return spent() - begun


def verdict_of(case: Case) -> str:
    """Diagnose a case on a worker."""
    return diagnose(case).verdict


def row(*cells: object) -> None:
    """Print one line of a table."""
    click.echo("| " + " | ".join(f"{c:.3g}" if isinstance(c, float) else str(c) for c in cells) + " |")


def table(*heads: str) -> None:
    """Print the head of a table."""
    click.echo("\n| " + " | ".join(heads) + " |\n|" + "---|" * len(heads))


def growth(x: list[float], y: list[float]) -> float:
    """Fit the exponent of a power law: 1 for proportional."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def by_length(friction: Case) -> None:
    """Print the cost over the length of the logs."""
    table("logs of at most [s]", "frames fitted", "verdict", "processor seconds", "peak memory [MB]")
    frames, seconds = [], []
    for length, found in zip(LENGTHS, costs([(cut(friction, length),) for length in LENGTHS])):
        fitted = sum(len(item.log.time) for item in cut(friction, length).fit_logs if item.repeats is None)
        row(f"{length:g}", fitted, found.verdict, found.seconds, round(found.memory))
        frames.append(float(fitted))
        seconds.append(found.seconds)
    click.echo(f"\nGrows as the {growth(frames, seconds):.2f}th power of the frames fitted.")


def by_kind(_: Case) -> None:
    """Print the cost over the kind of case."""
    table(f"case, logs of {SHORT:g} s", "verdict", "processor seconds", "peak memory [MB]")
    for name, found in zip(KINDS, costs([(cut(drawn(kind), SHORT),) for kind in KINDS.values()])):
        row(name, found.verdict, found.seconds, round(found.memory))


def by_library(friction: Case) -> None:
    """Print the cost over the number of effects that may be tried."""
    table(f"effects tried, logs of {SHORT:g} s", "verdict", "processor seconds")
    for many, found in zip(LIBRARIES, costs([(cut(friction, SHORT), many) for many in LIBRARIES])):
        row(many, found.verdict, found.seconds)


def by_number(_: Case) -> None:
    """Print the cost over the number of cases, in one process and in two."""
    nominal = load_robot()  # a case of the nominal model itself, whose diagnosis is short
    moment = cut(simulated_case("faultless", nominal, nominal), MOMENT)
    table(f"faultless cases of {MOMENT:g} s", "processor seconds in one process", "in two", "each, in one")
    throughput(moment, 1, 1)  # so that neither loads what the other does not
    for many in MANY:
        alone, together = throughput(moment, many, 1), throughput(moment, many, 2)
        row(many, alone, together, alone / many)


TABLES = {"length": by_length, "kind": by_kind, "effect library": by_library, "number": by_number}


@click.command()
@click.argument("tables", nargs=-1, type=click.Choice(list(TABLES)))
def main(tables: tuple[str, ...]) -> None:
    """Measure what a diagnosis costs and print Markdown tables, all or some."""
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    click.echo(
        f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}; load before: {load}."
    )
    friction = drawn(FRICTION)
    for name in tables or TABLES:
        TABLES[name](friction)


if __name__ == "__main__":
    main()
