"""Signs of quaternions: a rotation has two, and a path must not change from one to the other."""

import numpy as np

from tis.common.sources.trajectory import Array


def one_hemisphere(quaternions: Array) -> Array:
    """Return the same rotations (N, 4), x y z w, with signs such that each is nearest to the one before it.

    The first has w >= 0. Oracle: half-angle quaternions, test_jigsaws.
    """
    # The sign of a row is the product of all sign changes up to it.
    turns = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0, -1.0, 1.0)
    first = -1.0 if quaternions[0, 3] < 0 else 1.0
    return quaternions * (first * np.concatenate([[1.0], np.cumprod(turns)]))[:, np.newaxis]
