"""Results of the identification: a table like the paper's Table 1 (CSV, Markdown, terminal), robot file and figure."""

import csv
import io
from pathlib import Path

import numpy as np

from exodrake.core.files import write_folder
from exodrake.identification.kinematics.identify import Joint, Kinematics
from exodrake.identification.kinematics.layout import SEGMENTS

HEAD = (
    "joint", "axis", "gradient [mm/rad]", "gradient half width", "intercept [mm]", "intercept half width", "RMSE [mm]",
)  # fmt: skip
JOINT_HEAD = (
    "joint", "flexion range [rad]", "frames used", "3-D RMSE [mm]", "phalanx", "length [mm]", "half width [mm]",
)  # fmt: skip
LENGTHS = ("proximal", "middle", "distal")


def table_rows(found: Kinematics) -> list[tuple[str, ...]]:
    """Format the rows under HEAD, three per joint, in mm and mm/rad."""
    rows = []
    for joint in found.joints:
        line = joint.line
        columns = (line.gradient, line.gradient_interval, line.intercept, line.intercept_interval, line.rmse)
        for number, axis in enumerate("XYZ"):
            rows.append((joint.name, axis, *(f"{1e3 * column[number]:.3f}" for column in columns)))
    return rows


def length_rows(found: Kinematics) -> list[tuple[str, str, str, str]]:
    """Format joint, distal phalanx, its length and 95 % half width [mm]."""
    parameters = zip(found.joints, LENGTHS, found.lengths, found.intervals, strict=True)
    return [(joint.name, bone, f"{1e3 * length:.2f}", f"{1e3 * half:.2f}") for joint, bone, length, half in parameters]


def table_csv(found: Kinematics) -> str:
    """Format the table as CSV, followed by the lengths."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(HEAD)
    writer.writerows(table_rows(found))
    for joint, bone, length, half in length_rows(found):
        writer.writerow((joint, f"{bone} length", "", "", length, half, ""))
    return stream.getvalue()


def table_markdown(found: Kinematics) -> str:
    """Format the table as Markdown, followed by lengths, ranges, quality and remarks."""
    lines = [f"# Kinematic identification of {Path(found.source).name}", "", _row(HEAD), _row(["---"] * len(HEAD))]
    lines += [_row(row) for row in table_rows(found)]
    lines += [
        "",
        "Centre = gradient x angle + intercept, normal to the joint's axis, in the frame of the proximal segment.",
        "",
    ]
    lines += [_row(JOINT_HEAD), _row(["---"] * len(JOINT_HEAD))]
    for joint, (_, bone, length, half) in zip(found.joints, length_rows(found), strict=True):
        span = "{:.3f} .. {:.3f}".format(*joint.range)
        lines.append(_row((joint.name, span, joint.line.frames, f"{1e3 * joint.line.rmse_3d:.2f}", bone, length, half)))
    lines += ["", *(f"* {note}" for note in notes(found))]
    return "\n".join(lines) + "\n"


def notes(found: Kinematics) -> list[str]:
    """List the quality of the triads, the limits of the intervals, and the remarks of the label check."""
    residuals = ", ".join(f"{name} {1e3 * value:.2f}" for name, value in zip(SEGMENTS, found.residuals, strict=True))
    return [
        f"Median residual of the triads after smoothing [mm]: {residuals}.",
        f"Noise of the markers {1e3 * found.noise:.2f} mm per axis; errors that last for several frames make the"
        f" variances of the intervals {found.inflation:.1f} times those of independent noise.",
        "Half widths (95 %) include noise and what deforms the triads; skin that carries a whole triad along with the"
        " angle comes on top and cannot be seen in the markers alone.",
        "The distal length runs from the DIP axis to the tip marker, along the straight finger.",
        *found.remarks,
    ]


def robot_yaml(found: Kinematics) -> str:
    """Format a robot file: the nominal robot with the identified phalanx lengths [m], each with its source."""
    name = Path(found.source).name
    lines = [f"# source: exodrake identify kinematics {name}, {len(found.time)} frames; lengths in m, 95 % half widths"]
    lines += ["base: exo_index", "parameters:"]
    for joint, length, half in zip(found.joints, found.lengths, found.intervals, strict=True):
        lines.append(f"  finger.length.{joint.name}: {length:.5f}  # +- {half:.5f} m, source: markers, {name}")
    for joint in found.joints:
        low, high = joint.range
        lines.append(f"# seen: {joint.name} {low:.3f} .. {high:.3f} rad, centre moves {1e3 * _speed(joint):.2f} mm/rad")
    return "\n".join(lines) + "\n"


def _speed(joint: Joint) -> float:
    return float(np.linalg.norm(joint.line.gradient))


def write_report(found: Kinematics, folder: str | Path) -> list[Path]:
    """Write kinematics.csv, .md, .png and robot.yaml into a folder and return the files. InputError if it cannot."""
    from exodrake.identification.kinematics.figure import centre_figure

    contents = {
        "kinematics.csv": table_csv(found).encode(),
        "kinematics.md": table_markdown(found).encode(),
        "robot.yaml": robot_yaml(found).encode(),
        "kinematics.png": centre_figure(found),
    }
    return write_folder(folder, contents)


def print_table(found: Kinematics) -> None:
    """Print both tables on the terminal."""
    from rich.console import Console
    from rich.table import Table

    console = Console()
    table = Table(title=f"Joint centres of {Path(found.source).name}: centre = gradient x angle + intercept")
    for column in ("joint", "axis", "gradient [mm/rad]", "intercept [mm]", "RMSE [mm]"):
        table.add_column(column, justify="left" if column in HEAD[:2] else "right")
    for joint, axis, gradient, half_gradient, intercept, half_intercept, rmse in table_rows(found):
        shown = (
            f"{float(gradient):.2f} ± {float(half_gradient):.2f}",
            f"{float(intercept):.2f} ± {float(half_intercept):.2f}",
        )
        table.add_row(joint if axis == "X" else "", axis, *shown, f"{float(rmse):.2f}", end_section=axis == "Z")
    console.print(table)
    lengths = Table(title="Phalanx lengths and range of motion")
    for column in ("joint", "flexion [rad]", "phalanx", "length [mm]"):
        lengths.add_column(column)
    for joint, (name, bone, length, half) in zip(found.joints, length_rows(found), strict=True):
        lengths.add_row(name, "{:.2f} .. {:.2f}".format(*joint.range), bone, f"{length} ± {half}")
    console.print(lengths)


def _row(cells) -> str:
    return "| " + " | ".join(str(cell) for cell in cells) + " |"
