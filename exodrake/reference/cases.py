"""Cases of a blind set: motions, case mixes, robots. Everything follows from the seed.

Motions are tension references (n, 3) [N] at 20 ms. They are like those in data/reference, but in another order, at
other levels and paces; `share` is the duration relative to the usual one. Sweeps, chirp and holds are for fitting. Held
out are grasps or, sometimes, a smooth random motion of all wires that resembles nothing in the fit.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from exodrake.engine.inputs import Reference
from exodrake.reference.faults import LIBRARY, MARKER_FAULTS, OUTSIDE, WITHOUT_STRENGTH, draw_effect, find_blocks
from exodrake.reference.robot import FRAME, TENSION_MAX, TENSION_MIN, RobotSpec, draw_parameters

SEGMENT = 5.0  # s, one sweep up and down (physics.md claim 13)
HOLD = 8.0  # s, mean duration of one level
SWEEPS, CHIRP, HOLDS, GRASPS = 60.0, 36.0, 40.0, 40.0  # s
LEVELS = np.array([0.0, 1 / 3, 2 / 3, 1.0])


def clock(duration: float) -> np.ndarray:
    """Instants of the frames (n,) [s]."""
    return FRAME * np.arange(round(duration / FRAME))


def sweeps(rng: np.random.Generator, share: float = 1.0) -> Reference:
    """Triangles: each wire ramps four times from the anti-slack tension to its maximum and back.

    The other wires stand at levels of their maxima.
    """
    time = clock(share * SWEEPS)
    reference = np.zeros((len(time), 3))
    active = np.repeat(rng.permutation(3), round(share * SWEEPS / SEGMENT / 3))
    segment = np.minimum((time / SEGMENT).astype(int), len(active) - 1)
    for index, wire in enumerate(active):
        inside = segment == index
        phase = (time[inside] - index * SEGMENT) / SEGMENT
        level = rng.choice(LEVELS, 3) * TENSION_MAX
        level[(wire + rng.integers(1, 3)) % 3] *= rng.random() < 0.5
        top = rng.uniform(0.3, 0.7)
        reference[inside] = level
        reference[inside, wire] = TENSION_MAX[wire] * np.minimum(phase / top, (1 - phase) / (1 - top))
    return Reference(np.maximum(reference, TENSION_MIN), "sweeps")


def chirp(rng: np.random.Generator, share: float = 1.0) -> Reference:
    """Chirp: each wire in turn swings between 10 and 80 % of its maximum, from about 0.1 to about 1.8 Hz.

    The other wires rest at a base level.
    """
    time = clock(share * CHIRP)
    span = share * CHIRP / 3
    reference = np.tile(TENSION_MAX * rng.uniform(0.1, 0.2, 3), (len(time), 1))
    for index, wire in enumerate(rng.permutation(3)):
        inside = (time >= index * span) & (time < (index + 1) * span)
        local = time[inside] - index * span
        low, high = rng.uniform(0.04, 0.15), rng.uniform(1.4, 2.0)
        phase = 2 * np.pi * (low * local + (high - low) * local**2 / (2 * span))
        reference[inside, wire] = TENSION_MAX[wire] * (0.45 - 0.35 * np.cos(phase))
    return Reference(reference, "chirp")


def holds(rng: np.random.Generator, share: float = 1.0) -> Reference:
    """Steps to random levels of all wires, held 6 to 10 s."""
    time = clock(share * HOLDS)
    edges = np.arange(HOLD, share * HOLDS, HOLD)
    edges = np.sort(edges + rng.uniform(-1, 1, len(edges)))
    levels = rng.uniform(0.1, 0.9, (len(edges) + 1, 3)) * TENSION_MAX
    return Reference(levels[np.searchsorted(edges, time, side="right")], "holds")


def smooth(x: np.ndarray) -> np.ndarray:
    """Minimum-jerk step from 0 to 1 of a phase (n,) [-]."""
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)


def grasps(rng: np.random.Generator, share: float = 1.0) -> Reference:
    """Smooth grips of random synergy, depth, pace and hold."""
    time = clock(share * GRASPS)
    reference = np.full((len(time), 3), TENSION_MIN)
    patterns = np.array([[1.0, 0.25, 0.55], [1.0, 0.03, 0.04], [0.05, 1.0, 0.04], [0.7, 0.6, 0.1], [0.3, 0.1, 0.9]])
    start = rng.uniform(0, 1)
    while start < share * GRASPS:
        close, hold, pause = rng.uniform(0.5, 1.6), rng.uniform(0.8, 2.5), rng.uniform(0.3, 1.5)
        peak = patterns[rng.integers(len(patterns))] * rng.uniform(0.5, 0.9) * TENSION_MAX
        bump = smooth((time - start) / close) * smooth((start + 2 * close + hold - time) / close)
        reference += bump[:, None] * np.maximum(0.0, peak - TENSION_MIN)
        start += 2 * close + hold + pause
    return Reference(reference, "grasps")


def wander(rng: np.random.Generator, share: float = 1.0) -> Reference:
    """Smooth random motion of all wires at once: sums of slow sines through a soft limiter."""
    time = clock(share * GRASPS)
    reference = np.empty((len(time), 3))
    for wire in range(3):
        frequency = rng.uniform(0.03, 0.9, 7)
        weight = rng.standard_normal(7) / (0.3 + frequency)
        course = (weight * np.sin(2 * np.pi * np.outer(time, frequency) + rng.uniform(0, 2 * np.pi, 7))).sum(axis=1)
        level = 1 / (1 + np.exp(-1.5 * course / course.std() - rng.uniform(-1.5, 0.5)))
        reference[:, wire] = TENSION_MIN + level * (0.9 * TENSION_MAX[wire] - TENSION_MIN)
    return Reference(reference, "grasps")


MASKED = (
    {"tendon.capstan_friction", "tendon.coulomb_friction"}, {"tendon.coulomb_friction", "tendon.stribeck_friction"},
    {"tendon.capstan_friction", "tendon.stribeck_friction"}, {"tendon.slack", "encoder.homing_offset"},
    {"tendon.compliance", "tendon.stiffening"}, {"timing.mocap_delay", "timing.mocap_clock_skew"},
)  # fmt: skip
VISIBLE = 2.0  # noise standard deviations: smallest gap of an effect that a diagnosis is expected to see [assumed]
SAME_NATURE = 0.3  # share of pairs of one block that the kind "pair" keeps [assumed]
# kind -> number of effects of a case
KINDS = {"healthy": 0, "single": 1, "pair": 2, "unknown": 1, "same-block": 2, "three": 3}
STANDARD = {"healthy": 0.20, "single": 0.50, "pair": 0.15, "unknown": 0.15}


@dataclass(frozen=True)
class CaseMix:
    """Distribution of the cases of a set."""

    name: str = "standard"  # Name of the mix, which the labels and the score repeat
    # Kind of case, of KINDS -> weight
    weights: Mapping[str, float] = field(default_factory=STANDARD.copy)
    unseen: float = 0.35  # Share of held-out motions that resemble no fit motion
    # Range of the gap that each effect leaves [noise standard deviations]; larger ones are weakened
    gap: tuple[float, float] = (VISIBLE, math.inf)
    duration: float = 1.0  # Duration of the logs relative to the usual one
    hidden: tuple[str, ...] = ()  # Kinds of columns that the logs do not hold
    left_out: tuple[str, ...] = ()  # Ids of effects that no case holds


MIXES = {
    mix.name: mix
    for mix in (
        CaseMix(),
        CaseMix("healthy", {"healthy": 1.0}),
        CaseMix("small", {"single": 1.0}, gap=(VISIBLE, 2 * VISIBLE), left_out=WITHOUT_STRENGTH),
        CaseMix("half", duration=0.5),
        CaseMix("no-mocap", hidden=("angle",), left_out=MARKER_FAULTS),
        CaseMix("no-load-cells", hidden=("tension",)),
        CaseMix("encoders-alone", hidden=("tension", "angle"), left_out=MARKER_FAULTS),
        CaseMix("same-block", {"same-block": 1.0}),
        CaseMix("three", {"three": 1.0}),
    )
}


@dataclass(frozen=True)
class CasePlan:
    """One case to be made from seed material; the magnitudes of the effects `ids` are drawn when it is made.

    `name` is that of its folder; `unseen`: whether its held-out motion resembles no fit motion.
    """

    name: str
    seed: tuple[int, ...]
    kind: str
    ids: tuple[str, ...]
    unseen: bool
    mix: CaseMix = field(default_factory=CaseMix)


@dataclass(frozen=True)
class DrawnCase:
    """A case with robot and motions drawn."""

    spec: RobotSpec
    protocols: dict[str, Reference] = field(default_factory=dict)


def draw_kinds(mix: CaseMix, total: int, rng: np.random.Generator) -> list[tuple[str, tuple[str, ...]]]:
    """Kind and effects of each case of a mix, in order of kind; of several effects none masks another."""
    library, outside = ([name for name in names if name not in mix.left_out] for names in (LIBRARY, OUTSIDE))
    weights = np.array([mix.weights.get(kind, 0.0) for kind in KINDS])  # cases per kind, by largest remainders
    exact = total * weights / weights.sum()
    count = np.floor(exact).astype(int)
    count[np.argsort(count - exact)[: total - count.sum()]] += 1
    drawn = []
    for (kind, size), wanted in zip(KINDS.items(), count.tolist()):
        names, chosen = outside if kind == "unknown" else library, [()] * wanted if size == 0 else []
        while len(chosen) < wanted:
            if size == 1:  # every one is used before any comes again, in random order
                chosen += [(names[index],) for index in rng.permutation(len(names))]
                continue
            ids = tuple(str(name) for name in rng.choice(names, size, replace=False))
            one_block = len({find_blocks(name)[0] for name in ids}) == 1
            if any(masked <= set(ids) for masked in MASKED) or (kind == "same-block" and not one_block):
                continue
            if kind != "pair" or not one_block or rng.random() < SAME_NATURE:
                chosen.append(ids)
        drawn += [(kind, ids) for ids in chosen[:wanted]]
    return drawn


def plan(seed: int, total: int, *mixes: CaseMix) -> list[CasePlan]:
    """Plan a set of `total` cases of each mix; those of the first mix do not depend on the others.

    They are shuffled within each mix, so that a case's place says nothing about its kind.
    """
    rng = np.random.default_rng([seed, 0])
    width = max(2, len(str(total * len(mixes) - 1)))
    plans = []
    for mix in mixes:
        kinds = draw_kinds(mix, total, rng)
        for index in rng.permutation(total):
            (kind, ids), place = kinds[index], len(plans)
            unseen = bool(rng.random() < mix.unseen)
            plans.append(CasePlan(f"case_{place:0{width}d}", (seed, 1 + place), kind, ids, unseen, mix))
    return plans


def draw_case(plan: CasePlan, attempt: int = 0) -> DrawnCase:
    """Draw robot, effects and motions of a planned case.

    Parameters and motions do not depend on the attempt, magnitudes and channels of the effects do.
    """
    parameters = draw_parameters(np.random.default_rng([*plan.seed, 1]))
    rng, share = np.random.default_rng([*plan.seed, 2]), plan.mix.duration
    sweep = sweeps(rng, share)
    protocols = {"sweeps_1": sweep, "sweeps_2": sweep, "chirp": chirp(rng, share), "holds": holds(rng, share)}
    protocols["grasps"] = (wander if plan.unseen else grasps)(rng, share)
    rng = np.random.default_rng([*plan.seed, 3, attempt])
    effects = tuple(draw_effect(name, rng) for name in plan.ids)
    return DrawnCase(RobotSpec(parameters, effects), protocols)
