"""How good the kinematic identification and the session's zeros are, on simulated cases: `docs/identification.md`.

    python -m studies.identification --out docs/identification.md

Kinematics: recordings of a synthetic hand, each with a seed of its own; errors, and how many of the 21 values (three
lengths, gradient and intercept of three centres) lie within their 95 % intervals. Zeros: sessions of a simulated robot
after training on its 48 sweeps, each session a few sweeps with other noise; one wire's zero is shifted or none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np

from exodrake.cli.main import OneLineErrors
from exodrake.core.confidence import NORMAL_95
from exodrake.core.files import write_text
from exodrake.estimator.dataset import Sweeps, sweeps_from_logs
from exodrake.estimator.gp import fit
from exodrake.identification.kinematics.identify import identify
from exodrake.identification.kinematics.markers import Faults, Hand, synthesise
from exodrake.machines.robot_file import load_robot
from exodrake.simulation.protocols import sweeps
from exodrake.simulation.simulate import simulate

NOISE, SECONDS, RATE, GAPS = 3e-4, 20.0, 50.0, 6.0  # m RMS per axis, s, Hz, per marker and minute
FIRST = 1000  # seed of the first recording
SWEEPS_OF_A_SESSION = 2
SHIFTS = (0.5e-3, 1e-3)  # m


@dataclass(frozen=True, eq=False)
class Recordings:
    """Errors and half widths of identified recordings."""

    errors: np.ndarray  # (recordings, 21) of lengths [m], then gradient [m/rad] and intercept [m] of MCP, PIP, DIP
    halves: np.ndarray
    angles: np.ndarray  # (recordings, 4) RMSE of abduction, MCP, PIP, DIP [rad]

    @property
    def inside(self) -> np.ndarray:
        """Share (21,) of the recordings in which a value lies within its 95 % interval."""
        return np.mean(np.abs(self.errors) <= self.halves, axis=0)


def identified(seed: int, seconds: float = SECONDS, rate: float = RATE) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors (21,), half widths (21,) and RMSE of the angles (4,) of one synthetic recording."""
    recording, truth = synthesise(Hand(), Faults(noise=NOISE, dropouts=GAPS), seconds, rate, seed)
    found = identify(recording)
    errors, halves = [np.subtract(found.lengths, truth.lengths)], [np.array(found.intervals)]
    for joint, axis in zip(found.joints, truth.axes[1:]):
        errors += [joint.axis.slope - axis.slope, joint.axis.point - axis.point]
        halves += [*joint.half_widths]
    abduction = np.asarray(found.joints[0].abduction)
    angles = np.stack([abduction, *(joint.angle for joint in found.joints)], axis=1)
    return np.concatenate(errors), np.concatenate(halves), np.sqrt(np.nanmean((angles - truth.angles) ** 2, axis=0))


def recordings(count: int, seconds: float = SECONDS, rate: float = RATE) -> Recordings:
    """Identify `count` recordings with successive seeds."""
    parts = zip(*(identified(FIRST + number, seconds, rate) for number in range(count)))
    return Recordings(*(np.array(part) for part in parts))


@dataclass(frozen=True)
class Sessions:
    """Sessions with one shifted zero: shift [m], wire, share flagged, RMSE [rad] before and after, coverage."""

    shift: float
    wire: str
    flagged: float
    before: float
    after: float
    coverage: float


def sessions(count: int, seed: int = 0) -> list[Sessions]:
    """Estimate angles in `count` sessions of a simulated robot: no shift, then each shift of each wire."""
    robot = load_robot()
    estimator = fit(sweeps_from_logs([simulate(robot, sweeps(robot), seed=seed)]), points=250)
    rng, fresh = np.random.default_rng(seed), []
    for number in range(-(-count * SWEEPS_OF_A_SESSION // 48)):
        rows = sweeps_from_logs([simulate(robot, sweeps(robot), seed=seed + 1 + number)])
        labels = rng.permutation(np.unique(rows.sweep)).reshape(-1, SWEEPS_OF_A_SESSION)
        fresh += [rows.rows(np.isin(rows.sweep, some)) for some in labels]
    cases = [(0.0, "")] + [(shift, wire) for shift in SHIFTS for wire in estimator.wires]
    return [_judged(estimator, fresh[:count], shift, wire) for shift, wire in cases]


def _judged(estimator, fresh: list[Sweeps], shift: float, wire: str) -> Sessions:
    flags, errors = [], []
    zero = np.r_[np.zeros(len(estimator.wires)), [shift * (name == wire) for name in estimator.wires]]
    for session in fresh:
        session = replace(session, inputs=session.inputs + zero)
        zeros = estimator.zeros(session)
        used = estimator.correct_zeros(zeros, session) if zeros.moved else estimator
        flags.append(zeros.moved)
        before = estimator.predict(session.tension, session.stroke)[0] - session.angle
        mean, std, _ = used.predict(session.tension, session.stroke)
        after = mean - session.angle
        errors.append([np.mean(before**2), np.mean(after**2), np.mean(np.abs(after) < NORMAL_95 * std)])
    before, after, coverage = np.mean(errors, axis=0)
    return Sessions(shift, wire, float(np.mean(flags)), float(before**0.5), float(after**0.5), float(coverage))


def page(found: Recordings, judged: list[Sessions], per_case: int) -> str:
    """The page as Markdown."""
    inside, count = found.inside, len(found.errors)
    names = ("abduction", "MCP", "PIP", "DIP")
    lengths = [
        f"| {name} | {1e3 * np.sqrt(np.mean(error**2)):.2f} | {1e3 * np.abs(error).max():.2f} |"
        f" {1e3 * half.mean():.2f} | {100 * share:.0f} % |"
        for name, error, half, share in zip(("proximal", "middle", "distal"), found.errors.T, found.halves.T, inside)
    ]
    shares = [(name, 100 * inside[3 + 6 * k :][:3].mean(), 100 * inside[6 + 6 * k :][:3].mean())
              for k, name in enumerate(names[1:])]  # fmt: skip
    lines = [f"{name} gradient {gradient:.0f} %, intercept {intercept:.0f} %" for name, gradient, intercept in shares]
    angles = ", ".join(f"{name} {np.rad2deg(value):.2f}" for name, value in zip(names, found.angles.mean(axis=0)))
    zeros = [
        f"| {f'{one.wire} {1e3 * one.shift:.1f} mm' if one.wire else 'none'} | {100 * one.flagged:.0f} % |"
        f" {one.before:.3f} | {one.after:.3f} | {100 * one.coverage:.0f} % |"
        for one in judged
    ]
    return TEXT.format(
        count=count, seconds=SECONDS, rate=RATE, noise=1e3 * NOISE, gaps=GAPS, lengths="\n".join(lengths),
        all=100 * inside.mean(), lines="; ".join(lines), angles=angles, sessions=per_case,
        sweeps=SWEEPS_OF_A_SESSION, zeros="\n".join(zeros),
    )  # fmt: skip


TEXT = """# Identification and estimator, measured

Simulated cases with known truth, each with a seed of its own. This page is written by

    python -m studies.identification --out docs/identification.md --recordings {count} --sessions {sessions}

## Finger kinematics from markers

`exodrake identify kinematics` adjusts finger, hand poses and joint angles to all markers together (bundle adjustment):
one least-squares problem over 12 marker positions, four axes with moving centres, and ten unknowns a frame, which the
Schur complement eliminates. Its inverse normal matrix gives the intervals; errors that last for several frames widen
them. {count} recordings of a synthetic hand, {seconds:.0f} s at {rate:.0f} Hz, {noise:.1f} mm noise per axis,
{gaps:.0f} gaps per marker and minute:

| phalanx | RMS error [mm] | largest | mean half width | within 95 % interval |
|---|---|---|---|---|
{lengths}

All 21 values: {all:.1f} % within their 95 % intervals; {lines}.
Mean RMSE of the angles [deg]: {angles}.

The intervals count what markers can show. Skin that slides with the angle deforms the triads, which widens the
intervals, but it also moves joint centres, which no marker shows.

## The paper's equations

Corrected as on [the page about the paper](paper.md), they are functions of `exodrake.identification` and
`studies.paper`. The package itself uses other methods:

| paper | function | used instead |
|---|---|---|
| Eq. 7-13, joint centre | – | bundle adjustment (a) |
| Eq. 14-18, MCP angles by Newton | `studies.paper.printed_equations.joint_angles` | bundle adjustment (a) |
| Eq. 21, tension to angle | `studies.paper.stiffness.compliance` | nonlinear statics (b) |
| Eq. 22, angle to tension | `studies.paper.stiffness.tension_map` | `exodrake grasp` (b) |
| 2.3, maximum tension | `statics.find_maximum_tension` | - |
| Fig. 5 and 8a, sync pulse | `kinematics.markers.clock_from_pulses` | samples of slot 0 (c) |

(a) The centre of a single frame has an error that grows as 1/angle, and Newton's iteration takes axes as known and
poses as exact. The adjustment weighs all frames and markers by their noise, bridges gaps, and gives intervals.
(b) Arms and stiffness depend on the angle, tensions are bounded, and a posture must be stable and reached from rest.
(c) The model's motion capture samples in slot 0, so no log has a column for the pulse. `systems.sources.SyncPulse`
adds it to a Diagram as a signal; a late or drifting camera is an effect (`timing.mocap_delay`,
`timing.mocap_clock_skew`).

## Zeros of a new session

Re-donning shifts the zeros of the strokes. From tensions and strokes alone, `exodrake estimate` finds the shift of a
log, tests it, and corrects it. {sessions} sessions a case of {sweeps} sweeps each, after training on 48 sweeps of the
same simulated robot:

| zero shifted | flagged | RMSE as trained [rad] | corrected | within 95 % interval |
|---|---|---|---|---|
{zeros}

A changed rest posture or hand orientation looks like a shift. A session whose strokes differ by more than a constant
(contact, friction, another wearer) is reported and left alone.
"""


@click.command(cls=OneLineErrors)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Page to write (Markdown).")
@click.option("--recordings", "count", default=200, show_default=True, help="Marker recordings.")
@click.option("--sessions", "many", default=96, show_default=True, help="Sessions of the estimator per case.")
def command(out: Path, count: int, many: int) -> None:
    """Measure the kinematic identification and the zeros of sessions on simulated cases."""
    write_text(out, page(recordings(count), sessions(many), many))
    click.echo(f"wrote {out}")


if __name__ == "__main__":
    command()
