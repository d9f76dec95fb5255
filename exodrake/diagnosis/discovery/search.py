"""Search for a law: choice of the screened laws that are simulated and fitted, and their order.

Free inputs (`free_input`) name the block of the robot that has an unknown input, whatever its law. Laws inside that
block and outside it are fitted separately, and those inside rank first. A law outside ranks first if it takes up more
of what they leave than a law in a wrong part takes up of a right one's (`compare.LEAD`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from exodrake.core.progress import Stage, StageProgress
from exodrake.core.threads import side_by_side
from exodrake.diagnosis.discovery.compare import LEAD, lead
from exodrake.diagnosis.discovery.evidence import Eliminated
from exodrake.diagnosis.discovery.fit import Fit, Screened, nuisance_jacobian, refined, started, unlikely
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.refine import Explanation

STARTED, FITTED = 14, 2  # laws simulated as the linearisation predicts them; fitted inside a block and outside it
PER_POINT = 2  # laws at one point that are simulated; laws inside a block that are fitted to the end
FIRST, STEPS = 1, 2  # Gauss-Newton steps of all that are fitted; of those fitted to the end


def fit_best(
    likelihood: Likelihood, base: Explanation, model: Eliminated, screen: Sequence[Screened], where: str,
    progress: StageProgress,
) -> tuple[Likelihood, list[Fit]]:  # fmt: skip
    """The most promising laws fitted, inside a block and outside it, and the likelihood in units of what one leaves.

    Args:
        likelihood: views of the case.
        base: the robot beside which the laws were screened.
        model: its linearisation.
        screen: the screened laws, best first.
        where: the block; that of the best law where empty.
        progress: called with the law that is worked on.
    """
    chosen = promising(screen, where)
    starts = side_by_side([partial(started, likelihood, base, model, s) for s in chosen])
    cost = {id(f): unlikely(likelihood, base, f, s.weighed) for f, s in zip(starts, chosen, strict=True)}
    starts.sort(key=lambda f: cost[id(f)])
    block = where or starts[0].block
    first = [f for part in parted(starts, block) for f in part[:FITTED]]
    progress(Stage.FIT, ", ".join(dict.fromkeys(f.candidate.law.learned for f in first)))
    fits = side_by_side([partial(refined, likelihood, base, f, base.jacobian, FIRST) for f in first])
    fits.sort(key=lambda f: -evidence(f))
    likelihood = likelihood.scaled_to(min((f.residual for f in fits), key=likelihood.mean_log))
    inside, outside = parted(fits, block)
    last = [*inside[:PER_POINT], *outside[:1]]
    fits = side_by_side([partial(fitted_anew, likelihood, base, f) for f in last])
    return likelihood, sorted(fits, key=lambda f: -evidence(f))


def parted(fits: Sequence[Fit], block: str) -> tuple[list[Fit], list[Fit]]:
    """Fits in a block, and those outside it, in their order."""
    return [f for f in fits if f.block == block], [f for f in fits if f.block != block]


def fitted_anew(likelihood: Likelihood, base: Explanation, fit: Fit) -> Fit:
    """A fit after some further steps with a new Jacobian of the other parameters."""
    return refined(likelihood, base, fit, nuisance_jacobian(likelihood, base, fit), STEPS)


def promising(screen: Sequence[Screened], where: str) -> list[Screened]:
    """The laws that are simulated: the first ones of each point, as many outside a block as inside at most."""
    chosen: list[Screened] = []
    for s in screen:
        law = s.candidate.law
        here = [c for c in chosen if c.candidate.law is law]
        alike = [c for c in chosen if not where or (c.candidate.law.block == where) is (law.block == where)]
        if s.active and len(here) < PER_POINT and len(alike) < (STARTED if not where else STARTED // 2):
            chosen.append(s)
    return chosen


def ranked(fits: Sequence[Fit], shares: Sequence[float], where: str) -> list[int]:
    """Order of fits of falling evidence: those in the block that free inputs name first, unless another rejects it."""
    inside = [k for k, f in enumerate(fits) if not where or f.block == where]
    outside = [k for k in range(len(fits)) if k not in inside]
    return [*outside, *inside] if where and rejects(fits, shares, where) else [*inside, *outside]


def rejects(fits: Sequence[Fit], shares: Sequence[float], where: str) -> bool:
    """Whether a law outside a block takes up more of what the best one inside leaves than wrong laws do."""
    inside = max((s for f, s in zip(fits, shares, strict=True) if f.block == where), default=0.0)
    outside = max((s for f, s in zip(fits, shares, strict=True) if f.block != where), default=0.0)
    return lead(outside, inside) > LEAD


def evidence(fit: Fit) -> float:
    """Log evidence of a fitted law."""
    assert fit.weighed is not None
    return fit.weighed.log_evidence
