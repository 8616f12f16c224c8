"""Error against the age of the newest sample, from the ticks of a run."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Hand
from tis.common.units import MM_PER_M
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.section import Section, means
from tis.deploy.report.subjects.age import ages_at_ms
from tis.deploy.report.subjects.tracking import HandTrack


class AgeBins(Section):
    """The error of an estimator in bins of age."""

    age_ms: list[float] = means("Ages of the freshest sample, the middle of each bin.")
    rmse_3d_mm: list[float] = means("RMSE at these ages.")
    n: list[int] = means("Scored ticks in each bin.")


class TurnAgeBins(Section):
    """The error of an orientation method in bins of age."""

    age_ms: list[float] = means("Ages of the freshest sample, the middle of each bin.")
    rms_deg: list[float] = means("RMS of the orientation error at these ages.")
    n: list[int] = means("Scored ticks in each bin.")


Array = NDArray[np.float64]
MAX_BINS = 14
MIN_TICKS = 10
_STEP_MS = 0.5


class ErrorByAge(NamedTuple):
    """Bins of age, ascending: mean age (B,) in ms, RMSE (B,) in the error's unit, number of ticks (B,)."""

    age_ms: Array
    rmse: Array
    n: NDArray[np.int64]


def error_by_age(age_ms: Array, error: Array) -> ErrorByAge:
    """Return the RMSE by age of T ticks; ``age_ms`` and ``error`` are (T,), NaN for unknown.

    Samples and ticks usually share a rate, so ages take few values. Each value is a bin; rare ones are merged with
    older neighbours up to `MIN_TICKS` ticks. If that makes more than `MAX_BINS` bins, bins hold equal numbers of
    ticks instead. A last bin that stays too small is left out. Oracle: tables computed by hand, test_error_by_age.
    """
    known = np.isfinite(age_ms) & np.isfinite(error)
    age, squared = age_ms[known], error[known] ** 2
    # ages within half a millisecond count as one value
    label = np.round(age / _STEP_MS).astype(np.int64)
    _, place, n = np.unique(label, return_inverse=True, return_counts=True)
    place = _merged_bins(n)[place]
    if len(place) and place.max() >= MAX_BINS + int(np.bincount(place)[-1] < MIN_TICKS):
        # too many values: bins of equal counts; repeated edges would make empty bins
        edges = np.unique(np.quantile(age, np.linspace(0, 1, MAX_BINS + 1)))
        place = np.clip(np.searchsorted(edges, age, side="right") - 1, 0, max(len(edges) - 2, 0))
    n = np.bincount(place)
    total, ages = np.bincount(place, weights=squared), np.bincount(place, weights=age)
    enough = n >= MIN_TICKS
    n, total, ages = n[enough], total[enough], ages[enough]
    return ErrorByAge(ages / n, np.sqrt(total / n), n)


def _merged_bins(n: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the bin (V,) of each of V ascending ages with counts ``n`` (V,); a bin is full at `MIN_TICKS`."""
    bins = np.zeros(len(n), dtype=np.int64)
    current = filled = 0
    for i, count in enumerate(n.tolist()):
        bins[i] = current
        filled += count
        if filled >= MIN_TICKS:
            current, filled = current + 1, 0
    return bins


def errors_by_age(logs: RunLogs, track: HandTrack, hand: Hand) -> dict[str, AgeBins]:
    """Return the summary's ``error_by_age`` of one hand: by estimator, bins of age, their RMSE in 3D and tick counts.

    Bins are those of `error_by_age`; ticks without an estimate are left out. Oracle: test_error_by_age.
    """
    age_ms = ages_at_ms(logs, hand, track.t_ns)
    found = {}
    for name, estimate_m in track.estimates.items():
        error_mm = MM_PER_M * np.linalg.norm(estimate_m - track.truth_m, axis=1)
        bins = error_by_age(age_ms[track.scored], error_mm[track.scored])
        found[name] = AgeBins(age_ms=bins.age_ms.tolist(), rmse_3d_mm=bins.rmse.tolist(), n=bins.n.tolist())
    return found
