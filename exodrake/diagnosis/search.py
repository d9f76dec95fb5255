"""Search for the set of effects of largest evidence: stepwise, forward, backward and by exchange.

    best = the retuned robot
    repeat: try one effect less, one in place of another, and one more beside it, until none has more evidence

An effect is predicted by algebra on the linear model (its directions beside the set, all fitted parameters eliminated),
and the most promising ones are fitted. Evidence is that of the linear model about each fit (`LinearModel.evidence`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial, reduce
from itertools import combinations
from typing import NamedTuple

import numpy as np

from exodrake.core.parallel import side_by_side
from exodrake.core.progress import Stage, StageProgress, no_progress
from exodrake.diagnosis.fit import (
    HALF,
    LESS,
    ROUGH,
    Explanation,
    Groups,
    Predicted,
    fit_beside,
    linear_model,
    minimise,
    renew,
    settle,
    whole_jacobian,
    without,
)
from exodrake.diagnosis.likelihood import Likelihood
from exodrake.diagnosis.linear import LinearModel, minimise_bounded
from exodrake.diagnosis.linearise import Linearisation, Probe, linearise
from exodrake.diagnosis.parameter import Parameter
from exodrake.model.effect import Effect
from exodrake.model.part import READINGS

SINGLES, FITTED, LOOKED = 4, 3, 10  # first effects fitted; further ones; those whose directions are taken anew
SETTLED = 3  # times at most that a set is fitted on with new derivatives
ALIKE = 2  # effects by which sets differ that begin where others ended
NATS = 4.0  # of evidence within which two explanations are as likely: odds of 1 to 50
GAIN = 0.05  # share of what is left that one effect more must take up
LARGE = 0.1  # share of the gap from which an effect is a cause, not a refinement
LAW = 0.15  # relative error of a law: that of another simulator or of a machine differs by as much
SURE = 15.0  # nats of the tolerances' priors that an effect in their place has to spare: of 21 healthy robots 12
TINY = 1e-4  # share of the gap beyond retuning, a hundredth of it by RMS: less left is not looked into; assumed
FAR = 1.0  # noise variances: a set that leaves more leaves much
ALL = slice(None)  # logs
PAIRS = "pairs"  # in the place of an effect's id, where two were tried beside a set
PLAINER = "plainer"  # the same, where one of them was fitted again from where a plainer law ended

# laws of one kind stand for each other: a set holds one of them at a place
KINDS = {
    "coulomb_friction": "dry friction", "stribeck_friction": "dry friction", "presliding_friction": "dry friction",
    "presliding": "dry friction", "lugre": "dry friction", "prandtl_ishlinskii": "dry friction",
    "viscous_friction": "viscous friction", "direction": "viscous friction",
    "capstan_friction": "load-dependent friction", "load_friction": "load-dependent friction",
    "sheath_friction": "load-dependent friction", "gear_efficiency": "load-dependent friction",
    "pulley_friction": "load-dependent friction", "backdriving_friction": "load-dependent friction",
    "quadratic_friction": "load-dependent friction", "clock_skew": "clock skew", "mocap_clock_skew": "clock skew",
}  # fmt: skip
ONE = ("dry friction", "load-dependent friction")  # kinds whose laws exclude each other
# errors of a sensor that imitate causes
MEMORY = ("hysteresis", "low_pass", "drift", "delay", "clock_skew", "backlash")


def name_kind(effect: Effect) -> str:
    """Kind of an effect in words: that of its law, else of its family, else its name."""
    law = effect.id.rsplit(".", 1)[-1]
    return KINDS.get(law, effect.family or law.replace("_", " "))


def is_imitator(effect: Effect) -> bool:
    """Whether an effect imitates causes: a sensor's memory, a generic law of a signal that has states.

    So does friction that differs by direction where the motion goes one way.
    """
    law = effect.id.rsplit(".", 1)[-1]
    of_sensor = all(point.rsplit(".", 1)[-1] in READINGS for point in effect.at)
    return law == "direction" or (law in MEMORY and of_sensor)


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fitted set of effects."""

    explanation: Explanation  # the fit
    model: LinearModel  # linear model about it
    chi2: np.ndarray  # reduced chi-squares (views,)
    memory: float  # frames that count as one in what it leaves
    excess: float  # what it leaves above noise, views and separate joints in the mean [noise variances]

    @classmethod
    def at(cls, likelihood: Likelihood, e: Explanation) -> Fitted:
        """A fit with its linear model on the logs that it was fitted to."""
        memory = likelihood.with_memory(e.residual).memory
        model, chi2 = linear_model(likelihood.scaled_to(e.residual), e), likelihood.chi2(e.residual)
        squares = np.average(likelihood.chi2_by_log(e.residual), axis=0, weights=likelihood.samples_by_log)
        return cls(e, model, chi2, memory, float(np.maximum(squares - 1.0, 0.0).mean()))

    @property
    def effects(self) -> frozenset[str]:
        """Ids of its effects."""
        return frozenset(self.explanation.effects)

    @property
    def tolerance_cost(self) -> float:
        """What its nominal parameters cost by their priors [nats]."""
        e = self.explanation
        return 0.5 * float(np.sum(e.use[: e.nominal] ** 2))


class Excess(NamedTuple):
    """What a robot leaves beyond noise and what is negligible, in its worst channel [noise variances]; < 0: no gap."""

    fitted: float  # in the part of the logs that is fitted
    whole: float  # in whole logs
    shown: float  # what the fitted part shows over the most that a part of the logs shows
    needed: float  # samples of the shortest part that shows half of the most


@dataclass(eq=False)
class Search:
    """Sets of effects that were fitted on one case."""

    likelihood: Likelihood  # the case
    effects: tuple[Effect, ...]  # effects to try
    # (samples,) whitened residual that they are to explain: of the nominal robot, where retuning leaves no visible gap
    gap: np.ndarray
    share: float  # part of each log, from its beginning, on which all effects are tried beside the retuned robot
    fine: Likelihood  # the case with more of the logs, to which sets are fitted on; no more than were fitted: none are
    whole: Likelihood  # the case with whole logs, on which shares are measured; the likelihood where these were fitted
    excess: Callable[[np.ndarray], Excess]  # of a robot (parameters,)
    sets: dict[frozenset[str], Fitted] = field(default_factory=dict)  # fitted sets by their effects
    # sets beside which further effects were tried, and effects in whose place
    expanded: set[tuple[frozenset[str], str]] = field(default_factory=set)
    barred: set[str] = field(default_factory=set)  # laws for which a plainer one of their kind stands
    # evidence of sets by the memory that counts [nats]
    known: dict[tuple[Fitted, float], float] = field(default_factory=dict)
    # mean squares of what sets leave, as `Likelihood.chi2_by_log`
    squares: dict[Fitted, np.ndarray] = field(default_factory=dict)
    precise: dict[Fitted, Fitted] = field(default_factory=dict)  # sets that were fitted on
    # the fit that was grown last, and directions of effects there
    beside: tuple[Explanation, Linearisation] | None = None
    progress: StageProgress = no_progress  # called with the stage and what it works on

    @property
    def none(self) -> Fitted:
        """The retuned robot without an effect."""
        return self.sets[frozenset()]

    @property
    def longest(self) -> Likelihood:
        """The case with as many samples as sets are fitted on to, or were fitted to if those are more."""
        return max(self.likelihood, self.fine, key=lambda one: one.samples).for_stage("fit on")

    @cached_property
    def kinds(self) -> dict[str, tuple[str, str]]:
        """Block and kind of each effect by its id."""
        return {e.id: (e.block, name_kind(e)) for e in self.effects}

    @cached_property
    def lin(self) -> Linearisation:
        """Directions of all effects beside the retuned robot, simulated where they are needed first."""
        self.progress(Stage.LINEARISE, "")
        e, likelihood = self.none.explanation, self.likelihood.for_stage("linearise")
        return linearise(likelihood, e.robot, self.effects, e.residual, self.share, self.gap)

    def measure_left(self, fitted: Fitted, logs: np.ndarray | slice = ALL, before: np.ndarray | None = None) -> float:
        """Share of the gap beyond retuning that a set leaves in some logs (mask), the mean of the views that have one.

        before: mean squares of a robot in the place of the retuned one, as `Likelihood.chi2_by_log`.
        """
        weight, left = (x[:, 0] for x in self.left_in_views(fitted, logs, together=True, before=before))
        return float(weight @ left / max(weight.sum(), 1e-12))

    def left_by_log(self, fitted: Fitted, before: np.ndarray | None = None) -> np.ndarray:
        """The same (1 + logs,): by all logs, and with each of several logs left out."""
        count = len(self.whole.cells)
        fewer = (np.arange(count) != k for k in range(count) if count > 1)
        return np.array([self.measure_left(fitted, logs, before) for logs in (ALL, *fewer)])

    def left_by_joint(self, fitted: Fitted) -> np.ndarray:
        """The same of each joint (joints,) where joints are separate, else of all together (1,).

        In shares of what counts of the joint with the largest gap: a joint without one has none.
        """
        weight, left = self.left_in_views(fitted, ALL, together=False)
        return (weight * left).sum(axis=0) / max(weight.sum(axis=0).max(), 1e-12)

    def left_in_views(
        self, fitted: Fitted, logs: np.ndarray | slice, together: bool, before: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Weights and shares of the gap (views, joints) that a set leaves in some logs (mask).

        A view counts by its gap, fully where that is large against a negligible one. Noise is what the best set leaves
        where that is less than expected. together: all joints as one (views, 1).
        """
        samples, known = self.whole.samples_by_log, self.squares
        if new := [f for f in (*self.sets.values(), fitted) if f not in known]:  # what each leaves over the whole logs
            rows = [f.explanation.residual for f in new]
            if self.whole.samples != self.likelihood.samples:
                rows = self.whole.residual(np.array([f.explanation.robot for f in new]))
            known |= {f: self.whole.chi2_by_log(row) for f, row in zip(new, rows, strict=True)}

        def mean(squares: np.ndarray, some: np.ndarray | slice) -> np.ndarray:
            sums, n = ((x * samples)[some].sum(axis=0) for x in (squares, np.ones_like(squares)))
            return sums.sum(axis=1, keepdims=True) / n.sum(axis=1, keepdims=True) if together else sums / n

        floor = np.minimum(np.min([mean(x, ALL) for x in known.values()], axis=0), 1.0)
        squares = known[self.none] if before is None else before, known[fitted]
        gap, left = (np.maximum(mean(x, logs) - floor, 0.0) for x in squares)
        return gap / (gap + self.likelihood.views[0].problem.negligible ** 2), left / np.maximum(gap, 1e-12)

    def list_plainer(self, key: frozenset[str]) -> Iterator[tuple[str, Fitted]]:
        """Laws of a fitted set, each beside a set with one of its kind and fewer parameters in its place."""
        rich = self.sets[key]
        for effect in key & self.kinds.keys():
            for other, plain in self.find_replacements(rich, effect).items():
                if self.kinds[effect] == self.kinds[other] and len(plain.explanation.x) < len(rich.explanation.x):
                    yield effect, plain

    def bar_richer_laws(self) -> None:
        """Bar laws with more parameters than another of their kind that leaves as much, within the error of a law.

        Not one that is better by as much as an effect for each further parameter must be, in the best set that holds
        it. Sets that are less likely than with a plainer law are fitted again before, as they can do as much.
        """

        def likelier(key: frozenset[str]) -> bool:
            return any(self.evidence(plain) > self.evidence(self.sets[key]) for _, plain in self.list_plainer(key))

        again = [key for key in self.sets if (key, PLAINER) not in self.expanded and likelier(key)]
        self.expanded |= {(key, PLAINER) for key in again}
        self.add(side_by_side([partial(self.fit_again, key) for key in again]))
        self.barred, barred = set(), set[str]()
        usable = [(key, rich) for key, rich in self.sets.items() if self.usable(rich)]
        held = [(effect, rich, plain) for key, rich in usable for effect, plain in self.list_plainer(key)]
        for effect in dict.fromkeys(law for law, *_ in held):
            rich = self.choose_best([rich for law, rich, _ in held if law == effect])
            gain = self.measure_left(self.best_within(rich.effects - {effect})) - self.measure_left(rich)
            for plain in (plain for law, other, plain in held if law == effect and other is rich):
                as_good = self.measure_left(plain) - self.measure_left(rich) <= LAW**2 * gain
                more = len(rich.explanation.x) - len(plain.explanation.x)
                if as_good and self.usable(plain) and not self.beats(rich, plain, more):
                    barred.add(effect)
        self.barred = barred

    def usable(self, fitted: Fitted) -> bool:
        """Whether a set may be the answer: no amplitude ended at a bound other than its null, no law is barred."""
        e = fitted.explanation
        low, high = e.bounds
        small, lead = 1e-6 * (high - low), np.array([p.amplitude for p in e.parameters], dtype=bool)
        none = np.array([p.absent for p in e.parameters])
        ended = (high > low) & (((e.x <= low + small) & (low != none)) | ((e.x >= high - small) & (high != none)))
        return not (ended & lead).any() and not fitted.effects & self.barred

    def best_within(self, key: frozenset[str]) -> Fitted:
        """The fit of a set, or of a part of it, that leaves least: well fitted, none leaves more than a part."""
        return min((f for k, f in self.sets.items() if k <= key), key=self.measure_left)

    def find_replacements(self, best: Fitted, effect: str) -> dict[str, Fitted]:
        """Fitted sets in which another effect stands for one of a set."""
        rest = best.effects - {effect}
        others = {k: f for k, f in self.sets.items() if len(k) == len(best.effects) and rest <= k and effect not in k}
        return {next(iter(k - rest)): f for k, f in others.items()}

    def list_rivals(self, best: Fitted, effect: str, gain: float) -> dict[str, Fitted]:
        """Effects in the place of one, which takes up a `gain` of the gap, that leave no more or are as likely.

        No plainer law of its kind: either that is better by `bar_richer_laws`, or it is no rival.
        """
        found, left = dict[str, Fitted](), self.measure_left(best)
        plainer = [plain for law, plain in self.list_plainer(best.effects) if law == effect]
        for i, other in self.find_replacements(best, effect).items():
            if self.usable(other) and other not in plainer:
                memory = min(best.memory, other.memory)
                as_likely = self.evidence(best, memory) - self.evidence(other, memory) < NATS
                if as_likely or self.measure_left(other) - left <= min(LAW**2 * gain, left):
                    found[i] = other
        return found

    def plainer(self, best: Fitted) -> Fitted:
        """The set with causes in the place of what imitates them, where they explain as much."""
        known = {e.id: e for e in self.effects}
        for effect in [i for i in best.explanation.effects if i in known and is_imitator(known[i])]:
            smaller = self.sets.get(best.effects - {effect})
            gain = self.measure_left(smaller) - self.measure_left(best) if smaller else 1.0
            found = [f for i, f in self.list_rivals(best, effect, gain).items() if not is_imitator(known[i])]
            if found:
                best = max(found, key=self.evidence)
        return best

    @property
    def best(self) -> Fitted:
        """The best of all fitted sets."""
        return self.choose_best(self.sets.values())

    def choose_best(self, sets: Collection[Fitted]) -> Fitted:
        """The usable set of largest evidence whose effects all earn their place; the smallest if none is usable."""
        first, *others = sorted(sets, key=lambda f: len(f.effects))
        return reduce(lambda a, b: b if self.usable(b) and self.beats(b, a) else a, others, first)

    def beats(self, a: Fitted, b: Fitted, more: int | None = None) -> bool:
        """Whether a set is better than another: more evidence, enough more if it has `more` effects.

        Each effect more is one choice among all that the machine has, and the other set is no more as likely. It takes
        up `GAIN` of what is left over the whole logs, in one joint at least where joints are separate.
        """
        more = len(a.effects) - len(b.effects) if more is None else more
        memory = a.memory if more > 0 else b.memory if more < 0 else min(a.memory, b.memory)
        price = more * np.log(len(self.likelihood.robot.machine.effects)) + np.sign(more) * NATS
        if self.evidence(a, memory) - self.evidence(b, memory) <= price:
            return False
        return more <= 0 or bool(np.any(self.left_by_joint(a) < (1.0 - GAIN) ** more * self.left_by_joint(b)))

    def evidence(self, fitted: Fitted, memory: float | None = None) -> float:
        """Log evidence [nats] of a set; two sets are compared with the memory of what the larger one leaves."""
        memory = memory or self.likelihood.memory
        if (fitted, memory) not in self.known:
            self.known[fitted, memory] = fitted.model.evidence(memory)
        return self.known[fitted, memory]

    def add(self, found: Iterable[Explanation]) -> None:
        """Keep fits; of two fits of one set the one with more evidence."""
        for e in found:
            fitted = Fitted.at(self.likelihood, e)
            known = self.sets.get(fitted.effects)
            if known is None or self.evidence(fitted) > self.evidence(known):
                self.sets[fitted.effects] = fitted

    def screen_beside(self, e: Explanation, lin: Linearisation) -> list[Predicted]:
        """Each further effect beside an explanation by its best probe, the most promising first.

        In turn by all samples and by the first of each log: later ones go far apart where a loop hunts or a finger
        touches.
        """
        likelihood, found = self.likelihood.scaled_to(e.residual), dict[str, Predicted]()
        for pair in zip(*(screen(likelihood, e, lin, some) for some in (lin.kept, lin.early)), strict=True):
            for predicted in pair:
                found.setdefault(predicted.probe.effect, predicted)
        return list(found.values())

    def expand(self, key: frozenset[str], fitted: int = FITTED, place: str = "") -> None:
        """Fit the most promising effects beside a set, which had new directions there.

        place: effect in whose place they are; laws of its kind come first, as the linear model says little of their
        shapes. Where joints are separate it begins anew itself, too: each has a minimum of its own.

        Beside the best set all effects have where it leaves much: one may act only where this set has brought it. Where
        none of those that are fitted takes up half of that, the next ones are fitted, too. Of single effects the next
        ones are as long as none takes up a tenth: directions say little of a limit that a linear model does not reach.
        """
        if (key, place) in self.expanded:
            return
        self.expanded.add((key, place))
        e = self.sets[key].explanation
        likelihood = self.likelihood.scaled_to(e.residual)
        far = bool(key) and self.sets[key].excess > FAR and not place
        alike = {i for i, kind in self.kinds.items() if kind == self.kinds.get(place)}
        lin = self.lin
        if key:
            promising = [p.probe.effect for p in self.screen_beside(e, lin)[: None if far else LOOKED]]
            lin = self.linearise_beside(e, alike.union(promising), keep=not place)
        predicted = [p for p in self.screen_beside(e, lin) if self.may_join(key, p.probe.effects, again=alike)]
        if self.likelihood.robot.machine.separate and (again := [p for p in predicted if p.probe.effect == place]):
            self.add([self.fit_again(key | {place}, fit_beside(likelihood.for_stage("refine"), e, again))])
        new = [p for p in predicted if key.union(p.probe.effects) not in self.sets]
        new.sort(key=lambda p: p.probe.effect not in alike)
        fitted += sum(p.probe.effect in alike for p in new)
        self.progress(Stage.FIT, e.name)
        left = self.measure_left(self.sets[key]) * (HALF if key else 1.0 - LARGE)
        most = 2 * fitted if far else fitted
        for at in range(0, most if key or place else len(new), max(fitted, 1)):
            self.add(fit_beside(likelihood.for_stage("refine"), e, new[at : at + fitted]))
            if any(self.measure_left(f) < left for k, f in self.sets.items() if key < k and self.usable(f)):
                break
        self.bar_richer_laws()

    def linearise_beside(self, e: Explanation, wanted: Collection[str], keep: bool) -> Linearisation:
        """Directions beside an explanation, of some effects at least; keep: for further calls beside the same one."""
        known = self.beside[1] if self.beside and self.beside[0] is e else None
        have = {probe.effect for probe in known.probes} if known else set[str]()
        some = [x for x in self.effects if x.id in wanted and x.id not in have]
        lin = linearise(self.likelihood.for_stage("linearise again"), e.robot, some, e.residual, gap=e.residual)
        lin = known.join(lin) if known else lin
        self.beside = (e, lin) if keep else self.beside
        return lin

    def exchange(self, best: Fitted, effect: str) -> None:
        """Fit other effects in the place of one of a set, and the likeliest of them on, as that set was.

        Unless it leaves so much of what the one takes up that a cause would be lacking.
        """
        rest = best.effects - {effect}
        self.expand(rest, FITTED if rest else 0, place=effect)
        others = [f for f in self.find_replacements(best, effect).values() if self.usable(f)]
        if not others:
            return
        rival = max(others, key=self.evidence)
        self.converge(rival.effects, best.excess + LARGE * (self.sets[rest].excess - best.excess))

    def converge(self, key: frozenset[str], most: float = np.inf) -> None:
        """Fit a set on with new derivatives as long as it gains and leaves a visible gap, but no more than `most`."""
        for _ in range(SETTLED):
            before = self.sets[key]
            if before.excess > most:
                break
            self.add([self.fit_again(key)])
            after = self.sets[key]
            if self.evidence(after) - self.evidence(before) < NATS or self.excess(after.explanation.robot).whole < 0.0:
                break

    def fit_again(self, key: frozenset[str], others: Sequence[Explanation] = ()) -> Explanation:
        """A set fitted on with new derivatives, from the coordinates of sets like it where these cost less, by joint.

        others: further fits of it. Each fit ends in a minimum of its own: what one has found, another may lack. A law
        lends one of its kind in its place what is called alike, or amplitudes less of it.
        """
        e = self.sets[key].explanation
        likelihood, points = self.likelihood.scaled_to(e.residual).for_stage("refine again"), [e.x]

        def called(p: Parameter) -> tuple:
            return self.kinds.get(p.effect, p.effect), p.name.removeprefix(p.effect), p.channels

        for other in (*others, *(f.explanation for k, f in self.sets.items() if 0 < len(k ^ key) <= ALIKE)):
            known = dict(zip(other.parameters, other.x, strict=True))
            lent = {called(p): p.value(x) for p, x in known.items() if p.effect and p.effect not in key}
            lent = {p: p.coordinate(lent[called(p)]) for p in e.parameters if p not in known and called(p) in lent}
            x = np.array([known.get(p, lent.get(p, own)) for p, own in zip(e.parameters, e.x, strict=True)])
            scaled = np.array([p.amplitude and p in lent for p in e.parameters])
            points += [np.where(scaled, less * x, x) for less in (LESS if lent else LESS[:1])]
        begun = e.at_each(likelihood, list(np.clip(points, *e.bounds)))
        return settle(likelihood, Groups.of(likelihood, e).best(likelihood, begun))

    def fit_on(self, fitted: Fitted, jacobian: np.ndarray | None = None) -> Fitted:
        """A set fitted on to more of the logs: a part tells which set is best, values are as exact as it is long.

        jacobian: derivatives by the nominal parameters there, of a robot nearby.
        """
        before, more = fitted.explanation, self.fine.samples > self.likelihood.samples
        if not (more or before.effects):
            return fitted
        likelihood = self.longest
        if fitted not in self.precise:
            start = before
            if more:
                seen = before.find_visible(self.likelihood.scaled_to(before.residual)) & (jacobian is None)
                if jacobian is None:
                    jacobian = np.zeros((before.nominal, likelihood.samples), dtype=np.float32)
                start = renew(likelihood, replace(before, jacobian=jacobian).at(likelihood, before.x), seen)
            self.precise[fitted] = finish(likelihood.with_memory(start.residual), start)
        return self.precise[fitted]

    def fit_without(self, fitted: Fitted, gone: Collection[Parameter]) -> Fitted:
        """A set that was fitted on, fitted again without some amplitudes of its effects."""
        e, likelihood = fitted.explanation, self.longest
        kept = np.array([p not in gone for p in e.parameters])
        start = replace(e, parameters=tuple(p for p in e.parameters if p not in gone)).at(likelihood, e.x[kept])
        start.columns = whole_jacobian(likelihood, e)[e.nominal :][kept[e.nominal :]]
        return finish(likelihood.with_memory(start.residual), start)

    def is_negligible(self, fitted: Fitted) -> bool:
        """Whether a set leaves no visible gap over the whole logs, fitted on where the fitted part shows none."""
        left = self.excess(fitted.explanation.robot)
        if left.fitted < 0.0 <= left.whole:
            left = self.excess(self.fit_on(fitted).explanation.robot)
        return left.whole < 0.0

    def expand_nominal(self, nominal: Explanation) -> None:
        """Fit the most promising single effects from the nominal robot, where retuning strains its tolerances.

        They cost `SURE` more than in the mean of robots then. Such effects stand for what retuning moved: about the
        retuned robot the logs show nothing of them.
        """
        if self.none.tolerance_cost <= 0.5 * nominal.nominal + SURE:
            return
        likelihood = self.likelihood.scaled_to(nominal.residual).for_stage("refine")
        self.add(fit_beside(likelihood, nominal, self.screen_beside(nominal, self.lin)[:SINGLES]))
        likeliest = max((f for key, f in self.sets.items() if key), key=self.evidence)
        self.add([settle(likelihood.for_stage("refine again"), likeliest.explanation)])

    def take_over(self, before: Search) -> None:
        """Fit the sets of a search on fewer samples, from where they ended."""
        likelihood, jacobian = self.likelihood.for_stage("refine"), self.none.explanation.jacobian

        def fit(e: Explanation) -> Explanation:
            (start,) = replace(e, jacobian=jacobian).at_each(likelihood, [e.x])
            return minimise(likelihood.scaled_to(start.residual), start, tol=ROUGH)

        self.add(side_by_side([partial(fit, f.explanation) for key, f in before.sets.items() if key]))
        self.expanded = {(key, place) for key, place in before.expanded if place or not key}
        self.bar_richer_laws()

    def reduce(self, key: frozenset[str], again: bool = False) -> None:
        """Fit the sets with one effect less, from this set; again: also those that were fitted from elsewhere."""
        parts = [key - {i} for i in self.sets[key].explanation.effects]
        self.fit_parts(key, [part for part in parts if again or part not in self.sets])

    def fit_parts(self, key: frozenset[str], parts: Iterable[frozenset[str]]) -> None:
        """Fit parts of a set, from this set."""
        likelihood = self.likelihood.for_stage("refine")

        def smaller(part: frozenset[str]) -> Explanation:
            start = self.sets[key].explanation
            for effect in start.effects:
                start = start if effect in part else without(likelihood, start, effect)
            (again,) = start.at_each(likelihood, [np.r_[self.none.explanation.x, start.x[start.nominal :]]])
            start = min(start, again, key=lambda one: likelihood.mean_log(one.residual))
            return minimise(likelihood.scaled_to(start.residual), start)

        self.add(side_by_side([partial(smaller, part) for part in parts]))

    def run(self, most: int) -> Fitted:
        """The best set of at most so many effects."""
        self.expand(frozenset(), SINGLES)
        for _ in range(2 * most + 4):
            best = self.best
            self.likelihood = self.likelihood.with_memory(best.explanation.residual)
            best = self.best
            if best.effects:
                self.converge(best.effects)
                self.reduce(best.effects)
            if self.best.effects != best.effects:
                continue
            best = self.best
            for effect in sorted(best.effects):
                self.exchange(best, effect)
            if self.best.effects != best.effects:
                continue
            if self.measure_left(best) < TINY or self.is_negligible(best):
                break
            if len(best.effects) < most:
                self.expand(best.effects)
            if self.best.effects == best.effects and not self.look_further(best, most):
                break
        while True:
            best = self.plainer(self.best)
            self.reduce(best.effects, again=True)
            if not self.best.effects < best.effects:  # a smaller set, fitted again, may leave as little
                return best

    def look_further(self, best: Fitted, most: int) -> bool:
        """Look two effects ahead where the best set leaves much; whether the best set changed.

        One effect alone may not raise the evidence: those that a set lacks count as noise of long memory, which hides
        each step towards them. The pairs are those beside the set, larger by one, that leaves least, and those that
        leave least by the linear model, with a third effect beside the best of them.
        """
        size = len(best.effects)
        if size + 2 > most or best.excess <= FAR:
            return False

        def expand_larger(more: int, share: float) -> None:
            """Expand the set, larger by so many effects, that leaves least, if it leaves less than a share."""
            larger = [f for k, f in self.sets.items() if best.effects < k and len(k) == size + more and self.usable(f)]
            least = min(larger, key=lambda f: f.excess, default=best)
            if self.best.effects == best.effects and least.excess < share * best.excess:
                self.expand(least.effects)

        if size:
            expand_larger(1, 1.0 - LARGE)
        if self.best.effects == best.effects:
            self.expand_by_pairs(best)
        if size + 2 < most:
            expand_larger(2, HALF)
        return self.best.effects != best.effects

    def expand_by_pairs(self, best: Fitted) -> None:
        """Fit the pairs of effects beside a set that leave least by the linear model.

        They take up a tenth of what it leaves, half of the gap if there is no effect yet: a cause would be lacking.
        """
        key, e = best.effects, best.explanation
        if (key, PAIRS) in self.expanded:
            return
        self.expanded.add((key, PAIRS))
        likelihood = self.likelihood.scaled_to(e.residual)
        lin = self.linearise_beside(e, [x.id for x in self.effects], keep=True) if key else self.lin
        found = screen(likelihood, e, lin, lin.kept, pairs=True)
        least = (LARGE if key else HALF) * likelihood.cost(e.residual * lin.kept, e.x, e.prior_std)
        new = [p for p in found if p.gain > least and self.may_join(key, p.probe.effects)]
        new = [p for p in new if key.union(p.probe.effects) not in self.sets]
        self.add(fit_beside(likelihood.for_stage("refine"), e, new[:FITTED]))

    def may_join(self, key: frozenset[str], effects: Iterable[str], again: Collection[str] = ()) -> bool:
        """Whether effects may join a set: none is barred, and no two are laws of one kind that exclude each other.

        again: those that may, though they are barred.
        """
        kinds = [self.kinds[i] for i in key.union(effects)]
        alone = [kind for kind in kinds if kind[1] in ONE]
        return len(alone) == len(set(alone)) and not self.barred.difference(again).intersection(effects)

    def list_sparing(self, best: Fitted, size: int) -> list[Fitted]:
        """Sets of so many effects that spare `SURE` of the tolerances that the best one uses."""
        limit, others = best.tolerance_cost - SURE, (f for f in self.sets.values() if len(f.effects) == size)
        return [f for f in others if self.usable(f) and f.tolerance_cost < limit]


def finish(likelihood: Likelihood, start: Explanation) -> Fitted:
    """A set fitted from `start`, and from where the linear model about that fit costs least: the better of both.

    Where an effect acts as a nominal parameter does, as two factors of one product, a fit creeps along a curved valley:
    each step in it costs more than the priors gain. Derivatives are all those of one point: a corrected one beside a
    new one would look like knowledge, and give too narrow an interval.
    """
    likelihood = likelihood.scaled_to(start.residual)
    e = minimise(likelihood, start)
    if e.effects:
        leap = linear_model(likelihood, e).posterior().step
        further = minimise(likelihood, e.at(likelihood, np.clip(e.x + leap, *e.bounds)))
        e = min(e, further, key=lambda one: one.cost(likelihood))
    return Fitted.at(likelihood, replace(e, jacobian=start.jacobian, columns=start.columns))


def screen(
    likelihood: Likelihood, e: Explanation, lin: Linearisation, kept: np.ndarray, pairs: bool = False
) -> list[Predicted]:
    """Each effect that an explanation lacks, or two, by the best probe, those that lower the cost most first.

    kept: (samples,) mask of the samples that count.
    """
    cuts = np.cumsum([0, *(view.samples for view in likelihood.views)])
    blocks = [(v, 0, slice(int(cuts[v]), int(cuts[v + 1]))) for v in range(len(likelihood.views))]
    columns = whole_jacobian(likelihood, e)
    model = LinearModel.with_directions(e, columns, lin.directions, blocks, likelihood.memory, kept=kept)
    variance = np.array([v.scale**2 for v in likelihood.views]) / likelihood.memory
    reduced = replace(model, variance=variance).eliminate(len(e.x))

    def predict(probe: Probe) -> Predicted:
        at = probe.rows
        factors, change = minimise_bounded(reduced.normal[np.ix_(at, at)], reduced.slope[at], probe.low, probe.high)
        return Predicted(probe, factors, -change, e.x + reduced.others(at, factors))

    best: dict[str, Predicted] = {}
    for found in map(predict, (p for p in lin.probes if p.effect not in e.effects)):
        best[found.probe.effect] = max(best.get(found.probe.effect, found), found, key=lambda p: p.gain)
    both = (predict(a.probe.beside(b.probe)) for a, b in combinations(best.values(), 2))
    return sorted(both if pairs else best.values(), key=lambda p: -p.gain)
