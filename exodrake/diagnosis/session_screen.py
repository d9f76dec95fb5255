"""Screening session by session: single effects by the linearisation, with amplitudes of their own in each session.

    r = r0 + J x + D_s f_s        f_s = -S^-1 s,  the nominal parameters x shared and eliminated (`projection`)

An effect that begins or grows during the sessions may explain less of their mean than a wrong effect does.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from scipy.linalg import block_diag

from exodrake.diagnosis.isolation import Isolation, Tested, tested
from exodrake.diagnosis.linearise import Probe, with_effects
from exodrake.diagnosis.projection import RIDGE, Projection
from exodrake.diagnosis.refine import Explanation
from exodrake.diagnosis.sessions import Session, rows_of

MORE = 2  # effects that are added to those that were fitted with constant parameters


def screened(found: Isolation, sessions: Sequence[Session], known: Collection[str]) -> list[Tested]:
    """Effects beside the known ones that take up most with amplitudes of their own in each session, at their means.

    None for windows of one log: only some frames of it are linearised.
    """
    if sessions[0].frames is not None:
        return []
    best: dict[str, tuple[float, Probe, np.ndarray]] = {}
    likelihood, retuned = found.likelihood.scaled_to(found.retuned.explanation.residual), found.retuned.explanation
    split = Split(Projection(likelihood, retuned, found.beside_retuned), sessions)
    for probe in found.beside_retuned.probes:
        gain, factors = split(probe)
        if probe.effect not in known and gain > best.get(probe.effect, (0.0,))[0]:
            best[probe.effect] = (gain, probe, factors)
    chosen = sorted(best.values(), key=lambda one: -one[0])[:MORE]
    return [tested(found.likelihood, found.tests, [started(found, probe, f.mean(axis=0))])[0] for _, probe, f in chosen]


def started(found: Isolation, probe: Probe, factors: np.ndarray) -> Explanation:
    """The retuned robot with an effect at factors (directions,) of its probe."""
    known, machine = found.retuned.explanation, found.likelihood.robot.machine
    values = with_effects(known.values, [(machine, machine.effect(probe.effect))])
    parameters = known.parameters + probe.parameters
    x = np.r_[known.x, probe.coordinates(factors)]
    joined = Explanation((probe.effect,), parameters, x, values, known.residual, known.jacobian)
    return joined.at(found.likelihood, np.clip(x, *joined.bounds))


class Split:
    """A projection whose directions have factors of their own in each session."""

    def __init__(self, project: Projection, sessions: Sequence[Session]) -> None:
        residual, pull = project.pull(project.explanation.residual[None], project.explanation.use[None])
        self.inverse, self.pull = project.inverse, pull[:, 0]
        rows = [rows_of(project.likelihood, session) for session in sessions]
        self.directions = [project.directions[:, r] * project.weights[r] for r in rows]
        self.cross = [(project.fitted[:, r] @ d.T).astype(float) for r, d in zip(rows, self.directions, strict=True)]
        self.slopes = [(d @ residual[0, r]).astype(float) for r, d in zip(rows, self.directions, strict=True)]

    def __call__(self, probe: Probe) -> tuple[float, np.ndarray]:
        """Sum of squares that a probe takes up, and its factors (sessions, directions)."""
        cross = np.concatenate([c[:, probe.rows] for c in self.cross], axis=1)
        slope = np.concatenate([s[probe.rows] for s in self.slopes]) - cross.T @ (self.inverse @ self.pull)
        own = [d[probe.rows] for d in self.directions]
        normal = block_diag(*[(d @ d.T).astype(float) for d in own]) - cross.T @ self.inverse @ cross
        normal += 1e3 * RIDGE * np.diag(np.diag(normal)) + RIDGE * np.eye(len(normal))
        factors = -np.linalg.solve(normal, slope)
        return float(-slope @ factors), factors.reshape(len(own), -1)
