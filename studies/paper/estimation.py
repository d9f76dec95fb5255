"""Fig. 10 and 11: joint angles estimated from tension and stroke, and the estimate against a model."""

from typing import Any

import numpy as np

from exodrake.data.plot import new_figure
from exodrake.estimator.validate import HELD_OUT, RANDOM
from exodrake.machines.exo_index.machine import COLOURS
from exodrake.report.blocks import AFTER, BEFORE, MEASURED, RULE, SOFT, Drawing, Table, house_style, render_svg
from studies.paper.claim import AGREES, DOES_NOT, UNKNOWN, Chapter, Claim
from studies.paper.study import CREEP_STIFFNESS, CREEP_TIME, DATA, MODEL, MU_PHI, Study

PRINTED, IMU = 0.03, 0.027  # rad
DRAWN = 1000  # rows that are drawn, about
SHOWN = 1  # joint of Fig. 11 a: PIP
METHODS = {
    DATA: "Gaussian process, tension and stroke",
    "quadratic ridge": "quadratic ridge, tension and stroke",
    MODEL: "constant stiffness, fitted (Eq. 20–21)",
    "end stops": "fitted stiffness and known end stops",
    "nominal": "nominal numbers, nothing fitted",
}


def chapter(found: Study) -> Chapter:
    """Figures 10 and 11 with their claims."""
    ten = (
        f"Simulated: the {found.held.count} held-out sweeps, which the estimator has never seen. Left: measured angle"
        " (noisy motion capture), estimate, and its band of two standard deviations. Right: estimate against measured."
    )
    eleven = (
        "Simulated, the same sweeps. (a) PIP angle, measured, estimated from data, and by the model with constant"
        " stiffness fitted to the training sweeps; it sees tension only. (b), (c) All joints, estimated against"
        " measured. (d) RMSE per joint."
    )
    lead = (
        f"One wire ramps up and down while the two others stand at 0, 33, 66, 100 %: {found.sweeps} sweeps in"
        f" {found.seconds:.0f} s. The simulated robot is worn: friction in the sheaths (capstan, μφ = {MU_PHI}) and"
        f" wires that creep ({CREEP_STIFFNESS / 1e3:.0f} N/mm in series, {CREEP_TIME:.0f} s), which none of the models"
        " below knows, with the noise of load cells, encoders and cameras. The size of these faults is assumed; so only"
        " the order of the methods can be compared with the paper, not the numbers."
    )
    split = ("mean RMSE [rad] by how train and test were split", "random rows", "whole sweeps held out", "in 95 % band")
    by_split = []
    for method in (DATA, "quadratic ridge", "nearest row"):
        free, whole = found.split(RANDOM, method), found.split(HELD_OUT, method)
        inside = "–" if method == "nearest row" else f"{100 * whole.coverage.mean():.0f} %"
        by_split.append((method, f"{free.mean_rmse:.3f}", f"{whole.mean_rmse:.3f}", inside))
    trained = ("trained on", "RMSE on held-out sweeps [rad]", "in 95 % band", "of the joints")
    by_training = [
        (one.method, f"{one.mean_rmse:.3f}", f"{100 * one.coverage.mean():.0f} %",
         f"{100 * one.coverage.min():.0f} to {100 * one.coverage.max():.0f} %")
        for one in found.recorded
    ]  # fmt: skip
    body = (
        "Fig. 11: data-driven against model-based",
        Drawing(figure_11(found), eleven),
        methods_table(found),
        "Fig. 10: estimated and measured angles",
        Drawing(figure_10(found), ten),
        Table(split, by_split, wide=False),
        "Which sweeps to record",
        Table(trained, by_training, wide=False),
    )
    return Chapter("estimation", "Joint angles: Fig. 10, 11", lead, body, claims(found))


def methods_table(found: Study) -> Table:
    """RMSE by method on the worn and on the clean robot."""
    joints = found.held.joints
    header = ("RMSE on held-out sweeps [rad]", *joints, "mean", "mean without friction and creep")
    rows = [
        (words, *(f"{value:.3f}" for value in found.worn.rmse[name]), f"{found.error(name):.3f}",
         f"{found.clean.rmse[name].mean():.3f}")
        for name, words in METHODS.items()
    ]  # fmt: skip
    return Table(header, rows)


def claims(found: Study) -> tuple[Claim, ...]:
    """Claims of sections 2.3, 3.2 and 5."""
    data, model = found.error(DATA), found.error(MODEL)
    clean = [float(found.clean.rmse[name].mean()) for name in (DATA, MODEL)]
    nearest = found.split(RANDOM, "nearest row").mean_rmse, found.split(HELD_OUT, "nearest row").mean_rmse
    best = all(found.error(DATA) < found.error(name) for name in (MODEL, "end stops", "nominal"))
    return (
        Claim(
            "Fig. 11", "data-driven beats model-based", "better; no number in the text",
            f"{data:.3f} against {model:.3f} rad", AGREES if best else DOES_NOT,
            f"Simulated worn robot, {found.held.count} whole sweeps held out: {found.ratio:.1f} times smaller RMSE, a"
            f" factor that follows the assumed friction and creep. Without them {clean[0]:.3f} against {clean[1]:.3f},"
            f" {clean[1] / clean[0]:.1f} times: what is left of the model's error"
            " then is the end stops it lacks and a DIP that tips between two postures.",
        ),
        Claim(
            "3.2, 5", "RMSE of the estimated angle", f"about {PRINTED} rad",
            f"{data:.3f} held-out sweeps, {found.split(RANDOM).mean_rmse:.3f} random rows", UNKNOWN,
            "Same order, but on simulated wear of assumed size. Split, kernel and sample count are not in the text, and"
            f" the split decides: looking up the nearest row scores {nearest[0]:.3f} on random rows, {nearest[1]:.3f}"
            " on new sweeps.",
        ),
        Claim(
            "5", "similar to IMU sensors, 0.027 rad", f"{PRINTED} and {IMU}", f"ratio {PRINTED / IMU:.2f}", UNKNOWN,
            "The ratio is near 1, but task, subject and ground truth differ.",
        ),
        Claim(
            "2.3", "one wire ramps, the others at 0, 33, 66, 100 %", "number not stated",
            f"{found.sweeps} sweeps, {found.seconds:.0f} s", UNKNOWN,
            "If all pairs of levels are crossed. The text does not say they are, nor how fast the ramps were.",
        ),
    )  # fmt: skip


def drawn_rows(found: Study) -> np.ndarray:
    """Rows that are drawn."""
    return np.arange(0, len(found.held), max(1, len(found.held) // DRAWN))


def figure_10(found: Study) -> str:
    """Estimate and measured angle over the samples, and one against the other, a row per joint."""
    rows = drawn_rows(found)
    with house_style():
        drawn = new_figure(9.6, 6.6)
        panels = drawn.subplots(3, 2, width_ratios=(3.4, 1))
        for joint, name in enumerate(found.held.joints):
            left, right = panels[joint]
            course(left, found, rows, joint)
            estimate, spread = found.mean[rows, joint], 2.0 * found.std[rows, joint]
            left.fill_between(rows, estimate - spread, estimate + spread, color=AFTER, alpha=0.18, lw=0)
            left.plot(rows, estimate, color=AFTER, lw=0.9, label="estimated")
            left.set_ylabel(f"{name} [rad]")
            cloud(right, found.held.angle[rows, joint], estimate, AFTER)
            right.set_title(f"RMSE {found.worn.rmse[DATA][joint]:.3f} rad", fontsize=8.5)
        panels[0, 0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        panels[-1, 0].set_xlabel("sample")
        panels[-1, 1].set_xlabel("measured [rad]")
        return render_svg(drawn, "ten", "estimated and measured joint angles on held-out sweeps")


def figure_11(found: Study) -> str:
    """Data-driven and model-based estimate: over the samples, against measured, and their RMSE."""
    rows = drawn_rows(found)
    with house_style():
        drawn = new_figure(9.6, 5.4)
        panels = drawn.subplot_mosaic([["a", "a", "a"], ["b", "c", "d"]], height_ratios=(1, 1.15))
        course(panels["a"], found, rows, SHOWN)
        panels["a"].plot(rows, found.model[rows, SHOWN], color=BEFORE, lw=1.0, label="constant stiffness")
        panels["a"].plot(rows, found.mean[rows, SHOWN], color=AFTER, lw=1.0, label="data-driven")
        panels["a"].set_ylabel(f"{found.held.joints[SHOWN]} [rad]")
        panels["a"].set_xlabel("sample")
        panels["a"].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
        panels["a"].set_title("(a)")
        for name, title, guess in (("b", "(b) data-driven", found.mean), ("c", "(c) model-based", found.model)):
            for joint, label in enumerate(found.held.joints):
                cloud(panels[name], found.held.angle[rows, joint], guess[rows, joint], COLOURS[label], label)
            panels[name].set_title(title)
            panels[name].set_xlabel("measured [rad]")
        low, high = np.transpose([panels[name].get_ylim() for name in "bc"])  # to be compared
        for name in "bc":
            panels[name].set_ylim(low.min(), high.max())
        panels["b"].set_ylabel("estimated [rad]")
        panels["b"].legend(loc="upper left", markerscale=6, handletextpad=0.2)
        places = np.arange(len(found.held.joints))
        for shift, name, colour in ((-0.2, DATA, AFTER), (0.2, MODEL, BEFORE)):
            values = found.worn.rmse[name]
            panels["d"].bar(places + shift, values, width=0.36, color=colour)
            for place, value in zip(places, values):
                at = (place + shift, value, f"{value:.3f}")
                panels["d"].text(*at, ha="center", va="bottom", fontsize=7.5, color=SOFT)
        panels["d"].set_xticks(places, found.held.joints)
        panels["d"].set_title("(d) RMSE [rad]")
        panels["d"].tick_params(axis="x", length=0)
        return render_svg(drawn, "eleven", "data-driven against model-based estimates on held-out sweeps")


def course(axes: Any, found: Study, rows: np.ndarray, joint: int) -> None:
    """The measured angle, with a line where a new sweep begins."""
    for edge in np.flatnonzero(np.diff(found.held.sweep)):
        axes.axvline(edge + 0.5, color=RULE, lw=0.8)
    axes.plot(rows, found.held.angle[rows, joint], color=MEASURED, lw=1.4, label="measured")
    axes.set_xlim(0, len(found.held))


def cloud(axes: Any, measured: np.ndarray, estimate: np.ndarray, colour: str, label: str = "") -> None:
    """Estimate against measured, with the line on which they are equal."""
    axes.plot(measured, estimate, ".", ms=2, mew=0, color=colour, alpha=0.5, rasterized=True, label=label)
    ends = [measured.min(), measured.max()]
    axes.plot(ends, ends, color=SOFT, lw=0.8)
    axes.grid(color=RULE, lw=0.5)
