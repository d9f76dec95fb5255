"""Figure of an experiment: its references, and the difference of the two closest explanations on it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from exodrake.core.display import colour_of, display_of
from exodrake.data.plot import STYLE, new_figure, png_of
from exodrake.diagnosis.parameter import apply
from exodrake.experiment.contest import Contest
from exodrake.experiment.design import Design

DRAWN = 3  # kinds of columns
ROOM = 1.1, 2.1  # times what is largest, below and above, where the legend stands
BAND = 1.96  # standard deviations that hold 95 % (normal law)


@dataclass(frozen=True, eq=False)
class Difference:
    """Difference between the logs of a true explanation and of its closest rival after a refit.

    Attributes:
        true, rival: their names.
        values: (frames, columns) difference [unit of the column].
        band: (frames, columns) standard deviation of noise and of the errors of the laws, as large as the logs show
            [the same].
    """

    true: str
    rival: str
    values: np.ndarray
    band: np.ndarray


def difference_of(contest: Contest, design: Design) -> Difference:
    """The difference of the closest two explanations on an experiment."""
    problem, (true, rival) = contest.problem, design.information.closest
    e, trial = contest.explanations[rival], contest.trial(true, design.reference.values)
    moved = apply(e.values, e.parameters, design.information.refit(true, rival))
    logs = problem.predict(np.array([contest.robots[true], moved]), trial)
    variance = np.tile(problem.noise_std**2, (len(trial.reference), 1))
    for k in (true, rival):
        whole, bare = problem.predict(np.array([contest.robots[k], contest.bare[k]]), trial)
        variance += (contest.error[k] * (bare - whole)) ** 2
    return Difference(contest.names[true], contest.names[rival], logs[0] - logs[1], np.sqrt(variance))


def figure_of(contest: Contest, design: Design) -> bytes:
    """The figure as PNG."""
    import matplotlib

    difference, columns = difference_of(contest, design), contest.problem.columns
    size = np.sqrt(np.mean((difference.values / difference.band) ** 2, axis=0))
    best: dict[str, int] = {}
    for k in np.argsort(-size):
        best.setdefault(contest.problem.kinds[k], int(k))
    shown = list(best.values())[:DRAWN]
    with matplotlib.rc_context(STYLE):
        figure = new_figure(8.0, 2.4 + 1.6 * len(shown))
        rows = figure.subplots(1 + len(shown), 1, sharex=True, squeeze=False, height_ratios=[1.35, *[1.0] * len(shown)])
        draw_reference(rows[0, 0], contest, design)
        for axes, k in zip(rows[1:, 0], shown):
            one = replace(difference, values=difference.values[:, k], band=difference.band[:, k])
            draw_difference(axes, contest, one, columns[k], size[k])
        title = f"{difference.true} against {difference.rival} refitted"
        rows[1, 0].set_title(f"difference: {title}", fontsize=9, loc="left")
        rows[-1, 0].set_xlabel("Time [s]")
        name = contest.problem.case.name
        figure.suptitle(f"{name}: references of the experiment", fontsize=11, fontweight="bold", x=0.01, ha="left")
        figure.align_ylabels(list(rows[:, 0]))
        return png_of(figure)


def draw_reference(axes: Any, contest: Contest, design: Design) -> None:
    """The references, a line a channel."""
    machine = contest.problem.robot.machine
    column = machine.references[0]
    channels, display = machine.channels(column.signal), display_of(column.kind, machine)
    time = machine.frame * np.arange(len(design.reference.values))
    for k, channel in enumerate(channels):
        course = display.factor * design.reference.values[:, k]
        axes.plot(time, course, color=colour_of(channel, k, machine), label=channel)
    axes.set_ylabel(display.axis)
    axes.set_xlim(time[0], time[-1])
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=min(len(channels), 8), borderaxespad=0.1)


def draw_difference(axes: Any, contest: Contest, difference: Difference, column: str, size: float) -> None:
    """The difference in one column with the band that holds 95 % of noise and of the error of the laws."""
    machine = contest.problem.robot.machine
    kind, channel = column.rsplit("_", 1)
    display = display_of(kind, machine)
    time = machine.frame * np.arange(len(difference.values))
    band = BAND * display.factor * difference.band
    axes.fill_between(time, -band, band, color="#c9d0d8", lw=0, label="95 % of noise and of the error of a law")
    axes.plot(time, display.factor * difference.values, color="#d55e00", label=channel)
    axes.set_ylabel(f"{channel}\n{display.axis}")
    largest = max(float(band.max()), display.factor * float(np.abs(difference.values).max()))
    axes.set_ylim(-ROOM[0] * largest, ROOM[1] * largest)
    axes.legend(
        loc="upper right", ncols=2, fontsize=7.5, title=f"RMS {size:.2g} standard deviations", title_fontsize=7.5
    )
