"""Gap that injected effects leave on the held-out motion, and the draw of effects whose gap is large, or small, enough.

Gap of a signal: root mean square of the difference between two noise-free logs, in noise standard deviations.
"""

from dataclasses import replace

import numpy as np

from exodrake.reference.case_mix import CaseMix, CasePlan, DrawnCase, draw_case
from exodrake.reference.catalogue import weakened
from exodrake.reference.robot_spec import RobotSpec
from exodrake.reference.simulator import simulate

Log = dict[str, np.ndarray]  # column -> values (n,) [SI]
Gaps = dict[str, float]  # signal -> gap [noise standard deviations]
NOISE_STD = {"tension": 0.01, "stroke": 12.3e-6, "angle": 0.005}  # N, m, rad
ATTEMPTS = 6  # draws of magnitudes and channels
BISECTIONS = 12
WEAKEST = 1e-3  # strength of an effect, relative to its draw, that counts as absent [assumed]


def kind_of(column: str) -> str:
    """Column name without its wire or joint."""
    return column.rsplit("_", 1)[0] if column != "time" else column


def gap_in_noise(with_effect: Log, without: Log) -> Gaps:
    """Gap per signal between two logs."""
    gaps = {}
    for name, values in with_effect.items():
        if kind_of(name) in NOISE_STD:
            gaps[name] = float(np.sqrt(np.mean((values - without[name]) ** 2)) / NOISE_STD[kind_of(name)])
    return gaps


def held_out_gap(case: DrawnCase, without: RobotSpec, seed: list[int], hidden: tuple[str, ...]) -> Gaps:
    """Gap per logged signal between a case's robot and another; the same random courses in both."""
    robots = (case.spec, without)
    logs = [simulate(replace(robot, noisy=False), case.protocols["grasps"], seed) for robot in robots]
    return {name: gap for name, gap in gap_in_noise(*logs).items() if kind_of(name) not in hidden}


def parts_gaps(case: DrawnCase, seed: list[int], hidden: tuple[str, ...] = ()) -> tuple[list[float], Gaps]:
    """Gaps of a case.

    Args:
        case: Robot and motions.
        seed: Seed of the random courses.
        hidden: Kinds of columns that are not logged.

    Returns:
        What each effect adds to the others, a list of the largest signal's gap; and the gap of all by signal.
    """
    effects = case.spec.effects
    whole = held_out_gap(case, case.healthy, seed, hidden)
    if len(effects) < 2:
        return [max(whole.values())] * len(effects), whole
    without = [
        replace(case.spec, effects=tuple(other for other in effects if other is not effect)) for effect in effects
    ]
    return [max(held_out_gap(case, spec, seed, hidden).values()) for spec in without], whole


def small_enough(case: DrawnCase, seed: list[int], mix: CaseMix) -> tuple[DrawnCase, list[float], Gaps]:
    """Weaken the effects of a case until their smallest gap lies in the range of the mix, by bisection in the strength.

    Args:
        case: Robot and motions.
        seed: Seed of the random courses.
        mix: Mix that the case belongs to.

    Returns:
        Case, gap per effect and gap per signal; the last tried where no strength gives a gap in the range.
    """
    found = (case, *parts_gaps(case, seed, mix.hidden))
    low, high = WEAKEST, 1.0
    for _ in range(BISECTIONS if min(found[1]) > mix.gap[1] else 0):
        strength = float(np.sqrt(low * high))
        effects = tuple(weakened(effect, strength) for effect in case.spec.effects)
        weaker = replace(case, spec=replace(case.spec, effects=effects))
        found = (weaker, *parts_gaps(weaker, seed, mix.hidden))
        if distance(found[1], mix.gap) == 0.0:
            break
        low, high = (low, strength) if min(found[1]) > mix.gap[1] else (strength, high)
    return found


def distance(gaps: list[float], wanted: tuple[float, float]) -> float:
    """Distance of the smallest gap from the wanted range [noise standard deviations]."""
    return max(wanted[0] - min(gaps), min(gaps) - wanted[1], 0.0)


def visible_case(plan: CasePlan) -> tuple[DrawnCase, list[float], Gaps]:
    """Draw a planned case until the gap of its effects on the held-out motion is as wanted, or the attempts run out.

    Args:
        plan: Plan of the case.

    Returns:
        Case, gap per effect and gap per signal.
    """
    best = draw_case(plan), [], {}
    for attempt in range(ATTEMPTS if plan.ids else 0):
        found = small_enough(draw_case(plan, attempt), [*plan.seed, 4], plan.mix)
        if not best[1] or distance(found[1], plan.mix.gap) < distance(best[1], plan.mix.gap):
            best = found
        if distance(best[1], plan.mix.gap) == 0.0:
            break
    return best
