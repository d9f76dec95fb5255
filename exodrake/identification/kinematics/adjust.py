"""Bundle adjustment: finger, hand poses and joint angles together, by least squares over all seen markers.

    minimise  sum over frames and seen markers |y - (R_f x(finger, theta_f) + p_f)|^2      mean theta over the rest = 0

Each frame has ten unknowns of its own (pose of the hand, four angles), the finger 51. With H_f the normal matrix of a
frame, E_f its coupling to the finger and C_f to the constraint, the frames are eliminated by the Schur complement

    [N - sum E' H^-1 E,  - sum E' H^-1 C]
    [     symmetric   ,  - sum C' H^-1 C]

so a step costs one 55 x 55 system (Triggs et al., Bundle Adjustment, 1999, section 6.1). The inverse of that matrix
times the variance of the noise is the covariance of the finger. Errors of neighbouring frames may be correlated (skin,
filters of the camera software), so it is multiplied by the variance inflation of sums over blocks of frames, if that
exceeds 1. A weak prior holds what the motion does not show, such as the abduction axis of a hand without abduction.

The model of the markers: in the frame of the base triad, a marker X of segment k is carried by the joints before it
(paper Eq. 14):

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

from exodrake.identification.kinematics.rigid import Axis, across, apply, corners, hat, inverse, motion, rotation

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

    def shift(self, change: np.ndarray) -> "Finger":
        """Finger after a change (72,) of markers [m], directions [rad], centres [m] and slopes [m/rad]."""
        axes = []
        for axis, (turn, shift, slope) in zip(self.axes, change[COUNT:].reshape(4, 3, 3), strict=True):
            w = rotation(turn) @ axis.direction
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
        frames, size = len(angles), ALL if derivatives else 0
        turns = [axis.turn(angles[:, k]) for k, axis in enumerate(self.axes)]
        place = np.empty((frames, SEGMENTS, TRIAD, 3))
        by_angle = np.zeros((frames, SEGMENTS, TRIAD, 3, 4))
        by_change = np.zeros((frames, SEGMENTS, TRIAD, 3, size))
        for k in range(SEGMENTS):
            x = np.broadcast_to(self.markers[k], (frames, TRIAD, 3))
            angle, change, whole = by_angle[:, k], by_change[:, k], np.broadcast_to(np.eye(3), (frames, 3, 3))
            for number in reversed(range(k + 1 if k else 0)):  # carry markers and derivatives by one joint
                axis, turn, theta = self.axes[number], turns[number], angles[:, number]
                centre, rotate = axis.centre(theta)[:, None], turn[:, None]
                lever = x - centre
                turned = lever @ np.swapaxes(turn, 1, 2)
                still = (np.eye(3) - turn)[:, None]
                angle[:] = rotate @ angle
                angle[..., number] = np.cross(axis.direction, turned) + still @ axis.slope
                if derivatives:
                    start = COUNT + PER_AXIS * number
                    beyond = slice(start + PER_AXIS, ALL)  # of the joints between this one and the markers
                    change[..., beyond] = rotate @ change[..., beyond]
                    change[..., start : start + 3] = rotate @ hat(lever) - hat(turned)
                    change[..., start + 3 : start + 6] = still
                    change[..., start + 6 : start + 9] = theta[:, None, None, None] * still
                x, whole = turned + centre, turn @ whole
            place[:, k] = x
            for marker in range(TRIAD if derivatives else 0):
                start = 9 * k + 3 * marker
                change[:, marker, :, start : start + 3] = whole
        flat = (frames, SEGMENTS * TRIAD, 3)
        return place.reshape(flat), by_angle.reshape(*flat, 4), by_change.reshape(*flat, size)


STEPS = 60  # a finger needs 5 to 15
CONVERGED = 1e-10  # relative decrease of the cost
ROUNDING = 1e-14  # m; errors as small are rounding
DAMPING = 1e9  # beyond it no step lowers the cost
FRAME_STEPS, STILL = 20, 1e-12  # of a frame with the finger known; last step [rad, m]
CHUNK = 400  # frames at a time, for memory
HELD = 1e-9  # m2; holds what missing markers leave open in a frame
PRIOR = np.r_[np.full(COUNT, 0.03), np.tile(np.repeat([0.5, 0.03, 0.03], 3), 4)] ** -2  # m, rad, m/rad; assumed, wide


@dataclass(frozen=True)
class Adjusted:
    """Result of the bundle adjustment.

    Attributes:
        finger: The finger.
        covariance: (51, 51) of the coefficients of its `free` changes.
        noise: RMS noise per axis of a marker [m].
        inflation: Factor by which correlated errors enlarge the covariance; 1 for white noise.
        frames: Number of frames.
    """

    finger: Finger
    covariance: np.ndarray
    noise: float
    inflation: float
    frames: int


def adjust(
    points: np.ndarray, rest: np.ndarray, start: Finger, poses: np.ndarray, angles: np.ndarray, block: int
) -> Adjusted:
    """Adjust finger, poses and angles to markers.

    Args:
        points: (frames, 12, 3) measured markers [m], NaN where missing.
        rest: (frames,) mask of the frames whose mean angles are 0.
        start: Finger to start from.
        poses: (frames, 4, 4) poses of the base triad to start from [m].
        angles: (frames, 4) angles to start from [rad].
        block: Number of frames within which errors may be correlated.
    """
    finger, offset, damping = start, np.zeros(ALL), 1e-6
    angles = angles - angles[rest].mean(axis=0)
    error = _errors(points, finger.places(angles), poses)
    for _ in range(STEPS):
        system = _Normal(points, finger, poses, angles, rest)
        prior = _variance(error, points) * PRIOR
        cost = np.sum(error**2) + prior @ offset**2
        while damping < DAMPING:
            change, moves = system.step(prior, offset, damping)
            trial = finger.shift(change), shift_poses(poses, moves), angles + moves[:, 6:]
            left = _errors(points, trial[0].places(trial[2]), trial[1])
            lower = np.sum(left**2) + prior @ (offset + change) ** 2
            if lower <= cost:
                break
            damping *= 10
        else:
            break
        (finger, poses, angles), error, offset, damping = trial, left, offset + change, damping / 10
        if cost - lower <= CONVERGED * cost or lower < error.size * ROUNDING**2:
            break
    system, variance = _Normal(points, finger, poses, angles, rest), _variance(error, points)
    covariance = np.linalg.inv(system.reduced(variance * PRIOR)[0])[:FREE, :FREE]
    # variance of sums over blocks of frames, relative to that of independent errors
    whole = error[: len(error) // block * block].reshape(-1, block, COUNT)
    sums = np.sum(whole.sum(axis=1) ** 2)
    inflation = max(1.0, float(sums / max(np.sum(whole**2), np.finfo(float).tiny)))
    return Adjusted(finger, variance * inflation * covariance, float(np.sqrt(variance)), inflation, len(points))


def fit_frames(points: np.ndarray, finger: Finger, poses: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Fit pose and angles of each frame by Gauss-Newton with the finger known.

    Args:
        points: (frames, 12, 3) markers [m], NaN where missing.
        finger: The finger.
        poses: (frames, 4, 4) poses of the base triad to start from [m].
        angles: (frames, 4) angles to start from [rad].

    Returns:
        Angles (frames, 4) [rad].
    """
    for _ in range(FRAME_STEPS):
        place, by_angle, _ = finger.linearised(angles, derivatives=False)
        error = _errors(points, place, poses)
        own = _own(place, by_angle, points)
        pull = np.einsum("fmil,fmi->fl", own, error)
        normal = np.einsum("fmik,fmil->fkl", own, own) + HELD * np.eye(LOCAL)
        moves = np.linalg.solve(normal, pull[..., None])[..., 0]
        poses, angles = shift_poses(poses, moves), angles + moves[:, 6:]
        if np.max(np.abs(moves), initial=0.0) < STILL:
            break
    return angles


class _Normal:
    """Normal equations of all frames at one estimate."""

    def __init__(self, points, finger: Finger, poses, angles, rest) -> None:
        self.free = finger.free()
        normal, gradient, frames = np.zeros((ALL, ALL)), np.zeros(ALL), []
        for part in (slice(at, at + CHUNK) for at in range(0, len(points), CHUNK)):
            place, by_angle, by_change = finger.linearised(angles[part])
            by_change *= np.isfinite(points[part])[..., None]
            error = _errors(points[part], place, poses[part]).reshape(-1, COUNT)
            own = _own(place, by_angle, points[part]).reshape(-1, COUNT, LOCAL)
            wide = by_change.reshape(-1, COUNT, ALL)
            tall, turned = wide.reshape(-1, ALL), np.swapaxes(own, 1, 2)
            normal += tall.T @ tall
            gradient += tall.T @ error.ravel()
            fixed = np.zeros((len(own), LOCAL, 4))
            fixed[rest[part], 6:] = np.eye(4)
            coupling = np.concatenate([turned @ wide @ self.free, fixed], axis=2)
            frames.append((turned @ own, np.einsum("fil,fi->fl", own, error), coupling))
        self.normal = normal
        self.own, self.pull, self.to = (np.concatenate(part) for part in zip(*frames))
        self.start = np.r_[self.free.T @ gradient, np.zeros(4)]

    def reduced(self, prior: np.ndarray, damping: float = 0.0):
        """Schur complement (55, 55), and H^-1 [coupling, pull] (frames, 10, 56) of each frame; prior: (72,) weights."""
        own = self.own + (damping * self.own + HELD) * np.eye(LOCAL)
        solved = np.linalg.solve(own, np.concatenate([self.to, self.pull[..., None]], axis=2))
        matrix = np.zeros((FREE + 4,) * 2)
        inner = self.free.T @ ((self.normal + np.diag(prior)) @ self.free)
        matrix[:FREE, :FREE] = inner + damping * inner * np.eye(FREE)
        size = len(matrix)
        matrix -= self.to.reshape(-1, size).T @ solved[..., :size].reshape(-1, size)
        return matrix, solved

    def step(self, prior: np.ndarray, offset: np.ndarray, damping: float) -> tuple[np.ndarray, np.ndarray]:
        """Change of the finger (72,) and moves of the frames (frames, 10) [rad, m]."""
        matrix, solved = self.reduced(prior, damping)
        right = self.start - np.einsum("flg,fl->g", self.to, solved[..., -1])
        right[:FREE] -= self.free.T @ (prior * offset)
        answer = np.linalg.solve(matrix, right)
        return self.free @ answer[:FREE], solved[..., -1] - solved[..., :-1] @ answer


def _own(place: np.ndarray, by_angle: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Derivatives (frames, 12, 3, 10) of places with respect to rotation, shift and angles of their frame; 0 unseen."""
    shift = np.broadcast_to(np.eye(3), (*place.shape, 3))
    return np.concatenate([-hat(place), shift, by_angle], axis=3) * np.isfinite(points)[..., None]


def _errors(points: np.ndarray, place: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Measured less predicted markers (frames, 12, 3) [m], seen from the base triad; 0 where missing."""
    return np.nan_to_num(apply(inverse(poses), points) - place)


def shift_poses(poses: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Poses (frames, 4, 4) [m] after small rotations and shifts, moves (frames, 10) [rad, m]."""
    return poses @ motion(rotation(moves[:, :3]), moves[:, 3:6])


def _variance(error: np.ndarray, points: np.ndarray) -> float:
    """Variance of the noise [m2]; a frame seen completely spends ten of its 36 coordinates on its own unknowns."""
    left = np.count_nonzero(np.isfinite(points)) * (1 - LOCAL / COUNT) - FREE
    return float(np.sum(error**2) / max(left, 1))
