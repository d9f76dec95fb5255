"""Since when, tried: simulated robots that wear, loosen, are donned anew, drift or stay, session by session.

    python -m studies.since --out docs/since.md                       # 20 robots of each kind, some minutes
    python -m studies.since --out docs/since.md --repeats 20 --exo 2  # and as many of the Exo-Index, half a minute each

Each robot is drawn within its tolerances and diagnosed as any case. The sheath's robots come from exodrake's own
engine; those of the Exo-Index from the reference simulator of the blind package, which shares no equation with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from time import process_time

import click
import numpy as np
from scipy.stats import binomtest

import exodrake as exo
from exodrake.blind.make import rounded
from exodrake.blind.parameters import draw_parameters
from exodrake.blind.protocols import wander
from exodrake.blind.robot_spec import InjectedFault, RobotSpec
from exodrake.blind.simulator import simulate as simulate_reference
from exodrake.core.confidence import ALPHA, CONFIDENCE
from exodrake.core.files import write_text
from exodrake.core.proportions import binomial_interval
from exodrake.data.case import Case, CaseLog
from exodrake.data.log import Log
from exodrake.diagnosis.healthy import healthy_robot
from exodrake.diagnosis.since import Since
from exodrake.simulation import protocols
from exodrake.simulation.references import on_machine

START = datetime(2026, 1, 1, tzinfo=UTC)
SESSIONS, SECONDS = 10, 10.0
EARLIEST, LATEST = 1.5, 6.0  # d, of the begin
EXO_SHARE = 0.3  # of the random motion of a blind case


@dataclass(frozen=True)
class Kind:
    """A kind of robot: what happens to it, its effect and parameter, and the value at t [d] with its begin [d]."""

    name: str
    effect: str
    parameter: str
    value: Callable[[float, float], float]
    changes: bool = True


def ramp(first: float, rate: float) -> Callable[[float, float], float]:
    """A value that grows by `rate` a day from the begin on."""
    return lambda t, begin: first + rate * max(t - begin, 0.0)


def step(first: float, second: float) -> Callable[[float, float], float]:
    """A value that changes at the begin."""
    return lambda t, begin: second if t > begin else first


KINDS = (
    Kind("wear: play grows from 3° by 0.2° a day", "sheath.play", "half_width", ramp(0.052, 0.0035)),
    Kind("the same by 0.05° a day", "sheath.play", "half_width", ramp(0.052, 0.0009)),
    Kind("loosening: play from 3° to 3.6°", "sheath.play", "half_width", step(0.052, 0.063)),
    Kind("the same to 3.1°", "sheath.play", "half_width", step(0.052, 0.054)),
    Kind("donned anew: zero moves by 0.6°", "sheath.offset", "offset", step(0.0, 0.01)),
    Kind("the same from 3° to 3.1°", "sheath.offset", "offset", step(0.052, 0.054)),
    Kind("temperature: gain drifts by 1 % a day", "sheath.gain", "gain", ramp(0.0, -0.01)),
    Kind("the same from -15 % by 0.2 % a day", "sheath.gain", "gain", ramp(-0.15, -0.002)),
    Kind("steady, play 3°", "sheath.play", "half_width", ramp(0.052, 0.0), changes=False),
    Kind("steady, gain -15 %", "sheath.gain", "gain", ramp(-0.15, 0.0), changes=False),
    Kind("steady, healthy", "sheath.offset", "offset", ramp(0.0, 0.0), changes=False),
)


@dataclass(frozen=True)
class Outcome:
    """What was said of one robot.

    Attributes:
        verdict: its word.
        stated: whether a change is stated.
        right: whether it is stated of the planted effect.
        covered: whether the stated set holds the planted date.
        width: of the set [d].
        seconds: processor time [s].
    """

    verdict: str
    stated: bool
    right: bool
    covered: bool
    width: float
    seconds: float


def sheath_case(kind: Kind, seed: int) -> tuple[Case, exo.Robot, float]:
    """Sessions of a drawn sheath, its nominal robot, and the begin of the change [d]."""
    rng, nominal, logs = np.random.default_rng(seed), exo.load_robot("tendon_sheath"), []
    begin, base = rng.uniform(EARLIEST, LATEST), healthy_robot(nominal, rng)
    for k in range(SESSIONS):
        value = kind.value(float(k), begin)
        robot = base.splice(kind.effect, {kind.parameter: value}) if value else base
        own = int(rng.integers(1 << 31))
        motion = on_machine(protocols.random_motion, nominal, duration=SECONDS, seed=own, fastest=1.0)
        date = START + timedelta(days=k)
        logs.append(CaseLog(exo.simulate(robot, motion, seed=own), "random", "fit", None, f"{k}.csv", date))
    return Case("sheath", {}, tuple(logs), nominal.machine.frame), nominal, begin


def judged(since: Since | None, verdict: str, effect: str, begin: float, seconds: float) -> Outcome:
    """An answer beside the truth."""
    clearest = since.clearest if since else None
    if clearest is None or clearest.change is None:
        return Outcome(verdict, False, False, False, float("nan"), seconds)
    _, low, high = clearest.change.began
    right = clearest.name.startswith(effect)
    return Outcome(verdict, True, right, low <= begin <= high, high - low, seconds)


def tried(case: Case, nominal: exo.Robot, effect: str, begin: float) -> Outcome:
    """The outcome of a case."""
    began = process_time()
    found = exo.diagnose(case, nominal)
    return judged(found.since, found.verdict, effect, begin, process_time() - began)


def share(hits: int, total: int) -> str:
    """A share with its exact 95 % interval."""
    low, high = binomial_interval(hits, total)
    return f"{hits}/{total} ({100 * low:.0f} to {100 * high:.0f} %)" if total else "–"


def row(name: str, found: list[Outcome]) -> str:
    """A line of the table."""
    stated = [one for one in found if one.stated]
    widths = [one.width for one in stated]
    verdicts = ", ".join(f"{v} {sum(o.verdict == v for o in found)}" for v in dict.fromkeys(o.verdict for o in found))
    cells = [
        name, share(len(stated), len(found)), share(sum(o.right for o in stated), len(stated)),
        share(sum(o.covered for o in stated), len(stated)), f"{np.median(widths):.1f} d" if widths else "–", verdicts,
        f"{np.mean([o.seconds for o in found]):.1f} s",
    ]  # fmt: skip
    return "| " + " | ".join(cells) + " |"


EXO_KINDS = (
    Kind("wear: friction grows from 0.15 by 0.03 a day", "tendon.capstan_friction", "mu_phi", ramp(0.15, 0.03)),
    Kind("loosening: slack from 1 to 3 mm", "tendon.slack", "length", step(0.001, 0.003)),
    Kind("steady, friction 0.2", "tendon.capstan_friction", "mu_phi", ramp(0.2, 0.0), changes=False),
)


def exo_case(kind: Kind, seed: int) -> tuple[Case, exo.Robot, float]:
    """Sessions of a drawn Exo-Index from the reference simulator, and the begin of the change [d]."""
    rng, logs = np.random.default_rng(seed), []
    begin, parameters = rng.uniform(EARLIEST, LATEST), draw_parameters(rng)
    for k in range(SESSIONS):
        fault = InjectedFault(kind.effect, wires=("AF",), parameters={kind.parameter: kind.value(float(k), begin)})
        motion = wander(rng, EXO_SHARE)
        columns = rounded(simulate_reference(RobotSpec(parameters, (fault,)), motion, [seed, k]))
        log = Log(columns.pop("time"), columns, {}, f"{k}.csv")
        logs.append(CaseLog(log, "random", "fit", None, f"{k}.csv", START + timedelta(days=k)))
    return Case("exo", {}, tuple(logs)), exo.load_robot(), begin


HEAD = """# Since when: how often the stated date holds

Made by `python -m studies.since{options}`. Robots drawn within their tolerances; {sessions} daily sessions, the begin
of the change drawn between {earliest:g} and {latest:g} days after the first. "Stated": a change is stated (tests at
{level:g}, all quantities together). "Right": of the planted effect. "Date held": the stated {confidence:.0%} set holds
the planted begin. Shares with exact 95 % intervals; processor time of one diagnosis.

| robots | stated | right | date held | median width | verdicts | time |
|---|---|---|---|---|---|---|
"""


@click.command()
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Markdown page.")
@click.option("--repeats", default=20, show_default=True, help="Sheaths of each kind.")
@click.option(
    "--exo", "exos", default=0, show_default=True, help="Exo-Indexes of each kind, from the reference simulator."
)
def main(out: Path, repeats: int, exos: int) -> None:
    """Diagnose simulated robots over sessions and count how often the stated date holds."""
    lines, changed, steady = [], [], []
    for make, kinds, count in ((sheath_case, KINDS, repeats), (exo_case, EXO_KINDS, exos)):
        for number, kind in enumerate(kinds if count else ()):
            cases = (make(kind, 1000 * number + k) for k in range(count))
            found = [tried(case, nominal, kind.effect, begin) for case, nominal, begin in cases]
            lines.append(row(("" if make is sheath_case else "Exo-Index, ") + kind.name, found))
            (changed if kind.changes else steady).extend(found)
            click.echo(lines[-1])
    stated = [one for one in changed if one.stated]
    held, alarms = sum(one.covered for one in stated), sum(one.stated for one in steady)
    p = binomtest(held, len(stated), CONFIDENCE, alternative="less").pvalue if stated else float("nan")
    options = f" --out {out} --repeats {repeats}" + (f" --exo {exos}" if exos else "")
    text = HEAD.format(
        options=options, sessions=SESSIONS, earliest=EARLIEST, latest=LATEST, level=ALPHA, confidence=CONFIDENCE
    )
    text += "\n".join(lines) + "\n\n"
    text += f"All changes together: the date is held in {share(held, len(stated))}; one-sided binomial test against "
    text += f"{CONFIDENCE:.0%}: p = {p:.2g}. Steady robots: a change is stated in {share(alarms, len(steady))}.\n"
    write_text(out, text)


if __name__ == "__main__":
    main()
