"""Retuning of healthy robots that the reference simulator wrote, and effects that stand for what it moves."""

from dataclasses import replace

import numpy as np
from diagnosis_cases import case_of, robot_with

from exodrake.data.case import gather_logs
from exodrake.diagnosis.isolation import isolate
from exodrake.diagnosis.problem import make_problem
from exodrake.diagnosis.recorded import with_recorded_ranges
from exodrake.diagnosis.verdict import decide
from exodrake.machines.robot_file import load_robot
from exodrake.reference.cases import MIXES, CasePlan
from exodrake.reference.make import case_and_label
from exodrake.simulation.simulate import simulate


def test_a_robot_whose_finger_snaps_over_is_retuned_to_its_noise():
    """Fitted in closed loop alone it ended in another minimum, with reduced chi-squares of 16.3 and 3.6."""
    case, _ = case_and_label(CasePlan("case", (400123, 84), "healthy", (), False, MIXES["healthy"]))
    closed, prediction = isolate(make_problem(case, load_robot()).shorten(0.4)).retuned.chi2
    assert prediction < 1.1 and closed < 2.0


def test_routers_that_sit_lower_are_named_where_tolerances_could_stand_for_them():
    """Three standard deviations of three tolerances leave nothing, either."""
    robot = load_robot().splice("finger.router_height", {"height": -4e-4})
    logs = [simulate(robot, "short-sweeps:period=2", seed) for seed in (1, 2)]
    found = isolate(make_problem(gather_logs(logs), load_robot()))
    assert found.excess(found.retuned.explanation.robot) < 0.0
    (cause,) = decide(found).causes
    assert cause.effect == "finger.router_height" and cause.share.value > 0.9  # of the nominal robot's gap


def test_recordings_widen_only_ranges_that_the_library_does_not_state():
    for name, widened in (("exo_index", set()), ("emps", {"carriage.coulomb_friction"})):
        robot = load_robot(name)
        log = simulate(robot, "random-motion" if name == "exo_index" else "multisine", 0)
        far = replace(log, signals={column: 100.0 * values for column, values in log.signals.items()})
        wide = with_recorded_ranges(robot, gather_logs([far])).machine.effects
        changed = {a.id for a, b in zip(robot.machine.effects, wide, strict=True) if a.parameters != b.parameters}
        assert changed >= widened and bool(changed) == bool(widened)


def test_gaps_that_differ_from_run_to_run_are_no_gaps_of_tolerances():
    """Most of the nominal robot's gap in each column is a disturbance that counts as noise, as repeats show it."""
    found = isolate(make_problem(case_of(robot_with(seed=3), 3, 400), load_robot()))
    assert decide(found).verdict == "RETUNE"
    whole, rng = found.whole, np.random.default_rng(0)
    residual = whole.residual(found.nominal.robot[None], whole.fit).reshape(-1, len(whole.columns))
    noise = 1.2 * np.sqrt(np.maximum(np.mean(residual**2, axis=0), 1.0)) * whole.noise_std
    runs = [whole.predict(found.retuned.explanation.robot[None], trial)[0] for trial in whole.fit]
    fit = [replace(t, measured=y + noise * rng.standard_normal(y.shape)) for t, y in zip(whole.fit, runs, strict=True)]
    random = replace(found, whole=replace(whole, noise_std=noise, fit=tuple(fit)))
    decision = decide(random)
    assert decision.verdict == "UNKNOWN" and "run to run" in decision.reasons[0]
