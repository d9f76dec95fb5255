"""Since when, tried: simulated robots that wear, loosen, are donned anew, drift or stay, session by session.

    python -m studies.since --keep kept --out docs/since.md           # 20 robots of each kind, some minutes
    python -m studies.since --keep kept --out docs/since.md --exo 3   # and 3 of the Exo-Index, half a minute each

Each robot is drawn within its tolerances and diagnosed as any case. Sheaths come from exodrake's own engine, robots of
the Exo-Index from the reference simulator of the blind check, which shares no equation with it. Each answer is kept, so
the command can be repeated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from time import process_time
from typing import Any

import click
import numpy as np
from scipy.stats import binomtest

import exodrake as exo
from exodrake.core.confidence import ALPHA, CONFIDENCE
from exodrake.core.files import write_text
from exodrake.core.plain import plain
from exodrake.data.case import Case, CaseLog
from exodrake.model.robot import drawn_robot
from exodrake.reference.cases import wander
from exodrake.reference.make import record_log
from exodrake.reference.robot import InjectedFault, RobotSpec, draw_parameters
from exodrake.simulation import protocols
from exodrake.simulation.protocols import on_machine
from studies.page_text import keep as keep_answer, made, share

START = datetime(2026, 1, 1, tzinfo=UTC)
SESSIONS, SECONDS = 10, 10.0
EARLIEST, LATEST = 1.5, 6.0  # d, of the begin
EXO_SHARE = 0.3  # of the random motion of a blind case


@dataclass(frozen=True)
class Kind:
    """A kind of robot, and the parameter that changes."""

    name: str
    effect: str
    parameter: str
    value: Callable[[float, float], float]  # at t [d], with its begin [d]
    changes: bool = True  # whether it does at all
    same_law: bool = True  # whether the parameter means the same in the simulator and in the library
    alike: tuple[str, ...] = ()  # other effects that do the same to the logs


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
EXO_KINDS = (
    Kind("wear: friction grows from 0.15 by 0.03 a day", "tendon.capstan_friction", "mu_phi", ramp(0.15, 0.03),
         same_law=False),
    Kind("loosening: slack from 1 to 3 mm", "tendon.slack", "length", step(0.001, 0.003),
         alike=("encoder.homing_offset",)),
    Kind("steady, friction 0.2", "tendon.capstan_friction", "mu_phi", ramp(0.2, 0.0), changes=False, same_law=False),
)  # fmt: skip


def sheath_case(kind: Kind, seed: int) -> tuple[Case, exo.Robot, float]:
    """Sessions of a drawn sheath, its nominal robot, and the begin of the change [d]."""
    rng, nominal, logs = np.random.default_rng(seed), exo.load_robot("tendon_sheath"), []
    begin, base = rng.uniform(EARLIEST, LATEST), drawn_robot(nominal, rng)
    for k in range(SESSIONS):
        value = kind.value(float(k), begin)
        robot = base.splice(kind.effect, {kind.parameter: value}) if value else base
        own = int(rng.integers(1 << 31))
        motion = on_machine(protocols.random_motion, nominal, duration=SECONDS, seed=own, fastest=1.0)
        date = START + timedelta(days=k)
        logs.append(CaseLog(exo.simulate(robot, motion, seed=own), "random", "fit", None, f"{k}.csv", date))
    return Case("sheath", {}, tuple(logs), nominal.machine.frame), nominal, begin


def exo_case(kind: Kind, seed: int) -> tuple[Case, exo.Robot, float]:
    """Sessions of a drawn Exo-Index from the reference simulator, and the begin of the change [d]."""
    rng, logs = np.random.default_rng(seed), []
    begin, parameters = rng.uniform(EARLIEST, LATEST), draw_parameters(rng)
    for k in range(SESSIONS):
        fault = InjectedFault(kind.effect, ("AF",), parameters={kind.parameter: kind.value(float(k), begin)})
        motion = wander(rng, EXO_SHARE)
        log = record_log(RobotSpec(parameters, (fault,)), motion, [seed, k], f"{k}.csv")
        logs.append(CaseLog(log, "random", "fit", None, f"{k}.csv", START + timedelta(days=k)))
    return Case("exo", {}, tuple(logs)), exo.load_robot(), begin


@dataclass(frozen=True)
class Outcome:
    """Diagnosis of one robot beside the truth."""

    name: str
    verdict: str
    series: str  # quantity whose change is clearest; empty where none is stated
    right: bool  # whether it is of the injected effect
    begin: float  # true date [d]
    began: tuple[float, float]  # ends of the stated set [d]; NaN where no change is stated
    truth: float  # value at the last session; NaN where the parameter means something else in the library
    after: tuple[float, float]  # ends of its stated interval; NaN where no change is stated
    seconds: float  # processor time [s]

    @property
    def covered(self) -> bool:
        """Whether the stated set holds the true date."""
        return self.began[0] <= self.begin <= self.began[1]

    @property
    def sized(self) -> bool:
        """Whether the stated interval holds the true value at the last session."""
        return self.after[0] <= self.truth <= self.after[1]

    @property
    def width(self) -> float:
        """Of the set [d]."""
        return self.began[1] - self.began[0]


def judged(name: str, said: dict[str, Any], kind: Kind, begin: float) -> Outcome:
    """An answer beside the truth."""
    clearest = next((s for s in said["since"]["series"] if s["change"]), None)
    change = clearest["change"] if clearest else {"began": [np.nan] * 3, "after": [np.nan] * 3}
    began, after = ((change[what][1], change[what][2]) for what in ("began", "after"))
    series = clearest["name"] if clearest else ""
    truth = kind.value(SESSIONS - 1.0, begin) if kind.same_law and series.startswith(kind.effect) else np.nan
    right = series.startswith((kind.effect, *kind.alike))
    return Outcome(name, said["verdict"], series, right, begin, began, truth, after, said["seconds"])


def row(name: str, found: list[Outcome]) -> str:
    """A line of the table."""
    stated = [one for one in found if one.series]
    verdicts = ", ".join(f"{v} {sum(o.verdict == v for o in found)}" for v in dict.fromkeys(o.verdict for o in found))
    right = [one for one in stated if one.right and np.isfinite(one.truth)]
    cells = [name, share(len(stated), len(found))]
    cells += [share(sum(getattr(o, what) for o in stated), len(stated)) for what in ("right", "covered")]
    cells += [share(sum(o.sized for o in right), len(right))]
    cells += [f"{np.median([o.width for o in stated]):.1f} d" if stated else "–", verdicts]
    return "| " + " | ".join([*cells, f"{np.mean([o.seconds for o in found]):.1f} s"]) + " |"


HEAD = """# Since when: how often the stated date holds

Made by `python -m studies.since{options}` ({made}).

Robots drawn within their tolerances; {sessions} daily sessions, the begin of the change drawn between {earliest:g} and
{latest:g} days after the first. "Stated": a change is stated (tests at {level:g}, all quantities together). "Right": of
the injected effect, or for slack of the encoder's zero, which shifts the stroke alike. "Date held": the stated
{confidence:.0%} set holds the true begin. "Value held": the stated {confidence:.0%} interval of the value at the
last session holds the true one, where the effect is right and its parameter means the same in both simulators: the
reference simulator's sheath friction yields over a travel and is weaker at high load. Shares with exact 95 % intervals;
processor time of one diagnosis.

| robots | stated | right | date held | value held | median width | verdicts | time |
|---|---|---|---|---|---|---|---|
"""


def tried(make: Callable[[Kind, int], tuple[Case, exo.Robot, float]], kind: Kind, seed: int, keep: Path) -> Outcome:
    """Diagnosis of a drawn robot, kept in a file, beside the truth."""
    case, nominal, begin = make(kind, seed)
    place = keep / f"{case.name}-{seed}.json"

    def answer() -> dict[str, Any]:
        started = process_time()
        found = exo.diagnose(case, nominal)
        since = found.since.to_json() if found.since else {"series": []}
        return plain({"verdict": found.verdict, "since": since, "seconds": process_time() - started})

    return judged(place.stem, keep_answer(place, answer), kind, begin)


def misses(found: list[Outcome]) -> list[str]:
    """Lines about the robots whose change is stated wrongly."""
    return [
        f"- {o.name}: {o.series} began at {o.began[0]:.2f} to {o.began[1]:.2f} d (true {o.begin:.2f}), "
        f"at last {o.after[0]:.4g} to {o.after[1]:.4g} (true {o.truth:.4g}), {o.verdict}"
        for o in found
        if o.series and not (o.right and o.covered and (o.sized or np.isnan(o.truth)))
    ]


@click.command()
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Markdown page.")
@click.option("--keep", type=click.Path(path_type=Path), required=True, help="Folder of what is said, by robot.")
@click.option("--repeats", default=20, show_default=True, help="Sheaths of each kind.")
@click.option(
    "--exo", "exos", default=0, show_default=True, help="Exo-Indexes of each kind, from the reference simulator."
)
def main(out: Path, keep: Path, repeats: int, exos: int) -> None:
    """Diagnose simulated robots over sessions and count how often the stated date holds."""
    keep.mkdir(parents=True, exist_ok=True)
    lines, changed, steady = [], [], []
    for make, kinds, count in ((sheath_case, KINDS, repeats), (exo_case, EXO_KINDS, exos)):
        for number, kind in enumerate(kinds if count else ()):
            found = [tried(make, kind, 1000 * number + k, keep) for k in range(count)]
            lines.append(row(("" if make is sheath_case else "Exo-Index, ") + kind.name, found))
            (changed if kind.changes else steady).extend(found)
            click.echo("\n".join([lines[-1], *misses(found)]))
    stated = [one for one in changed if one.series]
    held, alarms = sum(one.covered for one in stated), sum(bool(one.series) for one in steady)
    p = binomtest(held, len(stated), CONFIDENCE, alternative="less").pvalue if stated else float("nan")
    options = f" --keep kept --out {out} --repeats {repeats}" + (f" --exo {exos}" if exos else "")
    text = HEAD.format(
        options=options, made=made(), sessions=SESSIONS, earliest=EARLIEST, latest=LATEST, level=ALPHA,
        confidence=CONFIDENCE,
    )  # fmt: skip
    text += "\n".join(lines) + "\n\n"
    text += f"All changes together: the date is held in {share(held, len(stated))}; one-sided binomial test against "
    text += f"{CONFIDENCE:.0%}: p = {p:.2g}. Steady robots: a change is stated in {share(alarms, len(steady))}.\n"
    write_text(out, text)


if __name__ == "__main__":
    main()
