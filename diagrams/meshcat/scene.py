"""What a recording shows: a finger with tendons or a serial arm, a second robot as its ghost, an object, the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from exodrake.core.errors import InputError
from exodrake.core.mechanism import SPACING, Piece, Shape, Skeleton
from exodrake.core.robot import Robot


def skeleton(robot: Robot) -> Skeleton | Shape:
    """Segments and tendons of a robot, or an arm. InputError where there is none, or a part has no size."""
    if robot.machine.skeleton is None:
        raise InputError(f"{robot.machine.name}: nothing to draw, since its machine.py says nothing of its shape")
    return robot.machine.skeleton(robot)


def finger_skeleton(robot: Robot) -> Skeleton:
    """`skeleton` of a finger. InputError for a machine that has none."""
    found = skeleton(robot)
    if isinstance(found, Shape):
        raise InputError(f"{robot.machine.name}: nothing to draw, since it has no finger")
    return found


def turn(angle: float) -> np.ndarray:
    """Rotation (3, 3) [-] by a joint's angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def span(bones: Skeleton, piece: Piece, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ends (3,), (3,) [m] of a piece in the frame of its first segment; angle (joints,) [rad]."""
    if piece.first == piece.last:
        return piece.start, piece.end
    joint = np.array([bones.lengths[piece.first - 1] if piece.first else 0.0, 0.0, 0.0])
    return piece.start, joint + turn(angle[piece.first]) @ piece.end


def along(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Middle (3,) [m], rotation (3, 3) that takes z to start -> end, and length [m]."""
    length = float(np.linalg.norm(end - start))
    z = (end - start) / length
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return (start + end) / 2.0, np.column_stack([x, np.cross(z, x), z]), length


SMALLEST = 0.3  # m, reach of a drawn arm at least, for an axis whose frames coincide: assumed
PLATE, THICK = 0.16, 0.03  # width and thickness of the base: shares of the size
BAR, DRUM, LONG, CUBE, RAIL = 0.028, 0.045, 0.11, 0.11, 0.015  # radii, lengths and widths as shares of the reach
BELOW = 0.5 * (LONG + THICK)  # of the base under axes side by side, which stand on it
LIMB, DARK, DRUMS = (0.90, 0.89, 0.86, 1.0), (0.27, 0.31, 0.38, 1.0), (0.55, 0.60, 0.67, 1.0)
FRONT, VIEW = np.array([0.75, -0.15, 0.5]), np.array([0.8, -1.3, 0.45])  # camera from the middle of the arm, in reaches


class Arm:
    """Draws an arm of some shape with a Meshcat."""

    def __init__(self, meshcat: Any, shape: Shape) -> None:
        self.meshcat, self.shape = meshcat, shape
        self.reach = max(SMALLEST, shape.reach)
        self.size = 3.0 * SPACING if shape.beside else self.reach  # to which widths are in proportion

    def begin(self, position: np.ndarray, ghost: bool) -> None:
        """Draws what there is at positions (joints,) [rad] or [m]; ghost: a second arm, too."""
        from pydrake.geometry import Box, Rgba

        wide = np.array([PLATE * self.size, self.reach if self.shape.beside else PLATE * self.size, THICK * self.size])
        base = f"{ROOT}/.base", pose([0.0, 0.0, -BELOW * self.size * self.shape.beside])
        if self.shape.beside and self.shape.sliding.any():
            wide = wide[[1, 0, 2]]  # along the rail
        self.meshcat.SetObject(base[0], Box(*wide), Rgba(*DARK))
        self.meshcat.SetTransform(*base)
        self._limbs(ROOT, LIMB, 1.0)
        if ghost:
            self._limbs(GHOST, GHOSTLY, 1.25)
            self.turn(GHOST, 0.0, position)
        for root in (ROOT, GHOST) if ghost else (ROOT,):
            self.meshcat.SetTransform(
                root, pose([0.0, 0.0, 0.0], rotation(self.shape.tilt[0], self.shape.tilt[1], 0.0))
            )
        self.turn(ROOT, 0.0, position)
        step = 10.0 ** np.floor(np.log10(self.reach)) * (0.5 if self.reach < 3.0 * SMALLEST else 1.0)
        ground = -0.5 * wide[2] - BELOW * self.size * self.shape.beside
        draw_squares(self.meshcat, ground, float(step) / 2.0, round(2.4 * self.reach / step) + 2)
        middle = np.array([0.0, 0.0, 0.0 if self.shape.beside else 0.45 * self.reach])
        view = FRONT if self.shape.beside and not self.shape.sliding.any() else VIEW
        self.meshcat.SetCameraPose(middle + (1.3 if self.shape.beside else 1.0) * self.reach * view, middle)

    def _limbs(self, root: str, colour: tuple, width: float) -> None:
        """Bars, drums and carriages under a path."""
        from pydrake.geometry import Box, Capsule, Cylinder, Rgba

        size, shape = width * self.size, self.shape
        for j, end in enumerate(shape.ends):
            path = segment_path(shape, j + 1, root)
            if np.linalg.norm(end) > 1e-6:
                middle, turn, length = along(np.zeros(3), end)
                self.meshcat.SetObject(f"{path}/.link", Capsule(BAR * size, length), Rgba(*colour))
                self.meshcat.SetTransform(f"{path}/.link", pose(middle, turn))
            body = Box(*(3 * [CUBE * size])) if shape.sliding[j] else Cylinder(DRUM * size, LONG * size)
            self.meshcat.SetObject(f"{path}/.joint", body, Rgba(*(DRUMS if root == ROOT else colour)))
            self.meshcat.SetTransform(f"{path}/.joint", pose([0.0, 0.0, 0.0], along(np.zeros(3), shape.axes[j])[1]))
            if shape.sliding[j] and root == ROOT:
                base = root if shape.beside else segment_path(shape, j, root)
                rail, fixed = f"{base}/.rail_{j}", rotation(*shape.angles[j])
                turn = fixed @ along(np.zeros(3), shape.axes[j])[1]
                self.meshcat.SetObject(rail, Box(RAIL * size, RAIL * size, 3.0 * SMALLEST), Rgba(*DARK))
                self.meshcat.SetTransform(rail, pose(shape.origins[j], turn))

    def turn(self, root: str, time: float, position: np.ndarray) -> None:
        """Adds a frame at a time [s] with these positions (joints,)."""
        from pydrake.math import RotationMatrix

        shape = self.shape
        for j, q in enumerate(position):
            fixed, origin = rotation(*shape.angles[j]), shape.origins[j]
            if shape.sliding[j]:
                at, turn = origin + fixed @ (q * shape.axes[j]), fixed
            else:
                at, turn = origin, fixed @ RotationMatrix(angle_axis(float(q), shape.axes[j])).matrix()
            self.meshcat.SetTransform(segment_path(shape, j + 1, root), pose(at, turn), time)

    def frame(self, time: float, position: np.ndarray, colour: np.ndarray) -> None:
        """Adds a frame at a time [s]: positions (joints,), and linear RGB (joints, 3) of the joints."""
        self.turn(ROOT, time, position)
        for j in range(len(position)):
            path = f"{segment_path(self.shape, j + 1)}/.joint/<object>"
            self.meshcat.SetProperty(path, "material.color", colour[j].tolist(), time)


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Rotation matrix (3, 3) of angles about fixed axes [rad]."""
    from pydrake.math import RollPitchYaw

    return RollPitchYaw(roll, pitch, yaw).ToRotationMatrix().matrix()


def angle_axis(angle: float, axis: np.ndarray) -> Any:
    """Drake's rotation by an angle [rad] about a unit axis (3,)."""
    from pydrake.common.eigen_geometry import AngleAxis

    return AngleAxis(angle, axis)


ROOT, GHOST = "/robot", "/ghost"  # Meshcat paths; below them a dot begins what is no joint, which may have any name
BONE, TENDON, GUIDE, SKIN = 0.0018, 0.0008, 0.0012, 0.20  # radii [m] and opacity
GHOSTLY = (0.42, 0.45, 0.50, 0.45)  # colour, which no load has, and opacity of the second robot
GROUND, CELL, CELLS = -0.085, 0.01, 12  # height [m], width [m] and half the number of squares
ACROSS = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])  # z lies along the joints' axes


@dataclass(frozen=True)
class Thing:
    """An object at the robot.

    Attributes:
        centre: (x, z) [m].
        radius: [m].
        length: of a cylinder along the joints' axes [m]; None for a sphere.
    """

    centre: tuple[float, float]
    radius: float
    length: float | None = None


def segment_path(bones: Skeleton | Shape, segment: int, root: str = ROOT) -> str:
    """Meshcat path of a segment; segments hang on those that carry them."""
    return "/".join([root, *bones.carriers(segment)])


def tendon_path(bones: Skeleton, piece: Any) -> str:
    """Meshcat path of a piece of a tendon."""
    return f"{segment_path(bones, piece.first)}/{piece.tendon}_{piece.name}"


def pose(position: np.ndarray | list[float], rotation: np.ndarray | None = None) -> Any:
    """A Drake transform from a position (3,) [m] and a rotation matrix (3, 3) [-]."""
    from pydrake.math import RigidTransform, RotationMatrix

    return RigidTransform(
        RotationMatrix(np.eye(3) if rotation is None else rotation), np.asarray(position, dtype=float)
    )


def draw_scene(meshcat: Any, bones: Skeleton, thing: Thing | None, ghost: bool) -> None:
    """Draws what does not move: base, segments, skin, joints, guides, ghost, object, ground and camera."""
    from pydrake.geometry import Box, Cylinder, Rgba, Sphere

    dark, bone = Rgba(0.27, 0.31, 0.38, 1.0), Rgba(0.93, 0.90, 0.83, 1.0)
    meshcat.SetObject(f"{ROOT}/.cuff", Box(0.010, 0.026, 0.026), dark)
    meshcat.SetTransform(f"{ROOT}/.cuff", pose([bones.base, 0.0, 0.0]))
    draw_segments(meshcat, bones, ROOT, "bone", [BONE] * len(bones.joints), bone)
    draw_segments(meshcat, bones, ROOT, "skin", list(bones.radii), Rgba(0.87, 0.68, 0.58, SKIN))
    if ghost:
        draw_segments(meshcat, bones, GHOST, "bone", [1.6 * BONE] * len(bones.joints), Rgba(*GHOSTLY))
    for i in range(1, len(bones.joints) + 1):
        path = f"{segment_path(bones, i)}/.joint"
        meshcat.SetObject(path, Cylinder(1.2 * BONE, 0.010), dark)
        meshcat.SetTransform(path, pose([0.0, 0.0, 0.0], ACROSS))
    for k, (segment, point) in enumerate(bones.guides):
        path = f"{segment_path(bones, segment)}/.guide_{k}"
        meshcat.SetObject(path, Sphere(GUIDE), Rgba(0.15, 0.17, 0.22, 1.0))
        meshcat.SetTransform(path, pose(point))
    if thing is not None:
        shape = Sphere(thing.radius) if thing.length is None else Cylinder(thing.radius, thing.length)
        meshcat.SetObject("/object", shape, Rgba(0.35, 0.55, 0.75, 0.55))
        meshcat.SetTransform("/object", pose([thing.centre[0], 0.0, thing.centre[1]], ACROSS))
    draw_ground(meshcat)


def draw_segments(meshcat: Any, bones: Skeleton, root: str, name: str, radii: list[float], colour: Any) -> None:
    """Draws a capsule for the base and each segment; radii: of the segments [m], the base a little thicker."""
    from pydrake.geometry import Capsule

    lying, lengths = turn(np.pi / 2), [-bones.base, *bones.lengths]
    for i, radius in enumerate([1.15 * radii[0] if name == "skin" else radii[0], *radii]):
        path = f"{segment_path(bones, i, root)}/.{name}"
        meshcat.SetObject(path, Capsule(radius, lengths[i]), colour)
        meshcat.SetTransform(path, pose([(lengths[i] if i else -lengths[0]) / 2.0, 0.0, 0.0], lying))


class Finger:
    """Draws a finger with tendons with a Meshcat."""

    def __init__(self, meshcat: Any, bones: Skeleton, thing: Thing | None = None) -> None:
        self.meshcat, self.bones, self.thing = meshcat, bones, thing

    def begin(self, angle: np.ndarray, ghost: bool) -> None:
        """Draws what there is at angles (joints,) [rad]; ghost: a second finger, too."""
        draw_scene(self.meshcat, self.bones, self.thing, ghost)
        draw_tendons(self.meshcat, self.bones, angle)

    def turn(self, root: str, time: float, angle: np.ndarray) -> None:
        """Adds a frame at a time [s] with these angles (joints,) [rad]."""
        for i in range(len(self.bones.joints)):
            place = pose([self.bones.lengths[i - 1] if i else 0.0, 0.0, 0.0], turn(angle[i]))
            self.meshcat.SetTransform(segment_path(self.bones, i + 1, root), place, time)

    def frame(self, time: float, angle: np.ndarray, colour: np.ndarray) -> None:
        """Adds a frame at a time [s]: angles (joints,) [rad], and linear RGB (tendons, 3) of the tendons."""
        self.move(time, angle)
        for piece in self.bones.pieces:
            shade = colour[self.bones.tendons.index(piece.tendon)].tolist()
            self.meshcat.SetProperty(f"{tendon_path(self.bones, piece)}/<object>", "material.color", shade, time)

    def show(self, time: float, angle: np.ndarray, colour: np.ndarray) -> None:
        """Shows at once what `frame` adds to a recording: Meshcat names colours differently outside of recordings."""
        self.move(time, angle)
        for tendon, shade in zip(self.bones.tendons, colour):
            for piece in (piece for piece in self.bones.pieces if piece.tendon == tendon):
                self.meshcat.SetProperty(tendon_path(self.bones, piece), "color", [*shade, 1.0])

    def move(self, time: float, angle: np.ndarray) -> None:
        """Adds angles (joints,) [rad] at a time [s]."""
        self.turn(ROOT, time, angle)
        for piece in (piece for piece in self.bones.pieces if piece.first != piece.last):
            path, (middle, rotation, length) = tendon_path(self.bones, piece), along(*span(self.bones, piece, angle))
            self.meshcat.SetTransform(path, pose(middle, rotation), time)
            self.meshcat.SetProperty(path, "scale", [1.0, 1.0, length], time)


def draw_ground(meshcat: Any) -> None:
    """Draws a pale grid of 1 cm squares below the finger, and sets the camera at the side."""
    draw_squares(meshcat, GROUND, CELL, CELLS)
    meshcat.SetCameraPose([0.040, -0.148, 0.022], [0.008, 0.0, -0.020])


def draw_squares(meshcat: Any, height: float, width: float, count: int) -> None:
    """Draws a white background and a pale grid of 2 `count` squares of that width [m] a side, at a height [m]."""
    from pydrake.geometry import Rgba

    for end in ("top_color", "bottom_color"):
        meshcat.SetProperty("/Background", end, [1.0, 1.0, 1.0])
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Grid", "visible", False)
    at = width * np.arange(-count, count + 1)
    far, low = np.full_like(at, width * count), np.full_like(at, height)
    starts = np.hstack([[at, -far, low], [-far, at, low]])
    ends = np.hstack([[at, far, low], [far, at, low]])
    meshcat.SetLineSegments("/ground", starts, ends, 1.0, Rgba(0.86, 0.88, 0.91, 1.0))


def draw_tendons(meshcat: Any, bones: Skeleton, angle: np.ndarray) -> None:
    """Draws the tendons' pieces at a posture (joints,) [rad]; those over a joint have unit length and are scaled."""
    from pydrake.geometry import Cylinder, Rgba

    for piece in bones.pieces:
        path = tendon_path(bones, piece)
        middle, rotation, length = along(*span(bones, piece, angle))
        fixed = piece.first == piece.last
        meshcat.SetObject(path, Cylinder(TENDON, length if fixed else 1.0), Rgba(0.55, 0.60, 0.67, 1.0))
        meshcat.SetTransform(path, pose(middle, rotation))
        if not fixed:
            meshcat.SetProperty(path, "scale", [1.0, 1.0, length])
