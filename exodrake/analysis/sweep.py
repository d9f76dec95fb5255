"""Many runs of a robot as a table: over a grid or a list of parameters, tolerances, or the answer of a diagnosis.

table = exo.sweep(robot, {"finger.kappa.MCP": [0.06, 0.08, 0.1]}, "chirp")
table = exo.sweep(robot, 200, exo.grasp("caging"), {"closed": lambda log: log["angle_PIP"].max()})
"""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from exodrake.analysis.robustness import within_intervals, within_tolerances
from exodrake.core.errors import InputError, argument, require_extra
from exodrake.core.parallel import side_by_side
from exodrake.core.plain import to_dict
from exodrake.core.progress import Count, no_progress
from exodrake.data.log import Log
from exodrake.data.plot import IMPROVED, STYLE, new_figure
from exodrake.engine.inputs import Reference
from exodrake.model.robot import Robot
from exodrake.model.units import quantity
from exodrake.simulation.protocols import protocol
from exodrake.simulation.simulate import simulate

CHUNK = 8  # runs between two reports of progress
DRAWS = 100  # of the intervals of a diagnosis
FAILED = "failed"  # column with the reason of a run without a log


def sweep(
    robot: Robot, over: Any, reference: Reference | str, summary: Mapping[str, Callable[[Log], float]] | None = None,
    draws: int = DRAWS, seed: int = 0, noise: int | None = None, progress: Count | None = None,
) -> Any:  # fmt: skip
    """Run variations of a robot on one reference by the compiled engine, on all cores, and tabulate them.

    Args:
        robot: the robot, whose run the others are compared with.
        over: what varies. Parameter -> values: all combinations; several such points as a list of parameter -> value;
            a number: so many robots within the tolerances; a diagnosis: robots within its intervals; or robots, such as
            `Fit.draw` gives. A parameter of an effect that the robot lacks splices it in. Values are numbers [SI] or
            text with a unit; a name without channel sets all channels.
        reference: what all follow; text as in `simulate`.
        summary: column -> function of a run's log; by default three numbers of each measured signal: `rms`, of the
            difference from the robot's own run, `peak`, the sample of largest magnitude, and `final`, all in SI.
        draws: number of robots of a diagnosis.
        seed: of the draws.
        noise: seed of the sensors' noise, the same in all runs; none without it.
        progress: called with the numbers of runs that are done, that failed, and of all.

    Returns:
        A pandas DataFrame, a row a run: parameters, then the summary; `attrs["units"]` holds the units. A run that
        diverges has NaN, and its reason in the column `failed`.

    Raises:
        InputError: for an unknown parameter, a value that cannot be read, nothing to run, and without pandas.

    Examples:
        >>> import exodrake as exo
        >>> table = exo.sweep(exo.load_robot(), {"finger.kappa.PIP": [0.1, 0.2]}, "caging")
        >>> table["angle_PIP final"].round(3).tolist()  # rad
        [0.317, 0.308]
    """
    argument("robot", robot, Robot)
    reference = argument("reference", reference, Reference, str)
    with require_extra("pandas is not installed; pip install exodrake[pandas]"):
        import pandas  # pyright: ignore
    reference = protocol(reference, robot) if isinstance(reference, str) else reference
    points, robots = variations(robot, over, draws, seed)
    nominal = simulate(robot, reference, noise)
    measured = [name for name in nominal.columns if name not in robot.machine.log_names(robot.machine.references)]
    names = list(summary) if summary else [f"{name} {what}" for name in measured for what in ("rms", "peak", "final")]

    def run(one: Robot) -> dict[str, Any]:
        """A row's summary."""
        try:
            log = simulate(one, reference, noise)
        except InputError as problem:
            return dict.fromkeys(names, np.nan) | {FAILED: str(problem)}
        if summary:
            return {name: function(log) for name, function in summary.items()}
        values = [(log[c] - nominal[c], log[c]) for c in measured]
        return dict(zip(names, [n for d, v in values for n in (np.sqrt(np.mean(d**2)), v[np.abs(v).argmax()], v[-1])]))

    rows: list[dict[str, Any]] = []
    for k in range(0, len(robots), CHUNK):
        rows += side_by_side([partial(run, one) for one in robots[k : k + CHUNK]])
        (progress or no_progress)(len(rows), sum(FAILED in row for row in rows), len(robots))
    table = pandas.DataFrame([point | row for point, row in zip(points, rows, strict=True)])
    units = {name: robot.machine.parameters[robot.indices(name)[0]].unit for point in points[:1] for name in point}
    units |= {name: nominal.units[name.rsplit(" ", 1)[0]] for name in names if not summary}
    table.attrs = {"units": units, "robot": robot.source, "reference": reference.name, "varied": list(points[0])}
    return table


def variations(robot: Robot, over: Any, draws: int, seed: int) -> tuple[list[dict[str, float]], list[Robot]]:
    """Parameters [SI] that vary, a mapping for each run, and the robots; arguments as in `sweep`."""
    if isinstance(over, int):
        over = [one for _, one in within_tolerances(robot, over, seed)]
    elif hasattr(over, "verdict") or (isinstance(over, Mapping) and "verdict" in over):
        over = [one for _, one in within_intervals(robot, to_dict(over), draws, seed)]
    elif isinstance(over, Mapping):
        grid = [[values] if isinstance(values, str | float | int) else list(values) for values in over.values()]
        over = [dict(zip(over, values, strict=True)) for values in product(*grid)] if over else []
    items = list(over) if isinstance(over, Iterable) else [over]
    if not items:
        raise InputError("nothing to run: no values, no robots")
    if all(isinstance(item, Robot) for item in items):
        differ = np.flatnonzero(np.any([one.values != robot.values for one in items], axis=0))
        return [{robot.machine.parameters[i].name: float(one.values[i]) for i in differ} for one in items], items
    points, robots = [], []
    for item in items:
        values = {
            name: quantity(value, robot.machine.parameters[robot.indices(name)[0]].unit, name)
            for name, value in argument("over", item, Mapping).items()
        }
        changed = robot
        for effect in robot.machine.effects:  # a parameter splices its effect in
            if any(name.startswith(f"{effect.id}.") for name in values) and effect.id not in changed.effects():
                changed = changed.splice(effect.id)
        points.append(values)
        robots.append(changed.with_parameters(values))
    return points, robots


def plot_sweep(table: Any) -> Any:
    """Figure of a sweep: each summary over one parameter, coloured by the second; by run where more than two vary."""
    import matplotlib

    units, varied = table.attrs["units"], table.attrs["varied"]
    numbers = [name for name in table.select_dtypes("number").columns if name not in varied]
    shown = [name for name in numbers if not name.endswith((" peak", " final"))] or numbers
    first, second = (*varied, None, None)[:2] if len(varied) <= 2 else (None, None)
    with matplotlib.rc_context(STYLE):
        columns = min(3, len(shown))
        rows = -(-len(shown) // columns)
        figure = new_figure(1.0 + 2.4 * columns, 0.5 + 1.7 * rows)
        panels = figure.subplots(rows, columns, sharex=True, squeeze=False)
        for axes in panels.flat[len(shown) :]:
            axes.set_axis_off()
        tint = {"c": table[second], "cmap": "viridis"} if second else {"color": IMPROVED["color"]}
        for axes, name in zip(panels.flat, shown, strict=False):
            dots = axes.scatter(table[first] if first else table.index, table[name], s=12, **tint)
            axes.set_title(f"{name} [{units[name]}]" if name in units else name, fontsize=8.5)
        if second:
            figure.colorbar(dots, ax=panels, label=f"{second} [{units[second]}]", aspect=40)
        figure.supxlabel(f"{first} [{units[first]}]" if first else "run", fontsize=9)
    return figure
