"""A robot in Meshcat: a log as a recording in one HTML file that plays offline, or a finger while a Diagram runs.

    html = recording_html(log, robot)
    diagram = build_diagram(robot, reference, systems=[FingerView(robot, Meshcat())])

Tendons are coloured by their load; the recording has play, pause, speed and a slider over time. `#t=1.5` in the address
stops it at that time.
"""

import logging
from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatAnimation, MeshcatParams
from pydrake.systems.framework import Context, LeafSystem

from exodrake.core.errors import InputError
from exodrake.core.templates import render
from exodrake.data.log import Log
from exodrake.diagrams.meshcat.scene import GHOST, GHOSTLY, Arm, Finger, Thing, segment_path, skeleton
from exodrake.model.display import find_display
from exodrake.model.mechanism import Shape, Skeleton
from exodrake.model.robot import Robot

__all__ = ["FingerView", "Thing", "average_frames", "recording_html"]

TEMPLATES = Path(__file__).parent / "templates"
FRAMES = 500  # at most, so that the file stays below 5 MB
RATE = 25.0  # frames per second of a short recording
# load as a share of the highest -> sRGB; slack is grey
STOPS = ((0.0, (0.55, 0.60, 0.67)), (0.35, (0.96, 0.76, 0.22)), (0.7, (0.91, 0.36, 0.13)), (1.0, (0.69, 0.02, 0.15)))


def find_colours(share: np.ndarray) -> np.ndarray:
    """Colours of loads.

    Args:
        share: (n,) loads over the highest [-].

    Returns:
        (n, 3) linear RGB, as Meshcat's materials take them.
    """
    at = np.array([x for x, _ in STOPS])
    srgb = np.column_stack([np.interp(share, at, [rgb[i] for _, rgb in STOPS]) for i in range(3)])
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)  # the sRGB standard's curve


def recording_html(
    log: Log,
    robot: Robot,
    title: str = "",
    thing: Thing | None = None,
    angles: str = "",
    other: Log | None = None,
    names: tuple[str, str] = ("this run", "nominal"),
    details: Sequence[str] = (),
) -> str:
    """HTML with the moving robot.

    Args:
        log: with angles and loads of the tendons.
        robot: whose geometry is drawn.
        title: of the recording; the log's label by default.
        thing: an object at the robot.
        angles: kind of the columns drawn, such as `angle_est`; the measured ones by default.
        other: a second log, drawn as a grey ghost.
        names: of both logs.
        details: lines below the title.

    Raises:
        InputError: a log lacks these columns, or the robot says nothing of its shape.
    """
    bones = skeleton(robot)
    kind, title = angles or bones.angle, title or log.label
    time, angle, load = average_frames(log, bones, kind)
    ghost = None
    if other is not None:  # at the same times, its ends held
        own, second, _ = average_frames(other, bones, kind)
        ghost = np.column_stack([np.interp(time, own, column) for column in second.T])
    top, step = full_load(robot, bones, load), float(time[1] - time[0]) if len(time) > 1 else 1.0 / RATE
    coloured, display = "joint" if isinstance(bones, Shape) else "tendon", find_display(bones.load, robot.machine)
    readings = {
        "time": time.round(4).tolist(), "step": step, "tendons": bones.tendons, "joints": bones.joints,
        "paths": [segment_path(bones, i + 1)[1:].split("/") for i in range(len(bones.joints))],
        "one": bones.load == bones.angle,
        "sliding": bones.sliding.tolist() if isinstance(bones, Shape) else [], "angle": angle.round(4).tolist(),
        "load": (display.factor * load).round(2).tolist(), "unit": display.unit,
        "top": (display.factor * top).tolist(), "ghost": [] if ghost is None else ghost.round(4).tolist(),
        "names": names,
    }  # fmt: skip
    end = "its limit" if limits_load(robot, bones) else "its largest here"
    tops = dict.fromkeys(f"{top:.3g}" for top in (min(readings["top"]), max(readings["top"])))
    unit = display.unit.replace("deg", "°")
    lowest, highest = (f"{value} {unit}".replace(" °", "°") for value in ("0", " to ".join(tops)))
    added = render(
        "recording.html", TEMPLATES, title=title, readings=readings, stops=STOPS, details=details,
        scale=[(round(100 * share), [round(255 * c) for c in rgb]) for share, rgb in STOPS],
        label=f"{coloured}: its {display.label.lower()}, from 0 to {end}",
        lowest=lowest, highest=highest, ghost=[round(255 * c) for c in GHOSTLY[:3]],
    )  # fmt: skip
    html = animate(step, angle, np.abs(load) / top, ghost, bones, thing)
    html = html.replace("<title>Drake MeshCat</title>", f"<title>{escape(title)}</title>")
    before, tag, after = html.rpartition("</body>")
    return before + added + tag + after


def animate(
    step: float, angle: np.ndarray, share: np.ndarray, ghost: np.ndarray | None, bones: Skeleton | Shape,
    thing: Thing | None = None,
) -> str:  # fmt: skip
    """A motion as Meshcat's own HTML, an endless loop.

    Args:
        step: time between frames [s].
        angle: (k, joints) [rad], or [m] of a sliding joint.
        share: (k, tendons) loads over the highest [-].
        ghost: (k, joints) angles of a second robot, or None.
        bones: what is drawn.
        thing: an object at the robot.
    """
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.WARNING)  # a server says where it listens, which nobody is to visit
    try:
        meshcat = Meshcat(MeshcatParams(host="localhost", show_stats_plot=False))
        drawn = Arm(meshcat, bones) if isinstance(bones, Shape) else Finger(meshcat, bones, thing)
        drawn.begin(angle[0], ghost is not None)
        meshcat.StartRecording(frames_per_second=1.0 / step, set_visualizations_while_recording=False)
        for k in range(len(angle)):
            time = (k + 0.5) * step  # Meshcat rounds down to a frame
            drawn.frame(time, angle[k], find_colours(share[k]))
            if ghost is not None:
                drawn.turn(GHOST, time, ghost[k])
        meshcat.StopRecording()
        animation = meshcat.get_mutable_recording()
        animation.set_autoplay(True)
        animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
        animation.set_repetitions(1_000_000)
        meshcat.PublishRecording()
        return meshcat.StaticHtml()
    finally:
        logger.setLevel(level)


def average_frames(log: Log, bones: Skeleton | Shape, angles: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means of a log over the frames of the recording, at most `FRAMES`.

    Returns:
        Time (k,) [s], angles (k, joints) [rad], and loads (k, tendons) in the unit of their columns [SI].
    """
    found = np.column_stack([log.time, log.array(angles, bones.joints), log.array(bones.load, bones.tendons)])
    for i in range(1, found.shape[1]):
        known = np.isfinite(found[:, i])
        if not known.any():
            raise InputError(f"{log.label}: a column of {angles} or {bones.load} is empty, so there is nothing to draw")
        found[:, i] = np.interp(log.time, log.time[known], found[known, i])
    stride = max(1, round(1.0 / (RATE * log.dt)), -(-len(log) // FRAMES)) if len(log) > 1 else 1
    count = max(1, len(found) // stride)
    means = found[: count * stride].reshape(count, -1, found.shape[1]).mean(axis=1)
    cut = 1 + len(bones.joints)
    return means[:, 0], means[:, 1:cut], means[:, cut:]


def full_load(robot: Robot, bones: Skeleton | Shape, load: np.ndarray) -> np.ndarray:
    """Load of each tendon (tendons,) [SI] at the end of the colour scale: its limit, else the largest seen."""
    largest = np.abs(load).max(axis=0)
    largest[largest == 0.0] = 1.0
    highest = robot.reference_limits()[1] if limits_load(robot, bones) else largest
    return np.where(np.isfinite(highest) & (highest > 0), highest, largest)


def limits_load(robot: Robot, bones: Skeleton | Shape) -> bool:
    """Whether the machine limits the references of what colours the tendons or joints, and these may not turn back."""
    machine, kind = robot.machine, robot.machine.references[0].kind.removesuffix("_ref")
    return bool(kind == bones.load != bones.angle and machine.reference_limits)


class FingerView(LeafSystem):
    """Finger and tendons in Meshcat, the tendons coloured by their tension as a share of its limit.

    .. pydrake_system::

        name: FingerView
        input_ports:
        - angle
        - tension

    angle [rad] per joint, tension [N] per tendon; without `tension` the tendons stay grey. Tendons are drawn straight
    between their routers.

    Raises:
        InputError: the robot has no finger.
    """

    def __init__(self, robot: Robot, meshcat: Meshcat, rate: float = 32.0) -> None:
        """Takes the robot, a Meshcat, and pictures per simulated second."""
        super().__init__()
        bones = skeleton(robot)
        if isinstance(bones, Shape):
            raise InputError(f"{robot.machine.name}: nothing to draw, since it has no finger")
        self.finger, self.optional = Finger(meshcat, bones), ("tension",)
        self.highest = full_load(robot, bones, np.zeros((1, len(bones.tendons))))
        self.DeclareVectorInputPort("angle", len(bones.joints))
        self.DeclareVectorInputPort("tension", len(bones.tendons))
        self.finger.begin(np.zeros(len(bones.joints)), False)
        self.DeclareForcedPublishEvent(self._draw)
        self.DeclarePeriodicPublishEvent(1.0 / rate, 0.0, self._draw)
        self.set_name("view")

    def _draw(self, context: Context) -> None:
        """Moves the finger to the present angles and colours its tendons."""
        tension = self.GetInputPort("tension")
        load = np.array(tension.Eval(context) if tension.HasValue(context) else np.zeros(len(self.highest)))
        angle = np.array(self.GetInputPort("angle").Eval(context))
        self.finger.frame(context.get_time(), angle, find_colours(np.abs(load) / self.highest), live=True)
