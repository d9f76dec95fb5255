"""The log of a run of a Drake Diagram, as `simulate` gives it of the same run."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from exodrake.core.errors import InputError
from exodrake.data.log import Log
from exodrake.diagrams.diagram import checked, find_parameter, logged_signals
from exodrake.simulation.simulate import delay_samples, log_of_signals

if TYPE_CHECKING:
    from pydrake.systems.framework import Context, Diagram


def diagram_log(diagram: Diagram, context: Context) -> Log:
    """The log that the robot of a Diagram would have written, one row for each frame that has ended.

    Time is that of the frame's start, and samples of a sensor on a clock of its own are late, as in `simulate`.
    References that are input ports of the Diagram are not in the log.

    Args:
        diagram: from `build_diagram`.
        context: root Context that has run.

    Returns:
        The columns of the machine.
    """
    return log_of_run(diagram, context, logged_signals(diagram, context))


def log_of_run(diagram: Diagram, context: Context, signals: Mapping[str, np.ndarray]) -> Log:
    """The log of a Diagram's run whose signals (rows, channels) [SI] are known; arguments as in `diagram_log`."""
    robot_diagram = checked(diagram)
    machine, signals = robot_diagram.robot.machine, dict(signals)
    delay_samples(machine, signals, partial(value_of, diagram, context))
    time = machine.frame * (np.round(signals["time"] / machine.frame) - 1.0)
    return log_of_signals(machine, time, signals, robot_diagram.source)


def value_of(diagram: Diagram, context: Context, name: str) -> float:
    """Value of a parameter [SI]; 0 where a system of one's own, which lacks it, stands in the part's place."""
    try:
        parameter = find_parameter(diagram, name)
    except InputError:
        return 0.0
    return float(parameter.get(context)[0])
