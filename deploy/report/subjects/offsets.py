"""Effective time and value offsets (ETVO) of a reproduced movement: how late it is, and how far off beyond that."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from tis.common.metrics.etvo import Etvo, etvo, offset_grid_s
from tis.common.metrics.percentiles import summarise
from tis.common.units import MM_PER_M, NS_PER_S
from tis.deploy.report.section import Section, Statistics, means, statistics
from tis.deploy.report.subjects.tracking import Array, HandTrack


class Offset(Section):
    """Effective time and value offsets (ETVO) of the reproduced movement."""

    n: int = means("Ticks that were aligned with the truth.")
    time_ms: Statistics = statistics("Effective time offset, positive when the movement is late.", "mean p50 p95 max")
    value_mm: Statistics = statistics(
        "Effective value offset, the error that remains after the time offset.", "p50 p95 max"
    )
    value_rms_mm: float | None = means("Root mean square of the value offset.")
    delay_derivative_ms_per_s: float | None = means("Mean absolute change of the time offset.")


MAX_TICKS: Final = 6000
"""Scored ticks that are aligned, the first ones: the cost grows with their number."""
_MIN_OFFSET_S: Final = -0.2
_MAX_OFFSET_S: Final = 1.0
_STEPS_A_TICK: Final = 4
_MS_PER_S: Final = 1000.0


def offsets(tracks: Sequence[HandTrack], name: str, rate_hz: int) -> Offset:
    """Return the offsets of one estimator against the truth, of all hands together.

    Time offsets from -0.2 to 1 s are searched.
    ``time_ms`` is positive for a late estimate, ``value_mm`` the error that remains after the shift in time, and
    ``delay_derivative_ms_per_s`` the rate of change of the delay. Missing estimates are left out.
    """
    found = [_aligned(track, track.estimates[name], track.truth_m, rate_hz) for track in tracks]
    rates = [(one.delay_derivative, len(one.time_s) - 1) for one in found]
    known = [(rate, n) for rate, n in rates if rate is not None]
    mean_rate = sum(rate * n for rate, n in known) / sum(n for _, n in known) if known else None
    return _offset(
        Etvo(np.concatenate([one.time_s for one in found]), np.concatenate([one.value for one in found]), mean_rate)
    )


def actuation_ms(track: HandTrack, active: str, rate_hz: int) -> Array:
    """Return the delay (T,) in ms of the plant's arm behind the active estimate; empty where it executes nothing."""
    if "plant" not in track.estimates or active not in track.estimates:
        return np.empty(0)
    found = _aligned(track, track.estimates["plant"], track.estimates[active], rate_hz)
    return found.time_s * _MS_PER_S


def _aligned(track: HandTrack, reproduced_m: Array, original_m: Array, rate_hz: int) -> Etvo:
    known = track.scored & np.isfinite(reproduced_m).all(axis=1) & np.isfinite(original_m).all(axis=1)
    which = np.flatnonzero(known)[:MAX_TICKS]
    # four candidate offsets per tick resolve a quarter of the period
    grid_s = offset_grid_s(_MIN_OFFSET_S, _MAX_OFFSET_S, 1.0 / (_STEPS_A_TICK * rate_hz))
    return etvo(track.t_ns[which] / NS_PER_S, reproduced_m[which], original_m[which], grid_s)


def _offset(found: Etvo) -> Offset:
    value_mm = found.value * MM_PER_M
    derivative = found.delay_derivative
    return Offset(
        n=len(value_mm),
        time_ms=summarise(found.time_s * _MS_PER_S, (50, 95), ("mean", "max")),
        value_mm=summarise(value_mm, (50, 95), ("max",)),
        value_rms_mm=float(np.sqrt(np.mean(value_mm**2))) if len(value_mm) else None,
        delay_derivative_ms_per_s=None if derivative is None else derivative * _MS_PER_S,
    )
