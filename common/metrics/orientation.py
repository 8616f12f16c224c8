"""Errors of orientations: the geodesic distance of rotations, in degrees."""

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]


def geodesic_deg(quaternion: Array, other: Array) -> Array:
    """Return the angle of the rotation from each of ``quaternion`` (T, 4) to ``other`` (T, 4), 0 to 180.

    Scalar last; q and -q are one orientation, and lengths do not matter. Huynh, "Metrics for 3D rotations" (2009),
    number 6. Oracle: rotations about known axes.
    """
    if not len(quaternion):
        return np.empty(0)
    rotations = scipy.spatial.transform.Rotation.from_quat
    between = rotations(quaternion).inv() * rotations(other)
    return np.asarray(np.degrees(between.magnitude()))


def orientation_at(t_ns: NDArray[np.int64], sample_ns: NDArray[np.int64], quaternion: Array) -> Array:
    """Interpolate orientations (N, 4) at ``sample_ns`` (N,), ascending, at ``t_ns`` (T,), at constant rotation speed.

    Spherical linear interpolation (Shoemake 1985), as positions are interpolated linearly; returns (T, 4), NaN
    before the first and after the last sample. Oracle: a rotation of constant speed.
    """
    found = np.full((len(t_ns), 4), np.nan)
    if len(sample_ns) < 2:
        return found
    inside = (t_ns >= sample_ns[0]) & (t_ns <= sample_ns[-1])
    if inside.any():
        begin_ns = sample_ns[0]  # relative instants are small enough to be exact floats
        known = scipy.spatial.transform.Rotation.from_quat(quaternion)
        between = scipy.spatial.transform.Slerp((sample_ns - begin_ns).astype(np.float64), known)
        found[inside] = between((t_ns[inside] - begin_ns).astype(np.float64)).as_quat()
    return found
