"""A robot and a diagnosis as a notebook shows them: a sentence, a figure, and the values with their intervals."""

from base64 import b64encode
from html import escape
from io import BytesIO

from exodrake.data import plot
from exodrake.diagnosis.result import Diagnosis
from exodrake.diagrams.block_diagram import wiring_svg
from exodrake.model.robot import Robot
from exodrake.report import wording as w

RETUNED = "#98a2b3"


def robot_html(robot: Robot) -> str:
    """A robot as one line, above its parts and signals."""
    return f"<div><p>{escape(repr(robot))}</p>{picture(wiring_svg(robot.machine, schedule=False))}</div>"


def diagnosis_html(diagnosis: Diagnosis) -> str:
    """The headline, the error of each kind of signal with each robot, and the values of the causes."""
    import matplotlib

    table = ""
    for row in (row for effect in w.causes(diagnosis) for row in w.parameter_values(effect, known=True)):
        table = table or "<tr><th>Parameter</th><th>Value</th><th>90 % interval</th></tr>"
        table += f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>"
    table = f"<table>{table}</table>" if table else ""
    title = f"<p><b>{escape(diagnosis.verdict)}</b> {escape(w.headline(diagnosis))}</p>"
    kinds, robots = list(w.kind_gaps(diagnosis).values()), w.list_robots(diagnosis)
    if not kinds:
        return f"<div>{title}{table}</div>"
    colours = {"before": plot.NOMINAL["color"], "retuned": RETUNED, "after": plot.IMPROVED["color"]}
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
        stream = BytesIO()
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return f"<div>{title}{picture(stream.getvalue().decode())}{table}</div>"


def picture(svg: str) -> str:
    """An SVG as an image of its own, whose styles reach nothing else of the notebook."""
    return f'<img alt="plot" style="max-width:100%" src="data:image/svg+xml;base64,{b64encode(svg.encode()).decode()}">'
