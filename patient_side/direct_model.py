"""The model of `direct_ls` and of its siblings for orientation and gripper: second moments of past and future."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DirectModel:
    """Second moments of a signal's past and future, relative to the present, for least squares on them.

    The signal has d axes: positions in m (3), an orientation in the tangent space at the present one in rad (3), a
    gripper's angle in rad (1). Past: L samples ``lags`` steps ago; future: H samples ``horizons`` steps ahead; a step
    is ``stride`` samples. ``past`` (d L, d L), ``cross`` (H, d L, d) and ``future`` (H, d, d) are in the unit's
    square, axes innermost. Each horizon uses its first ``n_lags`` (H,) lags, and its ``penalty`` (H,) times a random
    walk's moments is added to ``past``; ``covariance_scale`` (H,) multiplies the residuals' moment, so that 95 %
    ellipsoids hold 95 % of the held-back training rows.
    """

    stride: int
    lags: NDArray[np.int64]
    horizons: NDArray[np.int64]
    past: Array
    cross: Array
    future: Array
    n_lags: NDArray[np.int64]
    penalty: Array
    covariance_scale: Array

    @property
    def axes(self) -> int:
        """Number of axes d."""
        return int(self.future.shape[-1])
