"""Figure of joint centres over joint angle with regression line and 95 % band (paper Fig. 9 b-d)."""

import numpy as np

from exodrake.data.plot import new_figure, png_of
from exodrake.identification.kinematics.identify import Joint, Kinematics

PROXIMAL = ("back of the hand", "proximal phalanx", "middle phalanx")
COLOURS = {"X": "#1f6fb4", "Y": "#d1592b", "Z": "#3a8f4f"}


def centre_figure(found: Kinematics) -> bytes:
    """Draw the figure as PNG: a column per joint, a row per axis of the proximal frame, equal heights in mm."""
    figure = new_figure(11.0, 8.0)
    panels = figure.subplots(3, len(found.joints), sharex="col")
    height = max(_height(joint) for joint in found.joints)
    for column, (joint, frame) in enumerate(zip(found.joints, PROXIMAL, strict=True)):
        for row, (axis, colour) in enumerate(COLOURS.items()):
            panel = panels[row, column]
            _panel(panel, joint, row, colour, height)
            if column == 0:
                panel.set_ylabel(f"{axis} [mm]")
        panels[0, column].set_title(f"{joint.name} centre, seen from the\n{frame}", fontsize=10)
        panels[2, column].set_xlabel(f"{joint.name} flexion [rad]")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, markerscale=5)
    return png_of(figure, dpi=130)


def _height(joint: Joint) -> float:
    """Height [mm] of a panel that shows line and scatter of a joint."""
    lines = 1e3 * joint.line.at(np.linspace(*joint.range, 2))
    return float(np.max(np.abs(lines[1] - lines[0]) + 8e3 * joint.line.rmse))


def _panel(panel, joint: Joint, number: int, colour: str, height: float) -> None:
    used = np.abs(np.nan_to_num(joint.angle)) >= joint.smallest_angle
    span = np.linspace(*joint.range, 60)
    middle, half = 1e3 * joint.line.at(span)[:, number], 1e3 * joint.line.band(span)[:, number]
    dots = {"ms": 3, "color": colour, "alpha": 0.3, "mec": "none", "label": "a frame"}
    panel.plot(joint.angle[used], 1e3 * joint.centre[used, number], ".", **dots)
    band = {"color": "0.15", "alpha": 0.25, "lw": 0, "label": "95 % band of the line"}
    panel.fill_between(span, middle - half, middle + half, **band)
    panel.plot(span, middle, color="0.15", lw=1.4, label="line, of all frames together")
    edge = joint.smallest_angle
    panel.axvspan(max(joint.range[0], -edge), edge, color="0.93", lw=0, zorder=0, label="angle too small, left out")
    panel.set_ylim(np.mean(middle) - height / 2, np.mean(middle) + height / 2)
    line = joint.line
    gradient, intercept, rmse = (1e3 * values[number] for values in (line.gradient, line.intercept, line.rmse))
    equation = f"{gradient:+.2f} θ {intercept:+.2f},  RMSE {rmse:.2f} mm"
    box = {"fc": "white", "ec": "none", "pad": 1.5}
    panel.text(0.03, 0.97, equation, transform=panel.transAxes, va="top", fontsize=8, bbox=box)
    panel.grid(color="0.88", lw=0.6)
    panel.set_axisbelow(True)
