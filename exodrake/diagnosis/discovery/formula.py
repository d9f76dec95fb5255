"""A plain formula for a free law: few named terms, selected greedily on the law's linearisation.

    f(u) = b_1 t_1(u) + b_2 t_2(u) + ...        cost = S / v + p log(n)        (Bayesian information criterion)

S: sum of squares left by the terms; v: variance of a sample beside the free curve; p: number of coefficients; n: number
of independent samples. A formula is stated only where it is at least as likely as the free curve.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from exodrake.diagnosis.discovery.candidate import CandidateLaw
from exodrake.diagnosis.discovery.effect_text import SIZE
from exodrake.diagnosis.discovery.fit import Fit
from exodrake.diagnosis.discovery.forms import CURVE, HYSTERESIS, PLACE

MOST = 3  # terms
GRID = 200  # points on which a term is approximated by a curve
WIDTHS = (0.02, 0.05, 0.1, 0.14, 0.2, 0.28, 0.4)  # of terms with a width, in the largest |u|
BENDS = (0.2, 0.35, 0.5, 0.65, 0.8)  # of terms with a bend, in the range of u


@dataclass(frozen=True)
class Term:
    """A named term: its text with u, and its values (channels, 8) at the knots, or of the elements."""

    text: str
    values: np.ndarray

    def __hash__(self) -> int:
        return hash(self.text)


@dataclass(frozen=True)
class Formula:
    """Terms with coefficients.

    Attributes:
        terms: texts with u.
        coefficients: channel -> coefficients.
        std: channel -> their standard deviations.
    """

    terms: tuple[str, ...]
    coefficients: dict[str, tuple[float, ...]]
    std: dict[str, tuple[float, ...]]

    def text(self, channel: str) -> str:
        """The formula of a channel."""
        pieces = []
        for term, b in zip(self.terms, self.coefficients[channel], strict=True):
            size = f"{abs(b):.3g}" + ("" if term == "1" else f" {term}")
            pieces.append(("- " if b < 0.0 else "+ ") + size)
        return "f(u) = " + " ".join(pieces).removeprefix("+ ")


def terms_of(candidate: CandidateLaw) -> Iterator[Term]:
    """Named terms that a law may be made of."""
    form, u = candidate.form, candidate.knots
    if form.kind not in (CURVE, PLACE):
        word, unit = ("stop", form.unit) if form.kind == HYSTERESIS else ("fading", "s")
        for i in range(SIZE):
            yield Term(f"{word}(u; {float(np.median(u[:, i])):.2g} {unit})", np.tile(np.eye(SIZE)[i], (len(u), 1)))
        return
    for text, function in named(float(u.min()), float(u.max())):
        yield Term(text, np.array([projected(k, function) for k in u]))


def projected(knots: np.ndarray, function: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Values (8,) at the knots of the curve that is nearest to a function over their range."""
    at = np.linspace(knots[0], knots[-1], GRID)
    hats = np.array([np.interp(at, knots, one) for one in np.eye(SIZE)]).T
    return np.linalg.lstsq(hats, np.broadcast_to(function(at), at.shape), rcond=None)[0]


def named(low: float, high: float) -> Iterator[tuple[str, Callable[[np.ndarray], np.ndarray]]]:
    """Terms of a curve over a range, by their text."""
    largest = max(abs(low), abs(high))
    yield from (("1", np.ones_like), ("u", lambda u: u), ("u^2", lambda u: u**2), ("u^3", lambda u: u**3))
    signed = low < -0.05 * largest
    if signed:
        yield from (("sign(u)", np.sign), ("|u|", abs), ("u |u|", lambda u: u * abs(u)))
    for c in (w * largest for w in WIDTHS):
        if signed:
            yield f"exp(-|u| / {c:.2g}) sign(u)", lambda u, c=c: np.exp(-abs(u) / c) * np.sign(u)
        else:
            yield f"exp(-u / {c:.2g})", lambda u, c=c: np.exp(-u / c)
        yield f"tanh(u / {c:.2g})", lambda u, c=c: np.tanh(u / c)
        yield f"sin(u / {c:.2g})", lambda u, c=c: np.sin(u / c)
    for c in (low + b * (high - low) for b in BENDS):
        yield f"max(0, u - {c:.2g})", lambda u, c=c: np.maximum(0.0, u - c)
        yield f"max(0, {c:.2g} - u)", lambda u, c=c: np.maximum(0.0, c - u)


@dataclass(frozen=True, eq=False)
class TermFit:
    """Terms fitted to the free law.

    Attributes:
        cost: S / v + p log(n).
        coefficients: (terms of each active channel,).
        covariance: of the coefficients.
    """

    cost: float
    coefficients: np.ndarray
    covariance: np.ndarray


def formula(fit: Fit) -> Formula | None:
    """The shortest formula as likely as the free law, or none."""
    model, columns, weighed = fit.model, fit.columns, fit.weighed
    assert model is not None and columns is not None and weighed is not None
    penalty, free, v = np.log(model.samples), weighed.penalised, weighed.variance
    gram, slope, without = model.gram(columns, v), model.slope(columns, v), model.left(v)
    back = np.linalg.inv(fit.candidate.basis)
    known = {term: coordinates(fit, term, back) for term in terms_of(fit.candidate)}
    chosen: list[Term] = []
    best = without

    def solved(terms: list[Term]) -> TermFit:
        t = np.concatenate([known[term] for term in terms]).T
        normal = t.T @ gram @ t
        normal = normal + 1e-9 * np.diag(np.diag(normal)) + 1e-12 / v * np.eye(len(normal))
        b = -np.linalg.solve(normal, t.T @ slope)
        left = without + 2.0 * (t.T @ slope) @ b + b @ normal @ b
        return TermFit(left + penalty * len(b), b, np.linalg.inv(normal))

    while len(chosen) < MOST:
        trial = min((t for t in known if t not in chosen), key=lambda t: solved([*chosen, t]).cost)
        cost = solved([*chosen, trial]).cost
        if cost >= best:
            break
        chosen, best = [*chosen, trial], cost
        if best <= free:
            break
    if not chosen or best > free:
        return None
    chosen, best = shortened(chosen, best, solved)
    found = solved(chosen)
    return stated(fit, chosen, found.coefficients, np.sqrt(np.maximum(np.diag(found.covariance), 0.0)))


def shortened(chosen: list[Term], best: float, solved: Callable[[list[Term]], TermFit]) -> tuple[list[Term], float]:
    """Terms without those that a later one made needless."""
    for term in chosen[:-1]:
        less = [t for t in chosen if t is not term]
        if (cost := solved(less).cost) < best:
            chosen, best = less, cost
    return chosen, best


def coordinates(fit: Fit, term: Term, back: np.ndarray) -> np.ndarray:
    """Coordinates (channels, n) of a term in one active channel each."""
    found = np.zeros((len(fit.active), len(fit.active), SIZE))
    for i, channel in enumerate(fit.active):
        found[i, i] = back @ term.values[channel] / fit.candidate.size[channel]
    return found.reshape(len(fit.active), -1)


def stated(fit: Fit, terms: list[Term], b: np.ndarray, std: np.ndarray) -> Formula:
    """The formula with the coefficients of each channel."""
    count = len(fit.active)
    table, error = b.reshape(len(terms), count), std.reshape(len(terms), count)
    names = [fit.candidate.channels[i] for i in fit.active]
    coefficients = {name: tuple(map(float, table[:, i])) for i, name in enumerate(names)}
    errors = {name: tuple(map(float, error[:, i])) for i, name in enumerate(names)}
    return Formula(tuple(t.text for t in terms), coefficients, errors)
