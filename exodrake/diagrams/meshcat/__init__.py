"""A log as a moving finger: a Meshcat recording in one HTML file that plays offline, built from the log afterwards.

    html = recording_html(log, robot)

Tendons are coloured by their tension; `#t=1.5` in the address stops the recording at that time.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.robot import Robot
from exodrake.data.log import Log
from exodrake.diagrams.meshcat.page import colours, with_readings
from exodrake.diagrams.meshcat.shapes import HAND_END, Skeleton, along, skeleton, span, turn

FRAMES = 500  # at most, so that the page stays below 5 MB
RATE = 25.0  # frames per second of a short recording
BONE, TENDON, ROUTER, SKIN = 0.0018, 0.0008, 0.0012, 0.20  # radii [m] and opacity
GROUND, CELL, CELLS = -0.085, 0.01, 12  # height [m], width [m] and half the number of squares


@dataclass(frozen=True)
class Thing:
    """An object at the finger.

    Attributes:
        centre: (x, z) [m].
        radius: [m].
        length: of a cylinder across the finger [m]; None for a sphere.
    """

    centre: tuple[float, float]
    radius: float
    length: float | None = None


def recording_html(log: Log, robot: Robot, title: str = "", thing: Thing | None = None, angles: str = "angle") -> str:
    """A page with the moving finger.

    Args:
        log: with angles and tensions.
        robot: whose geometry is drawn.
        title: of the page; the log's label by default.
        thing: an object at the finger.
        angles: kind of the columns drawn, `angle` or `angle_est`.

    Raises:
        InputError: the log lacks these columns, or the robot has no finger.
    """
    bones = skeleton(robot)
    time, angle, tension, top = frames_of(log, robot, angles)
    with silent_meshcat() as meshcat:
        draw_scene(meshcat, bones, thing)
        draw_tendons(meshcat, bones, angle[0])
        step = float(time[1] - time[0]) if len(time) > 1 else 1.0 / RATE
        meshcat.StartRecording(frames_per_second=1.0 / step, set_visualizations_while_recording=False)
        for k in range(len(time)):
            animate(meshcat, bones, k * step, angle[k], colours(tension[k] / top))
        meshcat.StopRecording()
        repeat(meshcat)
        html = meshcat.StaticHtml()
    readings = {
        "time": time.round(4).tolist(),
        "step": step,
        "tendons": robot.machine.axes.tendons,
        "joints": bones.joints,
    }
    readings |= {"tension": tension.round(2).tolist(), "angle": angle.round(3).tolist(), "top": top.tolist()}
    return with_readings(html, title or log.label, readings)


def frames_of(log: Log, robot: Robot, angles: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Means of a log over the frames of the recording, at most `FRAMES`.

    Returns:
        Time (k,) [s], angles (k, joints) [rad], tensions (k, tendons) [N], and F_max (tendons,) [N].
    """
    axes = robot.machine.axes
    found = np.column_stack([log.time, log.array(angles, axes.joints), log.array("tension", axes.tendons)])
    for i in range(1, found.shape[1]):
        known = np.isfinite(found[:, i])
        if not known.any():
            raise InputError(f"{log.label}: a column of {angles} or tension is empty, so there is nothing to draw")
        found[:, i] = np.interp(log.time, log.time[known], found[known, i])
    stride = max(1, round(1.0 / (RATE * log.dt)), -(-len(log) // FRAMES)) if len(log) > 1 else 1
    count = max(1, len(found) // stride)
    means = found[: count * stride].reshape(count, -1, found.shape[1]).mean(axis=1)
    cut = 1 + len(axes.joints)
    ceiling = robot.limits.get("F_max", {})
    top = np.array([ceiling.get(name, max(1.0, found[:, cut + j].max())) for j, name in enumerate(axes.tendons)])
    return means[:, 0], means[:, 1:cut], means[:, cut:], top


@contextmanager
def silent_meshcat() -> Iterator[Any]:
    """A Meshcat server without log messages, closed afterwards."""
    from pydrake.geometry import Meshcat, MeshcatParams

    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        yield Meshcat(MeshcatParams(host="localhost", show_stats_plot=False))
    finally:
        logger.setLevel(level)


def segment_path(bones: Skeleton, segment: int) -> str:
    """Meshcat path of a segment; phalanges hang on each other."""
    return "/".join(["/hand", *bones.joints[:segment]])


def pose(position: np.ndarray | list[float], rotation: np.ndarray | None = None) -> Any:
    """A Drake transform from a position (3,) [m] and a rotation matrix (3, 3)."""
    from pydrake.math import RigidTransform, RotationMatrix

    return RigidTransform(
        RotationMatrix(np.eye(3) if rotation is None else rotation), np.asarray(position, dtype=float)
    )


def draw_scene(meshcat: Any, bones: Skeleton, thing: Thing | None) -> None:
    """Draws what does not move: hand, bones, skin, joints, routers, ground, object and camera."""
    from pydrake.geometry import Box, Capsule, Cylinder, Rgba, Sphere

    lying = turn(np.pi / 2)
    bone, skin = Rgba(0.93, 0.90, 0.83, 1.0), Rgba(0.87, 0.68, 0.58, SKIN)
    meshcat.SetObject("/hand/cuff", Box(0.010, 0.026, 0.026), Rgba(0.27, 0.31, 0.38, 1.0))
    meshcat.SetTransform("/hand/cuff", pose([HAND_END, 0.0, 0.0]))
    lengths, radii = [-HAND_END, *bones.lengths], [1.15 * bones.radii[0], *bones.radii]
    for i in range(len(lengths)):
        path, middle = segment_path(bones, i), (-lengths[0] if i == 0 else lengths[i]) / 2.0
        for name, radius, colour in (("bone", BONE, bone), ("skin", radii[i], skin)):
            meshcat.SetObject(f"{path}/{name}", Capsule(radius, lengths[i]), colour)
            meshcat.SetTransform(f"{path}/{name}", pose([middle, 0.0, 0.0], lying))
        if i:
            meshcat.SetObject(f"{path}/joint", Cylinder(1.2 * BONE, 0.010), Rgba(0.27, 0.31, 0.38, 1.0))
            meshcat.SetTransform(f"{path}/joint", pose([0.0, 0.0, 0.0], np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])))
    for k, (segment, point) in enumerate(bones.routers):
        path = f"{segment_path(bones, segment)}/router_{k}"
        meshcat.SetObject(path, Sphere(ROUTER), Rgba(0.15, 0.17, 0.22, 1.0))
        meshcat.SetTransform(path, pose(point))
    if thing is not None:
        shape = Sphere(thing.radius) if thing.length is None else Cylinder(thing.radius, thing.length)
        meshcat.SetObject("/object", shape, Rgba(0.35, 0.55, 0.75, 0.55))
        across = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])
        meshcat.SetTransform("/object", pose([thing.centre[0], 0.0, thing.centre[1]], across))
    draw_ground(meshcat)


def draw_ground(meshcat: Any) -> None:
    """Draws a white background, a pale grid of 1 cm squares, and sets the camera at the side of the thumb."""
    from pydrake.geometry import Rgba

    for end in ("top_color", "bottom_color"):
        meshcat.SetProperty("/Background", end, [1.0, 1.0, 1.0])
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Grid", "visible", False)
    at, reach = CELL * np.arange(-CELLS, CELLS + 1), CELL * CELLS
    far, low = np.full_like(at, reach), np.full_like(at, GROUND)
    starts = np.hstack([[at, -far, low], [-far, at, low]])
    ends = np.hstack([[at, far, low], [far, at, low]])
    meshcat.SetLineSegments("/ground", starts, ends, 1.0, Rgba(0.86, 0.88, 0.91, 1.0))
    meshcat.SetCameraPose([0.040, -0.148, 0.022], [0.008, 0.0, -0.020])


def draw_tendons(meshcat: Any, bones: Skeleton, angle: np.ndarray) -> None:
    """Draws the pieces of the tendons at the first posture; those over a joint have unit length and are scaled."""
    from pydrake.geometry import Cylinder, Rgba

    for piece in bones.pieces:
        path = tendon_path(bones, piece)
        middle, rotation, length = along(*span(bones, piece, angle))
        fixed = piece.first == piece.last
        meshcat.SetObject(path, Cylinder(TENDON, length if fixed else 1.0), Rgba(0.55, 0.60, 0.67, 1.0))
        meshcat.SetTransform(path, pose(middle, rotation))
        if not fixed:
            meshcat.SetProperty(path, "scale", [1.0, 1.0, length])


def tendon_path(bones: Skeleton, piece: Any) -> str:
    """Meshcat path of a piece of a tendon."""
    return f"{segment_path(bones, piece.first)}/{piece.tendon}_{piece.name}"


def animate(meshcat: Any, bones: Skeleton, time: float, angle: np.ndarray, colour: np.ndarray) -> None:
    """Adds a frame: angles (joints,) [rad] of the joints, and colours (tendons, 3) of the tendons."""
    for i in range(len(bones.joints)):
        start = [bones.lengths[i - 1] if i else 0.0, 0.0, 0.0]
        meshcat.SetTransform(segment_path(bones, i + 1), pose(start, turn(angle[i])), time)
    tendons = list(dict.fromkeys(piece.tendon for piece in bones.pieces))
    for piece in bones.pieces:
        path = tendon_path(bones, piece)
        if piece.first != piece.last:
            middle, rotation, length = along(*span(bones, piece, angle))
            meshcat.SetTransform(path, pose(middle, rotation), time)
            meshcat.SetProperty(path, "scale", [1.0, 1.0, length], time)
        meshcat.SetProperty(f"{path}/<object>", "material.color", colour[tendons.index(piece.tendon)].tolist(), time)


def repeat(meshcat: Any) -> None:
    """Publishes the recording as an endless loop."""
    from pydrake.geometry import MeshcatAnimation

    animation = meshcat.get_mutable_recording()
    animation.set_autoplay(True)
    animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
    animation.set_repetitions(1_000_000)
    meshcat.PublishRecording()
