"""Discovery of the free law, among all points of all parts, that best explains the gap left by known effects.

One linearisation screens all laws. The best few are fitted through the simulation and compared by their evidence.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from exodrake.core.confidence import ALPHA, NORMAL_90
from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.core.robot import Robot
from exodrake.diagnosis.closure import measure
from exodrake.diagnosis.comparison import taken_up
from exodrake.diagnosis.discovery.candidate import CandidateLaw, candidates
from exodrake.diagnosis.discovery.compare import LEAD, lead, level_of_noise
from exodrake.diagnosis.discovery.effect_text import SIZE
from exodrake.diagnosis.discovery.evidence import Eliminated, without
from exodrake.diagnosis.discovery.fit import Fit, Screened, nuisance_jacobian, refined, screened
from exodrake.diagnosis.discovery.formula import Formula, formula
from exodrake.diagnosis.discovery.law_machine import MachineMap, laws_of, with_laws
from exodrake.diagnosis.discovery.missing_law import Curve, MissingLaw, Runner
from exodrake.diagnosis.discovery.search import fit_best, ranked, rejects
from exodrake.diagnosis.discovery.watch import counted, watched
from exodrake.diagnosis.discovery.write_effect import effect_text, robot_with
from exodrake.diagnosis.isolation import Isolation, Tested
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.linearise import nominal_jacobian
from exodrake.diagnosis.one_more import PROMISING
from exodrake.diagnosis.parameter import apply
from exodrake.diagnosis.problem import Problem
from exodrake.diagnosis.refine import Explanation

COMPLETE = "without an effect the logs differ from the robot by no more than noise: no law is missing"
ROUNDS, WHOLE = 8, 4  # most Jacobians of the best law's other parameters, on whole logs; Gauss-Newton steps with each


def discover(
    problem: Problem, found: Isolation, progress: StageProgress = no_progress, blocks: Collection[str] = (),
    where: str = "",
) -> MissingLaw:  # fmt: skip
    """The law that is missing in a case: the best one in the block where free inputs act, or one that rejects it.

    Args:
        problem: the case, with what detectors found.
        found: its isolation.
        progress: called with the stage and the law that is worked on.
        blocks: of the robot whose points are tried; all where empty.
        where: block that free inputs beside the retuned robot name (`localise`), if any; without a say where that
            robot imitates a law, so that nothing is left for an input.
    """
    if found.retuned.levels.kept or found.nominal.levels.kept:
        return MissingLaw(False, COMPLETE)
    where = "" if imitates(found.retuned) else where
    moved = MachineMap(problem.robot.machine, with_laws(problem.robot.machine))
    progress(Stage.LINEARISE, "free laws")
    likelihood, base, model, screen = linearised(problem, found, moved, blocks)
    p = level_of_noise(likelihood, model, screen)
    if p > ALPHA:
        return MissingLaw(False, f"no law takes up more than noise lets one (p = {p:.2g})", p_noise=p)
    if screen[0].weighed.log_evidence <= without(model).log_evidence:
        return MissingLaw(False, "the logs are as likely without any law as with one", p_noise=p)
    likelihood, fits = fit_best(likelihood, base, model, screen, where, progress)
    retuned = moved.explanation(found.retuned.explanation)
    shares = [taken_up(likelihood, retuned, replace(retuned, x=fit.x, residual=fit.residual)).share for fit in fits]
    order = ranked(fits, shares, where)
    fits, shares = [fits[k] for k in order], [shares[k] for k in order]
    best = fits[0].candidate
    if shares[0] < PROMISING:
        there = f" in {where}, where free inputs act" if where else ""
        reason = f"the best law{there}, {best.name}, removes only {shares[0]:.0%} of what retuning leaves"
        return MissingLaw(False, reason, p_noise=p, others=runners(fits, shares))
    if where and best.law.block != where and not rejects(fits, shares, where):
        reason = f"free inputs act in {where}, where no free law does; elsewhere {best.name} removes {shares[0]:.0%}"
        return MissingLaw(False, reason, p_noise=p, others=runners(fits, shares))
    progress(Stage.CLOSURE, best.name)
    return answer(problem, found, moved, likelihood, base, fits, shares, p, where)


def linearised(
    problem: Problem, found: Isolation, moved: MachineMap, blocks: Collection[str]
) -> tuple[Likelihood, Explanation, Eliminated, list[Screened]]:
    """Views of the case, the robot beside which laws are sought, its linearisation, and the screened laws."""
    likelihood = moved.likelihood(found.likelihood).for_stage("discover")
    base = start_of(found, moved, likelihood)
    likelihood = likelihood.scaled_to(base.residual)
    laws = [law for law in laws_of(problem.robot.machine) if not blocks or law.block in blocks]
    whole = moved.problem(problem)
    tried = candidates(whole, laws, watched(whole, base.robot, laws))
    model = Eliminated(likelihood, base.residual - base.x @ base.jacobian, base.jacobian, base.prior_std)
    return likelihood, base, model, screened(likelihood, base, model, tried)


def imitates(retuned: Tested) -> bool:
    """Whether a robot's nominal parameters imitate a law: it leaves no more than it may, but leaves its tolerances."""
    return retuned.levels.fit > ALPHA and retuned.levels.moved > retuned.levels.most_moved


def start_of(found: Isolation, moved: MachineMap, likelihood: Likelihood) -> Explanation:
    """The robot beside which laws are sought, on a machine with laws: the retuned one, or one that imitates no law."""
    if not imitates(found.retuned):
        return moved.explanation(found.retuned.explanation)
    start = moved.explanation(found.nominal.explanation)
    jacobian = nominal_jacobian(likelihood, start.values, start.parameters, start.x, start.residual)
    return start.with_jacobian(jacobian)


def refitted(likelihood: Likelihood, base: Explanation, fit: Fit) -> Fit:
    """A law fitted to all of the logs until no step with a new Jacobian of the other parameters leads further."""
    fit = replace(fit, residual=likelihood.residual(fit.robot(base, likelihood)[None])[0], directions=None)
    for _ in range(ROUNDS):
        before, likelihood = fit.residual, likelihood.scaled_to(fit.residual)
        fit = refined(likelihood, base, fit, nuisance_jacobian(likelihood, base, fit), WHOLE)
        if fit.residual is before:
            break
    return fit


def runners(fits: Sequence[Fit], shares: Sequence[float]) -> tuple[Runner, ...]:
    """Fitted laws with their shares."""
    return tuple(Runner(f.candidate.law.learned, f.candidate.form.words, s) for f, s in zip(fits, shares, strict=True))


def answer(
    problem: Problem, found: Isolation, moved: MachineMap, likelihood: Likelihood, base: Explanation, fits: list[Fit],
    shares: list[float], p: float, where: str,
) -> MissingLaw:  # fmt: skip
    """The answer about the best law."""
    best, others = fits[0], runners(fits, shares)
    rival = next((k for k, f in enumerate(fits) if f.block != best.block), None)
    ahead = 1.0 if rival is None else lead(shares[0], shares[rival])
    best = refitted(moved.whole(likelihood, problem), base, best)
    short = formula(best)
    whole, nominal = moved.problem(problem), moved.values(problem.silent())
    rows = np.array([nominal, moved.values(found.retuned.explanation.robot), best.robot(base, likelihood)])
    closure = measure(whole, [rows] * len(problem.judged)).effect
    channels = tuple(name for name in (best.candidate.channels[i] for i in best.active) if name)
    counts = counted(whole, base.robot, best.candidate.law, best.candidate.number, best.candidate.seen)
    curves = curves_of(best, short, counts)
    formulas = {name: curve.formula for name, curve in curves.items() if curve.formula}
    weights = best.candidate.weights(best.modes)
    text = effect_text(best.candidate, weights, problem.case.name, formulas)
    return MissingLaw(
        found=True,
        reason=reason_of(found, best.candidate, shares[0], where),
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


def reason_of(found: Isolation, candidate: CandidateLaw, share: float, where: str) -> str:
    """Finding of the discovery in one sentence."""
    said = f"a free law of {candidate.form.words} at {candidate.law.key} removes {share:.0%} of what retuning leaves"
    if imitates(found.retuned):
        return f"{said}; without it nominal parameters leave their tolerances"
    if where not in ("", candidate.law.block):
        return f"{said}; free inputs act in {where}, whose laws it rejects"
    return said


def improved(problem: Problem, found: Isolation, fit: Fit, weights: np.ndarray, text: str) -> Robot:
    """The robot with the law as an effect, noise and resolutions as they were."""
    retuned = found.retuned.explanation
    values = apply(retuned.values, retuned.parameters, fit.x)
    silent = replace(problem, detected=()).silent()
    values = np.where(values != silent, values, problem.robot.values)
    return robot_with(replace(problem.robot, values=values), fit.candidate, weights, text)


def curves_of(fit: Fit, short: Formula | None, counts: np.ndarray) -> dict[str, Curve]:
    """The law in each channel, with its 90 % band and the histogram of its variable, counts (channels, bins)."""
    assert fit.weighed is not None
    candidate, found = fit.candidate, {}
    at, shape = candidate.shape()
    weights = candidate.weights(fit.modes)
    for i, channel in enumerate(fit.active):
        own = slice(i * SIZE, (i + 1) * SIZE)
        to_values = shape[channel] @ (candidate.size[channel] * candidate.basis)
        std = np.sqrt(np.einsum("ij,jk,ik->i", to_values, fit.weighed.covariance[own, own], to_values))
        value, name = shape[channel] @ weights[channel], candidate.channels[channel]
        edges = np.linspace(candidate.seen.low[channel], candidate.seen.high[channel], counts.shape[1] + 1)
        share = counts[channel] / max(float(counts[channel].sum()), 1.0)
        text = short.text(name) if short else ""
        found[name] = Curve(at[channel], value, value - NORMAL_90 * std, value + NORMAL_90 * std, edges, share, text)
    return found
