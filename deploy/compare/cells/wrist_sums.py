"""Sums of one twin's errors of orientation and gripper, which add up over trials as those of positions do."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from tis.common.metrics.tracking import error_vectors, orientation_at
from tis.common.sources.trajectory import HandRecording, Recording
from tis.common.units import sample_instant_ns
from tis.deploy.compare.cells.histogram import histogram
from tis.deploy.compare.cells.measured_method import MeasuredMethod
from tis.deploy.compare.cells.score import covered
from tis.deploy.report.measures.estimation.tracking import HandTrack
from tis.patient_side.statespace import Array

CHI2_1_95: Final = 3.841458820694124
"""95 % quantile of chi squared with one degree of freedom."""


def wrist_sums(
    track: HandTrack, recording: Recording, hand: HandRecording, methods: Mapping[str, MeasuredMethod]
) -> dict[str, Any]:
    """Return one hand's sums by method over the scored ticks of its track, in rad.

    A missing estimate counts with hold's. The truth is the recorded arm's, turned at a constant speed between two
    samples. Oracles: the summary of a logged twin, test_wrist_sums, and values by hand.
    """
    rows = hand.follower.rows(recording.start, len(recording))
    sample_ns = np.array([sample_instant_ns(k, recording.rate_hz) for k in range(len(rows))], dtype=np.int64)
    t_ns = track.t_ns[track.scored]
    truth = orientation_at(t_ns, sample_ns, rows.orientation)
    truth_rad = np.interp(t_ns, sample_ns, rows.gripper_rad)
    errors = {name: _errors(method, track, truth, truth_rad) for name, method in methods.items()}
    held, held_rad = errors["hold"] if "hold" in errors else (np.empty((0, 3)), np.empty(0))
    found: dict[str, Any] = {}
    for name, method in methods.items():
        error, error_rad = errors[name]
        missing = ~np.isfinite(error).all(axis=1) | ~np.isfinite(error_rad)
        error, error_rad = np.where(missing[:, None], held, error), np.where(missing, held_rad, error_rad)
        inside, known = covered(error, method.covariances_rad2[track.scored])
        variances = method.gripper_variances_rad2[track.scored]
        stated = np.isfinite(variances)
        found[name] = {
            "sse_rad2": float(np.sum(error**2)),
            "sse_gripper_rad2": float(np.sum(error_rad**2)),
            "n_scored": len(error),
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
