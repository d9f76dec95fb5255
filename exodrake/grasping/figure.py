"""Figure of a grasp: object, thumb and finger as planned, reached and estimated, and how it got there."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from exodrake.core.display import choose_colour, find_display
from exodrake.core.robot import Robot
from exodrake.data.log import Log
from exodrake.data.plot import STYLE, draw_estimate, draw_panel, new_figure
from exodrake.grasping.hand import joints
from exodrake.grasping.plan import Plan, at_hold
from exodrake.physics.finger_statics import parameters_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SKIN, THUMB, OBJECT = "#e7c3b0", "#d8d2cc", "#a9c7e3"
THUMB_BONE = complex(-0.030, 0.012)  # from the thumb's tip backwards, for the drawing only [m]


def grasp_figure(plan: Plan, log: Log, robot: Robot) -> Figure:
    """The figure of a plan and of its run (`run_plan`)."""
    import matplotlib
    from matplotlib.lines import Line2D

    with matplotlib.rc_context(STYLE):
        figure = new_figure(10.4, 5.4)
        grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.1), height_ratios=(1.5, 1.0))
        draw_posture(figure.add_subplot(grid[:, 0]), plan, log, robot)
        angle = figure.add_subplot(grid[0, 1])
        display = find_display("angle", robot.machine)
        for i, name in enumerate(plan.joints):
            colour = choose_colour(name, i, robot.machine)
            angle.plot(log.time, display.factor * log[f"angle_{name}"], color=colour, label=name)
            draw_estimate(angle, log, "angle", name, colour, display.factor)
            angle.axhline(display.factor * plan.planned[i], color=colour, lw=0.9, ls=(0, (4, 2)))
        handles = angle.get_legend_handles_labels()[0]
        handles.append(Line2D([], [], color="black", lw=0.6, label="estimate"))
        handles.append(Line2D([], [], color="#555", lw=0.9, ls=(0, (4, 2)), label="planned"))
        angle.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.04), handlelength=1.8)
        angle.set_ylabel(display.axis)
        tension = figure.add_subplot(grid[1, 1], sharex=angle)
        draw_panel(tension, log, "tension", robot.machine)
        tension.legend(loc="upper left", bbox_to_anchor=(1.0, 1.04), handlelength=1.8)
        tension.set_xlabel("Time [s]")
        tension.set_xlim(log.time[0], log.time[-1])
        angle.tick_params(labelbottom=False)
        figure.align_ylabels([angle, tension])
        state = "" if plan.feasible else ": not feasible, nearest shown"
        title = f"{plan.mode.replace('-', ' ').capitalize()}, {1e3 * plan.size:g} mm{state}"
        figure.suptitle(title, fontsize=11, fontweight="bold", x=0.01, ha="left")
    return figure


def draw_posture(axes: Any, plan: Plan, log: Log, robot: Robot) -> None:
    """Object, thumb and the finger's three postures at the hold, in its plane [mm]."""
    n = parameters_of(robot)
    thumb, centre = complex(*plan.hand.thumb), complex(*plan.centre)
    fill(axes, [thumb, thumb + THUMB_BONE], [plan.hand.thumb_radius], THUMB, 0.9)
    where = mm(thumb + THUMB_BONE / 2 + 0.002j)
    axes.annotate("thumb (place assumed)", where, ha="center", va="bottom", fontsize=7.5, color="#555")
    fill(axes, [centre, centre], [plan.size / 2.0], OBJECT, 0.75)
    axes.annotate(f"{1e3 * plan.size:g} mm", mm(centre), ha="center", va="center", color="#2b4d6e")
    planned = np.array(plan.planned)
    fill(axes, list(joints(planned, n)), list(n.radius), SKIN, 0.55)
    if not plan.feasible:
        x, y = mm(joints(np.array(plan.wanted), n))
        axes.plot(x, y, color="#999999", lw=1.2, ls=(0, (1, 1.2)), label="wanted")
    for name, angle, colour, dash, width, size in (
        ("planned", planned, "#222222", "-", 3.2, 4),
        ("reached", at_hold(log, "angle", plan.joints), "#0072b2", (0, (5, 2)), 1.8, 0),
        ("estimated", at_hold(log, "angle_est", plan.joints), "#d55e00", (0, (1, 1.5)), 1.8, 0),
    ):
        x, y = mm(joints(angle, n))
        axes.plot(x, y, color=colour, ls=dash, lw=width, label=name, marker="o", ms=size)
    axes.plot(*mm(complex(*plan.target)), "x", color="#cc79a7", ms=8, mew=1.8, label="target")
    axes.set_aspect("equal")
    axes.invert_yaxis()
    axes.margins(0.06)
    axes.set_xlabel("distal [mm]")
    axes.set_ylabel("palmar [mm]")
    axes.legend(loc="lower left", ncols=3, handlelength=2.2, columnspacing=1.0, bbox_to_anchor=(0.0, 1.0))


def fill(axes: Any, points: list[complex], radii: list[float], colour: str, alpha: float) -> None:
    """Rounded bones between points [m], one radius [m] each, as one filled shape."""
    import shapely

    bones = zip(points[:-1], points[1:], radii)
    shapes = [shapely.LineString([mm(a), mm(b + 1e-9 * (a == b))]).buffer(1e3 * r) for a, b, r in bones]
    x, y = np.array(shapely.union_all(shapes).exterior.coords).T  # pyright: ignore
    axes.fill(x, y, color=colour, alpha=alpha, lw=0)


def mm(points: Any) -> tuple[Any, Any]:
    """Complex points [m] as x and y [mm]."""
    return 1e3 * np.real(points), 1e3 * np.imag(points)
