"""Statistics of hand movements and turns: those of recorded suturing, and the same for any movement.

The recorded figures are aggregates; no single trial can be recovered from them.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
import scipy

from tis.common.sources.trajectory import Array
from tis.common.units import MM_PER_M

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

RECORDED_TURNING: Final[dict[str, float]] = {
    "hold-last error at 33 ms, deg": 1.678,
    "hold-last error at 100 ms, deg": 4.578,
    "hold-last error at 200 ms, deg": 8.809,
    "hold-last error at 500 ms, deg": 19.58,
    "hold-last error at 1000 ms, deg": 31.11,
    "angular speed p50, deg/s": 9.053,
    "angular speed p90, deg/s": 73.46,
    "angular speed p99, deg/s": 185.6,
    "angular speed rms, deg/s": 47.81,
    "time slower than 5 deg/s, share": 0.388,
    "angular power up to 0.25 Hz, share": 0.257,
    "angular power up to 0.5 Hz, share": 0.477,
    "angular power up to 1 Hz, share": 0.721,
    "angular power up to 2 Hz, share": 0.872,
    "angular power up to 4 Hz, share": 0.951,
    "angular power up to 8 Hz, share": 0.982,
    "angular acceleration p50, deg/s2": 117.4,
    "angular acceleration p90, deg/s2": 674.3,
    "angular acceleration p99, deg/s2": 1700.0,
}
"""Medians over both arms of 19 JIGSAWS suturing trials (people C to F) at 30 Hz, of the orientations of the tips."""

TOLERANCE: Final = 0.25
"""Largest relative deviation of a statistic of the synthetic surgeon from the recorded one."""

_HOLD_MS: Final = (33, 100, 200, 500, 1000)
_PERCENTILES: Final = (50, 90, 99)
_BANDS_HZ: Final = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
_WINDOW_S: Final = 17.0


class _Names(NamedTuple):
    """Words of the statistics' names, and the speed below which a tip counts as slow."""

    unit: str
    speed: str
    power: str
    acceleration: str
    slow: float


_MOVEMENT: Final = _Names("mm", "speed", "velocity power", "acceleration", 2.0)
_TURNING: Final = _Names("deg", "angular speed", "angular power", "angular acceleration", 5.0)


def movement_statistics(position_m: Array, rate_hz: int) -> dict[str, float]:
    """Return the statistics of a tip's positions (N, 3), named as in `RECORDED_SUTURING`.

    ``rate_hz`` is above 16 and N exceeds the rows of a second. Errors are 3D; velocity and acceleration are central
    differences; the spectrum is Welch's ("The use of fast Fourier transform for the estimation of power spectra",
    1967), summed over the axes, without the mean, its cumulative sum interpolated. Oracle: a circle.
    """
    tip_mm = MM_PER_M * position_m

    def moved_mm2(lag: int) -> Array:
        """Return the squared distances between rows ``lag`` apart."""
        return np.asarray(np.sum((tip_mm[lag:] - tip_mm[:-lag]) ** 2, axis=1))

    return _statistics(moved_mm2, np.gradient(tip_mm, 1.0 / rate_hz, axis=0), rate_hz, _MOVEMENT)


def turning_statistics(orientation: Array, rate_hz: int) -> dict[str, float]:
    """Return the statistics of a tip's unit quaternions (N, 4), named as in `RECORDED_TURNING`.

    As `movement_statistics`; the angular velocity is in the body frame, from neighbours on both sides. Oracle: a turn
    at constant speed.
    """
    rotations = scipy.spatial.transform.Rotation.from_quat(orientation)

    def turned_deg2(lag: int) -> Array:
        """Return the squared angles between rows ``lag`` apart."""
        return np.asarray(np.degrees((rotations[:-lag].inv() * rotations[lag:]).magnitude()) ** 2)

    velocity = np.degrees((rotations[:-2].inv() * rotations[2:]).as_rotvec()) * rate_hz / 2.0
    return _statistics(turned_deg2, velocity, rate_hz, _TURNING)


def _statistics(squares: Callable[[int], Array], velocity: Array, rate_hz: int, names: _Names) -> dict[str, float]:
    """Return the statistics of a path from its squared changes over a number of rows, and its velocity (N, 3)."""
    # The order of the figures is that of the recorded ones.
    speed = np.linalg.norm(velocity, axis=1)
    acceleration = np.linalg.norm(np.gradient(velocity, 1.0 / rate_hz, axis=0), axis=1)
    unit, found = names.unit, dict[str, float]()
    for hold_ms in _HOLD_MS:
        changes = squares(round(hold_ms * rate_hz / 1000))
        found[f"hold-last error at {hold_ms} ms, {unit}"] = float(np.sqrt(np.mean(changes)))
    for percent in _PERCENTILES:
        found[f"{names.speed} p{percent}, {unit}/s"] = float(np.percentile(speed, percent))
    found[f"{names.speed} rms, {unit}/s"] = float(np.sqrt(np.mean(speed**2)))
    found[f"time slower than {names.slow:g} {unit}/s, share"] = float(np.mean(speed < names.slow))
    for band_hz, share in _power_shares(velocity, rate_hz).items():
        found[f"{names.power} up to {band_hz:g} Hz, share"] = share
    for percent in _PERCENTILES:
        found[f"{names.acceleration} p{percent}, {unit}/s2"] = float(np.percentile(acceleration, percent))
    return found


def _power_shares(velocity: Array, rate_hz: int) -> dict[float, float]:
    """Return the share of the power of a velocity (N, 3) below each frequency in Hz."""
    window = min(round(_WINDOW_S * rate_hz), len(velocity))
    frequency_hz, power = scipy.signal.welch(velocity, rate_hz, nperseg=window, axis=0)
    cumulative = np.cumsum(power.sum(axis=1)) / power.sum()
    return {band_hz: float(np.interp(band_hz, frequency_hz, cumulative)) for band_hz in _BANDS_HZ}


def median_statistics(
    signals: Sequence[Array], rate_hz: int, statistics: Callable[[Array, int], dict[str, float]] = movement_statistics
) -> dict[str, float]:
    """Return the median of each statistic over the signals of several tips: positions (N, 3), by default."""
    of_each = [statistics(signal, rate_hz) for signal in signals]
    return {name: float(np.median([found[name] for found in of_each])) for name in of_each[0]}
