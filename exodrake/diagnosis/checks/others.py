"""Each log of a case beside the other logs: another unit, zero, clock or robot in one of them.

A channel of one log is predicted by a linear model that is fitted on the other logs: from the references, what the
nominal robot does on them, and the log's channels of other kinds. An effect of the robot acts on all logs and so is in
the model, as far as it is linear; what is wrong with one log is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from exodrake.core.errors import InputError
from exodrake.diagnosis.checks.compare import Comparison, list_few

LONG = 25  # frames: what lasts shorter is neither a gap nor frozen (assumed: longer than packets are lost in a row)
ANOTHER_UNIT = 10.0**0.5  # times a limit; geometrically half-way to the smallest factor of another decimal unit
# Times the largest error of the other logs: with few logs an error three times the largest is rare in any law without
# heavy tails, and healthy robots, simulated and real, stay below 2.7
UNLIKE = 3.0
SMALL = 0.03  # of the motion: the scatter of nominal parameters; predictions are not trusted further
RIDGE = 1e-3  # of the variance: columns that move alike share their weight
BLOCKS = 10  # of a log, in each of which a delay is taken: the scatter about a line then says how sure its slope is
DRIFTING = 7.0  # standard errors of a slope; predictions err alike for long, so that healthy robots reach 6
STILL = 1e-6  # of a column's motion over all logs: less in most of them is rounding, and the column rests there
ALONE = 0.75  # of an error, from which its cause is named


@dataclass(frozen=True, eq=False)
class OtherLogs:
    """Predictions of the channels of each log from the other logs; values in units of `scale` about `middle`.

    Attributes:
        comparison: the logs.
    """

    comparison: Comparison

    @cached_property
    def raw(self) -> list[np.ndarray]:
        """References, nominal and measured columns of each log (n, c) [SI]."""
        return [np.hstack([p.reference, p.nominal, p.measured]) for p in self.comparison.pairs]

    @cached_property
    def middle(self) -> np.ndarray:
        """(c,) median over logs of the columns' means [SI]."""
        return np.median([rows.mean(axis=0) for rows in self.raw], axis=0)

    @cached_property
    def scale(self) -> np.ndarray:
        """(c,) typical motion of the columns in the logs, that of a measured one no less than the nominal's [SI]."""
        spread, width = np.median([rows.std(axis=0) for rows in self.raw], axis=0), len(self.comparison.columns)
        spread[-width:] = np.maximum(spread[-width:], spread[-2 * width : -width])
        largest = np.vstack(self.raw).std(axis=0)
        return np.where(spread > STILL * largest, spread, np.where(largest > 0.0, largest, 1.0))

    @cached_property
    def rows(self) -> list[np.ndarray]:
        """A one and the scaled columns of each log (n, 1 + c)."""
        return [np.column_stack([np.ones(len(raw)), (raw - self.middle) / self.scale]) for raw in self.raw]

    @cached_property
    def moments(self) -> np.ndarray:
        """Mean products of the columns of each log (logs, 1 + c, 1 + c)."""
        return np.array([rows.T @ rows / len(rows) for rows in self.rows])

    @cached_property
    def repeats(self) -> np.ndarray:
        """Which logs (logs, logs) follow one reference, so that either predicts the other too well."""
        found = np.eye(len(self.rows), dtype=bool)
        for i, k in combinations(range(len(self.rows)), 2):
            a, b = (self.comparison.pairs[log].reference for log in (i, k))
            rows = min(len(a), len(b))
            same = np.allclose(a[:rows], b[:rows], rtol=0.0, atol=1e-9 * float(np.abs(a).max(initial=1e-9)))
            found[i, k] = found[k, i] = same
        return found

    def place(self, column: int) -> int:
        """Index of a compared column in `rows`."""
        return self.moments.shape[1] - len(self.comparison.columns) + column

    def fit_weights(self, column: int, logs: Sequence[int], without: Sequence[str] = ()) -> np.ndarray:
        """Weights (1 + c,) that predict a column, fitted on some logs; kinds that take no part, its own among them."""
        first, kinds = self.place(0), self.comparison.kinds
        others = first + np.flatnonzero(~np.isin(kinds, [kinds[column], *without]))
        used = np.concatenate([np.arange(first), others])
        moments = self.moments[list(logs)].mean(axis=0)
        ridge = np.full(len(used), RIDGE)
        ridge[0] = 0.0
        found = np.zeros(len(moments))
        found[used] = np.linalg.solve(moments[np.ix_(used, used)] + np.diag(ridge), moments[used, self.place(column)])
        return found

    def error(self, column: int, log: int, logs: Sequence[int], without: Sequence[str] = ()) -> float:
        """RMS error of a column of a log by a fit on some logs [motions]."""
        off = -self.fit_weights(column, logs, without)
        off[self.place(column)] += 1.0
        return float(np.sqrt(max(off @ self.moments[log] @ off, 0.0)))

    def errors(self, column: int, log: int, without: Sequence[str] = ()) -> list[float]:
        """Errors of a column in each other log, by fits that know neither of both; none with fewer than three logs."""
        found = []
        for k in range(len(self.rows)):
            known = [m for m in range(len(self.rows)) if m != log and not self.repeats[k, m]]
            found += [self.error(column, k, known, without)] if k != log and known else []
        return found

    def predict(self, column: int, log: int, without: Sequence[str] = ()) -> np.ndarray:
        """A column of a log (n,) by a fit on the others; the nominal robot's where there is no other."""
        others = [k for k in range(len(self.rows)) if k != log]
        if others:
            return self.rows[log] @ self.fit_weights(column, others, without)
        place = self.place(column) - 1
        return (self.comparison.pairs[log].nominal[:, column] - self.middle[place]) / self.scale[place]

    def compare(self, column: int, log: int, without: Sequence[str] = ()) -> tuple[float, str]:
        """How many times the usual error is the part of a column's error that a gain, offset or delay explains.

        What none of them explains is left to the robot: an effect may show in one motion alone.

        Returns:
            The ratio, 0 for an error that is usual, and the one of the three that suffices, in words.
        """
        others = [k for k in range(len(self.rows)) if k != log]
        if not (errors := self.errors(column, log, without)):
            return 0.0, ""
        usual, rms = max([SMALL, *errors]), self.error(column, log, others, without)
        if rms <= UNLIKE * usual:
            return 0.0, ""
        place = self.place(column) - 1
        scale, level = self.scale[place], self.middle[place] / self.scale[place]
        unit = self.comparison.pairs[log].item.log.units[self.comparison.columns[column]]
        h, y = self.predict(column, log, without), self.rows[log][:, place + 1]
        error, n = y - h, len(y)
        a, b = (np.fft.rfft(x - x.mean(), 2 * n) for x in (y, h))
        lags = np.arange(-(n // 4), n // 4 + 1)
        late = int(lags[np.argmax(np.fft.irfft(a * b.conj(), 2 * n)[lags])])
        shifted = np.roll(h, late)
        shifted[: max(late, 0)], shifted[n + min(late, 0) :] = h[0], h[-1]
        true = h + level
        gain = float(true @ (y + level) / (true @ true))
        both = np.column_stack([h, np.ones(n)])
        linear = error - both @ np.linalg.lstsq(both, error, rcond=None)[0]
        left = {
            f"about {gain:.3g} times what they say": error - (gain - 1.0) * true,
            f"{error.mean() * scale:+.3g} {unit} apart": error - error.mean(),
            f"{late * self.comparison.machine.frame:+.3g} s late": y - shifted,
        }
        total = float(error @ error)
        shares = {words: 1.0 - float(rest @ rest) / total for words, rest in left.items()}
        best = max(shares, key=lambda words: shares[words])
        share = max(shares[best], 1.0 - float(linear @ linear) / total)
        return rms * float(np.sqrt(share)) / usual, best if shares[best] > ALONE else ""

    def delay_slope(self, kind: str, log: int) -> tuple[float, float]:
        """By how much the delay of a kind of channel grows in a log [frames/frame], and that over its standard error.

        In each block of the log the error is fitted by offset, gain and delay; a line goes through the delays.
        """
        found = []
        for column in np.flatnonzero(self.comparison.kinds == kind):
            predicted = self.predict(int(column), log)
            error = self.rows[log][:, self.place(int(column))] - predicted
            speed = np.gradient(np.convolve(np.pad(predicted, 2, mode="edge"), np.ones(5) / 5.0, "valid"))
            for block in np.array_split(np.arange(len(predicted)), BLOCKS):
                if len(block) < LONG or not np.ptp(speed[block]) > 0.0:
                    continue
                level = predicted[block] - predicted[block].mean()
                shape = np.column_stack([np.ones(len(block)), level, speed[block]])
                inverse = np.linalg.pinv(shape.T @ shape)
                fitted = inverse @ (shape.T @ error[block])
                left = np.mean((error[block] - shape @ fitted) ** 2)
                if inverse[2, 2] > 0.0 and left > 0.0:
                    found.append((block.mean(), -fitted[2], 1.0 / (inverse[2, 2] * left)))
        if len(found) < BLOCKS // 2:
            return 0.0, 0.0
        time, delay, weight = np.array(found).T
        time, delay = (x - np.average(x, weights=weight) for x in (time, delay))
        spread = weight @ time**2
        if not spread > 0.0:
            return 0.0, 0.0
        slope = float(weight @ (time * delay) / spread)
        error = float(np.sqrt(weight @ (delay - slope * time) ** 2 / (len(time) - 2) / spread))
        return slope, abs(slope) / error if error > 0.0 else 0.0


def beyond_limits(comparison: Comparison) -> dict[str, dict[str, tuple[float, float]]]:
    """File -> command that is far beyond its limit -> largest size and limit [SI]; a measured motion has no limit."""
    machine, found = comparison.machine, {}
    if not (machine.references[0].kind.endswith("_ref") and machine.reference_limits and comparison.robot.limits):
        return {}
    try:
        limits = np.maximum(*map(np.abs, comparison.robot.reference_limits()))
    except InputError:  # not stated for each channel
        return {}
    columns = machine.log_names(machine.references[:1])
    for pair in comparison.pairs:
        largest = np.abs(pair.reference[:, : len(columns)]).max(axis=0)
        sizes = {c: (float(x), float(most)) for c, x, most in zip(columns, largest, limits) if most > 0.0}
        beyond = {c: one for c, one in sizes.items() if one[0] > ANOTHER_UNIT * one[1]}
        found |= {pair.item.file: beyond} if beyond else {}
    return found


def unlike_other_logs(comparison: Comparison) -> list[str]:
    """Channels of one log err by a gain, offset or delay, several times as far as those of any other log.

    With fewer than three logs nothing says what is usual. Of channels that predict each other, those count that still
    err when the others take no part. Where a command is in another unit, all channels follow it.
    """
    if len(comparison.pairs) < 3:
        return []
    other, kinds, unlike = OtherLogs(comparison), comparison.kinds, {}
    beyond = beyond_limits(comparison)
    for log in (k for k, pair in enumerate(comparison.pairs) if pair.item.file not in beyond):
        each = ((c, other.compare(c, log)) for c in range(len(comparison.columns)))
        found = {c: one for c, one in each if one[0] > UNLIKE}
        moving = dict.fromkeys(kinds[list(found)])
        alone = {c: other.compare(c, log, [kind for kind in moving if kind != kinds[c]]) for c in found}
        kept = {c: one for c, one in alone.items() if one[0] > UNLIKE}
        if found and not kept:  # those of one kind with the one that is most unlike
            kind = kinds[max(found, key=lambda c: found[c][0])]
            kept = {c: one for c, one in found.items() if kinds[c] == kind}
        if kept:
            unlike[log] = kept
    if not unlike:
        return []
    log = max(unlike, key=lambda log: sum(np.log(ratio) for ratio, _ in unlike[log].values()))
    found = unlike[log]
    named = next((c for c in sorted(found, key=lambda c: -found[c][0]) if found[c][1]), None)
    several = len(set(kinds[list(found)])) > 1
    return [
        f"{list_few(comparison.columns[c] for c in sorted(found))} of {comparison.pairs[log].item.file} do not follow "
        + "from the other logs"
        + (f" ({comparison.columns[named]}: {found[named][1]})" if named is not None else "")
        + (
            ": another robot?"
            if several
            else ": another unit, zero or clock, a clipped or dead channel, another robot?"
        )
    ]


def drifting_clocks(comparison: Comparison) -> list[str]:
    """The channels of one kind come ever later, or earlier, in one log, as those of no other log do."""
    if len(comparison.pairs) < 3:
        return []
    other, found = OtherLogs(comparison), []
    for kind in dict.fromkeys(comparison.kinds):
        slopes = [other.delay_slope(str(kind), log) for log in range(len(comparison.pairs))]
        for log, (slope, sure) in enumerate(slopes):
            rest = np.array([s for k, (s, _) in enumerate(slopes) if k != log])
            own = slope - np.median(rest)
            grows = abs(own) * len(other.rows[log])
            if sure > DRIFTING and grows > 1.0 and abs(own) > UNLIKE * np.abs(rest - np.median(rest)).max():
                file, word = comparison.pairs[log].item.file, "later" if own > 0.0 else "earlier"
                names = list_few(c for c, k in zip(comparison.columns, comparison.kinds, strict=True) if k == kind)
                found.append(
                    f"{names} of {file} come ever {word}, by {grows:.2g} frames at its end ({1e6 * abs(own):.0f} ppm), "
                    "unlike in the other logs: a clock of its own?"
                )
    return found
