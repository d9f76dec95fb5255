"""Results of the identification: a table like the paper's Table 1 (CSV, Markdown), robot file, figure (Fig. 9)."""

from pathlib import Path

import matplotlib
import numpy as np

from exodrake.core.errors import markdown_table
from exodrake.data.plot import STYLE, new_figure, render_png
from exodrake.identification.kinematics.identify import SMALLEST_ANGLE, Kinematics
from exodrake.identification.kinematics.markers import SEGMENTS

HEAD = (
    "joint", "axis", "gradient [mm/rad]", "gradient half width", "intercept [mm]", "intercept half width", "RMSE [mm]",
)  # fmt: skip
JOINT_HEAD = (
    "joint", "flexion range [rad]", "frames used", "3-D RMSE [mm]", "phalanx", "length [mm]", "half width [mm]",
)  # fmt: skip
LENGTHS = ("proximal", "middle", "distal")
PROXIMAL = ("back of the hand", "proximal phalanx", "middle phalanx")
COLOURS = {"X": "#1f6fb4", "Y": "#d1592b", "Z": "#3a8f4f"}


def table_rows(found: Kinematics) -> list[tuple[str, ...]]:
    """Format the rows under HEAD, three per joint, in mm and mm/rad."""
    rows = []
    for joint in found.joints:
        slope, point = joint.half_widths
        columns = np.transpose([joint.axis.slope, slope, joint.axis.point, point, joint.rmse])
        rows += [(joint.name, axis, *(f"{1e3 * x:.3f}" for x in row)) for axis, row in zip("XYZ", columns)]
    return rows


def length_rows(found: Kinematics) -> list[tuple[str, str, str, str]]:
    """Format joint, distal phalanx, its length and 95 % half width [mm]."""
    parameters = zip(found.joints, LENGTHS, found.lengths, found.intervals, strict=True)
    return [(joint.name, bone, f"{1e3 * length:.2f}", f"{1e3 * half:.2f}") for joint, bone, length, half in parameters]


def table_csv(found: Kinematics) -> str:
    """Format the table as CSV, followed by the lengths."""
    lengths = [(joint, f"{bone} length", "", "", length, half, "") for joint, bone, length, half in length_rows(found)]
    return "".join(",".join(row) + "\n" for row in (HEAD, *table_rows(found), *lengths))


def table_markdown(found: Kinematics) -> str:
    """Format the table as Markdown, followed by lengths, ranges, quality and remarks."""
    joints = [
        (name, "{:.3f} .. {:.3f}".format(*joint.range), joint.frames, f"{1e3 * np.linalg.norm(joint.rmse):.2f}", *rest)
        for joint, (name, *rest) in zip(found.joints, length_rows(found), strict=True)
    ]
    residuals = ", ".join(f"{name} {1e3 * value:.2f}" for name, value in zip(SEGMENTS, found.residuals, strict=True))
    notes = (
        f"Median residual of the triads after smoothing [mm]: {residuals}.",
        f"Noise of the markers {1e3 * found.noise:.2f} mm per axis; errors that last for several frames make the"
        f" variances of the intervals {found.inflation:.1f} times those of independent noise.",
        "Half widths (95 %) include noise and what deforms the triads; skin that carries a whole triad along with the"
        " angle comes on top and cannot be seen in the markers alone.",
        "The distal length runs from the DIP axis to the tip marker, along the straight finger.",
        *found.remarks,
    )
    parts = [
        f"# Kinematic identification of {Path(found.source).name}",
        markdown_table(HEAD, table_rows(found)),
        "Centre = gradient x angle + intercept, normal to the joint's axis, in the frame of the proximal segment.",
        markdown_table(JOINT_HEAD, joints),
        "\n".join(f"* {note}" for note in notes),
    ]
    return "\n\n".join(parts) + "\n"


def robot_yaml(found: Kinematics) -> str:
    """Format a robot file: the nominal robot with the identified phalanx lengths [m], each with its source."""
    name = Path(found.source).name
    lines = [f"# source: exodrake identify kinematics {name}, {len(found.time)} frames; lengths in m, 95 % half widths"]
    lines += ["base: exo_index", "parameters:"]
    for joint, length, half in zip(found.joints, found.lengths, found.intervals, strict=True):
        lines.append(f"  finger.length.{joint.name}: {length:.5f}  # +- {half:.5f} m, source: markers, {name}")
    for joint in found.joints:
        (low, high), speed = joint.range, 1e3 * np.linalg.norm(joint.axis.slope)
        lines.append(f"# seen: {joint.name} {low:.3f} .. {high:.3f} rad, centre moves {speed:.2f} mm/rad")
    return "\n".join(lines) + "\n"


def make_report(found: Kinematics) -> dict[str, str | bytes]:
    """Contents of kinematics.csv, .md, .png and robot.yaml."""
    return {
        "kinematics.csv": table_csv(found), "kinematics.md": table_markdown(found),
        "robot.yaml": robot_yaml(found), "kinematics.png": centre_figure(found),
    }  # fmt: skip


@matplotlib.rc_context(STYLE)
def centre_figure(found: Kinematics) -> bytes:
    """Draw the figure as PNG: a column per joint, a row per axis of the proximal frame, equal heights in mm."""
    figure = new_figure(11.0, 8.0)
    panels = figure.subplots(3, len(found.joints), sharex="col")
    ends = [1e3 * joint.axis.centre(np.array(joint.range)) for joint in found.joints]
    heights = [np.abs(b - a) + 8e3 * joint.rmse for (a, b), joint in zip(ends, found.joints)]
    height = float(np.max(heights))  # mm, of line and scatter
    for column, (joint, frame) in enumerate(zip(found.joints, PROXIMAL, strict=True)):
        used, span = np.abs(np.nan_to_num(joint.angle)) >= SMALLEST_ANGLE, np.linspace(*joint.range, 60)
        for row, (axis, colour) in enumerate(COLOURS.items()):
            panel = panels[row, column]
            middle, half = 1e3 * joint.axis.centre(span)[:, row], 1e3 * joint.band(span)[:, row]
            dots = {"ms": 3, "color": colour, "alpha": 0.3, "mec": "none", "label": "a frame"}
            panel.plot(joint.angle[used], 1e3 * joint.centre[used, row], ".", **dots)
            band = {"color": "0.15", "alpha": 0.25, "lw": 0, "label": "95 % band of the line"}
            panel.fill_between(span, middle - half, middle + half, **band)
            panel.plot(span, middle, color="0.15", lw=1.4, label="line, of all frames together")
            left_out = {"color": "0.93", "lw": 0, "zorder": 0, "label": "angle too small, left out"}
            panel.axvspan(max(joint.range[0], -SMALLEST_ANGLE), SMALLEST_ANGLE, **left_out)
            gradient, intercept, rmse = (1e3 * v[row] for v in (joint.axis.slope, joint.axis.point, joint.rmse))
            equation = f"{gradient:+.2f} θ {intercept:+.2f},  RMSE {rmse:.2f} mm"
            box = {"fc": "white", "ec": "none", "pad": 1.5}
            panel.text(0.03, 0.97, equation, transform=panel.transAxes, va="top", fontsize=8, bbox=box)
            panel.set_ylim(np.mean(middle) + height * np.array([-0.5, 0.5]))
            panel.set_ylabel("" if column else f"{axis} [mm]")
        panels[0, column].set_title(f"{joint.name} centre, seen from the\n{frame}", fontsize=10)
        panels[2, column].set_xlabel(f"{joint.name} flexion [rad]")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), markerscale=5)
    return render_png(figure, dpi=130)
