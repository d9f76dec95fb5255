"""Case mixes: which cases a blind set holds, and the robot and motions of each. Everything follows from the seed."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from exodrake.core.errors import InputError
from exodrake.reference.catalogue import LIBRARY, MARKER_FAULTS, OUTSIDE, WITHOUT_STRENGTH, block_of, draw_effect
from exodrake.reference.parameters import draw_parameters
from exodrake.reference.protocols import protocols_of
from exodrake.reference.robot_spec import Protocol, RobotSpec

MASKED = (
    {"tendon.capstan_friction", "tendon.coulomb_friction"}, {"tendon.coulomb_friction", "tendon.stribeck_friction"},
    {"tendon.capstan_friction", "tendon.stribeck_friction"}, {"tendon.slack", "encoder.homing_offset"},
    {"tendon.compliance", "tendon.stiffening"}, {"timing.mocap_delay", "timing.mocap_clock_skew"},
)  # fmt: skip
VISIBLE = 2.0  # noise standard deviations: smallest gap of an effect that a diagnosis is expected to see [assumed]
SAME_NATURE = 0.3  # share of pairs of one block that the kind "pair" keeps [assumed]
STANDARD = {"healthy": 0.20, "single": 0.50, "pair": 0.15, "unknown": 0.15}


@dataclass(frozen=True)
class CaseMix:
    """Distribution of the cases of a set.

    Attributes:
        name: Name of the mix, which the labels and the score repeat.
        weights: Kind of case -> weight; kinds: healthy, single, pair, unknown, same-block and three.
        unseen: Share of held-out motions that resemble no fit motion.
        gap: Range of the gap that each effect leaves [noise standard deviations]; larger ones are weakened.
        duration: Duration of the logs relative to the usual one.
        hidden: Kinds of columns that the logs do not hold.
        left_out: Ids of effects that no case holds.
    """

    name: str = "standard"
    weights: Mapping[str, float] = field(default_factory=STANDARD.copy)
    unseen: float = 0.35
    gap: tuple[float, float] = (VISIBLE, math.inf)
    duration: float = 1.0
    hidden: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()


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
    """One case to be made; the magnitudes of its effects are drawn when it is made.

    Attributes:
        name: Name of its folder.
        seed: Seed material.
        kind: Kind of case.
        ids: Ids of its effects.
        unseen: Whether its held-out motion resembles no fit motion.
        mix: Mix that it belongs to.
    """

    name: str
    seed: tuple[int, ...]
    kind: str
    ids: tuple[str, ...]
    unseen: bool
    mix: CaseMix = field(default_factory=CaseMix)


@dataclass(frozen=True)
class DrawnCase:
    """A case with robot and motions drawn; `healthy` is the same robot without the effects."""

    spec: RobotSpec
    healthy: RobotSpec
    protocols: dict[str, Protocol] = field(default_factory=dict)


def named_mixes(names: Iterable[str]) -> tuple[CaseMix, ...]:
    """Case mixes by name; InputError for a name that there is not."""
    for name in names:
        if name not in MIXES:
            raise InputError(f"no case mix {name!r}; there are {', '.join(MIXES)}")
    return tuple(MIXES[name] for name in dict.fromkeys(names))


def counts(mix: CaseMix, total: int) -> dict[str, int]:
    """Number of cases per kind, by largest remainders of the weights."""
    weights = np.array(list(mix.weights.values()))
    exact = total * weights / weights.sum()
    whole = np.floor(exact).astype(int)
    for index in np.argsort(whole - exact)[: total - whole.sum()]:
        whole[index] += 1
    return dict(zip(mix.weights, whole.tolist()))


def rounds(names: Iterable[str], count: int, rng: np.random.Generator) -> list[str]:
    """List `count` names, every one used before any comes again, in random order."""
    names, chosen = list(names), []
    while len(chosen) < count:
        chosen += [names[index] for index in rng.permutation(len(names))]
    return chosen[:count]


def draw_set(
    names: Sequence[str], size: int, rng: np.random.Generator, accepted: Callable[[set[str]], bool]
) -> tuple[str, ...]:
    """Draw so many different effects that mask none of each other, until `accepted(blocks)` holds for their blocks."""
    while True:
        chosen = tuple(str(name) for name in rng.choice(names, size, replace=False))
        if not any(masked <= set(chosen) for masked in MASKED) and accepted({block_of(name) for name in chosen}):
            return chosen


def draw_kinds(mix: CaseMix, total: int, rng: np.random.Generator) -> list[tuple[str, tuple[str, ...]]]:
    """Kind and effects of each case of a mix, in order of kind."""
    library, outside = ([name for name in names if name not in mix.left_out] for names in (LIBRARY, OUTSIDE))
    count = dict.fromkeys((*STANDARD, "same-block", "three"), 0) | counts(mix, total)

    def sets(kind, size, accepted):
        return [draw_set(library, size, rng, accepted) for _ in range(count[kind])]

    drawn = {
        "healthy": [()] * count["healthy"],
        "single": [(name,) for name in rounds(library, count["single"], rng)],
        "pair": sets("pair", 2, lambda blocks: len(blocks) == 2 or rng.random() < SAME_NATURE),
        "unknown": [(name,) for name in rounds(outside, count["unknown"], rng)],
        "same-block": sets("same-block", 2, lambda blocks: len(blocks) == 1),
        "three": sets("three", 3, lambda blocks: True),
    }
    return [(kind, ids) for kind, chosen in drawn.items() for ids in chosen]


def plan(seed: int, total: int, *mixes: CaseMix) -> list[CasePlan]:
    """Plan a set, shuffled within each mix so that a case's place says nothing about its kind.

    Args:
        seed: Seed of the set.
        total: Number of cases of each mix.
        mixes: Case mixes.

    Returns:
        Plans of the cases; those of the first mix do not depend on the others.
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
    protocols = protocols_of(np.random.default_rng([*plan.seed, 2]), plan.unseen, plan.mix.duration)
    rng = np.random.default_rng([*plan.seed, 3, attempt])
    effects = tuple(draw_effect(name, rng) for name in plan.ids)
    return DrawnCase(RobotSpec(parameters, effects), RobotSpec(parameters), protocols)
