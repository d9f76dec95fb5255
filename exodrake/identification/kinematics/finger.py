"""Model of the markers on a finger: four triads, four axes, and its derivatives for the bundle adjustment.

In the frame of the base triad, a marker X of segment k is carried by the joints before it (paper Eq. 14):

    x = T_abduction(theta_1) T_MCP(theta_2) T_PIP(theta_3) T_DIP(theta_4) X       (as many factors as joints before it)
    T(theta) X = R (X - Q) + Q,  R = e^{[w] theta},  Q = Y + G theta

and X is its place at rest, where all angles are 0. Derivatives of one factor, with d = X - Q:

    dx/dtheta = w x R d + (I - R) G      dx/dY = I - R      dx/dG = theta (I - R)      dx/dw: R [d] - [R d]

The last is for a small rotation of w. `Finger.free` lists the changes that markers can show: the base triad keeps its
frame, centres and slopes stay normal to their axes, and the two axes of the MCP perpendicular. (A component of the
abduction axis along the flexion axis is, to first order, a change of the flexion angle.)
"""

from dataclasses import dataclass

import numpy as np

from exodrake.identification.kinematics.axis import Axis, across
from exodrake.identification.kinematics.rigid import hat, rotation, turned_by
from exodrake.identification.kinematics.triads import corners

SEGMENTS, TRIAD = 4, 3
COUNT = 3 * TRIAD * SEGMENTS  # coordinates of markers
PER_AXIS = 9  # small rotation of w, Y, G
ALL = COUNT + PER_AXIS * 4
LOCAL = 10  # of a frame: rotation and shift of the hand, four angles
FREE = 51  # changes of a finger that markers can show


@dataclass(frozen=True)
class Finger:
    """Finger at rest in the frame of the base triad.

    Attributes:
        markers: (4, 3, 3) markers of base, proximal, middle and distal segment [m].
        axes: Abduction, MCP, PIP and DIP flexion.
    """

    markers: np.ndarray
    axes: tuple[Axis, Axis, Axis, Axis]

    def free(self) -> np.ndarray:
        """Changes that markers can show, as columns (72, 51) [m, rad, m/rad] of markers, then w, Y, G of each axis."""
        blocks = np.zeros((ALL, 3 + COUNT - 9))
        blocks[:9, :3] = corners().reshape(9, 3)
        blocks[9:COUNT, 3:] = np.eye(COUNT - 9)
        pair = np.zeros((ALL, 3))
        pair[COUNT : COUNT + 3] = pair[COUNT + PER_AXIS : COUNT + PER_AXIS + 3] = np.eye(3)
        columns = [blocks, pair]
        for number, axis in enumerate(self.axes):
            plane = np.linalg.svd(axis.direction[None])[2][1:].T
            for part in range(3):
                if (number, part) in ((0, 0), (1, 0), (0, 2)):
                    continue  # the two MCP axes turn together, and the abduction axis stays in place
                column = np.zeros((ALL, 2))
                start = COUNT + PER_AXIS * number + 3 * part
                column[start : start + 3] = plane
                columns.append(column)
        return np.hstack(columns)

    def moved(self, change: np.ndarray) -> "Finger":
        """Finger after a change (72,) of markers [m], directions [rad], centres [m] and slopes [m/rad]."""
        axes = []
        for axis, (turn, shift, slope) in zip(self.axes, change[COUNT:].reshape(4, 3, 3), strict=True):
            w = turned_by(turn) @ axis.direction
            axes.append(Axis(w, across(axis.point + shift, w), across(axis.slope + slope, w)))
        return Finger(self.markers + change[:COUNT].reshape(self.markers.shape), tuple(axes))  # type: ignore[arg-type]

    def places(self, angles: np.ndarray) -> np.ndarray:
        """Markers (frames, 12, 3) [m] in the frame of the base triad at angles (frames, 4) [rad]."""
        return self.linearised(angles, derivatives=False)[0]

    def linearised(self, angles: np.ndarray, derivatives: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places of the markers and their derivatives.

        Args:
            angles: (frames, 4) abduction, MCP, PIP, DIP [rad].
            derivatives: False leaves them zero.

        Returns:
            Places (frames, 12, 3) [m], and their derivatives with respect to the angles (frames, 12, 3, 4) [m/rad] and
            to a change of the finger (frames, 12, 3, 72).
        """
        frames = len(angles)
        turns = [rotation(axis.direction, angles[:, k]) for k, axis in enumerate(self.axes)]
        place = np.empty((frames, SEGMENTS, TRIAD, 3))
        by_angle = np.zeros((frames, SEGMENTS, TRIAD, 3, 4))
        by_change = np.zeros((frames if derivatives else 0, SEGMENTS, TRIAD, 3, ALL))
        for k in range(SEGMENTS):
            x = np.broadcast_to(self.markers[k], (frames, TRIAD, 3))
            angle, change, turn = by_angle[:, k], by_change[:, k], np.broadcast_to(np.eye(3), (frames, 3, 3))
            for number in reversed(range(k + 1 if k else 0)):
                x = self._carried(number, x, angles[:, number], turns[number], angle, change if derivatives else None)
                turn = turns[number] @ turn
            place[:, k] = x
            for marker in range(TRIAD if derivatives else 0):
                start = 9 * k + 3 * marker
                change[:, marker, :, start : start + 3] = turn
        flat = (frames, SEGMENTS * TRIAD, 3)
        return place.reshape(flat), by_angle.reshape(*flat, 4), by_change.reshape(len(by_change), *flat[1:], ALL)

    def _carried(self, number, x, theta, turn, angle, change) -> np.ndarray:
        """Carry markers x (frames, 3, 3) [m] and their derivatives by one joint, and add those of the joint."""
        axis, rotate = self.axes[number], turn[:, None]
        centre = axis.centre(theta)[:, None]
        lever = x - centre
        turned = lever @ np.swapaxes(turn, 1, 2)
        still = (np.eye(3) - turn)[:, None]
        angle[:] = rotate @ angle
        angle[..., number] = np.cross(axis.direction, turned) + still @ axis.slope
        if change is not None:
            start = COUNT + PER_AXIS * number
            beyond = slice(start + PER_AXIS, ALL)  # of the joints between this one and the markers
            change[..., beyond] = rotate @ change[..., beyond]
            change[..., start : start + 3] = rotate @ hat(lever) - hat(turned)
            change[..., start + 3 : start + 6] = still
            change[..., start + 6 : start + 9] = theta[:, None, None, None] * still
        return turned + centre
