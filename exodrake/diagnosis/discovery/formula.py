"""A plain formula for a free law: few named terms, selected greedily on the law's linear model.

    f(u) = b_1 t_1(u) + b_2 t_2(u) + ...        cost = S + p log(n)        (Bayesian information criterion)

S: weighted sum of squares left by the terms; p: number of coefficients; n: number of independent samples. A formula is
stated only where it is at least as likely as the free curve.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from exodrake.core.part import HYSTERESIS
from exodrake.diagnosis.discovery.candidates import Candidate
from exodrake.diagnosis.discovery.law_code import SIZE
from exodrake.diagnosis.linear import RIDGE, Reduced

MOST = 3  # terms
GRID = 200  # points on which a term is approximated by a curve
WIDTHS = (0.02, 0.05, 0.1, 0.14, 0.2, 0.28, 0.4)  # of terms with a width, in the largest |u|
BENDS = (0.2, 0.35, 0.5, 0.65, 0.8)  # of terms with a bend, in the range of u


@dataclass(frozen=True, eq=False)
class Term:
    """A named term: its text with u, and its values (channels, 8) at the knots, or of the elements."""

    text: str
    values: np.ndarray


def terms_of(candidate: Candidate) -> Iterator[Term]:
    """Named terms that a law may be made of."""
    form, u = candidate.form, candidate.knots
    if not form.is_curve:
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


def formulas(
    candidate: Candidate, active: list[int], reduced: Reduced, modes: np.ndarray, scales: np.ndarray, samples: float
) -> dict[str, str]:
    """The shortest formula that is as likely as the free law, channel by channel; none without one.

    Args:
        candidate: the law.
        active: positions of the channels that have it.
        reduced: linear model of its modes alone, in steps from the fit.
        modes: (active * 8,) fitted coordinates.
        scales: (active,) their prior standard deviations.
        samples: number of independent samples.
    """
    penalty, back = float(np.log(samples)), np.linalg.inv(candidate.basis)
    prior = np.repeat(scales, SIZE)
    volume = np.linalg.slogdet(np.eye(len(prior)) + reduced.normal * np.outer(prior, prior))[1]
    free = float(np.sum((modes / prior) ** 2) + volume)

    def coordinates(term: Term) -> np.ndarray:
        """The term in one active channel each (channels, n)."""
        found = np.zeros((len(active), len(active), SIZE))
        for i, channel in enumerate(active):
            found[i, i] = back @ term.values[channel] / candidate.size[channel]
        return found.reshape(len(active), -1)

    def solved(terms: list[Term]) -> tuple[float, np.ndarray]:
        """Cost beyond that of the fit, and coefficients (terms of each active channel,)."""
        t = np.concatenate([known[term] for term in terms]).T if terms else np.zeros((len(modes), 0))
        normal, slope = t.T @ reduced.normal @ t, t.T @ (reduced.slope - reduced.normal @ modes)
        b = -np.linalg.solve(normal + np.diag(RIDGE * np.diag(normal) + 1e-12), slope)
        step = t @ b - modes
        return float(2.0 * reduced.slope @ step + step @ reduced.normal @ step) + penalty * len(b), b

    known = {term: coordinates(term) for term in terms_of(candidate)}
    chosen: list[Term] = []
    while len(chosen) < MOST and solved(chosen)[0] > free:
        trial = min((t for t in known if t not in chosen), key=lambda t: solved([*chosen, t])[0])
        if solved([*chosen, trial])[0] >= solved(chosen)[0]:
            break
        chosen.append(trial)
    if not chosen or solved(chosen)[0] > free:
        return {}
    for term in chosen[:-1]:  # that a later one made needless
        less = [t for t in chosen if t is not term]
        chosen = less if solved(less)[0] < solved(chosen)[0] else chosen
    table = solved(chosen)[1].reshape(len(chosen), len(active))
    return {candidate.channels[c]: text_of(chosen, table[:, i]) for i, c in enumerate(active)}


def text_of(terms: list[Term], coefficients: np.ndarray) -> str:
    """The formula with some coefficients."""
    pieces = []
    for term, b in zip(terms, coefficients, strict=True):
        size = f"{abs(b):.3g}" + ("" if term.text == "1" else f" {term.text}")
        pieces.append(("- " if b < 0.0 else "+ ") + size)
    return "f(u) = " + " ".join(pieces).removeprefix("+ ")
