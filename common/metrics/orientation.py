"""Errors of orientations: rotation vectors in rad, and the geodesic distance of rotations in degrees."""

from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

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
