"""Candidates for the missing law: a form at a point with its knots, its basis, its plausible size, and its formula.

Where the variable of a law goes is measured by watches, effects that count in the simulated robot. A formula is made of
few named terms, selected greedily on the law's linear model:

    f(u) = b_1 t_1(u) + b_2 t_2(u) + ...        cost = S + p log(n)        (Bayesian information criterion)

S: weighted sum of squares left by the terms; p: number of coefficients; n: number of independent samples. It is stated
only where it is at least as likely as the free curve.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg import block_diag

from exodrake.compiled.compose import compile_machine
from exodrake.compiled.inputs import NOTHING, NoiseInputs, input_rows
from exodrake.core.machine import signal_count, state_size
from exodrake.core.parallel import side_by_side
from exodrake.core.part import HYSTERESIS, RELAXATION, FreeLaw
from exodrake.diagnosis.discovery.law_code import SIZE, LawPoint
from exodrake.diagnosis.linear import RIDGE, Reduced
from exodrake.diagnosis.problem import Problem, Trial

LENGTH = 0.4  # correlation length of a curve in its range: assumed
FINE = 40.0  # range over the width near 0 in which knots lie close: assumed
REACHES = (0.01, 0.6)  # of hysteresis, smallest and largest in ranges of the variable: assumed
MODEST = 0.05  # size of a law in the range of its point's value: small against curvature, large against rounding
FRAMES = 2.0  # shortest memory
MOST = 3  # terms of a formula
GRID = 200  # points on which a term is approximated by a curve
WIDTHS = (0.02, 0.05, 0.1, 0.14, 0.2, 0.28, 0.4)  # of terms with a width, in the largest |u|
BENDS = (0.2, 0.35, 0.5, 0.65, 0.8)  # of terms with a bend, in the range of u


@dataclass(frozen=True, eq=False)
class Candidate:
    """A candidate for the missing law: a form at a point."""

    law: LawPoint
    number: int  # of the form, from 1
    channels: tuple[str, ...]
    knots: np.ndarray  # (channels, 8) of the curve, reaches of hysteresis [unit of u] or time constants [s]
    size: np.ndarray  # (channels,) plausible weight
    basis: np.ndarray  # (8, 8) weights of the modes in units of size, largest prior variance first
    low: np.ndarray  # (channels,) lowest value of its variable in the simulated logs [unit of u]
    high: np.ndarray  # (channels,) highest value [unit of u]

    @property
    def form(self) -> FreeLaw:
        """Its form."""
        return self.law.forms[self.number - 1]

    @property
    def name(self) -> str:
        """Id of the effect and its form in words."""
        return f"{self.law.learned}: {self.form.words}"

    def shape(self) -> tuple[np.ndarray, np.ndarray]:
        """Curves of the law: abscissas (channels, points), and values per weight (channels, points, 8).

        A curve at its knots; hysteresis as the first loading from rest; relaxation as the answer to a step.
        """
        if self.form.is_curve:
            return self.knots, np.tile(np.eye(SIZE), (len(self.knots), 1, 1))
        at = np.concatenate([np.zeros((len(self.knots), 1)), self.knots], axis=1)
        ratio = at[:, :, None] / self.knots[:, None, :]
        return at, np.minimum(ratio, 1.0) if self.form.kind == HYSTERESIS else np.exp(-ratio)


def run_watches(
    problem: Problem, values: np.ndarray, settings: Mapping[str, Mapping[str, float | np.ndarray]]
) -> dict[str, dict[str, np.ndarray]]:
    """States of watches at the ends of all fitted trials, which a robot runs in closed loop without noise.

    Args:
        problem: the case.
        values: (parameters,) of the robot.
        settings: id of each law to be watched -> parameters of its watch.

    Returns:
        The same id -> name of a state -> (trials, channels).
    """
    machine, row = problem.robot.machine, values.copy()
    module = compile_machine(machine)
    for identity, given in settings.items():
        for name, value in given.items():
            row[[*machine.effect_indices(f"{identity}_watch", name).values()]] = value

    def end_state(trial: Trial) -> np.ndarray:
        n, state, w = len(trial.reference), np.zeros(state_size(machine)), np.zeros(signal_count(machine))
        noise = NoiseInputs.draw(n, None, machine)
        noise |= {name: given[:n] for name, given in trial.latent.items()}
        module.begin(row, state)
        given = input_rows(machine, trial.reference, noise).values()
        module.run(row, state, w, *given, machine.slot, 1, np.zeros((n, len(w))), NOTHING, NOTHING)
        return state

    ends = np.array(side_by_side([partial(end_state, trial) for trial in problem.fit]))
    found, at = {identity: dict[str, np.ndarray]() for identity in settings}, 0
    for part in machine.parts:
        at += machine.part_size(part)[0]
        for effect in machine.effects_on(part):
            for state in effect.states:
                width = machine.width(state.axis)
                if (law := effect.id.removesuffix("_watch")) != effect.id and law in found:
                    found[law][state.name] = ends[:, at : at + width]
                at += width * state.width
    return found


def list_candidates(problem: Problem, values: np.ndarray, laws: Sequence[LawPoint]) -> list[Candidate]:
    """All laws that may be missing at some points, where a robot `values` (parameters,) with watches runs a case."""
    machine, found = problem.robot.machine, list[Candidate]()
    longest = max(len(trial.reference) for trial in problem.fit) * machine.frame
    ranges: dict[
        tuple[str, int], tuple[np.ndarray, np.ndarray]
    ] = {}  # (channels,) each, of variables that are computed
    for k in range(1, max((len(law.forms) for law in laws), default=-1) + 2):
        settings = {law.identity: {"form": float(k)} for law in laws if k <= len(law.forms) + 1}
        for identity, states in run_watches(problem, values, settings).items():
            if states["started"].any():
                low, high = states["low_seen"].min(axis=0), states["high_seen"].max(axis=0)
                ranges[identity, k] = low, np.where(high > low, high, low + 1e-9)
    for law, k, form in ((one, k, form) for one in laws for k, form in enumerate(one.forms, 1)):
        if not {(law.identity, k), (law.identity, len(law.forms) + 1)} <= set(ranges):
            continue
        (low, high), (least, most) = ranges[law.identity, k], ranges[law.identity, len(law.forms) + 1]
        # plausible weights: the range of the value that passes, over that of the factor
        size = np.maximum(most - least, 0.5 * np.maximum(abs(least), abs(most)))
        size = np.maximum(size, 0.1 * max(float(size.max()), 1e-6))
        span = np.maximum(high - low, 1e-6 * np.maximum(1.0, abs(low)))
        if form.kind == RELAXATION:
            knots = np.tile(np.geomspace(FRAMES * machine.frame, 0.5 * longest, SIZE), (len(low), 1))
            size = size / np.maximum(high - low, 1e-9)
        elif form.kind == HYSTERESIS:
            knots = span[:, None] * np.geomspace(*REACHES, SIZE)
        elif form.fine:
            near = span / FINE
            knots = (near * np.sinh(np.linspace(np.arcsinh(low / near), np.arcsinh((low + span) / near), SIZE))).T
        else:
            knots = np.linspace(low, low + span, SIZE).T
        if form.kind != RELAXATION and form.factor not in ("", "-1.0") and form.factor.isidentifier():
            size = np.ones(len(size))
        # modes of the prior of the weights: smooth curves (a Gaussian process), or independent elements
        basis = np.eye(SIZE)[:, [1, 3, 5, 7, 0, 2, 4, 6]]
        if form.is_curve:
            apart = np.sqrt(3.0) * abs(np.subtract.outer(np.arange(SIZE), np.arange(SIZE))) / (SIZE - 1) / LENGTH
            variances, vectors = np.linalg.eigh(1.0 + (1.0 + apart) * np.exp(-apart))  # a constant, and Matern 3/2
            basis = (vectors * np.sqrt(variances))[:, ::-1]
        found.append(Candidate(law, k, machine.axes.of(law.point.axis), knots, MODEST * size, basis, low, high))
    return found


def find_terms(candidate: Candidate) -> Iterator[tuple[str, np.ndarray]]:
    """Named terms that a law may be made of: text with u, and values (channels, 8) at the knots, or of the elements."""
    form, u = candidate.form, candidate.knots
    if not form.is_curve:
        word, unit = ("stop", form.unit) if form.kind == HYSTERESIS else ("fading", "s")
        for i in range(SIZE):
            yield f"{word}(u; {float(np.median(u[:, i])):.2g} {unit})", np.tile(np.eye(SIZE)[i], (len(u), 1))
        return
    low, high = float(u.min()), float(u.max())
    largest = max(abs(low), abs(high))
    signed = low < -0.05 * largest
    terms: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "1": np.ones_like, "u": lambda u: u, "u^2": lambda u: u**2, "u^3": lambda u: u**3,
    }  # fmt: skip
    if signed:
        terms |= {"sign(u)": np.sign, "|u|": abs, "u |u|": lambda u: u * abs(u)}
    for c in (w * largest for w in WIDTHS):
        name = f"exp(-|u| / {c:.2g}) sign(u)" if signed else f"exp(-u / {c:.2g})"
        terms[name] = lambda u, c=c: np.exp(-abs(u) / c) * np.sign(u) if signed else np.exp(-u / c)
        terms[f"tanh(u / {c:.2g})"] = lambda u, c=c: np.tanh(u / c)
        terms[f"sin(u / {c:.2g})"] = lambda u, c=c: np.sin(u / c)
    for c in (low + b * (high - low) for b in BENDS):
        terms[f"max(0, u - {c:.2g})"] = lambda u, c=c: np.maximum(0.0, u - c)
        terms[f"max(0, {c:.2g} - u)"] = lambda u, c=c: np.maximum(0.0, c - u)
    for text, function in terms.items():
        curves = []
        for knots in u:  # the curve that is nearest to the function over the range of the knots
            at = np.linspace(knots[0], knots[-1], GRID)
            hats = np.array([np.interp(at, knots, one) for one in np.eye(SIZE)]).T
            curves.append(np.linalg.lstsq(hats, np.broadcast_to(function(at), at.shape), rcond=None)[0])
        yield text, np.array(curves)


def find_formulas(
    candidate: Candidate, active: list[int], reduced: Reduced, modes: np.ndarray, scales: np.ndarray, samples: float
) -> dict[str, str]:
    """The shortest formula that is as likely as the free law, by channel; none without one.

    `reduced` is the linear model of the modes of the `active` channels about the fitted coordinates `modes`
    (active * 8,) with prior standard deviations `scales` (active,), from so many independent samples.
    """
    penalty, back = float(np.log(samples)), np.linalg.inv(candidate.basis)
    prior = np.repeat(scales, SIZE)
    volume = np.linalg.slogdet(np.eye(len(prior)) + reduced.normal * np.outer(prior, prior))[1]
    free, texts, known = float(np.sum((modes / prior) ** 2) + volume), [], []
    for text, values in find_terms(candidate):  # coordinates of each term in one active channel each (active, n)
        texts.append(text)
        known.append(block_diag(*(back @ values[channel] / candidate.size[channel] for channel in active)))

    def solve(terms: list[int]) -> tuple[float, np.ndarray]:
        """Cost beyond that of the fit, and coefficients (terms of each active channel,)."""
        t = np.concatenate([known[term] for term in terms]).T if terms else np.zeros((len(modes), 0))
        normal, slope = t.T @ reduced.normal @ t, t.T @ (reduced.slope - reduced.normal @ modes)
        b = -np.linalg.solve(normal + np.diag(RIDGE * np.diag(normal) + 1e-12), slope)
        step = t @ b - modes
        return float(2.0 * reduced.slope @ step + step @ reduced.normal @ step) + penalty * len(b), b

    chosen: list[int] = []
    while len(chosen) < MOST and solve(chosen)[0] > free:
        trial = min(set(range(len(known))) - set(chosen), key=lambda term: solve([*chosen, term])[0])
        if solve([*chosen, trial])[0] >= solve(chosen)[0]:
            break
        chosen.append(trial)
    if not chosen or solve(chosen)[0] > free:
        return {}
    for term in chosen[:-1]:  # that a later one made needless
        less = [one for one in chosen if one != term]
        chosen = less if solve(less)[0] < solve(chosen)[0] else chosen
    found, table = {}, solve(chosen)[1].reshape(len(chosen), len(active))
    for i, channel in enumerate(active):
        named = ["" if texts[term] == "1" else f" {texts[term]}" for term in chosen]
        formula = "".join(
            f" {'-' if b < 0.0 else '+'} {abs(b):.3g}{n}" for b, n in zip(table[:, i], named, strict=True)
        )
        found[candidate.channels[channel]] = f"f(u) ={formula.removeprefix(' +')}"
    return found
