"""Which cases a blind set holds, and the robot and motions of each. Everything follows from the seed."""

from dataclasses import dataclass, field

import numpy as np

from exodrake.blind.catalogue import LIBRARY, OUTSIDE, block_of, draw_effect
from exodrake.blind.parameters import draw_parameters
from exodrake.blind.protocols import protocols_of
from exodrake.blind.robot_spec import RobotSpec

MASKED = (
    {"tendon.capstan_friction", "tendon.coulomb_friction"}, {"tendon.coulomb_friction", "tendon.stribeck_friction"},
    {"tendon.capstan_friction", "tendon.stribeck_friction"}, {"tendon.slack", "encoder.homing_offset"},
    {"tendon.compliance", "tendon.stiffening"}, {"timing.mocap_delay", "timing.mocap_clock_skew"},
)  # fmt: skip


@dataclass(frozen=True)
class CaseMix:
    """Weights of the kinds of case, and the share of held-out motions that resemble no fit motion."""

    healthy: float = 0.20
    single: float = 0.50
    pair: float = 0.15
    unknown: float = 0.15
    unseen: float = 0.35

    @property
    def kinds(self):
        return {"healthy": self.healthy, "single": self.single, "pair": self.pair, "unknown": self.unknown}


@dataclass(frozen=True)
class CasePlan:
    """One case to be made: seed material, kind, and the ids of its effects; magnitudes are drawn when it is made."""

    name: str
    seed: tuple[int, ...]
    kind: str
    ids: tuple[str, ...]
    unseen: bool


@dataclass(frozen=True)
class DrawnCase:
    """A case with robot and motions drawn; `healthy` is the same robot without the effects."""

    spec: RobotSpec
    healthy: RobotSpec
    protocols: dict = field(default_factory=dict)


def counts(mix, total):
    """Number of cases per kind, by largest remainders of the weights."""
    weights = np.array(list(mix.kinds.values()))
    exact = total * weights / weights.sum()
    whole = np.floor(exact).astype(int)
    for index in np.argsort(whole - exact)[: total - whole.sum()]:
        whole[index] += 1
    return dict(zip(mix.kinds, whole.tolist()))


def rounds(names, count, rng):
    """`count` names, every one used before any comes again, in random order."""
    names, chosen = list(names), []
    while len(chosen) < count:
        chosen += [names[index] for index in rng.permutation(len(names))]
    return chosen[:count]


def draw_pair(rng):
    """Two effects of different blocks or at least of different nature."""
    while True:
        first, second = (str(name) for name in rng.choice(list(LIBRARY), 2, replace=False))
        if {first, second} not in MASKED and (block_of(first) != block_of(second) or rng.random() < 0.3):
            return first, second


def plan(seed, total, mix):
    """Plans of a set, shuffled so that a case's place says nothing about its kind."""
    rng = np.random.default_rng([seed, 0])
    count = counts(mix, total)
    ids = [()] * count["healthy"] + [(name,) for name in rounds(LIBRARY, count["single"], rng)]
    ids += [draw_pair(rng) for _ in range(count["pair"])] + [(name,) for name in rounds(OUTSIDE, count["unknown"], rng)]
    kinds = [kind for kind, many in count.items() for _ in range(many)]
    width = max(2, len(str(total - 1)))
    plans = []
    for place, index in enumerate(rng.permutation(total)):
        unseen = bool(rng.random() < mix.unseen)
        plans.append(CasePlan(f"case_{place:0{width}d}", (seed, 1 + place), kinds[index], ids[index], unseen))
    return plans


def draw_case(plan, attempt=0):
    """Robot, effects and motions of a planned case. Parameters and motions do not depend on the attempt, magnitudes and
    seats do.
    """
    parameters = draw_parameters(np.random.default_rng([*plan.seed, 1]))
    protocols = protocols_of(np.random.default_rng([*plan.seed, 2]), plan.unseen)
    rng = np.random.default_rng([*plan.seed, 3, attempt])
    effects = tuple(draw_effect(name, rng) for name in plan.ids)
    return DrawnCase(RobotSpec(parameters, effects), RobotSpec(parameters), protocols)
