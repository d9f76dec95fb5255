"""What `exodrake simulate` says of a run: what was changed, and how far the signals went."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    import numpy as np
    from rich.table import Table

    from exodrake.core.robot import Robot
    from exodrake.data.log import Log
    from exodrake.simulation.scenario import Scenario


def changes(scenario: Scenario, robot: Robot) -> list[str]:
    """Differences from a plain run of the nominal robot: effects with values, parameters, variants, options."""
    from exodrake.core.display import in_words
    from exodrake.core.robot import effect_in_words

    said = [effect_in_words(robot, identity) for identity in robot.effects()]
    for name in scenario.parameters:
        values = sorted({float(robot.values[i]) for i in robot.indices(name)})
        unit = robot.machine.parameters[robot.indices(name)[0]].unit
        said.append(f"{name} = {' and '.join(in_words(value, unit) for value in values)}")
    said += robot.machine.variant_names
    _, _, options = scenario.protocol.partition(":")
    said += [option.replace("=", " = ") for option in filter(None, options.split(","))]
    said += ["no noise"] if scenario.seed is None else [f"seed {scenario.seed}"] * (scenario.seed != 0)
    said += ["readings unrounded"] * (not scenario.quantisation) + ["in Drake"] * (scenario.engine == "drake")
    return said


def show(scenario: Scenario, robot: Robot, log: Log, nominal: Log | None, folder: Path, names: list[str]) -> None:
    """Prints what ran, how far each signal went, and the files."""
    from rich.console import Console
    from rich.markup import escape

    console, peak = Console(), turning_point(robot, log)
    console.print(f"[bold]{escape(log.label)}[/bold]  {log.duration:g} s, {len(log)} rows")
    for change in changes(scenario, robot):
        console.print(f"with {escape(change)}", highlight=False, soft_wrap=True)
    console.print(signals(robot, log, nominal, peak))
    if peak is not None:
        console.print(
            f"{log.time[peak]:.2f} s: the last moment at which the references are farthest from their start",
            style="dim",
        )
    console.print(f"[bold]{escape(str(folder))}/[/bold]  {'  '.join(names)}", soft_wrap=True)


def turning_point(robot: Robot, log: Log) -> int | None:
    """Last row in which the references are as far from their start as they go; None where they do not move."""
    import numpy as np

    kind = robot.machine.references[0].kind
    away: np.ndarray = np.linalg.norm(log[kind] - log[kind][0], axis=1) if log.has(kind) else np.zeros(len(log))
    far = np.flatnonzero(away >= away.max() * (1.0 - 1e-9))
    return int(far[-1]) if away.max() > 0.0 else None


def signals(robot: Robot, log: Log, nominal: Log | None, peak: int | None) -> Table:
    """Range of each measured channel, its errors from reference and nominal run."""
    import numpy as np
    from rich.markup import escape

    from exodrake.core.display import display_of
    from exodrake.report.terminal import table

    machine, rows = robot.machine, []
    for column in (column for column in machine.columns if column not in machine.references):
        display = display_of(column.kind, machine)
        for channel in machine.channels(column.signal):
            name, reference = f"{column.kind}_{channel}", f"{column.kind}_ref_{channel}"
            values = display.factor * log[name]
            cells = [values.min(), values.max(), *([] if peak is None else [values[peak]]), values[-1]]
            errors = [(log, reference)] + ([(nominal, name)] if nominal is not None else [])
            for other, wanted in errors:
                known = other.has(wanted)
                cells.append(np.sqrt(np.mean((values - display.factor * other[wanted]) ** 2)) if known else np.nan)
            texts = ["" if np.isnan(cell) else f"{float(cell):.3g}" for cell in cells]
            rows.append((f"{column.kind} {channel}".rstrip(), escape(display.unit), *texts))
    titles = ["signal", "unit", ">lowest", ">highest", *([] if peak is None else [f">at\n{log.time[peak]:.2f} s"])]
    titles += [">in the\nend", ">RMS from\nreference", *([">RMS from\nnominal"] if nominal is not None else [])]
    return table(titles, rows)


def warn(robot: Robot) -> None:
    """Says which parameters, and values of effects, lie outside their plausible range."""
    from exodrake.core.robot import implausible

    for sentence in implausible(robot):
        click.secho(f"note: {sentence}", fg="yellow", err=True)
