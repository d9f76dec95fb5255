"""Fig. 2e and Eq. 2: moment arms of flexor and extensor against joint angle, by virtual work and as printed.

R = dl/dq (ours, signed)        R = 0.5 |A x B| / |A - B| (as printed in our copy)
"""

import numpy as np
from scipy.optimize import brentq

from exodrake.data.plot import new_figure
from exodrake.physics.wire_paths import EXTENSOR, FLEXOR, path
from exodrake.report.blocks import RULE, SOFT, Drawing, Table, house_style, render_svg
from studies.paper.claim import AGREES, DOES_NOT, Chapter, Claim

LENGTH, LOW, HIGH = 5e-3, 3e-3, 5e-3  # m, paper Fig. 2: a = b, and m = n of the flexor and extensor (S), of (L)
ROUTERS = {
    "flexor": (LENGTH, LENGTH, LOW, LOW, FLEXOR),
    "extensor (S)": (LENGTH, LENGTH, LOW, LOW, EXTENSOR),
    "extensor (L)": (LENGTH, LENGTH, HIGH, HIGH, EXTENSOR),
}
COLOURS = {"flexor": "#0072b2", "extensor (S)": "#d55e00", "extensor (L)": "#8a5a00"}
SPAN = np.deg2rad(np.linspace(0.0, 90.0, 181))
TABLE = (0, 30, 60, 90)  # deg
LARGEST = 1.56  # rad, largest angle of any joint in the paper's Table 2 (PIP)


Arms = dict[str, np.ndarray]  # name -> moment arms over SPAN (n,) [m]


def arm(name: str, angle: float) -> float:
    """Moment arm [m] of a router pair at an angle [rad], positive while it moves the joint its own way."""
    return ROUTERS[name][-1] * path(np.cos(angle), np.sin(angle), *ROUTERS[name])[1]


def as_printed(arms):
    """The arms of Eq. 2 as printed: half, without sign."""
    return 0.5 * np.abs(arms)


def zero_of(name: str) -> float:
    """Angle [rad] at which an arm vanishes."""
    return float(brentq(lambda angle: arm(name, angle), 0.1, 2.0))  # pyright: ignore[reportArgumentType]


def curves() -> Arms:
    """All arms from 0 to 90 deg."""
    return {name: np.array([arm(name, q) for q in SPAN]) for name in ROUTERS}


def read_arm(found: Arms, name: str, degrees: float) -> float:
    """Arm [m] at an angle [deg]."""
    return float(np.interp(np.deg2rad(degrees), SPAN, found[name]))


def chapter() -> Chapter:
    """Figure 2e and the claims about moment arms."""
    found = curves()
    rows = []
    for degrees in TABLE:
        own = [1e3 * read_arm(found, name, degrees) for name in ROUTERS]
        rows.append((f"{degrees}°", *(f"{value:.3f}".replace("-", "−") for value in (*own, *map(as_printed, own)))))
    header = ("angle", *(f"{name} [mm]" for name in ROUTERS), *(f"{name}, printed" for name in ROUTERS))
    caption = (
        "Computed. Left: the arm that turns tension into torque. Right: Eq. 2 as it stands in our copy of the paper."
    )
    lead = (
        "Where the wire bends round two routers, its moment arm is the slope of its length over the angle. Eq. 2 has"
        " the area of a triangle in place of its height, hence a factor 0.5, and a norm that cannot turn negative,"
        " although the text argues with the negative branch."
    )
    body = (Drawing(figure(found), caption), Table(header, rows))
    return Chapter("arms", "Moment arms: Fig. 2e, Eq. 2", lead, body, claims(found))


def claims(found: Arms) -> tuple[Claim, ...]:
    """Claims about Eq. 2 and Fig. 2e."""
    step, at = 1e-6, float(np.deg2rad(30.0))
    above, below = (path(np.cos(q), np.sin(q), *ROUTERS["flexor"])[0] for q in (at + step, at - step))
    slope = (above - below) / (2 * step)  # of the wire taken in
    ratio = slope / as_printed(arm("flexor", at))
    rises = bool(np.all(np.diff(found["flexor"]) > 0)) and bool(np.all(np.diff(found["extensor (S)"]) < 0))
    zeros = [np.rad2deg(zero_of(name)) for name in ("extensor (S)", "extensor (L)")]
    left = 1e3 * arm("extensor (L)", LARGEST)
    first, last = (1e3 * read_arm(found, "flexor", degrees) for degrees in (0, 90))
    return (
        Claim(
            "Eq. 2", "moment arm, flexor at 0°", f"{first / 2:.3f} mm", f"{first:.3f} mm", DOES_NOT,
            f"The wire taken in per radian is {ratio:.2f} times the printed arm: with the factor 0.5, work at the wire"
            " is not work at the joint, and every torque is halved.",
        ),
        Claim(
            "Fig. 2e", "flexor arm rises with angle, extensor arm falls", "rises, falls",
            f"flexor {first:.2f} to {last:.2f} mm over 90°", AGREES if rises else DOES_NOT,
            "Holds up to 118°, where the flexor's routers would meet.",
        ),
        Claim(
            "Fig. 2e", "extensor (S) turns negative at large angles", "negative", f"beyond {zeros[0]:.2f}°", AGREES,
            "By the signed arm. Eq. 2 as printed has a norm and could not show it.",
        ),
        Claim(
            "Fig. 2e", "extensor (L), 5 mm high, stays above zero", "> 0", f"zero at {zeros[1]:.2f}°",
            AGREES if left > 0 else DOES_NOT,
            f"Just: at the largest printed joint angle ({LARGEST} rad) {left:.2f} mm are left, and beyond 90° none.",
        ),
    )  # fmt: skip


def figure(found: Arms) -> str:
    """Both versions side by side on the same axes, as SVG."""
    with house_style():
        drawn = new_figure(9.6, 3.2)
        panels = drawn.subplots(1, 2, sharey=True)
        for axes, title, change in zip(
            panels, ("by virtual work", "as printed: half, no sign"), (np.asarray, as_printed)
        ):
            for name, values in found.items():
                shown = 1e3 * change(values)
                axes.plot(np.rad2deg(SPAN), shown, color=COLOURS[name], lw=1.6)
                axes.annotate(
                    name, (90.0, shown[-1]), (4, 0), textcoords="offset points", va="center", color=COLOURS[name]
                )
            axes.axhline(0.0, color=SOFT, lw=0.7)
            axes.set_title(title)
            axes.set_xlim(0.0, 90.0)
            axes.set_xticks(range(0, 91, 15))
            axes.set_xlabel("joint angle [°]")
            axes.grid(color=RULE, lw=0.5)
        panels[0].set_ylabel("moment arm [mm]")
        zero = np.rad2deg(zero_of("extensor (S)"))
        panels[0].plot([zero], [0.0], "o", ms=4, color=COLOURS["extensor (S)"])
        panels[0].annotate(f"{zero:.2f}°", (zero, 0.0), (4, 6), textcoords="offset points", color=SOFT)
        return render_svg(drawn, "arms", "moment arms against joint angle, by virtual work and as printed")
