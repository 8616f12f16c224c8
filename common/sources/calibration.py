"""Statistics of hand movements: those of recorded suturing, and the same for any movement.

The recorded figures are aggregates; no single trial can be recovered from them.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
import scipy

from common.sources.trajectory import Array
from common.units import MM_PER_M

RECORDED_SUTURING: Final[dict[str, float]] = {
    "hold-last error at 33 ms, mm": 0.673,
    "hold-last error at 100 ms, mm": 1.925,
    "hold-last error at 200 ms, mm": 3.715,
    "hold-last error at 500 ms, mm": 8.118,
    "hold-last error at 1000 ms, mm": 13.286,
    "speed p50, mm/s": 5.50,
    "speed p90, mm/s": 30.43,
    "speed p99, mm/s": 84.03,
    "speed rms, mm/s": 21.23,
    "time slower than 2 mm/s, share": 0.300,
    "velocity power up to 0.25 Hz, share": 0.346,
    "velocity power up to 0.5 Hz, share": 0.553,
    "velocity power up to 1 Hz, share": 0.781,
    "velocity power up to 2 Hz, share": 0.937,
    "velocity power up to 4 Hz, share": 0.971,
    "velocity power up to 8 Hz, share": 0.984,
    "acceleration p50, mm/s2": 46.90,
    "acceleration p90, mm/s2": 202.0,
    "acceleration p99, mm/s2": 523.9,
}
"""Medians over 29 JIGSAWS suturing trials at 30 Hz, of the arms' tips; for errors the median of each axis."""

TOLERANCE: Final = 0.25
"""Largest relative deviation of a statistic of the synthetic surgeon from the recorded one."""

_HOLD_MS: Final = (33, 100, 200, 500, 1000)
_SLOW_MM_PER_S: Final = 2.0
_PERCENTILES: Final = (50, 90, 99)
_BANDS_HZ: Final = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
_WINDOW_S: Final = 17.0


def movement_statistics(position_m: Array, rate_hz: int) -> dict[str, float]:
    """Return the statistics of a tip's positions (N, 3), named as in `RECORDED_SUTURING`.

    ``rate_hz`` is above 16 and N exceeds the rows of a second. Errors are 3D; velocity and acceleration are central
    differences; the spectrum is Welch's ("The use of fast Fourier transform for the estimation of power spectra",
    1967), summed over the axes, without the mean, its cumulative sum interpolated. Oracle: a circle.
    """
    tip_mm = MM_PER_M * position_m
    velocity = np.gradient(tip_mm, 1.0 / rate_hz, axis=0)
    speed = np.linalg.norm(velocity, axis=1)
    acceleration = np.linalg.norm(np.gradient(velocity, 1.0 / rate_hz, axis=0), axis=1)
    found: dict[str, float] = {}
    for hold_ms in _HOLD_MS:
        lag = round(hold_ms * rate_hz / 1000)
        moved_mm = tip_mm[lag:] - tip_mm[:-lag]
        found[f"hold-last error at {hold_ms} ms, mm"] = float(np.sqrt(np.mean(np.sum(moved_mm**2, axis=1))))
    for percent in _PERCENTILES:
        found[f"speed p{percent}, mm/s"] = float(np.percentile(speed, percent))
    found["speed rms, mm/s"] = float(np.sqrt(np.mean(speed**2)))
    found["time slower than 2 mm/s, share"] = float(np.mean(speed < _SLOW_MM_PER_S))
    # Spectrum: the share of velocity power below each frequency.
    window = min(round(_WINDOW_S * rate_hz), len(velocity))
    frequency_hz, power = scipy.signal.welch(velocity, rate_hz, nperseg=window, axis=0)
    cumulative = np.cumsum(power.sum(axis=1)) / power.sum()
    for band_hz in _BANDS_HZ:
        share = float(np.interp(band_hz, frequency_hz, cumulative))
        found[f"velocity power up to {band_hz:g} Hz, share"] = share
    for percent in _PERCENTILES:
        found[f"acceleration p{percent}, mm/s2"] = float(np.percentile(acceleration, percent))
    return found


def median_statistics(tips_m: Sequence[Array], rate_hz: int) -> dict[str, float]:
    """Return the median of each statistic over the positions (N, 3) of several tips."""
    of_each = [movement_statistics(tip_m, rate_hz) for tip_m in tips_m]
    return {name: float(np.median([found[name] for found in of_each])) for name in of_each[0]}
