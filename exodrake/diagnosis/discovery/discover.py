"""Discovery: the free law, of all points of all parts, that explains best what no known effect does.

One linearisation screens all laws; the best few are fitted through the simulation and compared by their evidence.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from exodrake.core.confidence import ALPHA
from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.core.robot import Robot
from exodrake.diagnosis.closure import measure
from exodrake.diagnosis.comparison import removed
from exodrake.diagnosis.discovery.candidate import Candidate, candidates
from exodrake.diagnosis.discovery.compare import LEAD, lead, level_of_noise
from exodrake.diagnosis.discovery.effect_text import SIZE
from exodrake.diagnosis.discovery.evidence import Eliminated, without
from exodrake.diagnosis.discovery.fit import Fit, Screened, nuisance_jacobian, refined, screened, started
from exodrake.diagnosis.discovery.formula import Formula, formula
from exodrake.diagnosis.discovery.law_machine import Moved, laws_of, with_laws
from exodrake.diagnosis.discovery.missing_law import Curve, MissingLaw, Runner
from exodrake.diagnosis.discovery.watch import watched
from exodrake.diagnosis.discovery.write_effect import effect_text, robot_with
from exodrake.diagnosis.intervals import Z90
from exodrake.diagnosis.isolation import Isolation
from exodrake.diagnosis.levels import PROMISING
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.parameter import apply
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.refine import Explanation, whole_jacobian

STARTED, FITTED = 14, 4  # laws simulated as the linearisation predicts them; fitted; the best two points to the end
PER_POINT = 2  # of these at one point, at most
FIRST, STEPS, WHOLE = 1, 2, 4  # Gauss-Newton steps of all; of those fitted to the end; of the best, on whole logs


def discover(
    problem: Problem, found: Isolation, progress: StageProgress = no_progress, blocks: Collection[str] = ()
) -> MissingLaw:
    """The law that is missing in a case.

    Args:
        problem: the case, with what detectors found.
        found: its isolation.
        progress: called with the stage and the law that is worked on.
        blocks: of the robot whose points are tried; all where empty.
    """
    if found.retuned.levels.kept or found.nominal.levels.kept:
        return MissingLaw(False, "the robot without an effect leaves what noise leaves: no law is missing")
    machine, retuned = problem.robot.machine, found.retuned.explanation
    moved = Moved(machine, with_laws(machine))
    base, likelihood = moved.explanation(retuned), moved.likelihood(found.likelihood).scaled_to(retuned.residual)
    likelihood.stage = "discover"
    progress(Stage.LINEARISE, "free laws")
    laws = [law for law in laws_of(machine) if not blocks or law.block in blocks]
    whole = moved.problem(problem)
    tried = candidates(whole, laws, watched(whole, base.robot, laws))
    jacobian = whole_jacobian(likelihood, base)
    screen = screened(likelihood, base, jacobian, tried)
    model = Eliminated(likelihood, base.residual - base.x @ jacobian, jacobian, base.prior_std)
    p = level_of_noise(likelihood, model, screen)
    if p > ALPHA:
        return MissingLaw(False, f"no law takes up more than noise lets one (p = {p:.2g})", p_noise=p)
    if screen[0].weighed.log_evidence <= without(model).log_evidence:
        return MissingLaw(False, "the logs are as likely without any law as with one", p_noise=p)
    likelihood, fits = fit_best(likelihood, base, jacobian, model, screen, progress)
    before = likelihood.chi2(base.residual)
    shares = [removed(before, likelihood.chi2(fit.residual)) for fit in fits]
    if shares[0] < PROMISING:
        reason = f"the best law, {fits[0].candidate.name}, removes only {shares[0]:.0%} of what retuning leaves"
        return MissingLaw(False, reason, p_noise=p, others=runners(fits, shares))
    progress(Stage.CLOSURE, fits[0].candidate.name)
    return answer(problem, found, moved, likelihood, base, fits, shares, p)


def fit_best(
    likelihood: Likelihood, base: Explanation, jacobian: np.ndarray, model: Eliminated, screen: Sequence[Screened],
    progress: StageProgress,
) -> tuple[Likelihood, list[Fit]]:  # fmt: skip
    """The most promising laws fitted, best first, and the likelihood in units of what the best one leaves."""
    chosen: list[Screened] = []
    for s in screen:
        here = [c for c in chosen if c.candidate.law is s.candidate.law]
        if s.active and len(here) < PER_POINT and len(chosen) < STARTED:
            chosen.append(s)
    starts = [started(likelihood, base, model, s) for s in chosen]
    starts.sort(key=lambda f: likelihood.mean_log(f.residual))
    fits = []
    for start in starts[:FITTED]:
        progress(Stage.FIT, start.candidate.name)
        fits.append(refined(likelihood, base, start, jacobian, FIRST))
    fits.sort(key=lambda f: likelihood.mean_log(f.residual))
    likelihood = likelihood.scaled_to(fits[0].residual)
    fits = [refined(likelihood, base, f, nuisance_jacobian(likelihood, base, f), STEPS) for f in of_two_points(fits)]
    return likelihood, sorted(fits, key=lambda f: -evidence(f))


def of_two_points(fits: Sequence[Fit]) -> list[Fit]:
    """The first two fits at the point of the first one, and the first one at another point."""
    here = [f for f in fits if f.candidate.law is fits[0].candidate.law]
    return [*here[:PER_POINT], *[f for f in fits if f not in here][:1]]


def refitted(likelihood: Likelihood, base: Explanation, fit: Fit) -> Fit:
    """A law fitted to all of the logs."""
    robot = fit.robot(base, likelihood)
    fit = replace(fit, residual=likelihood.residual(robot[None])[0])
    likelihood = likelihood.scaled_to(fit.residual)
    return refined(likelihood, base, fit, nuisance_jacobian(likelihood, base, fit), WHOLE)


def evidence(fit: Fit) -> float:
    """Log evidence of a fitted law."""
    assert fit.weighed is not None
    return fit.weighed.log_evidence


def runners(fits: Sequence[Fit], shares: Sequence[float]) -> tuple[Runner, ...]:
    """Fitted laws with their shares."""
    return tuple(Runner(f.candidate.law.learned, f.candidate.form.words, s) for f, s in zip(fits, shares, strict=True))


def answer(
    problem: Problem, found: Isolation, moved: Moved, likelihood: Likelihood, base: Explanation, fits: list[Fit],
    shares: list[float], p: float,
) -> MissingLaw:  # fmt: skip
    """The answer about the best law."""
    best, others = fits[0], runners(fits, shares)
    identity = best.candidate.law.identity
    rival = next((k for k, f in enumerate(fits) if f.candidate.law.identity != identity), None)
    ahead = 1.0 if rival is None else lead(shares[0], shares[rival])
    best = refitted(moved.whole(likelihood, problem), base, best)
    short = formula(best)
    whole, nominal = moved.problem(problem), moved.values(problem.silent())
    rows = np.array([nominal, base.robot, best.robot(base, likelihood)])
    closure = measure(whole, [rows] * len(problem.judged)).effect
    channels = tuple(name for name in (best.candidate.channels[i] for i in best.active) if name)
    curves = curves_of(best, short)
    formulas = {name: curve.formula for name, curve in curves.items() if curve.formula}
    weights = best.candidate.weights(best.modes)
    text = effect_text(best.candidate, weights, problem.case.name, formulas)
    return MissingLaw(
        found=True,
        reason=reason_of(best.candidate, shares[0]),
        id=best.candidate.law.learned,
        words=best.candidate.form.words,
        unit=best.candidate.form.unit,
        channels=channels,
        share=shares[0],
        p_noise=p,
        runner_up=None if rival is None else others[rival],
        lead=ahead,
        distinguished=ahead > LEAD,
        others=others,
        curves=curves,
        closure=closure,
        held_out=bool(problem.holdout),
        robot=improved(problem, found, best, weights, text),
        text=text,
    )


def reason_of(candidate: Candidate, share: float) -> str:
    """What was found, in one sentence."""
    return f"a free law of {candidate.form.words} at {candidate.law.key} removes {share:.0%} of what retuning leaves"


def improved(problem: Problem, found: Isolation, fit: Fit, weights: np.ndarray, text: str) -> Robot:
    """The robot with the law as an effect, noise and resolutions as they were."""
    retuned = found.retuned.explanation
    values = apply(retuned.values, retuned.parameters, fit.x)
    silent = replace(problem, detected=()).silent()
    values = np.where(values != silent, values, problem.robot.values)
    return robot_with(replace(problem.robot, values=values), fit.candidate, weights, text)


def curves_of(fit: Fit, short: Formula | None) -> dict[str, Curve]:
    """The law in each channel, with its 90 % band and the histogram of its variable."""
    assert fit.weighed is not None
    candidate, found = fit.candidate, {}
    at, shape = candidate.shape()
    weights = candidate.weights(fit.modes)
    for i, channel in enumerate(fit.active):
        own = slice(i * SIZE, (i + 1) * SIZE)
        to_values = shape[channel] @ (candidate.size[channel] * candidate.basis)
        std = np.sqrt(np.einsum("ij,jk,ik->i", to_values, fit.weighed.covariance[own, own], to_values))
        value, name = shape[channel] @ weights[channel], candidate.channels[channel]
        edges = np.linspace(
            candidate.seen.low[channel], candidate.seen.high[channel], candidate.seen.counts.shape[1] + 1
        )
        counts = candidate.seen.counts[channel] / max(float(candidate.seen.counts[channel].sum()), 1.0)
        text = short.text(name) if short else ""
        found[name] = Curve(at[channel], value, value - Z90 * std, value + Z90 * std, edges, counts, text)
    return found
