"""A serial arm in space: a bar for each link, a drum for a turning joint, a carriage on a rail for a sliding one."""

from __future__ import annotations

from typing import Any

import numpy as np

from exodrake.core.skeleton import SPACING, Shape
from exodrake.diagrams.meshcat.scene import GHOST, GHOSTLY, ROOT, draw_squares, pose, segment_path
from exodrake.diagrams.meshcat.shapes import along

SMALLEST = 0.3  # m, reach of a drawn arm at least, for an axis whose frames coincide: assumed
PLATE, BELOW = 0.16, 0.1  # width of the base, and how far it lies below axes side by side: shares of the size
BAR, DRUM, LONG, CUBE, RAIL = 0.028, 0.045, 0.11, 0.11, 0.015  # radii, lengths and widths as shares of the reach
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

        wide = np.array([PLATE * self.size, self.reach if self.shape.beside else PLATE * self.size, 0.03 * self.size])
        base = f"{ROOT}/base", pose([0.0, 0.0, -BELOW * self.size * self.shape.beside])
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
        self.meshcat.SetCameraPose(middle + self.reach * view, middle)

    def _limbs(self, root: str, colour: tuple, width: float) -> None:
        """Bars, drums and carriages under a path."""
        from pydrake.geometry import Box, Capsule, Cylinder, Rgba

        size, shape = width * self.size, self.shape
        for j, end in enumerate(shape.ends):
            path = segment_path(shape, j + 1, root)
            if np.linalg.norm(end) > 1e-6:
                middle, turn, length = along(np.zeros(3), end)
                self.meshcat.SetObject(f"{path}/link", Capsule(BAR * size, length), Rgba(*colour))
                self.meshcat.SetTransform(f"{path}/link", pose(middle, turn))
            body = Box(*(3 * [CUBE * size])) if shape.sliding[j] else Cylinder(DRUM * size, LONG * size)
            self.meshcat.SetObject(f"{path}/joint", body, Rgba(*(DRUMS if root == ROOT else colour)))
            self.meshcat.SetTransform(f"{path}/joint", pose([0.0, 0.0, 0.0], along(np.zeros(3), shape.axes[j])[1]))
            if shape.sliding[j] and root == ROOT:
                base = root if shape.beside else segment_path(shape, j, root)
                rail, fixed = f"{base}/rail_{j}", rotation(*shape.angles[j])
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
            path = f"{segment_path(self.shape, j + 1)}/joint/<object>"
            self.meshcat.SetProperty(path, "material.color", colour[j].tolist(), time)


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Rotation matrix (3, 3) of angles about fixed axes [rad]."""
    from pydrake.math import RollPitchYaw

    return RollPitchYaw(roll, pitch, yaw).ToRotationMatrix().matrix()


def angle_axis(angle: float, axis: np.ndarray) -> Any:
    """Drake's rotation by an angle [rad] about a unit axis (3,)."""
    from pydrake.common.eigen_geometry import AngleAxis

    return AngleAxis(angle, axis)
