"""Numbers as people read them, and a diagnosis in words: causes with place, share and rivals, the rest, since when."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from exodrake.core.errors import plural
from exodrake.diagnosis import result
from exodrake.diagnosis.change_point import STEP, Change
from exodrake.diagnosis.parameter import Parameter, nominal_parameters
from exodrake.diagnosis.result import Diagnosis, Interval, NamedEffect, SignalGap, Where
from exodrake.model.display import Display, find_display, percent, shown_unit, with_unit
from exodrake.model.effect import Effect
from exodrake.model.machine import Machine

if TYPE_CHECKING:
    from exodrake.diagnosis.discovery.discover import MissingLaw
    from exodrake.diagnosis.since import Series, Since

# verdict -> its colour in a report, and in a terminal
LOOKS = {
    result.NO_GAP: ("#18794e", "green"), result.RETUNE: ("#0b7285", "cyan"), result.NAMED: ("#1d4ed8", "blue"),
    result.AMBIGUOUS: ("#a15c00", "yellow"), result.PARTLY: ("#7a3e9d", "magenta"), result.UNKNOWN: ("#b42318", "red"),
}  # fmt: skip
COLOURS, STYLES = ({verdict: look[k] for verdict, look in LOOKS.items()} for k in (0, 1))
DIGITS = 3  # significant digits of a quantity
MOST_MOVED = 4  # parameters that a sentence lists
MOST_SEATS = 4  # channels that a sentence lists where an effect sits on all of them
SMALL = 1.1  # noise standard deviations: a gap below it leaves nothing to close
AT_LIMIT = 0.999  # of the largest change that a tolerance allows, from which a parameter counts as limited by it
MUCH = 2.0  # standard deviations of its tolerance, beyond which a change is said: one in twenty that differ by chance
VAST = 100.0  # noise standard deviations, beyond which noise is no measure of a gap
LEAST_SHARE = 0.005  # of the gap: a smaller one would be rounded to 0 %
REFINED = "a refinement may be the error of a cause's law, and is no cause"
EXPERIMENT = (
    "`exodrake experiment CASE --out reference.csv`, with this --robot, designs the motion that tells them apart"
)


def digits(value: float, count: int = DIGITS) -> str:
    """A number with `count` significant digits and no exponent where that is readable."""
    if not math.isfinite(value):
        return "none" if math.isnan(value) else "∞" if value > 0 else "-∞"
    if value == 0.0:
        return "0"
    places = count - 1 - math.floor(math.log10(abs(value)))
    if not -count < places < 8:
        return f"{value:.{count - 1}e}"
    return f"{value:.{max(0, places)}f}"


def quantity(value: float, si: str, unit: str = "") -> str:
    """A quantity [SI] in the unit shown: 0.0123, "m" -> `12.3 mm`."""
    name, factor = shown_unit(si, unit)
    return with_unit(digits(factor * value), name)


def interval(item: Interval) -> tuple[str, str]:
    """A value with its unit, and its 90 % interval, with as many decimals as the interval's width deserves."""
    name, factor = shown_unit(item.unit)
    value, low, high = (factor * x for x in (item.value, item.low, item.high))
    width = high - low
    if not all(math.isfinite(x) for x in (value, low, high)) or width <= 0.0:
        return with_unit(digits(value), name), f"{digits(low)} to {digits(high)}"
    places = max(0, min(8, 1 - math.floor(math.log10(width))))
    return with_unit(f"{value:z.{places}f}", name), f"{low:.{places}f} to {high:.{places}f}"


def closure(fraction: float) -> str:
    """A closure: a fraction as per cent; of an error that grew, by what factor: -2.5 is `grew by a factor of 3.5`."""
    return f"grew by a factor of {factor(1.0 - fraction)}" if rounds_below(fraction) else percent(abs(fraction))


def closure_span(item: Interval) -> str:
    """Ends of an interval of closures: `93 to 98 %`, `grew by a factor of 2.1 to 5.0`, or one of each."""
    if not rounds_below(item.low):
        return f"{closure(item.low).removesuffix(' %')} to {closure(item.high)}"
    if rounds_below(item.high):
        return f"grew by a factor of {factor(1.0 - item.high)} to {factor(1.0 - item.low)}"
    return f"{closure(item.low)} to {percent(abs(item.high))} gone"


def closure_words(item: Interval, error: str, where: str = "") -> str:
    """A closure with its interval in a sentence: how much of "the excess error" is gone "with the improved robot"."""
    value, rest = f"{closure(item.value)} ({closure_span(item)})", f" {where}" if where else ""
    return f"{error} {value}{rest}" if rounds_below(item.value) else f"{value} of {error} is gone{rest}"


def rounds_below(fraction: float) -> bool:
    """Whether a fraction is negative once it is rounded to per cent."""
    return math.isfinite(fraction) and round(100 * fraction) < 0


def factor(ratio: float) -> str:
    """A ratio with two figures: `1.13`, `47`, `47,000`."""
    return f"{ratio:.2f}" if ratio < 2.0 else f"{ratio:.1f}" if ratio < 10.0 else f"{float(f'{ratio:.2g}'):,.0f}"


def join_words(items: tuple[str, ...] | list[str], last: str = "and") -> str:
    """Items in a sentence: `a, b and c`."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {last} {items[-1]}" if items else ""


def join_first(items: list[str]) -> str:
    """The first `MOST_MOVED` items in a sentence, and how many more there are."""
    more = len(items) - MOST_MOVED
    return join_words([*items[:MOST_MOVED], *([f"{more} more"] if more > 0 else [])])


def split_column(name: str, machine: Machine) -> tuple[str, str]:
    """Kind and channel of a column: `speed_cmd_AF` -> (`speed_cmd`, `AF`)."""
    kinds = [c.kind for c in machine.columns if name.startswith(f"{c.kind}_")]
    kind = max(kinds, key=len, default=name.rsplit("_", 1)[0])
    return kind, name[len(kind) + 1 :]


def seat(place: Where | NamedEffect, machine: Machine) -> str:
    """Tendons and joints in words, `all 7 joints` for a long list of all of them; empty if there are none."""
    parts = []
    for axis, names in (("tendon", place.wires), ("joint", place.joints)):
        if len(names) > MOST_SEATS and set(names) == set(machine.axes.of(f"{axis}s")):
            parts.append(f"all {len(names)} {axis}s")
        elif names:
            parts.append(f"the {axis}" if names == (axis,) else f"{plural(len(names), axis)} {join_words(names)}")
    return " and ".join(parts)


def shorten_id(identity: str) -> str:
    """`tendon.capstan_friction` -> `capstan friction`."""
    return " + ".join(part.strip().split(".")[-1].replace("_", " ") for part in identity.split("+"))


def find_effect(diagnosis: Diagnosis, identity: str) -> Effect | None:
    """An effect of the library of the machine; None if the library lacks it."""
    return next((e for e in diagnosis.machine.effects if e.id == identity), None)


def causes(diagnosis: Diagnosis, role: str = result.CAUSE) -> list[NamedEffect]:
    """Effects that the verdict calls causes, the largest first; or those of another role."""
    return [e for e in diagnosis.effects if e.role == role]


def name_place(diagnosis: Diagnosis, effect: NamedEffect) -> tuple[str, str]:
    """Kind and id of an effect, `load-dependent friction (tendon.capstan_friction)`, and its place, `in the motor`."""
    place = seat(effect, diagnosis.machine)
    place = f"at {place}" if place else f"in the {effect.id.split('.')[0]}"
    return f"{effect.kind or shorten_id(effect.id)} ({effect.id})", place


def block_words(diagnosis: Diagnosis) -> str:
    """A sentence that says in which parts the effects of a block act which is no part itself, such as `timing`."""
    block, machine = diagnosis.where.block, diagnosis.machine
    found = [p.name for p in machine.parts if any(e.block == block for e in machine.effects_on(p))]
    if not found or block in {p.name for p in machine.parts}:
        return ""
    return f" Effects of the {block} act in {plural(len(found), 'part')} {join_words(found)}."


def parameter_values(effect: NamedEffect) -> list[tuple[str, str, str]]:
    """Name, value and 90 % interval of each parameter, by channel where they disagree, whose interval says anything."""
    found = []
    for name, item in effect.parameters.items():
        channels = effect.channels.get(name, {})
        alike = all(item.low <= one.value <= item.high for one in channels.values())
        several = {} if alike else {f"{name} {channel}": one for channel, one in channels.items()}
        shown = (several or {name: item}).items()
        found += [(title, *interval(one)) for title, one in shown if says_something(one)]
    return found


def by_channel(effect: NamedEffect) -> str:
    """Values of the first parameter channel by channel, where they differ: `mu_phi 0.31 at AF, 0.12 at MF`."""
    for name, item in list(effect.parameters.items())[:1]:
        channels = {c: i for c, i in effect.channels.get(name, {}).items() if says_something(i)}
        if len(channels) > 1 and not all(item.low <= one.value <= item.high for one in channels.values()):
            return f"{name} " + ", ".join(f"{interval(one)[0]} at {channel}" for channel, one in channels.items())
    return ""


def says_something(item: Interval) -> bool:
    """Whether an interval is no wider than twice its value."""
    return math.isfinite(item.high - item.low) and item.high - item.low <= 2.0 * abs(item.value)


def share(fraction: float) -> str:
    """A share of the gap as per cent, between 0 and 100 %; one that would be rounded to 0 is `< 1 %`."""
    if 0.0 < fraction < LEAST_SHARE:
        return "< 1 %"
    return percent(min(max(fraction, 0.0), 1.0)) if math.isfinite(fraction) else "–"


def share_span(item: Interval) -> str:
    """A share of the gap with its 90 % interval, where it has one that is not rounded to 0: `91 % (87-94)`."""
    if not item.low < item.high or item.high < LEAST_SHARE:
        return share(item.value)
    low, high = (percent(min(max(end, 0.0), 1.0)).removesuffix(" %") for end in (item.low, item.high))
    return f"{share(item.value)} ({low}-{high})"


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence: causes, places, shares, what remains, and what held-out motion says of them."""
    errors = {name: signal.after / signal.noise_std for name, signal in diagnosis.closure.signals.items()}
    worst, error = max(errors.items(), key=lambda one: one[1], default=("", 0.0))
    size, seen = f"{digits(error, 2)} noise standard deviations", error**2 > 2.0  # as large again as the noise
    if error > VAST:
        size = quantity((gap := diagnosis.closure.signals[worst]).after, gap.unit)
    held_out = diagnosis.problem is not None and bool(diagnosis.problem.holdout)
    beyond = f"; on held-out motion {size} remain on {worst}" if seen and held_out else ""
    if diagnosis.verdict == result.NO_GAP:
        return f"What the nominal robot leaves beyond noise is negligible on every signal{beyond}."
    contradicted = diagnosis.confirmed is False and diagnosis.closure.effect.high < 0.0
    doubt = "contradicts" if contradicted else "does not confirm"
    unconfirmed = f"; held-out motion {doubt} it" if diagnosis.confirmed is False else ""
    if diagnosis.verdict == result.RETUNE:
        moved = diagnosis.retune.moved  # the largest change first
        shown = [f"{m.name} {quantity(m.nominal, m.unit)} -> {quantity(m.value, m.unit)}" for m in moved]
        words = f": {join_first(shown)}" if shown else ""
        return f"Nominal parameters within their tolerances explain the gap{words}; no effect is needed{beyond}."
    if diagnosis.verdict == result.UNKNOWN:
        where, explained = diagnosis.where, 1.0 - diagnosis.remainder.value
        place = seat(where, diagnosis.machine)
        within = f" in the {where.block}" if where.block != "none" else ""
        text = f"There is a gap{within}{f' at {place}' if place else ''}{regime_words(where.regime)}"
        if result.TOO_LITTLE in diagnosis.reasons[-1]:
            return f"{text}: {diagnosis.reasons[-1]}{unconfirmed}."
        text += ", that no effect of the library explains"
        best = min(diagnosis.candidates, key=lambda c: abs(c.share - explained), default=None)
        if best and explained > LEAST_SHARE:
            text += f"; the best set, {best.id}, would explain {share(explained)} of it"
        return f"{text}{unconfirmed}."
    said, named, found = list[str](), "explains {} of the gap", causes(diagnosis)  # by each cause
    ambiguous = [e for e in found if e.rivals]
    for effect in sorted(found, key=lambda e: bool(e.rivals) != bool(found[0].rivals)):  # those like the largest first
        (kind, place), values = name_place(diagnosis, effect), by_channel(effect)
        known = math.isfinite(effect.share.value)  # not of one among several that detectors found
        explained = named.format(share(effect.share.value).replace("<", "less than")) if known else "was detected"
        explained += f" ({values})" if values and not effect.rivals else ""
        if effect.rivals:
            others = join_words([f"{shorten_id(r.id)} ({r.id})" for r in effect.rivals], "or")
            lead = "the logs cannot tell" if effect is ambiguous[0] else "nor"
            said.append(f"{lead} {shorten_id(effect.id)} ({effect.id}) from {others} {place}, which {explained}")
        else:
            besides = " besides" if said and diagnosis.verdict == result.AMBIGUOUS else ""
            said.append(f"{kind} {place}{besides} {explained}")
        named = "explains {} of it"
    words, left = "; ".join(said), diagnosis.remainder
    if math.isfinite(left.value):
        if left.value < LEAST_SHARE:
            words += f"; {size} remain on {worst}" if seen and not beyond else "; nothing remains"
        else:
            partly = diagnosis.verdict == result.PARTLY
            words += f"; {share(left.value)} remains{f' in the {left.block}' if partly and left.block else ''}"
            words += regime_words(left.regime) if partly else ""
            words += f", most on {worst} ({size})" if worst and (partly or seen) and not beyond else ""
    if contradicted:  # first of all: the answer is doubtful
        return f"Held-out motion contradicts this: {words}{beyond}."
    closed = "" if diagnosis.closure.overall.value > 0.0 else "; on the judged logs the gap is not closed"
    return f"{words[:1].upper()}{words[1:]}{beyond}{unconfirmed}{closed}."


def rival_values(diagnosis: Diagnosis, effect: NamedEffect, rival: str) -> list[tuple[str, str]]:
    """Names and values of the first parameter of a rival in an effect's place, by channel where it is not absent there.

    None where its robot is not among the explanations in play.
    """
    wanted = {e.id for e in diagnosis.effects} - {effect.id} | {rival}
    changed = next((r.parameters for r in diagnosis.rivals if set(r.effects) == wanted), {})
    machine = diagnosis.machine
    lead = machine.effect(rival).parameters[0]
    places = machine.effect_indices(rival, lead.name).items()
    named = [(f"{lead.name} {channel}".rstrip(), machine.parameters[i].name) for channel, i in places]
    return [(label, quantity(changed[name], lead.unit)) for label, name in named if name in changed]


def regime_words(regime: Mapping[str, float]) -> str:
    """The condition that the error depends on most: `, mostly with direction of motion`; empty without one."""
    return f", mostly with {max(regime, key=lambda name: regime[name])}" if regime else ""


def refinement_words(diagnosis: Diagnosis) -> str:
    """Refinements with place and share in a sentence, and what they are; empty without any."""
    found = causes(diagnosis, result.REFINEMENT)
    each = [f"{' '.join(name_place(diagnosis, e))}, {share(e.share.value)} of the gap" for e in found]
    return f"{'; '.join(each)} ({REFINED})" if each else ""


def list_robots(diagnosis: Diagnosis) -> dict[str, str]:
    """The robots that the answer compares: their key among the gaps of a signal -> what they are."""
    robots = {"before": "nominal robot", "retuned": "retuned robot", "after": "improved robot"}
    if diagnosis.verdict == result.UNKNOWN:
        return robots | {"after": "best set (not accepted)"}
    return dict(list(robots.items())[: {result.NO_GAP: 1, result.RETUNE: 2}.get(diagnosis.verdict, 3)])


def robot_errors(diagnosis: Diagnosis) -> tuple[dict[str, str], bool]:
    """RMS error of each of these robots over all signals, and whether in noise standard deviations.

    Else in per cent of the nominal robot's: noise is no measure of errors that are all beyond `VAST`.
    """
    rms = {key: diagnosis.closure.rms[key] for key in list_robots(diagnosis)}
    if min(rms.values()) > VAST:
        return {key: percent(size / rms["before"]) for key, size in rms.items()}, False
    return {key: digits(size) for key, size in rms.items()}, True


def last_robot(diagnosis: Diagnosis) -> str:
    """Description of the last of these robots."""
    return list(list_robots(diagnosis).values())[-1]


def robot_titles(diagnosis: Diagnosis) -> list[str]:
    """Titles of columns of these robots: `Nominal`, `Retuned`, `Improved`."""
    return [name.removesuffix(" robot").partition(" (")[0].capitalize() for name in list_robots(diagnosis).values()]


def kind_gaps(diagnosis: Diagnosis) -> dict[str, tuple[Display, SignalGap]]:
    """Gap of each kind of signal, RMS [SI] over the signals of that kind, and how the kind is shown."""
    by_kind: dict[str, list[SignalGap]] = {}
    for name, gap in diagnosis.closure.signals.items():
        by_kind.setdefault(split_column(name, diagnosis.machine)[0], []).append(gap)
    found = {}
    for kind, gaps in by_kind.items():
        rows = np.array([[s.before, s.retuned, s.after, s.noise_std] for s in gaps])
        excess = np.mean((rows[:, :3] / rows[:, 3:]) ** 2, axis=0) - 1.0
        closed = 1.0 - max(excess[2], 0.0) / excess[0] if excess[0] > 0.0 else math.nan
        before, retuned, after, noise_std = np.sqrt(np.mean(rows**2, axis=0)).tolist()
        total = SignalGap(before, retuned, after, noise_std, float(closed), gaps[0].unit)
        found[kind] = find_display(kind, diagnosis.machine), total
    return found


def list_changes(diagnosis: Diagnosis) -> list[tuple[Parameter, float]]:
    """Nominal parameters with the coordinates that the improved robot gives them, the largest change first.

    Of a set that was not accepted nothing counts: then those of the retuned robot.
    """
    last = diagnosis.robots["retuned" if diagnosis.verdict == result.UNKNOWN else "improved"]
    nominal = diagnosis.robots["nominal"]
    found = [(p, p.coordinate(float(last.values[p.index[0]]))) for p in nominal_parameters(nominal)]
    return sorted(found, key=lambda change: -abs(change[1] / change[0].prior_std))


def describe_change(machine: Machine, parameter: Parameter, x: float) -> tuple[str, str, str]:
    """A nominal parameter's value before and after its change, and a word where it went as far as tolerances allow."""
    unit, limited = machine.parameters[parameter.index[0]].unit, abs(x) >= AT_LIMIT * max(map(abs, parameter.bounds))
    before, after = (quantity(value, unit) for value in (parameter.base, parameter.value(x)))
    return before, after, " (its limit)" if limited else ""


def retuned_words(diagnosis: Diagnosis) -> str:
    """Nominal parameters that changed by much, or as far as tolerances allow; empty without any."""
    found = []
    for p, x in list_changes(diagnosis):
        before, after, limit = describe_change(diagnosis.machine, p, x)
        if limit or abs(x) > MUCH * p.prior_std:
            found.append(f"{p.name} {before} -> {after}{limit}")
    return join_first(found) if found else ""


def motion_words(diagnosis: Diagnosis) -> str:
    """Kinds of motion that the closure was measured on, and closures of kinds left out of the fit."""
    found = diagnosis.closure
    if not found.motions or not diagnosis.effects:
        return ""
    each = ", ".join(f"{kind} {closure(c.value)}" for kind, c in found.motions.items())
    return f"measured on {', '.join(found.measured_on)}; kinds of motion left out of the fit, one at a time: {each}"


def alike_words(diagnosis: Diagnosis) -> str:
    """Effects that alone, with nominal parameters, explain as much as `RETUNE`; empty without any."""
    if diagnosis.verdict != result.RETUNE:
        return ""
    shares = [f"{identity} ({percent(one)} of that)" for identity, one in diagnosis.retune.alike.items()]
    return f"one effect alone, with nominal parameters, closes as much: {', '.join(shares)}" if shares else ""


def since_words(diagnosis: Diagnosis) -> list[str]:
    """Changes over the sessions in sentences: what, when, and how much; none for a case without sessions."""
    found = diagnosis.since
    if found is None:
        return []
    if found.note:
        return [found.note]
    if found.clearest is None or found.clearest.change is None:
        spans = f"{len(found.sessions)} {'sessions' if found.unit == 'd' else 'windows of the log'}"
        return [f"no quantity changes over the {spans}"]
    one, change = found.clearest, found.clearest.change
    before, after = (interval(Interval(*item, one.unit)) for item in (change.before, change.after))
    sizes = f"{before[0]} until then, {after[0]} ({after[1]}) in the last session"
    rate = "" if change.shape == STEP else f"; it changes by {change_rate(found, one, change)}"
    shapes = " or ".join(change.shapes)
    lines = [f"the change of {name_series(one)} began {change_date(found, change)}: {sizes}{rate} ({shapes})"]
    alike = [other for other in found.series if other.change is not None and other.name == one.name]
    if len(alike) > 1:
        lines.append(f"it changes, too, on {join_words([other.channel for other in alike[1:]])}")
    if diagnosis.verdict == result.UNKNOWN and found.effect:
        lines.append(
            f"no constant explanation is left, but {found.effect} alone, with a size of its own in each session, "
            f"leaves a reduced chi-square of {digits(found.chi2)}"
        )
    return lines


def change_date(found: Since, change: Change) -> str:
    """The date with its 90 % set."""
    _, low, high = (found.moment(t) for t in change.began)
    if change.began[1] <= found.times[0] and change.shape != STEP:
        return f"in the first session or before, by {high} at the latest"
    return f"about {high}" if low == high else f"between {low} and {high} (90 %)"


def change_rate(found: Since, one: Series, change: Change) -> str:
    """Rate by day or minute, and as a share of the value before where that is clearly not zero."""
    per, scale = ("a day", 1.0) if found.unit == "d" else ("a minute", 60.0)
    value = quantity(scale * change.rate[0], one.unit)
    level, low, high = change.before
    share = f", {percent(scale * change.rate[0] / level)} of the value before" if low * high > 0.0 else ""
    return f"{value} {per}{share}"


def name_series(one: Series) -> str:
    """A series in words."""
    name = "the residual’s power" if one.name == "residual" else one.name
    return f"{name} on {one.channel}" if one.channel else name


def law_lines(law: MissingLaw | None) -> list[str]:
    """Result of a discovery in lines of text; nothing without one."""
    if law is None:
        return []
    if not law.found:
        return [f"law     none: {law.reason}"]
    seat = f" of {', '.join(law.channels)}" if law.channels else ""
    lines = [f"law     {law.id}: {law.words}{seat}", f"        {law.reason}"]
    if law.closure is not None and math.isfinite(law.closure.value):
        logs = "held-out logs" if law.held_out else "fitted logs"
        lines.append(f"        {closure_words(law.closure, 'what retuning leaves', f'on the {logs}')}")
    for name, curve in law.curves.items():
        if curve.formula:
            lines.append(f"        {name + ': ' if name else ''}{curve.formula}")
    if law.runner_up is not None:
        apart = "rejected" if law.distinguished else "not distinguished by these logs"
        other = f"{law.runner_up.id} ({law.runner_up.words}, {closure(law.runner_up.share)})"
        lines.append(
            f"        runner-up {other}: {apart} (the law takes up {percent(max(law.lead, 0.0))} of what it leaves)"
        )
    return lines
