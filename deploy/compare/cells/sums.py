"""Sums of one twin's errors: all pooled scores are functions of sums and histograms, which add up over trials."""

from collections import Counter
from collections.abc import Iterable, Mapping
from math import ceil, log
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tis.common.metrics.consistency import CHI2_1_95, CHI2_3_95
from tis.common.metrics.tracking import error_vectors, moves, orientation_at
from tis.common.sources.trajectory import HandRecording, Recording
from tis.common.units import NS_PER_MS, sample_instant_ns
from tis.deploy.compare.cells.measured import MeasuredEstimator, MeasuredMethod
from tis.deploy.report.subjects.tracking import HandTrack
from tis.patient_side.linear_system import Array
from tis.patient_side.statespace import ArmModel

Histogram = dict[str, int]
"""Bins of equal ratio: number (text, as JSON keys are) -> count; bin b holds 1.001^b to 1.001^(b + 1)."""

_WIDTH = log(1.001)
ERROR_WIDTH = log(1.01)
"""Width of the bins of errors, 1 %: there are three times as many values as of a step's time."""
AGE_EDGES_MS: Final = (0, 20, 40, 60, 80, 100, 150, 200, 300, 400, 500, 700, 1000, 1500, 2000, 3000, 5000)
"""The bins of error against age; the last one is open."""


def hand_sums(
    track: HandTrack, ages_ns: NDArray[np.int64], model: ArmModel, measured: Mapping[str, MeasuredEstimator]
) -> dict[str, Any]:
    """Return one hand's sums: over the scored ticks, in SI units, lists are x, y, z.

    ``ages_ns`` (T,) are those of the freshest sample. A missing estimate counts with hold's, as in
    `tis.common.metrics.tracking.score`. ``sst_m2`` is about the mean of this hand's scored ticks: the position of a
    set-up is not an estimate.
    """
    # quantities that all estimators share: truth, hold, ages, variance of the movement
    scored, truth = track.scored, track.truth_m[track.scored]
    hold = track.estimates["hold"]
    ages_ns = ages_ns[scored]
    which_age = np.searchsorted(np.array(AGE_EDGES_MS) * NS_PER_MS, ages_ns, side="right") - 1
    moves = np.ptp(truth, axis=0) > 0 if len(truth) else np.zeros(3, dtype=np.bool_)
    sst = np.where(moves, np.sum((truth - truth.mean(axis=0)) ** 2, axis=0), 0.0) if len(truth) else np.zeros(3)
    estimators: dict[str, Any] = {}
    for name, estimate in track.estimates.items():
        # errors of the scored ticks, hold's where the estimate is missing
        missing = np.isnan(estimate.sum(axis=1))
        errors = (np.where(missing[:, None], hold, estimate) - track.truth_m)[scored]
        squares = np.sum(errors**2, axis=1)
        entry = {
            "sse_m2": np.sum(errors**2, axis=0).tolist(),
            "n_missing": int(np.count_nonzero(missing & scored)),
            "sse_by_age_m2": np.bincount(which_age, squares, len(AGE_EDGES_MS)).tolist(),
            "error_nm": histogram(np.rint(1e9 * np.sqrt(squares)).astype(np.int64), ERROR_WIDTH),
        }
        estimator = measured.get(name)
        if estimator is not None:
            inside, known = covered(
                errors, np.where(missing[:, None, None], np.nan, estimator.covariances_m2)[scored]
            )
            entry |= {
                "n_covered": inside,
                "n_ellipsoids": known,
                "step_ns": histogram(np.array(estimator.steps_ns, dtype=np.int64)),
                "trained": hasattr(estimator.inner, "model"),
            }
        estimators[name] = entry
    return {
        "n_scored": int(np.count_nonzero(scored)),
        "sst_m2": sst.tolist(),
        "range_m": (model.output_high_m - model.output_low_m).tolist(),
        "n_by_age": np.bincount(which_age, minlength=len(AGE_EDGES_MS)).tolist(),
        "age_sum_by_age_ns": np.bincount(which_age, ages_ns, len(AGE_EDGES_MS)).tolist(),
        "age_sum_ns": int(ages_ns.sum()),
        "age_ns": histogram(ages_ns),
        "estimators": estimators,
    }


def covered(errors_m: Array, covariances_m2: Array) -> tuple[int, int]:
    """Return how many errors (T, 3) lie within the 95 % ellipsoid of their covariance (T, 3, 3), and their number.

    Rows with a non-finite covariance are excluded. For a singular one an error must lie in its range. Oracle: solving
    row by row, and the share itself for normal errors.
    """
    known = np.isfinite(covariances_m2).all(axis=(1, 2))
    if not known.any():
        return 0, 0
    # squared Mahalanobis distance in the axes of the ellipsoid
    variances, axes = np.linalg.eigh(covariances_m2[known])
    along = np.einsum("tij,ti->tj", axes, errors_m[known]) ** 2
    flat = variances <= 1e-12 * np.maximum(variances[:, -1:], 0.0)
    # an error of a nanometre from a flat ellipsoid is rounding
    distances = np.where(flat, np.where(along > 1e-18, np.inf, 0.0), along / np.where(flat, 1.0, variances))
    return int(np.count_nonzero(distances.sum(axis=1) <= CHI2_3_95)), int(np.count_nonzero(known))


def wrist_sums(
    track: HandTrack, recording: Recording, hand: HandRecording, methods: Mapping[str, MeasuredMethod]
) -> dict[str, Any]:
    """Return one hand's sums by method over the scored ticks of its track, in rad.

    A missing estimate counts with hold's. The truth is the recorded arm's, turned at a constant speed between two
    samples; an orientation or a gripper that never moves is not scored, as the recording lacks it.
    Oracles: the summary of a logged twin, test_wrist_sums, and values by hand.
    """
    rows = hand.follower.rows(recording.start, len(recording))
    sample_ns = np.array([sample_instant_ns(k, recording.rate_hz) for k in range(len(rows))], dtype=np.int64)
    t_ns = track.t_ns[track.scored]
    truth = orientation_at(t_ns, sample_ns, rows.orientation)
    truth_rad = np.interp(t_ns, sample_ns, rows.gripper_rad)
    n_turns, n_openings = len(t_ns) * moves(rows.orientation), len(t_ns) * moves(rows.gripper_rad)
    errors = {name: _errors(method, track, truth, truth_rad) for name, method in methods.items()}
    held, held_rad = errors["hold"] if "hold" in errors else (np.empty((0, 3)), np.empty(0))
    found: dict[str, Any] = {}
    for name, method in methods.items():
        error, error_rad = errors[name]
        missing = ~np.isfinite(error).all(axis=1) | ~np.isfinite(error_rad)
        error, error_rad = np.where(missing[:, None], held, error), np.where(missing, held_rad, error_rad)
        error, error_rad = error[:n_turns], error_rad[:n_openings]
        inside, known = covered(error, method.covariances_rad2[track.scored][:n_turns])
        variances = method.gripper_variances_rad2[track.scored][:n_openings]
        stated = np.isfinite(variances)
        found[name] = {
            "sse_rad2": float(np.sum(error**2)),
            "sse_gripper_rad2": float(np.sum(error_rad**2)),
            "n_scored": n_turns,
            "n_gripper_scored": n_openings,
            "n_missing": int(np.count_nonzero(missing)),
            "n_covered": inside,
            "n_ellipsoids": known,
            "n_gripper_covered": int(np.count_nonzero(error_rad[stated] ** 2 <= CHI2_1_95 * variances[stated])),
            "n_gripper_intervals": int(np.count_nonzero(stated)),
            "step_ns": histogram(np.array(method.steps_ns, dtype=np.int64)),
        }
    return found


def _errors(method: MeasuredMethod, track: HandTrack, truth: Array, truth_rad: Array) -> tuple[Array, Array]:
    """Return the errors of orientation (T, 3) and gripper (T,) at the scored ticks."""
    return error_vectors(method.orientation[track.scored], truth), truth_rad - method.gripper_rad[track.scored]


def histogram(values: NDArray[np.int64], width: float = _WIDTH) -> Histogram:
    """Count values (N,), durations in ns or errors in nm; those below 1 count as 1. ``width``: a bin's, in logs."""
    if not len(values):
        return {}
    bins = np.floor(np.log(np.maximum(values, 1)) / width).astype(np.int64)
    first = int(bins.min())
    counts = np.bincount(bins - first)
    return {str(first + i): int(counts[i]) for i in np.flatnonzero(counts).tolist()}


def merged(histograms: Iterable[Mapping[str, int]]) -> Histogram:
    """Return the sum of the histograms."""
    total: Counter[str] = Counter()
    for one in histograms:
        total.update(one)
    return dict(total)


def percentile(counts: Mapping[str, int], percent: int, width: float = _WIDTH) -> float | None:
    """Return the nearest-rank percentile within half a bin (0.05 %, of errors 0.5 %), None without values.

    100 is the largest value. Oracle: `tis.common.metrics.percentiles`.
    """
    n = sum(counts.values())
    rank = max(ceil(percent * n / 100), 1)
    seen = 0
    for number in sorted(map(int, counts)):
        seen += counts[str(number)]
        if seen >= rank:
            return float(np.exp((number + 0.5) * width))  # the geometric middle of the bin
    return None
