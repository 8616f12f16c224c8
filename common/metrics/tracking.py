"""Accuracy of an estimator: its errors of position and orientation against the recorded truth, relative to hold's.

Positions have shape (T, 3) in m, one row per tick; NaN marks a missing position. Errors of orientations are rotation
vectors in rad, and the geodesic distance of rotations in degrees.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.units import MM_PER_M, NS_PER_S

Array = NDArray[np.float64]
Axes = list[float | None]
Score = dict[str, Axes | float | int | None]

_PER_AXIS: Final = ("r2_pct", "nrmse_fit_pct", "rmse_normalized", "rmse_mm", "max_mm")
_IN_3D: Final = ("r2_3d_pct", "nrmse_fit_3d_pct", "rmse_3d_mm", "max_3d_mm")

SETTLING_NS = 2 * NS_PER_S
"""Time after the first arrival before ticks are scored, so that filters can settle."""


def truth_at(t_ns: NDArray[np.int64], sample_ns: NDArray[np.int64], position_m: Array) -> Array:
    """Return the recorded arm's position at each of ``t_ns`` (T,), linearly interpolated, (T, 3).

    ``sample_ns`` (N,) increases, ``position_m`` is (N, 3). NaN before the first and after the last sample.
    Oracle: exact fractions in the tests.
    """
    if len(sample_ns) == 0:
        return np.full((len(t_ns), 3), np.nan)
    axes = [np.interp(t_ns, sample_ns, position_m[:, a], left=np.nan, right=np.nan) for a in range(3)]
    return np.column_stack(axes)


def scored_ticks(
    t_ns: NDArray[np.int64], truth_m: Array, hold_m: Array, first_arrival_ns: int | None
) -> NDArray[np.bool_]:
    """Mark the scored ticks (T,), the same set for every estimator.

    They begin 2 s after the first arrival and have both a truth and an estimate of hold. Without an arrival there
    are none.
    """
    if first_arrival_ns is None:
        return np.zeros(len(t_ns), dtype=np.bool_)
    begun = t_ns >= first_arrival_ns + SETTLING_NS
    return begun & _exists(truth_m) & _exists(hold_m)


class Scorable(NamedTuple):
    """One hand's ticks for a score: positions (T, 3) of an estimator, of hold and of the truth.

    ``scored`` (T,) marks the scored ticks; ``range_m`` (3,) is the min-max range of the training part.
    """

    estimate_m: Array
    hold_m: Array
    truth_m: Array
    scored: NDArray[np.bool_]
    range_m: Array

    @property
    def missing(self) -> NDArray[np.bool_]:
        """Mark the ticks (T,) without a finite estimate."""
        return ~_exists(self.estimate_m)

    @property
    def error_m(self) -> Array:
        """Return the errors (n, 3) at the scored ticks, hold's where an estimate is missing."""
        used = np.where(self.missing[:, None], self.hold_m, self.estimate_m)
        return np.asarray((used - self.truth_m)[self.scored])

    @property
    def sst_m2(self) -> Array:
        """Return the truth's sums of squares (3,) about its scored mean."""
        truth = self.truth_m[self.scored]
        if not len(truth):
            return np.zeros(3)
        # A constant truth has no variance, but its sum of squares about a rounded mean may be 1e-33.
        moves = np.ptp(truth, axis=0) > 0
        return np.where(moves, np.sum((truth - truth.mean(axis=0)) ** 2, axis=0), 0.0)


def score(*hands: Scorable) -> Score:
    """Return one estimator's accuracy, pooled over hands, under the summary's names; lists are x, y, z.

    With e = estimate - truth over the scored ticks: ``r2_pct = 100 (1 - SSE / SST)``, SST about the scored mean, None
    where the truth does not move, and ``nrmse_fit_pct = 100 (1 - sqrt(SSE / SST))``, the fit of Ljung's System
    Identification Toolbox; ``rmse_mm``, ``max_mm``; ``rmse_normalized`` in units of ``range_m``, None where that is 0
    for all hands. Names with ``_3d`` use sums over the axes and distances, as does `ratio_to_hold`. ``n_missing`` of
    the ``n_scored`` ticks have no finite estimate and use hold's. Hands are pooled by their sums: each tick has the
    same weight, and each hand's SST is about its own mean. Without scored ticks every figure is None. Oracles:
    tables worked by hand, of one hand and of two.
    """
    errors = [hand.error_m for hand in hands]
    error = np.concatenate(errors)
    n = len(error)
    n_missing = sum(int(np.count_nonzero(hand.missing & hand.scored)) for hand in hands)
    counts = {"n_scored": n, "n_missing": n_missing}
    if n == 0:
        axes: Score = {name: [None, None, None] for name in _PER_AXIS}
        return {**axes, **dict.fromkeys(_IN_3D), "ratio_to_hold": None, **counts}

    # Sums of squares per axis; from them every figure follows.
    sse, sst = np.sum(error**2, axis=0), np.sum([hand.sst_m2 for hand in hands], axis=0)
    rmse_m = np.sqrt(sse / n)
    unexplained = [None if t == 0 else float(s / t) for s, t in zip(sse, sst, strict=True)]
    of_all = float(sse.sum() / sst.sum()) if sst.sum() > 0 else None
    return {
        "r2_pct": [_r2_pct(share) for share in unexplained],
        "nrmse_fit_pct": [_fit_pct(share) for share in unexplained],
        "rmse_normalized": _normalized(errors, [hand.range_m for hand in hands]),
        "rmse_mm": [float(r * MM_PER_M) for r in rmse_m],
        "max_mm": [float(m * MM_PER_M) for m in np.abs(error).max(axis=0)],
        "r2_3d_pct": _r2_pct(of_all),
        "nrmse_fit_3d_pct": _fit_pct(of_all),
        "rmse_3d_mm": float(np.sqrt(sse.sum() / n) * MM_PER_M),
        "max_3d_mm": float(np.linalg.norm(error, axis=1).max() * MM_PER_M),
        "ratio_to_hold": ratio_to_hold(errors, [(hand.hold_m - hand.truth_m)[hand.scored] for hand in hands]),
        **counts,
    }


def ratio_to_hold(errors_m: Sequence[Array], hold_errors_m: Sequence[Array]) -> float | None:
    """Return ``sqrt(sum |e|^2 / sum |e_hold|^2)``, pooled over all rows of all arrays, each (T_i, 3).

    One array per arm and trial; every tick has the same weight. None where hold has no error.
    """
    hold = sum(float(np.sum(e**2)) for e in hold_errors_m)
    if hold == 0:
        return None
    return float(np.sqrt(sum(float(np.sum(e**2)) for e in errors_m) / hold))


def _normalized(errors_m: Sequence[Array], ranges_m: Sequence[Array]) -> Axes:
    """Return each axis's RMSE in units of the hands' ranges, over the hands that have one; None without any."""
    found: Axes = []
    for axis in range(3):
        units = [e[:, axis] / w[axis] for e, w in zip(errors_m, ranges_m, strict=True) if w[axis] != 0]
        found.append(float(np.sqrt(np.mean(np.concatenate(units) ** 2))) if units else None)
    return found


def _r2_pct(unexplained: float | None) -> float | None:
    return None if unexplained is None else 100 * (1 - unexplained)


def _fit_pct(unexplained: float | None) -> float | None:
    return None if unexplained is None else 100 * (1 - unexplained**0.5)


def _exists(position_m: Array) -> NDArray[np.bool_]:
    rows: NDArray[np.bool_] = np.asarray(np.isfinite(position_m).all(axis=1))
    return rows


def moves(recorded: Array) -> bool:
    """Tell whether recorded values (N, ...) ever change: a source without orientation or gripper repeats one."""
    return bool((recorded != recorded[:1]).any())


_BATCH: Final = 20_000


def error_vectors(estimate: Array, truth: Array) -> Array:
    """Return the rotation vectors (T, 3), in rad, from each estimate (T, 4) to the truth (T, 4); NaN without both.

    They are in the body frame of the estimate, as its stated covariance is. Scalar last; q and -q are one
    orientation, and lengths do not matter. Oracle: rotations about known axes.
    """
    found = np.full((len(estimate), 3), np.nan)
    known = np.flatnonzero(np.isfinite(estimate).all(axis=1) & np.isfinite(truth).all(axis=1))
    rotations = scipy.spatial.transform.Rotation.from_quat
    for begin in range(0, len(known), _BATCH):  # rotations take much memory
        some = known[begin : begin + _BATCH]
        found[some] = (rotations(estimate[some]).inv() * rotations(truth[some])).as_rotvec()
    return found


def angles_deg(vector_rad: Array) -> Array:
    """Return the angles (T,) of rotation vectors (T, 3) in degrees, 0 to 180: the geodesic distance.

    Huynh, "Metrics for 3D rotations" (2009), number 6. Oracle: rotations about known axes.
    """
    return np.asarray(np.degrees(np.linalg.norm(vector_rad, axis=1)))


def orientation_at(t_ns: NDArray[np.int64], sample_ns: NDArray[np.int64], quaternion: Array) -> Array:
    """Interpolate orientations (N, 4) at ``sample_ns`` (N,), ascending, at ``t_ns`` (T,), at constant rotation speed.

    Spherical linear interpolation (Shoemake 1985), as positions are interpolated linearly; returns (T, 4), NaN
    before the first and after the last sample. Oracle: a rotation of constant speed.
    """
    found = np.full((len(t_ns), 4), np.nan)
    if len(sample_ns) < 2:
        return found
    inside = np.flatnonzero((t_ns >= sample_ns[0]) & (t_ns <= sample_ns[-1]))
    for begin in range(0, len(inside), _BATCH):
        some = inside[begin : begin + _BATCH]
        # The samples around these instants only: fewer rotations at once.
        first = max(int(np.searchsorted(sample_ns, t_ns[some].min(), side="right")) - 2, 0)
        last = int(np.searchsorted(sample_ns, t_ns[some].max())) + 2
        begin_ns = sample_ns[first]  # relative instants are small enough to be exact floats
        known = scipy.spatial.transform.Rotation.from_quat(quaternion[first:last])
        between = scipy.spatial.transform.Slerp((sample_ns[first:last] - begin_ns).astype(np.float64), known)
        found[some] = between((t_ns[some] - begin_ns).astype(np.float64)).as_quat()
    return found
