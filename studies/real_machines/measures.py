"""Error measures as papers state them."""

from __future__ import annotations

import numpy as np

# Hz, order and factor of the decimating filter for EMPS forces: assumed, since the paper does not state its own
CUT, ORDER, DECIMATION = 20.0, 4, 25
FRICTION_RATE = 1e3  # Hz, at which EMPS was recorded


def relative_error(measured: np.ndarray, error: np.ndarray) -> float:
    """|error| / |measured| of a force (n,)."""
    return float(np.linalg.norm(error) / np.linalg.norm(measured))


def decimated(force: np.ndarray) -> np.ndarray:
    """A force (n,) filtered both ways and thinned out, as identification papers do before they compare."""
    from scipy.signal import butter, filtfilt

    return filtfilt(*butter(ORDER, CUT / (0.5 * FRICTION_RATE)), force)[::DECIMATION]  # pyright: ignore


def rms_degrees(residual: np.ndarray) -> float:
    """RMS of an angle's residual (n,) [rad] in degrees."""
    return float(np.degrees(np.sqrt(np.nanmean(residual**2))))


def inverse_dynamics(place: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, float]:
    """Mass [kg], viscous [N s/m] and Coulomb [N] friction and offset [N] by regression, and the relative error left.

    The method of the published EMPS results; signals are filtered both ways and subsampled.

    Args:
        place: (n,) positions [m].
        force: (n,) forces [N].
    """
    from scipy.signal import butter, filtfilt

    low, high = butter(ORDER, WIDE / (0.5 * FRICTION_RATE))  # pyright: ignore
    smooth, wanted = filtfilt(low, high, place), filtfilt(low, high, force)[EDGE:-EDGE:THIN]
    speed = np.gradient(smooth, 1.0 / FRICTION_RATE)
    columns = (np.gradient(speed, 1.0 / FRICTION_RATE), speed, filtfilt(low, high, np.sign(speed)), np.ones_like(speed))
    matrix = np.column_stack(columns)[EDGE:-EDGE:THIN]
    found = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
    return found, relative_error(wanted, wanted - matrix @ found)


WIDE, THIN, EDGE = 60.0, 10, 100  # Hz; rows kept of; rows left out at both ends, where filters ring: assumed
