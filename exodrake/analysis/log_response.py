"""Frequency response between two signals of a log, beside that of robots on the same references.

Inputs that move at once, and feedback of noise, bias the estimate. The robots run on the references of the logs with
noise and pass the same estimator, so their responses have the same bias.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.signal import csd

from exodrake.core.errors import InputError, argument
from exodrake.core.plain import plain
from exodrake.data.case import LogSource, gather_logs
from exodrake.data.log import Log
from exodrake.data.plot import IMPROVED, MEASURED, NOMINAL, STYLE, new_figure
from exodrake.engine.inputs import Reference
from exodrake.model.display import percent
from exodrake.model.robot import Robot
from exodrake.simulation.protocols import reference_rows
from exodrake.simulation.simulate import simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HANN = 18.0 / 19.0  # independent segments in one of Hann windows that overlap by half (Welch 1967)
SEGMENTS, QUARTERS = 8, 4  # lengths of a segment in all logs, and in the shortest: fifteen averages; assumed
RESOLVED = 0.5  # a response is resolved where its radius is at most this share of it: 3.5 dB and 30 deg; assumed
LEAKED = 0.75  # share of the input's power from which a line shows other lines: noise reaches 0.5; assumed
LOW = "blackmanharris"  # window whose side lobes lie at -92 dB, those of Hann's at -31 dB (Harris 1978)
CLOCKS = 1e-3  # relative difference of two sampling periods that count as one
CONFIDENCE = 0.9
MOST_MISSING = 0.1  # share of missing samples, which are read between their neighbours; assumed
STYLES = {"nominal": NOMINAL, "improved": IMPROVED}
COLUMNS = 3  # of panels in a figure
DECADES = 2.3  # with three labels each, which do not touch in a panel of 2.4 inches


@dataclass(frozen=True, eq=False, repr=False)
class LogResponse:
    """Frequency response from one signal to another, measured and of robots on the same references."""

    input: str
    output: str
    unit: str
    frequency: np.ndarray  # (f,) Fourier frequencies of a segment above 0 [Hz]
    response: np.ndarray  # (f,) complex, measured [unit]
    coherence: np.ndarray  # (f,)
    low: np.ndarray  # (f,) ends of the 90 % band of its magnitude [unit]
    high: np.ndarray
    models: dict[str, np.ndarray]  # robot -> complex response (f,) of its log [unit]
    power: np.ndarray  # (f,) density of the output [its unit^2/Hz]
    leaked: np.ndarray  # (f,) share of the input's power that comes from other lines
    segments: float  # number of independent ones
    logs: tuple[str, ...]

    def __repr__(self) -> str:
        shown = self.frequency[self.band]
        band = f"resolved at {shown[0]:.3g} to {shown[-1]:.3g} Hz" if len(shown) else "resolved nowhere"
        head = f"LogResponse({self.input} -> {self.output}: {len(self.frequency)} lines, {band})"
        gaps = [f"{name}: {self.in_words(name)}" for name in self.models]
        return "\n  ".join([head, *(["measured against " + "; ".join(gaps)] if gaps else [])])

    @property
    def radius(self) -> np.ndarray:
        """Radius (f,) of the confidence region about the response in the complex plane [unit]."""
        return self.high - np.abs(self.response)

    @property
    def resolved(self) -> np.ndarray:
        """Mask (f,) of the lines [-] whose radius is at most half of the response, in the band where these prevail.

        No other band has a larger number of such lines less that of the rest. A line whose input leaked from others,
        as from a slow swing, is none: it shows the response there.
        """
        clear = (self.radius <= RESOLVED * np.abs(self.response)) & (self.leaked <= LEAKED)
        excess = np.concatenate([[0], np.cumsum(np.where(clear, 1, -1))])
        last = int(np.argmax(excess - np.minimum.accumulate(excess)))
        first = int(np.argmin(excess[: last + 1]))
        return clear & (np.arange(len(clear)) >= first) & (np.arange(len(clear)) < last)

    @property
    def band(self) -> slice:
        """Lines from the first resolved one to the last; empty if none is."""
        found = np.flatnonzero(self.resolved)
        return slice(int(found[0]), int(found[-1]) + 1) if len(found) else slice(0, 0)

    @property
    def explained(self) -> float:
        """Share of the output's power that the input explains."""
        return float(np.sum(self.coherence * self.power) / np.sum(self.power))

    def gap(self, model: str = "nominal") -> tuple[np.ndarray, np.ndarray]:
        """Measured response over that of a robot, at resolved lines, NaN elsewhere: (f,) [dB] and (f,) [deg]."""
        ratio = np.where(self.resolved, self.response / self.models[model], np.nan)
        return 20.0 * np.log10(np.abs(ratio)), np.degrees(np.angle(ratio))

    def in_words(self, model: str) -> str:
        """The gap over the resolved lines, weighted by the power of the output: `-3.9 dB, -31 deg`."""
        if not self.resolved.any():
            return "-"
        weights = self.power[self.resolved]
        level, phase = (np.average(part[self.resolved], weights=weights) for part in self.gap(model))
        return f"{round(level, 1) + 0.0:+.1f} dB, {round(phase) + 0.0:+.0f} deg"  # no -0

    def to_control(self, model: str = "") -> Any:
        """A python-control `FrequencyResponseData` of what was measured, or of a robot by its name."""
        from control import frd

        found = self.models[model] if model else self.response
        return frd(found, 2.0 * np.pi * self.frequency, inputs=[self.input], outputs=[self.output])  # pyright: ignore

    def to_dict(self) -> dict[str, Any]:
        """All fields, and the gap to each robot in dB and degrees, as plain data."""
        gaps = {name: dict(zip(("dB", "deg"), self.gap(name), strict=True)) for name in self.models}
        return plain(vars(self) | {"gap": gaps, "resolved": self.resolved})


def frequency_response(
    log: LogSource, input: str, output: str, robot: Robot | None = None, improved: Robot | None = None,
    segment: float | None = None,
) -> LogResponse:  # fmt: skip
    """Frequency response from one column of a log to another, with coherence and a confidence band.

    Args:
        log: a log, its file, several of them, or a case with its folder.
        input: column, such as `tension_AF`.
        output: column, such as `angle_PIP`.
        robot: nominal robot, which runs on the same references; none if None.
        improved: another such robot.
        segment: length of Welch's segments [s]; if None an eighth of all logs together, a quarter of one at most.

    Raises:
        InputError: for a column that a log lacks or that stands still, clocks that differ, and too few segments.

    Examples:
        >>> import exodrake as exo
        >>> log = exo.simulate(exo.load_robot(), "random-motion")
        >>> exo.frequency_response(log, "tension_AF", "angle_PIP")
        LogResponse(tension_AF -> angle_PIP: 125 lines, resolved at 0.2 to 1 Hz)
    """
    for name, value in (("robot", robot), ("improved", improved)):
        argument(name, value, Robot, type(None))
    logs = [item.log for item in gather_logs(log, period=robot.machine.frame if robot else None).logs]
    robots = {"nominal": robot, "improved": improved}
    runs = {name: simulate_references(one, logs) for name, one in robots.items() if one is not None}
    return estimate_response(logs, runs, input, output, segment)


def block_responses(case: LogSource, robots: Mapping[str, Robot], segment: float | None = None) -> list[LogResponse]:
    """Frequency response of each block of a machine: from the signal before it to its own, a channel each.

    A block whose input has other channels than its output gets the input that explains most of the output's power.
    The robots are all of one machine; case and segment as in `frequency_response`.
    """
    machine = next(iter(robots.values())).machine
    logs = [item.log for item in gather_logs(case, period=machine.frame).logs]
    runs = {name: simulate_references(robot, logs) for name, robot in robots.items()}
    moving = {name for name in logs[0].columns if all(log.has(name) and is_moving(log[name]) for log in logs)}
    kinds = [machine.references[0].kind, *(block.output for block in machine.segments)]
    names, found = [[n for n in machine.log_names([machine.column(kind)]) if n in moving] for kind in kinds], []
    for block, inputs, outputs in zip(machine.segments, names, names[1:]):
        for output in outputs if inputs and not block.exact else ():
            own = [name for name in inputs if name.rsplit("_", 1)[1] == output.rsplit("_", 1)[1]]
            tried = [estimate_response(logs, runs, name, output, segment) for name in own or inputs]
            found.append(max(tried, key=lambda one: one.explained))
    return found


def is_moving(values: np.ndarray) -> bool:
    """Whether a signal (n,) [any unit] has two different samples."""
    return len(np.unique(values[np.isfinite(values)])) > 1


def simulate_references(robot: Robot, logs: Sequence[Log]) -> list[Log]:
    """Logs of a robot on the references of some logs, with noise."""
    machine, found = robot.machine, []
    for seed, log in enumerate(logs):
        check_clock(log, machine.frame, machine.name)
        rows = np.column_stack([fill_gaps(column, log.label) for column in reference_rows(machine, log).T])
        found.append(simulate(robot, Reference(rows, log.label), seed))
    return found


def check_clock(log: Log, period: float, other: str) -> None:
    """InputError if the clock of a log differs from a period [s]."""
    if abs(log.dt - period) > CLOCKS * period:
        raise InputError(f"{log.label}: a row every {log.dt:g} s, {other} has one every {period:g} s")


def fill_gaps(values: np.ndarray, where: str) -> np.ndarray:
    """A signal (n,) [any unit] with missing samples read between their neighbours; InputError if many are missing."""
    known, at = np.isfinite(values), np.arange(len(values))
    if (lost := 1.0 - known.mean()) > MOST_MISSING:
        raise InputError(f"{where}: {percent(lost)} of the samples are missing, at most {percent(MOST_MISSING)} may")
    return np.interp(at, at[known], values[known])


def estimate_response(
    logs: Sequence[Log], runs: Mapping[str, Sequence[Log]], input: str, output: str, segment: float | None = None
) -> LogResponse:
    """The response of measured logs, and of the `runs` of robots on their references; else as `frequency_response`.

    H = S_uy / S_uu and the coherence |S_uy|^2 / (S_uu S_yy) are of Welch's spectra S, averaged over all segments. With
    probability P the response lies within r of its estimate, by the F distribution of 2 and 2 (n - 1) degrees of
    freedom for n independent segments (Bendat & Piersol, Random Data, 4th ed. 2010, ch. 9):

        r^2 = (1 - coherence) S_yy / S_uu ((1 - P)^(-1 / (n - 1)) - 1)
    """
    dt, shortest = logs[0].dt, min(map(len, logs))
    for log in logs:
        check_clock(log, dt, logs[0].label)
        for name in (input, output):
            if np.ndim(log[name]) != 1:
                columns = " or ".join(f"{name}_{channel}" for channel in log.names(name))
                raise InputError(f"{log.label}: {name!r} is no column, but a kind of them; did you mean {columns}?")
            if not is_moving(log[name]):
                raise InputError(f"{log.label}: column {name!r} stands still, so it has no frequency response")
    length = min(sum(map(len, logs)) // SEGMENTS, shortest // QUARTERS)
    length = length if segment is None else int(min(segment / dt, 1e9) + 0.5)
    counts = [(len(log) - length // 2) // max(length - length // 2, 1) for log in logs]
    count = HANN * sum(counts)
    if not 4 <= length <= shortest or count <= 1.0:
        raise InputError(
            f"{logs[0].label}: segments of {length * dt:g} s do not fit in logs of {shortest * dt:g} s; wanted two "
            "segments of four rows at least"
        )
    frequency, uu, uy, yy = cross_spectra(logs, counts, input, output, length)
    leaked = np.maximum(1.0 - cross_spectra(logs, counts, input, output, length, LOW)[1] / uu, 0.0)
    h, coherence = uy / uu, np.minimum(np.abs(uy) ** 2 / (uu * yy), 1.0)
    radius = np.sqrt((1.0 - coherence) * yy / uu * ((1.0 - CONFIDENCE) ** (-1.0 / (count - 1.0)) - 1.0))
    spectra = {name: cross_spectra(found, counts, input, output, length) for name, found in runs.items()}
    with np.errstate(divide="ignore", invalid="ignore"):  # a robot whose input stands still has no response
        models = {name: cross / own for name, (_, own, cross, _) in spectra.items()}
    above, below = (logs[0].units.get(name, "s") for name in (output, input))
    below = f"({below})" if set(below) & set("/ ") else below
    unit = above if below == "-" else f"{'1' if above == '-' else above}/{below}"
    ends = np.maximum(np.abs(h) - radius, 0.0), np.abs(h) + radius
    names = tuple(log.label for log in logs)
    return LogResponse(input, output, unit, frequency, h, coherence, *ends, models, yy, leaked, count, names)


def cross_spectra(
    logs: Sequence[Log], counts: Sequence[int], input: str, output: str, length: int, window: str = "hann"
) -> tuple[np.ndarray, ...]:
    """Frequencies (f,) [Hz] above 0, and spectra (f,) [SI] of input, from input to output, and of output.

    Segments have `length` rows, half of which overlap; `counts` are the numbers of segments of the logs.
    """
    frequency, total = np.zeros(0), np.zeros((2, 2, 1))
    for log, count in zip(logs, counts, strict=True):
        rows = np.array([fill_gaps(log[name], f"{log.label}, column {name!r}") for name in (input, output)])
        frequency, spectra = csd(rows[:, None], rows[None], 1.0 / log.dt, nperseg=length, window=window)
        total = total + np.asarray(spectra) * count / sum(counts)
    return frequency[1:], total[0, 0, 1:].real, total[0, 1, 1:], total[1, 1, 1:].real


def plot_responses(responses: Sequence[LogResponse], style: Mapping[Any, Any] = STYLE) -> Figure:
    """Magnitude, phase and coherence of each response, a column of panels each, over the lines that are resolved."""
    import matplotlib

    shown = [one for one in responses if one.resolved.any()]
    if not shown:
        raise InputError("no response is resolved at any frequency: nothing to draw; longer logs would help")
    columns, rows = min(COLUMNS, len(shown)), -(-len(shown) // COLUMNS)
    with matplotlib.rc_context(dict(style)):
        figure = new_figure(1.0 + 2.9 * COLUMNS, 0.4 + 3.0 * rows)  # fewer columns are wider
        grid = figure.subplots(3 * rows, columns, squeeze=False, height_ratios=[1.5, 1.0, 0.75] * rows)
        stacks = grid.reshape(rows, 3, columns).swapaxes(1, 2).reshape(-1, 3)
        for axes in stacks[len(shown) :].flat:
            axes.set_axis_off()
        for k, (panels, one) in enumerate(zip(stacks, shown)):
            level, phase, coherence = panels
            f, known, h = one.frequency[one.band], one.resolved[one.band], one.response[one.band]
            look, dots = {"color": MEASURED["color"], "alpha": 0.18, "lw": 0}, MEASURED | {"marker": ".", "ms": 2.5}
            low, high = (20.0 * np.log10(np.maximum(end[one.band], 1e-300)) for end in (one.low, one.high))
            level.fill_between(f, low, high, where=known, **look)
            level.plot(f, np.where(known, 20.0 * np.log10(np.abs(h)), np.nan), **dots, label="measured")
            angle, spread = np.degrees(
                [np.unwrap(np.angle(h[known])), np.arcsin((one.radius[one.band] / np.abs(h))[known])]
            )
            phase.fill_between(f[known], angle - spread, angle + spread, **look)
            phase.plot(f[known], angle, **dots)
            for name, found in one.models.items():  # above what was measured: visible where it lies on that
                line = STYLES.get(name, {"color": "#009e73"}) | {"label": name, "zorder": 3}
                level.plot(f, 20.0 * np.log10(np.abs(found[one.band])), **line)
                phase.plot(f[known], angle - one.gap(name)[1][one.resolved], **line)
            coherence.plot(f, one.coherence[one.band], **MEASURED)
            coherence.set_ylim(0.0, 1.05)
            level.set_title(f"{one.input} → {one.output} [{one.unit}]".replace("_", " "), fontsize=8.5)
            for axes, label in zip(panels, ("Gain [dB]", "Phase [°]", "Coherence")):
                axes.set(xscale="log", xlim=(f[0], f[-1] if len(f) > 1 else 2.0 * f[0]))
                axes.set_ylabel(label if k % columns == 0 else "")
                label_ticks(axes.xaxis)
                axes.tick_params(labelbottom=axes is coherence)
            coherence.set_xlabel("Frequency [Hz]" if k + columns >= len(shown) else "")
        handles = {label: h for axes in grid[::3].flat for h, label in zip(*axes.get_legend_handles_labels())}
        figure.legend(handles.values(), handles.keys(), loc="outside upper right", ncols=4)
        figure.align_ylabels()
    return figure


def label_ticks(*scales: Any) -> None:
    """Labels logarithmic axes of Matplotlib by plain numbers, 1, 2 and 5 of each decade where there is room."""
    from matplotlib.ticker import AutoLocator, LogLocator

    for axis in scales:
        low, high = axis.get_view_interval()
        narrow, close = high < 10.0 * low, high < 10.0**DECADES * low
        axis.set_major_locator(AutoLocator() if narrow else LogLocator(subs=(1.0, 2.0, 5.0) if close else (1.0,)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("")
