"""Fit of chosen parameters of a robot to its logs: nonlinear least squares on closed-loop simulations.

Intervals are those of a delete-a-block jackknife, plus what the tolerances of the other parameters move the fit by; the
formulas are in `docs/explain/identification.md`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter, lfiltic
from scipy.stats import chi2, norm, qmc, t as student

from exodrake.core.errors import InputError, argument, markdown_table
from exodrake.core.plain import to_dict
from exodrake.data.case import LogSource, gather_logs
from exodrake.data.log import Log, fill_columns
from exodrake.data.plot import IMPROVED, NOMINAL, STYLE, new_figure
from exodrake.diagnosis.likelihood import longest
from exodrake.diagnosis.parameter import apply, nominal_parameters
from exodrake.diagnosis.problem import Problem, list_required, make_problem
from exodrake.model.robot import Robot
from exodrake.model.units import quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEP = 1e-3  # of a parameter's scale, for central differences
BLOCKS, FEWEST = 32, 8  # stretches of time of the jackknife, most and least: t of 31 is 3 % off the normal; assumed
REPEATS = 4.0  # times over which a model's error repeats, in a stretch at least, so that these are independent; assumed
RUNS = 60  # evaluations of the residual, at most
# starts that are spread over the ranges, and the best of them from which a fit begins, too: a limit that is not reached
# has no slope, and latency and lag have several minima; assumed
SPREAD, FARTHER = 64, 3
HIGHER = 0.01  # of the cost by which another minimum is noted
CONFIDENCE = 0.9
LAGS = 25  # of the tests of residuals, as many as MATLAB's `resid`
ORDERS = range(1, 11)  # of the ARX models, of which the best in simulation counts; assumed
AT_BOUND = 1e-6  # of a parameter's scale
NUMBERED = 8  # parameters whose correlations a figure states
ALIKE = 1e6  # condition of the scaled Jacobian from which parameters act alike; assumed


@dataclass(frozen=True)
class FittedParameter:
    """A fitted parameter: value before and after the fit, 90 % interval and standard deviations in its SI unit."""

    name: str  # of several that move together, separated by blanks, the first one's value is stated
    unit: str
    start: float
    value: float
    low: float
    high: float
    std: float
    std_white: float  # of white residuals alone, as most programs state it
    std_others: float  # from the tolerances of all parameters that are not free
    at_bound: bool  # the fit ended at a bound: an interval then says little


@dataclass(frozen=True)
class SignalFit:
    """Fit percent of one column, 100 (1 - |y - f| / |y - mean|) as of MATLAB's `compare`, and tests of its residual."""

    column: str
    start: float  # of the robot before and after, and of a linear model simulated on the references [%]
    fitted: float
    arx: float
    held_start: float  # the same on held-out logs [%]
    held_fitted: float
    held_arx: float
    left: float  # of a linear model of the fitted robot's residual [%]; of noise alone 1 or 2
    whiteness: float  # p-value of white residuals (Ljung & Box 1978)
    independence: float  # p-value of independence of the references (Ljung 1999, sec. 16.6)


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """A robot fitted to logs."""

    case: str  # name of what it was fitted to
    robot: Robot
    parameters: tuple[FittedParameter, ...]
    covariance: np.ndarray  # (parameters, parameters) of their values [SI]
    signals: tuple[SignalFit, ...]  # fit and tests of each column
    directions: np.ndarray  # (parameters, n) change of the flat parameter vector by one unit of each value
    chi2: tuple[float, float]  # mean square of the residual before and after [noise variances]
    frames: int  # of the fitted logs
    blocks: int  # stretches of time that the intervals rest on
    notes: tuple[str, ...] = ()  # remarks, a sentence each

    def __repr__(self) -> str:
        shown = self.parameters[:3]
        words = [f"{p.name} {p.value:.4g} ({p.low:.4g} to {p.high:.4g}) {p.unit}".removesuffix(" -") for p in shown]
        more = f"; {len(self.parameters) - 3} more" if len(self.parameters) > 3 else ""
        before, after = (np.median([getattr(s, name) for s in self.signals]) for name in ("start", "fitted"))
        head = f"Fit({self.case}: {'; '.join(words)}{more})"
        return f"{head}\n  median fit {before:.1f} -> {after:.1f} %, chi2 {self.chi2[0]:.4g} -> {self.chi2[1]:.4g}"

    @property
    def correlation(self) -> np.ndarray:
        """Correlations (parameters, parameters) [-] of the fitted values."""
        std = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(std, std)

    @property
    def tables(self) -> tuple[tuple[Sequence[str], list[tuple[str, ...]]], ...]:
        """Headings and rows of the parameters, and of the signals; a heading that begins with `>` heads numbers."""
        rows = [(p.name, *(f"{x:.5g}" for x in (p.start, p.value, p.low, p.high)), p.unit) for p in self.parameters]
        titles = ("fit [%] of", ">start", ">fitted", ">ARX", ">held out, start", ">held out, fitted", ">held out, ARX")
        signals = []
        for s in self.signals:
            percents = (s.start, s.fitted, s.arx, s.held_start, s.held_fitted, s.held_arx)
            signals.append((s.column, *("" if x != x else f"{max(x, -100.0):.1f}" for x in percents)))
        return (("parameter", ">start", ">fitted", ">low", ">high", "unit"), rows), (titles, signals)

    @property
    def table(self) -> str:
        """Parameters and signals as tables in Markdown."""
        return "\n\n".join(markdown_table(*one) for one in self.tables)

    def draw(self, count: int, seed: int = 0) -> list[Robot]:
        """Robots drawn from the normal distribution of the fitted values, for `exo.sweep`."""
        rng = np.random.default_rng(seed)
        drawn = rng.multivariate_normal(np.zeros(len(self.parameters)), self.covariance, count)
        return [replace(self.robot, values=self.robot.values + row @ self.directions) for row in drawn]

    def plot(self) -> Figure:
        """Fit percent of each column before and after, and of the ARX model, with correlations of the parameters."""
        import matplotlib

        with matplotlib.rc_context(STYLE):
            figure = new_figure(7.4, 1.2 + 0.24 * max(len(self.signals), 3))
            left, right = figure.subplots(1, 2, width_ratios=[1.5, 1.0])
            rows = range(len(self.signals))
            before, after = NOMINAL["color"], IMPROVED["color"]
            drawn = {"start": (before, "before"), "arx": ("#98a2b3", "ARX"), "fitted": (after, "fitted")}
            for name, (colour, label) in drawn.items():
                styles = {"": {"color": colour, "label": label}, "held_": {"mfc": "none", "mec": colour}}
                for prefix, style in styles.items():
                    values = [max(getattr(s, prefix + name), 0.0) for s in self.signals]
                    left.plot(values, rows, "o", ms=4.5, **style)
            left.set_yticks(rows, [s.column for s in self.signals])
            left.set(xlabel="Fit [%], below 0 drawn at 0; hollow: held out", xlim=(-3.0, 103.0))
            left.set_ylim(len(self.signals) - 0.5, -0.5)
            figure.legend(loc="outside upper left", ncols=3)
            right.imshow(self.correlation, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
            for (i, j), value in np.ndenumerate(self.correlation) if len(self.parameters) <= NUMBERED else ():
                colour = "white" if abs(value) > 0.7 else "black"
                right.text(j, i, f"{round(value, 2) + 0.0:.2f}", ha="center", va="center", fontsize=6.5, color=colour)
            names = [f"{p.name.split()[0]}  {k + 1}" for k, p in enumerate(self.parameters)]
            right.set_xticks(range(len(names)), [str(k + 1) for k in range(len(names))], fontsize=7)
            right.set_yticks(range(len(names)), names, fontsize=7)
            right.set_title("Correlation of the estimates", fontsize=8.5)
            right.grid(visible=False)
        return figure

    def to_json(self) -> dict[str, Any]:
        """Parameters, correlations, signals, chi-squares and notes."""
        names = ("case", "parameters", "covariance", "correlation", "signals", "chi2", "frames", "blocks", "notes")
        return {name: getattr(self, name) for name in names}

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return to_dict(self)


def fit(
    robot: Robot,
    logs: LogSource,
    free: Sequence[str],
    bounds: Mapping[str, Sequence[float | str]] | None = None,
    held_out: Sequence[Log | str | Path] = (),
    prediction: bool = False,
) -> Fit:
    """Fit parameters of a robot to its logs by least squares, with intervals, fit percent and tests of residuals.

    Args:
        robot: the robot; an effect whose parameters are fitted must be spliced in.
        logs: a case or its folder, a log, its file, or several logs.
        free: full names of parameters; a name without channel frees each channel, names separated by blanks move
            together by one factor.
        bounds: name -> (low, high), numbers [SI] or text with a unit; plausible ranges of the robot file otherwise.
        held_out: further logs, which are not fitted.
        prediction: whether prediction errors are fitted beside output errors, where the machine has an observer.

    Raises:
        InputError: naming parameter, file or column, for an unknown or doubled parameter, bounds that do not hold the
            start, a parameter that moves no column of the logs or acts like others, and unreadable logs.

    Examples:
        >>> import exodrake as exo
        >>> robot = exo.load_robot()
        >>> log = exo.simulate(robot.with_parameters({"tendon.k.AF": 2600.0}), "caging")
        >>> exo.fit(robot, log, free=["tendon.k.AF"])  # the 90 % interval holds 2600 N/m
        Fit(caging: tendon.k.AF 2599 (2029 to 3169) N/m)
          median fit 97.6 -> 97.7 %, chi2 4.167 -> 1.05
    """
    machine = argument("robot", robot, Robot).machine
    case = gather_logs(logs, held_out, machine.frame, list_required(machine))
    problem = make_problem(case, robot)
    names, scales, low, high = free_parameters(problem.robot, free, bounds or {})
    views = [problem]
    if prediction:
        if (injected := problem.prediction_error()) is None:
            words = "no observer, or no logs of its signals, so there are no prediction errors"
            raise InputError(f"{machine.name}: {words}")
        views.append(injected)
    base = problem.silent()

    def residual(values: np.ndarray) -> np.ndarray:
        """Residuals (rows, samples) of flat parameter vectors (rows, n)."""
        return np.concatenate([view.residual(values, view.fit) for view in views], axis=1)

    def jacobian(x: np.ndarray) -> np.ndarray:
        """Derivatives (samples, parameters), central but at a bound."""
        ends = np.clip(x + STEP * np.array([np.eye(len(x)), -np.eye(len(x))]), low, high)
        above, below = (residual(base + end @ scales) for end in ends)
        return ((above - below) / np.diag(ends[0] - ends[1])[:, None]).T

    def say_alike(slopes: np.ndarray) -> str:
        """What columns of a Jacobian (samples, parameters) that are zero or dependent mean; empty without any."""
        sizes = np.linalg.norm(slopes, axis=0)
        for name, size in zip(names, sizes, strict=True):
            if not size:
                return f"{name} moves none of {', '.join(problem.columns)}, so no fit finds it"
        alike = np.linalg.cond(slopes / sizes) > ALIKE
        return f"{', '.join(names)} act alike on these logs; free fewer of them" if alike else ""

    def minimise(start: np.ndarray) -> Any:
        """The least-squares fit from coordinates (parameters,)."""
        return least_squares(
            lambda x: residual((base + x @ scales)[None])[0], start, jacobian, (low, high), x_scale="jac",  # pyright: ignore
            max_nfev=RUNS,
        )  # fmt: skip

    before = residual(base[None])[0]
    spread = spread_starts(base, scales, low, high)
    costs = [float(left @ left) for (left,) in (residual((base + x @ scales)[None]) for x in spread)]
    starts = [np.zeros(len(names)), *spread[np.argsort(costs)[:FARTHER]]]
    # parameters have to differ at one start: a time constant, say, has no slope at 0
    if (alike := say_alike(jacobian(starts[0]))) and all(say_alike(jacobian(x)) for x in starts[1:]):
        raise InputError(f"{case.name}: {alike}")
    minima = [minimise(x) for x in starts]
    found = min(minima, key=lambda one: one.cost)
    x, left, slopes = found.x, found.fun, found.jac
    fitted, firsts, stretches = base + x @ scales, [machine.index[name.split()[0]] for name in names], []
    if alike := say_alike(slopes):
        ended = ", ".join(f"{name} {value:.4g}" for name, value in zip(names, fitted[firsts], strict=True))
        raise InputError(f"{case.name}: where the fit ends, at {ended}, {alike}")
    frames = sum(len(trial.measured) for trial in problem.fit)
    length = max(frames // max(BLOCKS, 4 * len(x)), min(int(REPEATS * longest(problem)), frames // FEWEST), 1)
    for view in views:  # number of the stretch of time that each sample lies in
        first = 0
        for trial in view.fit:
            number = first + np.arange(len(trial.measured)) // length
            first = number[-1] + 1
            stretches.append(np.repeat(number, trial.measured.shape[1]))
    block = np.concatenate(stretches)
    inverse, own, blocks = np.linalg.inv(slopes.T @ slopes), jackknife(left, slopes, block), int(block.max()) + 1
    spoken_for = {name for text in names for name in text.split()}
    others = [p for p in nominal_parameters(problem.robot) if spoken_for.isdisjoint(p.name.split())]
    moved = [apply(fitted, [p], np.array([STEP * p.prior_std])) for p in others]
    shifts = (residual(np.array(moved)) - left) / STEP @ slopes @ inverse if moved else np.zeros((0, len(x)))
    covariance, white = own + shifts.T @ shifts, inverse * (left @ left) / max(len(left) - len(x), 1)
    start, size = problem.robot.values[firsts], scales[np.arange(len(names)), firsts]
    std, wide = np.sqrt(np.diag(covariance)), float(student.ppf(0.5 + 0.5 * CONFIDENCE, blocks - 1))
    ends = np.clip(x + wide * std * np.array([[-1.0], [1.0]]), low, high)
    stds = (std, np.sqrt(np.diag(white)), np.linalg.norm(shifts, axis=0))
    numbers = np.array([start, *(start + size * np.array([x, *ends])), *(size * np.array(stds))]).T.tolist()
    bound = (np.minimum(x - low, high - x) < AT_BOUND).tolist()
    parameters = tuple(
        FittedParameter(name, machine.parameters[i].unit, *row, at_bound=at)
        for name, i, row, at in zip(names, firsts, numbers, bound, strict=True)
    )
    values = {n: float(fitted[machine.index[n]]) for n in spoken_for}
    notes = [*case.notes, *(f"{p.name} ended at a bound" for p in parameters if p.at_bound)]
    open_ended = ~(np.isfinite(low) & np.isfinite(high)) & (np.abs(x) < AT_BOUND)
    notes += [f"{p.name} stayed where it began; state its range" for p, o in zip(parameters, open_ended) if o]
    advice = f"not converged after {RUNS} evaluations: free fewer parameters, or narrow their bounds"
    notes += [] if found.success else [advice]
    higher = [(x0, one) for x0, one in zip(starts, minima) if one.cost > (1.0 + HIGHER) * found.cost]
    outcomes = {False: "ended in another minimum", True: "did not move, as at a bound or a limit that is not reached"}
    for stays, words in outcomes.items():
        if sizes := [2.0 * m.cost / len(left) for x0, m in higher if (np.abs(m.x - x0).max() < AT_BOUND) == stays]:
            notes.append(f"{len(sizes)} of {len(minima)} starts {words}: chi2 {min(sizes):.4g} to {max(sizes):.4g}")
    return Fit(
        case.name, problem.stated.with_parameters(values, f"fitted to {case.name}"), parameters,
        covariance * np.outer(size, size), compare_signals(problem, np.array([base, fitted])), scales / size[:, None],
        (float(np.mean(before**2)), float(np.mean(left**2))), frames, blocks,
        tuple(notes),
    )  # fmt: skip


def free_parameters(
    robot: Robot, free: Sequence[str], bounds: Mapping[str, Sequence[float | str]]
) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray]:
    """Names of what is fitted, directions in the flat parameter vector (parameters, n) [SI], and ends of coordinates.

    A direction is as long as the parameter, or a tenth of its range where that is more. The ends (parameters,) are in
    directions [-].
    """
    machine, stated, given = robot.machine, robot.parameters(), dict[str, tuple[float, ...]]()
    for indices, (name, *ends) in robot.general_first((name, *ends) for name, ends in bounds.items()):
        for info in (machine.parameters[i] for i in indices):
            given[info.name] = tuple(quantity(end, info.unit, f"bounds of {name}") for end in ends)
    groups: list[list[str]] = []
    for text in [free] if isinstance(free, str) else free:
        names = [[machine.parameters[i].name for i in robot.indices(word)] for word in text.split() or [""]]
        groups += [[name for word in names for name in word]] if len(names) > 1 else [[name] for name in names[0]]
    every = [name for group in groups for name in group]
    if not every:
        raise InputError("no parameter is free; name one, such as finger.kappa")
    scales = np.zeros((len(groups), len(robot.values)))
    low, high = np.tile([[-np.inf], [np.inf]], len(groups))
    for k, group in enumerate(groups):
        for name in group:
            value, i = robot[name], machine.index[name]
            if every.count(name) > 1:
                raise InputError(f"{name} is free twice")
            if name not in stated:
                effect = next(e.id for e in machine.effects if name.startswith(f"{e.id}."))
                words = "is not in the robot, so nothing of it can be fitted; splice it in first"
                raise InputError(f"{name}: {effect} {words}")
            least, most = given.get(name) or hold_start(value, stated[name].low, stated[name].high)
            if not least <= value <= most or least == most or not np.isfinite(value):
                raise InputError(f"{name} = {value:g} does not lie between its bounds {least:g} and {most:g}")
            if len(group) > 1:
                scales[k, i] = value * np.sign(robot[group[0]])
            else:
                scales[k, i] = max(abs(value), 0.1 * (most - least) if np.isfinite(most - least) else 0.0) or 1.0
            if not scales[k, i]:
                raise InputError(f"{name} is 0, so it cannot move by a factor together with {group[0]}")
            ends = sorted(((least - value) / scales[k, i], (most - value) / scales[k, i]))
            low[k], high[k] = max(low[k], ends[0]), min(high[k], ends[1])
    return [" ".join(group) for group in groups], scales, low, high


def hold_start(value: float, low: float, high: float) -> tuple[float, float]:
    """A plausible range about a start: an end that it lies beyond moves as far again, by ratio of positive ones."""
    lowest, highest = (value**2 / end if low > 0.0 else 2.0 * value - end for end in (low, high))
    return min(low, lowest, value), max(high, highest, value)


def spread_starts(base: np.ndarray, scales: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Coordinates (`SPREAD`, parameters) [-] spread evenly between their ends, by ratio where the sign is fixed.

    Where there is no end, from half to twice the value. From the flat vector of the start (n,) [SI], and what
    `free_parameters` returns.
    """
    first = np.abs(scales).argmax(axis=1)
    value, size = base[first], scales[np.arange(len(first)), first]
    least = np.where(np.isfinite(low), value + low * size, value - 0.5 * np.abs(value))
    most = np.where(np.isfinite(high), value + high * size, value + np.abs(value))
    share = qmc.Sobol(len(first), rng=0).random(SPREAD)
    by_ratio = least * most > 0.0
    ratio = np.where(by_ratio, most / np.where(by_ratio, least, 1.0), 1.0)
    points = np.where(by_ratio, least * ratio**share, least + (most - least) * share)
    return np.clip((points - value) / size, low, high)


def jackknife(left: np.ndarray, slopes: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Covariance (parameters, parameters) [coordinates] of a least-squares fit by leaving out blocks.

    From residual (samples,) [noise_std], its derivatives (samples, parameters), and the block of each sample.
    """
    count, whole, moved = int(block.max()) + 1, slopes.T @ slopes, []
    for b in range(count):
        own, error = slopes[block == b], left[block == b]
        moved.append(np.linalg.lstsq(whole - own.T @ own, own.T @ error, rcond=None)[0])
    return (count - 1) / count * np.transpose(moved) @ moved


def compare_signals(problem: Problem, rows: np.ndarray) -> tuple[SignalFit, ...]:
    """Fit and tests of each column, with flat parameter vectors (2, n) [SI] of the robot before and after."""
    sets = [[(trial, problem.predict(rows, trial)) for trial in trials] for trials in (problem.fit, problem.holdout)]
    inputs = [[fill_columns(trial.reference) for trial, _ in one] for one in sets]
    found = []
    for j, column in enumerate(problem.columns):
        measured = [[trial.measured[:, j] for trial, _ in one] for one in sets]
        before, after = ([[run[k, :, j] for _, run in one] for one in sets] for k in (0, 1))
        errors = [[y - f for y, f in zip(*pair, strict=True)] for pair in zip(measured, after, strict=True)]
        robots = [list(map(fit_percent, measured, runs)) for runs in (before, after)]
        percents = np.transpose([*robots, arx_percents(inputs, measured)]).ravel().tolist()
        left, (white, independent) = arx_percents(inputs, errors)[0], check_residual(errors[0], inputs[0])
        found.append(SignalFit(column, *percents, left=left, whiteness=white, independence=independent))
    return tuple(found)


def fit_percent(measured: Sequence[np.ndarray], simulated: Sequence[np.ndarray]) -> float:
    """100 (1 - |y - f| / |y - mean|) [%] over several logs, (n,) each, without missing samples; NaN without logs."""
    error = sum(float(np.nansum((y - f) ** 2)) for y, f in zip(measured, simulated, strict=True))
    moved = sum(float(np.nansum((y - np.nanmean(y)) ** 2)) for y in measured)
    return 100.0 * (1.0 - float(np.sqrt(error / moved))) if moved else float("nan")


def arx_percents(inputs: Sequence[Sequence[np.ndarray]], outputs: Sequence[Sequence[np.ndarray]]) -> list[float]:
    """Fit percent [%] of the ARX model that simulates the fitted logs best, on fitted and on held-out logs.

    Of several that are as good to a per cent it is the one of least order.

        y[t] = c + b0 u[t] + b1 u[t-1] + ... - a1 y[t-1] - ...

    Inputs are (n, inputs) for each log, of fitted and of held-out logs; outputs (n,) [SI].
    """
    known = [[fill_columns(y[:, None])[:, 0] for y in ys] for ys in outputs]

    def delay(rows: np.ndarray, delays: range, order: int) -> np.ndarray:
        """Columns (n - order, ...) of rows (n, ...) that are so many samples late."""
        return np.column_stack([np.roll(rows, k, axis=0) for k in delays])[order:]

    def simulate_log(u: np.ndarray, y: np.ndarray, order: int, weights: np.ndarray) -> np.ndarray:
        """Output (n,) from the first samples on."""
        driven = weights[0] + delay(u, range(order + 1), order) @ weights[1:-order]
        fading = [1.0, *weights[-order:]]
        later = lfilter([1.0], fading, driven, zi=lfiltic([1.0], fading, y[:order][::-1]))[0]
        return np.concatenate([y[:order], later])

    found = []
    for order in ORDERS:
        own = zip(inputs[0], known[0], strict=True)
        tables = [np.hstack([delay(u, range(order + 1), order), -delay(y, range(1, order + 1), order)]) for u, y in own]
        table = np.insert(np.vstack(tables), 0, 1.0, axis=1)
        weights = np.linalg.lstsq(table, np.concatenate([y[order:] for y in known[0]]), rcond=None)[0]
        with np.errstate(over="ignore", invalid="ignore"):
            runs = [[simulate_log(u, y, order, weights) for u, y in zip(*one)] for one in zip(inputs, known)]
            found.append([fit_percent(ys, own) for ys, own in zip(outputs, runs, strict=True)])
    return max(found, key=lambda percents: round(percents[0]) if np.isfinite(percents[0]) else -np.inf)


def check_residual(errors: Sequence[np.ndarray], inputs: Sequence[np.ndarray]) -> tuple[float, float]:
    """p-values [-] of residuals that are white, and that are uncorrelated with present and past inputs.

    Under the second one the sum of e[t] u[t-k] is normal, with the variance of the product of both spectra (Ljung 1999,
    sec. 16.6); of all lags and inputs the largest counts, by Bonferroni's inequality. Of each log, errors are (n,) and
    inputs (n, inputs).
    """
    centred = [np.nan_to_num(e - np.nanmean(e)) for e in errors]
    count = sum(map(len, centred))
    own = np.array([sum(e[k:] @ e[: len(e) - k] for e in centred) for k in range(LAGS + 1)])
    if not own[0]:
        return float("nan"), float("nan")
    white = count * (count + 2) * np.sum((own[1:] / own[0]) ** 2 / (count - np.arange(1, LAGS + 1)))
    cross, variance = 0.0, 0.0
    for e, rows in zip(centred, inputs, strict=True):
        u = rows - rows.mean(axis=0)
        cross = cross + np.array([e[k:] @ u[: len(u) - k] for k in range(LAGS + 1)])
        power = np.abs(np.fft.fft(e)) ** 2 @ np.abs(np.fft.fft(u, axis=0)) ** 2
        variance = variance + power / len(e) ** 2
    z = np.abs(cross) / np.sqrt(np.maximum(variance, 1e-300))
    return float(chi2.sf(white, LAGS)), float(min(1.0, 2.0 * norm.sf(z.max()) * z.size))
