"""The summary's effective time and value offsets: how late and how wrong the arm's movement is reproduced."""

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from common.metrics.etvo import Etvo, etvo, offset_grid_s
from common.metrics.percentiles import summarise
from common.units import MM_PER_M, NS_PER_S

if TYPE_CHECKING:  # tracking imports this module
    from deploy.report.measures.estimation.tracking import HandTrack

Array = NDArray[np.float64]

MAX_TICKS: Final = 6000
"""Ticks that are aligned, the first ones that are scored: the work grows with their number."""

_MIN_OFFSET_S: Final = -0.2
_MAX_OFFSET_S: Final = 1.0
_STEPS_A_TICK: Final = 4
_MS_PER_S: Final = 1000.0


def offsets(track: "HandTrack", name: str, rate_hz: int) -> dict[str, Any]:
    """Return the offsets of one estimator behind the truth; those between -0.2 and 1 s are tried.

    ``time_ms`` is positive when it is late, ``value_mm`` what is wrong beyond that, ``delay_derivative_ms_per_s`` how
    much the delay changes. Missing estimates are left out.
    """
    return _summary(_aligned(track, track.estimates[name], track.truth_m, rate_hz))


def actuation_ms(track: "HandTrack", active: str, rate_hz: int) -> Array:
    """Return how late a servo's arm does what the active estimator said, (T,) in ms, tick by tick; none without."""
    if "plant" not in track.estimates or active not in track.estimates:
        return np.empty(0)
    found = _aligned(track, track.estimates["plant"], track.estimates[active], rate_hz)
    return found.time_s * _MS_PER_S


def _aligned(track: "HandTrack", reproduced_m: Array, original_m: Array, rate_hz: int) -> Etvo:
    there = track.scored & np.isfinite(reproduced_m).all(axis=1) & np.isfinite(original_m).all(axis=1)
    which = np.flatnonzero(there)[:MAX_TICKS]
    grid_s = offset_grid_s(_MIN_OFFSET_S, _MAX_OFFSET_S, 1.0 / (_STEPS_A_TICK * rate_hz))
    return etvo(track.t_ns[which] / NS_PER_S, reproduced_m[which], original_m[which], grid_s)


def _summary(found: Etvo) -> dict[str, Any]:
    value_mm = found.value * MM_PER_M
    derivative = found.delay_derivative
    return {
        "n": len(value_mm),
        "time_ms": summarise(found.time_s * _MS_PER_S, (50, 95), ("mean", "max")),
        "value_mm": summarise(value_mm, (50, 95), ("max",)),
        "value_rms_mm": float(np.sqrt(np.mean(value_mm**2))) if len(value_mm) else None,
        "delay_derivative_ms_per_s": None if derivative is None else derivative * _MS_PER_S,
    }
