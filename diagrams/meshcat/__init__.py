"""A robot in Meshcat: a log as a recording in one HTML file that plays offline, or a finger while a Diagram runs.

    html = recording_html(log, robot)
    diagram = build_diagram(robot, reference, systems=[FingerView(robot, Meshcat())])

Tendons are coloured by their load; the recording has play, pause, speed and a slider over time. `#t=1.5` in the address
stops it at that time.

A recording shows a finger with tendons or a serial arm, a second robot as its ghost, an object, the ground. Segments
hang on those that carry them, so that a joint's angle moves one transform. A dot in a Meshcat path begins what is no
joint, which may have any name.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.geometry import Box, Capsule, Cylinder, Meshcat, MeshcatAnimation, MeshcatParams, Rgba, Sphere
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.framework import Context, LeafSystem

from exodrake.core.errors import InputError
from exodrake.core.templates import render
from exodrake.data.log import Log
from exodrake.model.display import find_display
from exodrake.model.mechanism import SPACING, Piece, Shape, Skeleton
from exodrake.model.robot import Robot
from exodrake.systems.part import Cloneable

TEMPLATES = Path(__file__).parent / "templates"
FRAMES = 500  # at most, so that the file stays below 5 MB
RATE = 25.0  # frames per second of a short recording
# load as a share of the highest -> sRGB; slack is grey
STOPS = ((0.0, (0.55, 0.60, 0.67)), (0.35, (0.96, 0.76, 0.22)), (0.7, (0.91, 0.36, 0.13)), (1.0, (0.69, 0.02, 0.15)))
ROOT, GHOST = "/robot", "/ghost"  # Meshcat paths of the robot and of the second one
GHOSTLY = (0.42, 0.45, 0.50, 0.45)  # colour, which no load has, and opacity of the second robot
DARK, STEEL = (0.27, 0.31, 0.38, 1.0), (0.55, 0.60, 0.67, 1.0)
HERE, UPRIGHT = np.zeros(3), RotationMatrix()
# of a finger: radii [m]; height and width [m] of the squares on the ground, and half their number
BONE, TENDON, GUIDE = 0.0018, 0.0008, 0.0012
GROUND, CELL, CELLS = -0.085, 0.01, 12
BONES, SKIN = (0.93, 0.90, 0.83, 1.0), (0.87, 0.68, 0.58, 0.20)
ACROSS = RotationMatrix.MakeXRotation(-np.pi / 2.0)  # z lies along the joints' axes
# of an arm
SMALLEST = 0.3  # m, reach of a drawn arm at least, for an axis whose frames coincide: assumed
PLATE, THICK = 0.16, 0.03  # width and thickness of the base: shares of the size
BAR, DRUM, LONG, CUBE, RAIL = 0.028, 0.045, 0.11, 0.11, 0.015  # radii, lengths and widths as shares of the reach
BELOW = 0.5 * (LONG + THICK)  # of the base under axes side by side, which stand on it
LIMB = (0.90, 0.89, 0.86, 1.0)
FRONT, VIEW = np.array([0.75, -0.15, 0.5]), np.array([0.8, -1.3, 0.45])  # camera from the middle of the arm, in reaches


@dataclass(frozen=True)
class Thing:
    """An object at the robot."""

    centre: tuple[float, float]  # (x, z) [m]
    radius: float  # [m]
    length: float | None = None  # of a cylinder along the joints' axes [m]; None for a sphere


def skeleton(robot: Robot) -> Skeleton | Shape:
    """Segments and tendons of a robot, or an arm. InputError where there is none, or a part has no size."""
    if robot.machine.skeleton is None:
        raise InputError(f"{robot.machine.name}: nothing to draw, since its machine.py says nothing of its shape")
    return robot.machine.skeleton(robot)


def span(bones: Skeleton, piece: Piece, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends (3,), (3,) [m] of a piece in the frame of its first segment; angle (joints,) [rad]."""
    if piece.first == piece.last:
        return piece.start, piece.end
    joint = np.array([bones.lengths[piece.first - 1] if piece.first else 0.0, 0.0, 0.0])
    return piece.start, joint + RotationMatrix.MakeYRotation(angle[piece.first]) @ piece.end


def along(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, RotationMatrix, float]:
    """Middle (3,) [m], rotation that takes z to start -> end, and length [m]."""
    rotation = RotationMatrix.MakeFromOneVector(end - start, axis_index=2)
    return (start + end) / 2.0, rotation, float(np.linalg.norm(end - start))


def segment_path(bones: Skeleton | Shape, segment: int, root: str = ROOT) -> str:
    """Meshcat path of a segment."""
    return "/".join([root, *bones.carriers(segment)])


class Scene:
    """Drawing of a robot with a Meshcat: what its kinds share."""

    def __init__(self, meshcat: Any, bones: Any) -> None:
        self.meshcat, self.bones = meshcat, bones

    def put(self, path: str, body: Any, colour: tuple, position: Any = HERE, rotation: Any = UPRIGHT) -> None:
        """Draws a body at a place (3,) [m], turned, in the frame of the path that it hangs on."""
        self.meshcat.SetObject(path, body, Rgba(*colour))
        self.meshcat.SetTransform(path, RigidTransform(rotation, position))

    def draw_ground(self, height: float, width: float, count: int) -> None:
        """Draws a white background and a pale grid of 2 `count` squares of that width [m] a side, at a height [m]."""
        for end in ("top_color", "bottom_color"):
            self.meshcat.SetProperty("/Background", end, [1.0, 1.0, 1.0])
        self.meshcat.SetProperty("/Axes", "visible", False)
        self.meshcat.SetProperty("/Grid", "visible", False)
        at = width * np.arange(-count, count + 1)
        far, low = np.full_like(at, width * count), np.full_like(at, height)
        starts = np.hstack([[at, -far, low], [-far, at, low]])
        ends = np.hstack([[at, far, low], [far, at, low]])
        self.meshcat.SetLineSegments("/ground", starts, ends, 1.0, Rgba(0.86, 0.88, 0.91, 1.0))


class Finger(Scene):
    """Drawing of a finger with tendons, at an object if there is one."""

    def __init__(self, meshcat: Any, bones: Skeleton, thing: Thing | None = None) -> None:
        super().__init__(meshcat, bones)
        self.thing = thing
        self.tendons = [(p, f"{segment_path(bones, p.first)}/{p.tendon}_{p.name}") for p in bones.pieces]

    def begin(self, angle: np.ndarray, ghost: bool) -> None:
        """Draws what there is at angles (joints,) [rad]; ghost: a second finger, too."""
        bones, thing, count = self.bones, self.thing, len(self.bones.joints)
        high = 0.013 - GROUND  # the finger's base stands on the ground
        self.put(f"{ROOT}/.cuff", Box(0.010, 0.026, high), DARK, [bones.base, 0.0, GROUND + high / 2.0])
        self._segments(ROOT, "bone", count * [BONE], BONE, BONES)
        self._segments(ROOT, "skin", list(bones.radii), 1.15 * bones.radii[0], SKIN)
        if ghost:
            self._segments(GHOST, "bone", count * [1.6 * BONE], 1.6 * BONE, GHOSTLY)
        for i in range(1, count + 1):
            self.put(f"{segment_path(bones, i)}/.joint", Cylinder(1.2 * BONE, 0.010), DARK, HERE, ACROSS)
        for k, (segment, point) in enumerate(bones.guides):
            self.put(f"{segment_path(bones, segment)}/.guide_{k}", Sphere(GUIDE), (0.15, 0.17, 0.22, 1.0), point)
        if thing is not None:
            body = Sphere(thing.radius) if thing.length is None else Cylinder(thing.radius, thing.length)
            self.put("/object", body, (0.35, 0.55, 0.75, 0.55), [thing.centre[0], 0.0, thing.centre[1]], ACROSS)
        self.draw_ground(GROUND, CELL, CELLS)
        self.meshcat.SetCameraPose([0.040, -0.148, 0.022], [0.008, 0.0, -0.020])
        for piece, path in self.tendons:  # those over a joint have unit length and are scaled
            middle, rotation, length = along(*span(bones, piece, angle))
            fixed = piece.first == piece.last
            self.put(path, Cylinder(TENDON, length if fixed else 1.0), STEEL, middle, rotation)
            if not fixed:
                self.meshcat.SetProperty(path, "scale", [1.0, 1.0, length])

    def _segments(self, root: str, name: str, radii: list[float], first: float, colour: tuple) -> None:
        """Draws a capsule for the base, of the radius `first` [m], and for each segment."""
        lengths = [-self.bones.base, *self.bones.lengths]
        for i, radius in enumerate([first, *radii]):
            middle = [(lengths[i] if i else -lengths[0]) / 2.0, 0.0, 0.0]
            path = f"{segment_path(self.bones, i, root)}/.{name}"
            self.put(path, Capsule(radius, lengths[i]), colour, middle, RotationMatrix.MakeYRotation(np.pi / 2.0))

    def turn(self, root: str, time: float, angle: np.ndarray) -> None:
        """Adds a frame at a time [s] with these angles (joints,) [rad]."""
        for i in range(len(self.bones.joints)):
            joint = np.array([self.bones.lengths[i - 1] if i else 0.0, 0.0, 0.0])
            place = RigidTransform(RotationMatrix.MakeYRotation(angle[i]), joint)
            self.meshcat.SetTransform(segment_path(self.bones, i + 1, root), place, time)

    def frame(self, time: float, angle: np.ndarray, colour: np.ndarray, live: bool = False) -> None:
        """Adds a frame at a time [s]: angles (joints,) [rad], and linear RGB (tendons, 3) of the tendons.

        live: whether it is shown at once; Meshcat names colours differently outside of recordings.
        """
        self.turn(ROOT, time, angle)
        for piece, path in self.tendons:
            if piece.first != piece.last:
                middle, rotation, length = along(*span(self.bones, piece, angle))
                self.meshcat.SetTransform(path, RigidTransform(rotation, middle), time)
                self.meshcat.SetProperty(path, "scale", [1.0, 1.0, length], time)
            shade = colour[self.bones.tendons.index(piece.tendon)].tolist()
            if live:
                self.meshcat.SetProperty(path, "color", [*shade, 1.0])
            else:
                self.meshcat.SetProperty(f"{path}/<object>", "material.color", shade, time)


class Arm(Scene):
    """Drawing of an arm of some shape."""

    def __init__(self, meshcat: Any, bones: Shape) -> None:
        super().__init__(meshcat, bones)
        self.reach = max(SMALLEST, bones.reach)
        self.size = 3.0 * SPACING if bones.beside else self.reach  # to which widths are in proportion
        self.fixed = [RollPitchYaw(*angles).ToRotationMatrix() for angles in bones.angles]

    def begin(self, position: np.ndarray, ghost: bool) -> None:
        """Draws what there is at positions (joints,) [rad] or [m]; ghost: a second arm, too."""
        shape, below = self.bones, BELOW * self.size * self.bones.beside
        wide = np.array([PLATE * self.size, self.reach if shape.beside else PLATE * self.size, THICK * self.size])
        if shape.beside and shape.sliding.any():
            wide[:2] = 3.0 * SMALLEST, wide[0]  # along the rail, which lies on it
        self.put(f"{ROOT}/.base", Box(*wide), DARK, [0.0, 0.0, -below])
        tilt = RollPitchYaw(shape.tilt[0], shape.tilt[1], 0.0).ToRotationMatrix()
        for root, colour, width in ((ROOT, LIMB, 1.0), (GHOST, GHOSTLY, 1.25))[: 1 + ghost]:
            size = width * self.size
            for j, end in enumerate(shape.ends):  # bars, drums and carriages
                path, line = segment_path(shape, j + 1, root), along(HERE, shape.axes[j])[1]
                if np.linalg.norm(end) > 1e-6:
                    middle, turn, length = along(HERE, end)
                    self.put(f"{path}/.link", Capsule(BAR * size, length), colour, middle, turn)
                body = Box(*(3 * [CUBE * size])) if shape.sliding[j] else Cylinder(DRUM * size, LONG * size)
                self.put(f"{path}/.joint", body, STEEL if root == ROOT else colour, HERE, line)
                if shape.sliding[j] and root == ROOT:
                    rail = f"{root if shape.beside else segment_path(shape, j, root)}/.rail_{j}"
                    low = shape.origins[j] - [0.0, 0.0, 0.5 * (LONG - RAIL) * size * shape.beside]
                    self.put(rail, Box(RAIL * size, RAIL * size, 3.0 * SMALLEST), DARK, low, self.fixed[j] @ line)
            self.meshcat.SetTransform(root, RigidTransform(tilt, HERE))
            self.turn(root, 0.0, position)
        step = 10.0 ** np.floor(np.log10(self.reach)) * (0.5 if self.reach < 3.0 * SMALLEST else 1.0)
        self.draw_ground(-0.5 * wide[2] - below, float(step) / 2.0, round(2.4 * self.reach / step) + 2)
        middle = np.array([0.0, 0.0, 0.0 if shape.beside else 0.45 * self.reach])
        view = FRONT if shape.beside and not shape.sliding.any() else VIEW
        self.meshcat.SetCameraPose(middle + (1.3 if shape.beside else 1.0) * self.reach * view, middle)

    def turn(self, root: str, time: float, position: np.ndarray) -> None:
        """Adds a frame at a time [s] with these positions (joints,)."""
        shape = self.bones
        for j, (q, fixed, origin) in enumerate(zip(position, self.fixed, shape.origins)):
            place = RigidTransform(fixed, origin + fixed @ (q * shape.axes[j]))
            if not shape.sliding[j]:
                place = RigidTransform(fixed @ RotationMatrix(AngleAxis(float(q), shape.axes[j])), origin)
            self.meshcat.SetTransform(segment_path(shape, j + 1, root), place, time)

    def frame(self, time: float, position: np.ndarray, colour: np.ndarray) -> None:
        """Adds a frame at a time [s]: positions (joints,), and linear RGB (joints, 3) of the joints."""
        self.turn(ROOT, time, position)
        for j in range(len(position)):
            path = f"{segment_path(self.bones, j + 1)}/.joint/<object>"
            self.meshcat.SetProperty(path, "material.color", colour[j].tolist(), time)


def find_colours(share: np.ndarray) -> np.ndarray:
    """Colours (n, 3) of loads over the highest (n,) [-]: linear RGB, as Meshcat's materials take them."""
    at = np.array([x for x, _ in STOPS])
    srgb = np.column_stack([np.interp(share, at, [rgb[i] for _, rgb in STOPS]) for i in range(3)])
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)  # the sRGB standard's curve


def recording_html(
    log: Log, robot: Robot, title: str = "", thing: Thing | None = None, angles: str = "", other: Log | None = None,
    names: tuple[str, str] = ("this run", "nominal"), details: Sequence[str] = (),
) -> str:  # fmt: skip
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
        "one": bones.load == bones.angle, "above": isinstance(bones, Shape) and bones.beside,
        "sliding": bones.sliding.tolist() if isinstance(bones, Shape) else [], "angle": angle.round(4).tolist(),
        "load": (display.factor * load).round(2).tolist(), "unit": display.unit,
        "top": (display.factor * top).tolist(), "ghost": [] if ghost is None else ghost.round(4).tolist(),
        "names": names,
    }  # fmt: skip
    end = "its limit" if limits_load(robot, bones) else "its largest here"
    ends = min(readings["top"]), max(readings["top"])
    tops = dict.fromkeys(f"{float(format(top, '.3g')):g}" for top in ends)
    unit = display.unit.replace("deg", "°")
    lowest, highest = (f"{value} {unit}".replace(" °", "°") for value in ("0", " to ".join(tops)))
    added = render(
        "recording.html", TEMPLATES, title=title, readings=readings, stops=STOPS, details=details,
        scale=[(round(100 * share), [round(255 * c) for c in rgb]) for share, rgb in STOPS],
        label=f"{coloured}: its {display.label.lower()}, from 0 to {end}",
        lowest=lowest, highest=highest, ghost=[round(255 * c) for c in GHOSTLY[:3]],
    )  # fmt: skip
    head = f'<meta name="viewport" content="width=device-width, initial-scale=1">\n  <title>{escape(title)}</title>'
    html = animate(step, angle, np.abs(load) / top, ghost, bones, thing).replace("<title>Drake MeshCat</title>", head)
    before, tag, after = html.rpartition("</body>")
    return before + added + tag + after


def animate(
    step: float, angle: np.ndarray, share: np.ndarray, ghost: np.ndarray | None, bones: Skeleton | Shape,
    thing: Thing | None = None,
) -> str:  # fmt: skip
    """A motion as Meshcat's own HTML, an endless loop.

    A frame each `step` [s]: angle (k, joints) [rad], or [m] of a sliding joint; share (k, tendons) of the loads in the
    highest [-]; ghost (k, joints) of a second robot, or None.
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
    """Time (k,) [s], angles (k, joints) [rad] and loads (k, tendons) [SI], averaged over at most `FRAMES` frames."""
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


class FingerView(Cloneable, LeafSystem):
    """Finger and tendons in Meshcat, the tendons coloured by their tension as a share of its limit.

    .. pydrake_system::

        name: FingerView
        input_ports: [angle, tension]

    angle [rad] per joint, tension [N] per tendon; without `tension` the tendons stay grey. Tendons are drawn straight
    between their routers.

    Raises:
        InputError: the robot has no finger.

    Examples:
        >>> import exodrake as exo
        >>> from pydrake.geometry import Meshcat
        >>> robot = exo.load_robot()
        >>> view = exo.FingerView(robot, Meshcat())  # in the browser, at view.finger.meshcat.web_url()
        >>> diagram = exo.build_diagram(robot, exo.grasp("caging"), systems=[view])
        >>> diagram.GetSubsystemByName("view") is view
        True
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
