"""Figure of an experiment: its references, and the difference of the two closest explanations on it."""

from __future__ import annotations

import numpy as np

from exodrake.core.display import colour_of, display_of
from exodrake.data.plot import STYLE, new_figure, png_of
from exodrake.diagnosis.parameter import apply
from exodrake.experiment.contest import Contest
from exodrake.experiment.design import Design

DRAWN = 3  # kinds of columns
ROOM = 1.1, 2.1  # times what is largest, below and above, where the legend stands
BAND = 1.96  # standard deviations that hold 95 % (normal law)


def predict_difference(contest: Contest, design: Design) -> tuple[np.ndarray, np.ndarray]:
    """Difference between the logs of the closest two explanations on an experiment, the rival refitted.

    Returns:
        The difference, and the standard deviation of noise and of the errors of the laws, as large as the logs show:
        (frames, columns) each [unit of the column].
    """
    problem, (true, rival) = contest.problem, design.information.closest
    e, trial = contest.explanations[rival], contest.trial(true, design.reference.values)
    refitted = apply(e.values, e.parameters, design.information.refit(true, rival))
    logs = problem.predict(np.array([contest.robots[true], refitted]), trial)
    variance = np.tile(problem.noise_std**2, (len(trial.reference), 1))
    for k in (true, rival):
        whole, bare = problem.predict(np.array([contest.robots[k], contest.bare[k]]), trial)
        variance += (contest.error[k] * (bare - whole)) ** 2
    return logs[0] - logs[1], np.sqrt(variance)


def draw_experiment(contest: Contest, design: Design) -> bytes:
    """The figure as PNG."""
    import matplotlib

    problem, machine = contest.problem, contest.problem.robot.machine
    difference, std = predict_difference(contest, design)
    size = np.sqrt(np.mean((difference / std) ** 2, axis=0))
    best: dict[str, int] = {}
    for k in np.argsort(-size):
        best.setdefault(problem.kinds[k], int(k))
    shown, time = list(best.values())[:DRAWN], machine.frame * np.arange(len(difference))
    with matplotlib.rc_context(STYLE):
        figure = new_figure(8.0, 2.4 + 1.6 * len(shown))
        rows = figure.subplots(1 + len(shown), 1, sharex=True, squeeze=False, height_ratios=[1.35, *[1.0] * len(shown)])
        references, column = rows[0, 0], machine.references[0]
        channels, display = machine.channels(column.signal), display_of(column.kind, machine)
        for k, channel in enumerate(channels):
            course = display.factor * design.reference.values[:, k]
            references.plot(time, course, color=colour_of(channel, k, machine), label=channel)
        references.set_ylabel(display.axis)
        references.set_xlim(time[0], time[-1])
        references.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=min(len(channels), 8), borderaxespad=0.1)
        for axes, k in zip(rows[1:, 0], shown, strict=True):
            kind, channel = problem.columns[k].rsplit("_", 1)
            display = display_of(kind, machine)
            course, band = display.factor * difference[:, k], BAND * display.factor * std[:, k]
            axes.fill_between(time, -band, band, color="#c9d0d8", lw=0, label="95 % of noise and of the error of a law")
            axes.plot(time, course, color="#d55e00", label=channel)
            axes.set_ylabel(f"{channel}\n{display.axis}")
            largest = max(float(band.max()), float(np.abs(course).max()))
            axes.set_ylim(-ROOM[0] * largest, ROOM[1] * largest)
            title = f"RMS {size[k]:.2g} standard deviations"
            axes.legend(loc="upper right", ncols=2, fontsize=7.5, title=title, title_fontsize=7.5)
        true, rival = (contest.names[k] for k in design.information.closest)
        rows[1, 0].set_title(f"difference: {true} against {rival} refitted", fontsize=9, loc="left")
        rows[-1, 0].set_xlabel("Time [s]")
        title = f"{problem.case.name}: references of the experiment"
        figure.suptitle(title, fontsize=11, fontweight="bold", x=0.01, ha="left")
        figure.align_ylabels(list(rows[:, 0]))
        return png_of(figure)
