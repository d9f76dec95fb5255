"""A robot and a diagnosis as a notebook shows them: a sentence, a figure, and the values with their intervals."""

from io import StringIO

from exodrake.data import plot
from exodrake.diagnosis.result import Diagnosis
from exodrake.diagrams.block_diagram import wiring_svg
from exodrake.model.robot import Robot
from exodrake.report import wording as w
from exodrake.report.blocks import LINE, Drawing, render


def robot_html(robot: Robot) -> str:
    """A robot as one line, above its parts and signals."""
    drawing = Drawing(wiring_svg(robot.machine, schedule=False))
    return render("notebook.html", verdict="", text=repr(robot), rows=(), drawing=drawing)


def diagnosis_html(diagnosis: Diagnosis) -> str:
    """The headline, the error of each kind of signal with each robot, and the values of the causes."""
    import matplotlib

    rows = [row for effect in w.causes(diagnosis) for row in w.parameter_values(effect)]
    said = {"verdict": diagnosis.verdict, "text": w.headline(diagnosis), "rows": rows}
    kinds, robots = list(w.kind_gaps(diagnosis).values()), w.list_robots(diagnosis)
    if not kinds:
        return render("notebook.html", **said, drawing=None)
    colours = {"before": plot.NOMINAL["color"], "retuned": LINE, "after": plot.IMPROVED["color"]}
    with matplotlib.rc_context({**plot.STYLE, "svg.fonttype": "none"}):
        figure = plot.new_figure(7.0, 0.8 + 0.22 * len(kinds) * len(robots))
        axes = figure.subplots()
        for k, (key, name) in enumerate(robots.items()):
            places = [i + 0.8 * (k + 0.5) / len(robots) - 0.4 for i in range(len(kinds))]
            values = [getattr(gap, key) / gap.noise_std for _, gap in kinds]
            axes.barh(places, values, 0.7 / len(robots), color=colours[key], label=name)
        axes.axvline(1.0, color="#1f2328", lw=0.8)
        axes.set_yticks(range(len(kinds)), [display.label for display, _ in kinds])
        axes.invert_yaxis()
        axes.set(xscale="log", xlabel="RMS error / noise standard deviation (line: noise alone)")
        figure.legend(loc="outside upper left", ncols=3)
        stream = StringIO()
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return render("notebook.html", **said, drawing=Drawing(stream.getvalue()))
