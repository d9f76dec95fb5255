"""Write docs/finger.gif: a grasp by the nominal finger and by one with sheath friction, on the same reference.

python docs/_finger.py
"""

from io import BytesIO
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image
from pydrake.math import RotationMatrix

import exodrake as exo
from exodrake.data.plot import IMPROVED, MEASURED, NOMINAL, STYLE, new_figure
from exodrake.diagrams.meshcat import span
from exodrake.model.mechanism import Skeleton

EVERY, DPI, COLOURS = 5, 100, 64  # frames of 20 ms, dots per inch, colours of the picture
SKIN, GHOST = "#f1ddd0", "#f6e3d6"


def places(bones: Skeleton, angle: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Origin (3,) [m] and rotation (3, 3) of each segment at angles (joints,) [rad]."""
    found = [(np.zeros(3), np.eye(3))]
    for i, flexed in enumerate(angle):
        origin, rotation = found[-1]
        start = np.array([bones.lengths[i - 1] if i else 0.0, 0.0, 0.0])
        found.append((origin + rotation @ start, rotation @ RotationMatrix.MakeYRotation(flexed).matrix()))
    return found


def draw_finger(axes, bones: Skeleton, angle: np.ndarray, style: dict, ghost: bool) -> None:
    """Draw phalanges and tendons at angles (joints,) [rad] from the side."""
    frames = places(bones, angle)
    ends = [origin for origin, _ in frames[1:]] + [frames[-1][0] + frames[-1][1] @ [bones.lengths[-1], 0.0, 0.0]]
    line = 1e3 * np.array([[bones.base, 0.0, 0.0], *ends])[:, (0, 2)]
    axes.plot(*line.T, color=GHOST if ghost else SKIN, lw=20, alpha=0.45 if ghost else 1, solid_capstyle="round")
    axes.plot(*line.T, marker="o", ms=3.5, **style | {"linewidth": 1.8})
    for piece in () if ghost else bones.pieces:
        origin, rotation = frames[piece.first]
        tendon = np.array([origin + rotation @ point for point in span(bones, piece, angle)])
        axes.plot(*(1e3 * tendon[:, (0, 2)]).T, color=IMPROVED["color"] if piece.tendon == "AF" else "#6b7280", lw=1.0)


def frame(row: int, bones: Skeleton, nominal: exo.Log, log: exo.Log) -> Image.Image:
    """The picture of a row of both logs."""
    figure = new_figure(7.4, 2.8)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1))
    side = figure.add_subplot(grid[:, 0], aspect="equal", xlim=(-62, 82), ylim=(-72, 16))
    side.set_axis_off()
    side.set_title("Dotted: nominal. Black: friction in the sheath of AF (blue)", loc="left", fontsize=9)
    for one, style, ghost in ((nominal, NOMINAL, True), (log, MEASURED, False)):
        draw_finger(side, bones, one.array("angle")[row], style, ghost)
    for k, (column, factor, label, top) in enumerate(
        [("tension_AF", 1.0, "Tension AF [N]", 8.5), ("angle_DIP", 180 / np.pi, "Joint angle DIP [°]", 72)]
    ):
        axes = figure.add_subplot(grid[k, 1], xlim=(0, log.duration), ylim=(0, top), ylabel=label)
        axes.tick_params(labelbottom=bool(k))
        for one, style in ((nominal, NOMINAL), (log, MEASURED)):
            axes.plot(one.time[: row + 1], factor * one[column][: row + 1], **style | {"linewidth": 1.8})
    axes.set_xlabel("Time [s]")
    buffer = BytesIO()
    figure.savefig(buffer, dpi=DPI)
    return Image.open(buffer).convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)


def main() -> None:
    """Simulate both grasps and write the picture."""
    robot, reference = exo.load_robot(), exo.grasp("caging")
    rusty = robot.splice("tendon.capstan_friction", {"mu_phi": 0.3}, channels=["AF"])
    nominal, log = (exo.simulate(one, reference) for one in (robot, rusty))
    assert robot.machine.skeleton is not None
    bones = robot.machine.skeleton(robot)
    with matplotlib.rc_context(STYLE):
        images = [frame(row, bones, nominal, log) for row in range(0, len(log), EVERY)]
    path = Path(__file__).with_name("finger.gif")
    images[0].save(path, save_all=True, append_images=images[1:], duration=20 * EVERY, loop=0, optimize=True)
    print(f"{path.name}: {len(images)} frames, {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
