"""A diagnosis made by hand, with runs to match: no fit, no simulation."""

from dataclasses import replace
from math import nan

import numpy as np

from exodrake.data.case import Case, CaseLog
from exodrake.data.log import Log
from exodrake.diagnosis.problem import Problem, Trial
from exodrake.diagnosis.result import (
    AMBIGUOUS,
    NAMED,
    NO_GAP,
    PARTLY,
    REFINEMENT,
    RETUNE,
    UNKNOWN,
    Candidate,
    Closure,
    Diagnosis,
    EffectRival,
    Interval,
    Moved,
    NamedEffect,
    Provenance,
    Remainder,
    Retune,
    Rival,
    SignalGap,
    Where,
)
from exodrake.machines.robot_file import load_robot
from exodrake.report.diagnosis_html import SimulatedLog, SimulatedLogs

VERDICTS = (NO_GAP, RETUNE, NAMED, AMBIGUOUS, PARTLY, UNKNOWN)
TENDONS, JOINTS = ("AF", "MF", "AE"), ("MCP", "PIP", "DIP")
KINDS = {"tension": ("N", 0.01, 3.0), "stroke": ("m", 12e-6, 8e-3), "speed_cmd": ("m/s", 4e-4, 0.02)}
COLUMNS = (*(f"{kind}_{w}" for kind in KINDS for w in TENDONS), *(f"angle_{j}" for j in JOINTS))
SHARES = {"tendon": 0.83, "finger": 0.11, "sensor": 0.04, "motor": 0.015, "encoder": 0.005}
REGIME = {"direction of motion": 0.61, "load": 0.22, "time since reversal": 0.12, "frequency below 1 Hz": 0.7}
IDS = ("tendon.capstan_friction", "tendon.coulomb_friction", "finger.hysteresis", "finger.stiffness + sensor.gain")

LEFT = {PARTLY: Remainder(0.38, 0.32, 0.45, 3.1, "finger", {"speed": 0.4}), UNKNOWN: Remainder(0.59, 0.5, 0.7, 5.2)}


def noise_and_sizes():
    """Noise standard deviation and size of each column [SI]."""
    table = {**KINDS, "angle": ("rad", 5e-3, 0.9)}
    return (np.array([table[c.rsplit("_", 1)[0]][k] for c in COLUMNS]) for k in (1, 2))


def simulated_logs(robot=None, frames=1500, gap=0.06):
    """A fitted and a held-out log: the nominal robot errs by a share `gap`, the improved one by noise alone."""
    rng = np.random.default_rng(1)
    noise_std, size = noise_and_sizes()
    time = 0.02 * np.arange(frames)
    course = np.clip(1.2 * np.sin(2 * np.pi * time / 7.5), 0, 1)[:, None] * size * rng.uniform(0.5, 1.0, len(noise_std))
    measured = course + noise_std * rng.standard_normal(course.shape)
    measured[40:60, -1] = np.nan
    lag = gap * size * np.sign(np.gradient(course, axis=0)) * (course > 0)
    runs = {"nominal": course - lag, "retuned": course - 0.8 * lag, "improved": course}
    held = Trial("grasps.csv.gz", np.abs(course[:, :3]), measured)
    fit = replace(held, name="chirp.csv.gz")
    log = Log(time, dict(zip(COLUMNS, measured.T, strict=True)))
    again = CaseLog(log, "chirp", "fit", fit.name, "chirp_2.csv.gz")
    logs = (CaseLog(log, "chirp", "fit", None, fit.name), again, CaseLog(log, "grasps", "holdout", None, held.name))
    case = Case("synthetic", {}, logs, hashes={item.file: f"{k}" * 64 for k, item in enumerate(logs)})
    problem = Problem(robot or load_robot(), COLUMNS, noise_std, (fit,), (held,), case)
    return SimulatedLogs(problem, tuple(SimulatedLog(trial, runs, noise_std) for trial in (fit, held)))


def chosen(runs, columns, **changes):
    """The simulated logs with some columns alone."""
    places = [COLUMNS.index(c) for c in columns]

    def trial(t):
        return replace(t, measured=t.measured[:, places])

    problem = runs.problem
    problem = replace(
        problem,
        columns=tuple(columns),
        noise_std=problem.noise_std[places],
        fit=tuple(map(trial, problem.fit)),
        holdout=tuple(map(trial, problem.holdout)),
        **changes,
    )
    logs = [
        SimulatedLog(trial(log.trial), {n: rows[:, places] for n, rows in log.simulated.items()}, problem.noise_std)
        for log in runs.logs
    ]
    return SimulatedLogs(problem, tuple(logs))


def closure(healthy=False):
    """Gaps of all signals, down to 1.05 noise standard deviations."""
    noise_std, size = noise_and_sizes()
    units = {kind: item[0] for kind, item in KINDS.items()} | {"angle": "rad"}
    signals = {
        name: SignalGap(b, 0.8 * b, 1.05 * f, f, 0.98, units[name.rsplit("_", 1)[0]])
        for name, f, b in zip(COLUMNS, noise_std, 1.02 * noise_std if healthy else 0.05 * size)
    }
    whole, retune, effect = Interval(0.962, 0.934, 0.981), Interval(0.24, 0.18, 0.31), Interval(0.95, 0.91, 0.975)
    return Closure(whole, retune, Interval(nan, nan, nan) if healthy else effect, signals)


def cause(verdict=NAMED):
    """Capstan friction on two tendons; of an ambiguous verdict with a rival."""
    channels = {"AF": Interval(0.31, 0.28, 0.34), "MF": Interval(0.29, 0.25, 0.33)}
    rivals = (EffectRival(IDS[1], Interval(0.89, 0.85, 0.93)),) if verdict == AMBIGUOUS else ()
    share = Interval(0.62, 0.55, 0.68) if verdict == PARTLY else Interval(0.91, 0.87, 0.94)
    return NamedEffect(
        IDS[0], ("AF", "MF"), (), {"mu_phi": Interval(0.30, 0.27, 0.33)}, {"mu_phi": channels},
        kind="load-dependent friction", share=share, rivals=rivals,
    )  # fmt: skip


def refinement():
    """Hysteresis of the joints that takes up 3 % of the gap."""
    parameters = {"torque": Interval(2e-3, 1e-3, 3e-3, "N m")}
    share = Interval(0.03, 0.01, 0.05)
    return NamedEffect(IDS[2], (), JOINTS, parameters, {}, kind="hysteresis", role=REFINEMENT, share=share)


def candidate(name, place, best):
    """The set at a place of the ranking; best: share that the first one explains."""
    return Candidate(name, best - 0.1 * place, 1.1 + place, 1.2 + place, 900.0 - 200.0 * place)


def moved(robot, retuned):
    """What retuning moved."""
    names = ("tendon.k.AF", "finger.kappa.MCP")
    return tuple(
        Moved(n, robot[n], retuned[n], robot.machine.parameters[robot.machine.index[n]].unit, 2.0) for n in names
    )


def diagnosis(verdict=NAMED):
    """A diagnosis of each verdict."""
    robot = load_robot()
    found, healthy = verdict not in (NO_GAP, RETUNE), verdict == NO_GAP
    where = Where("tendon", ("AF", "MF"), (), SHARES, REGIME)
    retuned = (
        robot
        if healthy
        else robot.with_parameters({"finger.kappa.MCP": 0.0712, "tendon.k": 2600.0}, source="fitted to case")
    )
    improved = retuned.splice(IDS[0], {"mu_phi": 0.3}, ("AF", "MF")) if found else retuned
    best = {UNKNOWN: 0.41, PARTLY: 0.62}.get(verdict, 0.94)
    rivals = tuple(Rival((identity,), {}) for identity in IDS[:2])
    return Diagnosis(
        case="case <7> & co",
        verdict=verdict,
        where=where if found else Where("none"),
        effects=(cause(verdict), refinement()) if verdict in (NAMED, AMBIGUOUS, PARTLY) else (),
        equivalents=IDS[:2] if verdict == AMBIGUOUS else (),
        remainder=LEFT.get(verdict, Remainder(0.06, 0.03, 0.09, 0.4)),
        closure=closure(healthy),
        rivals=rivals if verdict == AMBIGUOUS else (),
        candidates=tuple(candidate(n, i, best) for i, n in enumerate(IDS)) if found else (),
        reasons=("the causes explain the gap, and nothing else does",),
        notes=("chirp.csv.gz: 2 repeated rows dropped",),
        run_time=48.2,
        robots={"nominal": robot, "retuned": retuned, "improved": improved},
        simulated={"retune": 1200.0, "linearise": 6400.0},
        provenance=Provenance(
            "2026-11-22T08:00:00+00:00", "0.1", "abc123", "exodrake diagnose case", "exo_index.yaml", "f00d", "none", {}
        ),
        retune=Retune() if healthy else Retune(moved(robot, retuned), {"finger.stiffness": 0.97}),
    )
