"""Retuning: the nominal numbers fitted alone, from the nominal robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.diagnosis.fit import Fitter, Point

RETUNES = 4  # rounds at most
ENDING = 0.1  # a round that lowers the cost by less than this share is the last: they converge quadratically
# reduced chi-square: below the first, effects are screened from the retuned robot, not from the nominal one; below
# the second, fits are minimised with care, since there an effect is judged by the little that it gains
NEARBY, CLOSE = 60.0, 1.5
LEAPS = (-0.6, -0.3, 0.3, 0.6)  # of a stop's limit, where it is tried
LEAP_GAIN = 50.0  # cost that must be promised for a fit from there


@dataclass(frozen=True, eq=False)
class Retuned:
    """The fitted point; the point that effects are screened from, with the responses there (samples, nominal
    coordinates).
    """

    point: Point
    base: Point
    responses: np.ndarray


def retuned(fitter: Fitter, origin: Point) -> Retuned:
    """The nominal numbers fitted, their responses taken anew until that gains no more."""
    point = base = origin
    kept: np.ndarray | None = None
    for turn in range(RETUNES):
        responses = fitter.responses(point)
        kept = responses if kept is None else kept
        better = fitter.fit(point, responses, steps=8)
        if ending(point, better) or turn == RETUNES - 1:
            better = multi_started(fitter, better, responses)
        if better.chi2 < NEARBY:
            base, kept = better, responses
        ended, point = ending(point, better), better
        if ended:
            break
    assert kept is not None
    if point.chi2 < CLOSE:
        point, kept = fitter.minimised(point)
        base = point
    return Retuned(point, base, kept)


def ending(before: Point, after: Point) -> bool:
    """Whether a round gained so little that it is the last."""
    return before.cost - after.cost < ENDING * after.cost


def multi_started(fitter: Fitter, point: Point, responses: np.ndarray) -> Point:
    """The point, or a better one with an end stop elsewhere: it is met suddenly, and a fit from its wrong side stays
    there.
    """
    for i in (
        i
        for i, coordinate in enumerate(fitter.coordinates)
        if coordinate.name.startswith(fitter.problem.robot.machine.end_stops)
    ):
        leaps = (fitter.leap(point, responses, i, share * fitter.limit[i]) for share in LEAPS)
        promised, x = min(leaps, key=lambda found: found[0])
        if promised < point.cost - LEAP_GAIN:
            trial = fitter.fit(fitter.at(point.hypothesis, point.u, x), responses, steps=8)
            point = trial if trial.cost < point.cost else point
    return point
