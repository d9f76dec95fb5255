"""Free inputs: evidence that a block has an input of unknown course, at a point where an effect may act.

    r_t = J_t x + F_t c_t + e_t         x ~ N(0, P^-1)     c_tj ~ N(0, s_j^2)     e ~ N(0, v_kind)

r: whitened prediction errors in a cell of time t. x: nominal parameters. F: responses to an effect, or to a change of a
nominal parameter, in each channel j. c: its amplitudes, free in each cell. So no law is needed, only the pattern that
an input at that point leaves in the signals (unknown inputs; Frank, Automatica 26(3), 1990). `free_input_evidence` has
the evidence.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from exodrake.diagnosis.fit import Explanation
from exodrake.diagnosis.free_input_evidence import CELL, Cells
from exodrake.diagnosis.likelihood import SAMPLE, Likelihood
from exodrake.diagnosis.linearise import Linearisation

LARGEST = 1.0  # relative change of a nominal parameter that stands for a fault; assumed
WHOLE = ("",)  # channels of an input of the whole robot
LEAST = 10  # cells of a case whose inputs are compared
SMALL = 1e-2  # response [noise_std] that counts as none


@dataclass(frozen=True, eq=False)
class Input:
    """A free input.

    Attributes:
        name: id of an effect, or name of a nominal parameter.
        channels: that have one each; one without a name for the whole robot.
        responses: (channels, samples) to an amplitude of 1, of the last view.
        largest: (channels,) plausible amplitude.
    """

    name: str
    channels: tuple[str, ...]
    responses: np.ndarray
    largest: np.ndarray


@dataclass(frozen=True, eq=False)
class Course:
    """A fitted free input.

    Attributes:
        name: name of the input.
        channels: channels that respond.
        gain: log evidence above that without an input.
        share: share of the residual's variance that it takes up by that.
        size: (channels,) root mean square amplitudes.
        count: (channels,) number of amplitudes that the logs determine.
    """

    name: str
    channels: tuple[str, ...]
    gain: float
    share: float
    size: np.ndarray
    count: np.ndarray

    @property
    def block(self) -> str:
        """Block in which it acts."""
        return self.name.split(".")[0]


def inputs_of(likelihood: Likelihood, lin: Linearisation, e: Explanation) -> list[Input]:
    """Free inputs at every effect of a linearisation, and at every nominal parameter of a block with effects."""
    responses, found = likelihood.split(lin.directions)[-1], {}
    for probe in lin.probes:  # an effect with channels has its directions by channel first
        if probe.effect not in found or found[probe.effect].channels == WHOLE:
            channels = tuple((probe.parameters[i].channels or WHOLE)[0] for i in probe.scaled) or WHOLE
            largest = np.maximum(np.abs(probe.low), np.abs(probe.high))
            found[probe.effect] = Input(probe.effect, channels, responses[probe.rows], largest)
    return [*found.values(), *nominal_inputs(likelihood, e)]


def nominal_inputs(likelihood: Likelihood, e: Explanation) -> list[Input]:
    """Free inputs at nominal parameters, those of all channels together."""
    machine, jacobian = likelihood.robot.machine, likelihood.split(e.jacobian)[-1]
    blocks, known = {effect.block for effect in machine.effects}, {*machine.axes.tendons, *machine.axes.joints}
    groups: dict[str, dict[str, int]] = {}
    for i, p in enumerate(e.parameters[: e.nominal]):
        name = p.name.split()[0]
        stem, _, last = name.rpartition(".")
        if name.split(".")[0] in blocks:
            groups.setdefault(stem if last in known else name, {})[last if last in known else ""] = i
    return [
        Input(f"{name}, nominal", tuple(rows), jacobian[list(rows.values())], np.full(len(rows), LARGEST))
        for name, rows in groups.items()
    ]


def course(cells: Cells, given: Input) -> Course | None:
    """A free input fitted; None for one that leaves nothing in the logs."""
    responses = cells.cut(given.responses)
    strength = np.sqrt(np.mean(np.sum(responses**2, axis=1), axis=0))
    on = np.flatnonzero(np.max(np.abs(responses), axis=(0, 1), initial=0.0) > SMALL)
    if not len(on):
        return None
    products = cells.products(responses[:, :, on] / strength[on])
    found = cells.fitted(products, cells.first_scale(products), given.largest[on] * strength[on])
    gain = max(found.log_evidence - cells.alone.log_evidence, 0.0)
    share = 1.0 - float(np.exp(-2.0 * gain / np.sum(cells.count)))
    channels = tuple(given.channels[i] for i in on)
    return Course(given.name, channels, gain, share, found.scale / strength[on], found.count)


def free_courses(likelihood: Likelihood, lin: Linearisation, e: Explanation) -> list[Course]:
    """Free inputs that raise the evidence of the logs, best first.

    Args:
        likelihood: views of the case.
        lin: linearisation beside an explanation without effects.
        e: the explanation.
    """
    problem = likelihood.views[-1].problem
    offset, jacobian = (likelihood.split(rows)[-1] for rows in (e.residual - e.x @ e.jacobian, e.jacobian))
    frames = max(round(SAMPLE / problem.robot.machine.frame), 1)
    if sum(len(trial.measured) // (CELL * frames) for trial in problem.fit) < LEAST:
        return []
    cells = Cells(offset, jacobian, e.prior_std, problem.fit, problem.kinds, frames)
    found = [course(cells, given) for given in inputs_of(likelihood, lin, e)]
    return sorted((c for c in found if c is not None and c.gain > 0.0), key=lambda c: -c.gain)
