"""An arm that follows its command as a second-order servo: ``x'' = w^2 (u - x) - 2 zeta w x'``."""

from collections.abc import Callable
from math import ceil, pi
from typing import Final

import numpy as np
import scipy

from common.sources.trajectory import Array

GRID_HZ: Final = 1000
"""Rate at which the command is evaluated; in between it is taken as linear."""


def servo(path: Callable[[Array], Array], t_s: Array, bandwidth_hz: float, damping: float) -> Array:
    """Return the servo's positions (N, d) at ascending times ``t_s`` (N,) for the command ``path(t)``.

    ``path`` gives positions (M, d) at times (M,). The servo rests at ``path(0)`` until t = 0, so its movement is a
    function of continuous time and does not depend on ``t_s``. Exact for a command that is linear between the grid's
    instants. Oracle: the differential equation solved numerically, test_servo.
    """
    w = 2.0 * pi * bandwidth_hz
    grid_s = np.arange(ceil(max(float(t_s[-1]), 0.0) * GRID_HZ) + 2) / GRID_HZ
    command = path(grid_s)
    # First-order hold is exact for a command that is linear between the grid's instants.
    system = np.array([w * w]), np.array([1.0, 2.0 * damping * w, w * w])
    (numerator,), denominator, _ = scipy.signal.cont2discrete(system, 1.0 / GRID_HZ, "foh")
    at_rest = scipy.signal.lfilter_zi(numerator, denominator)[:, None] * command[0]
    followed, _ = scipy.signal.lfilter(numerator, denominator, command, axis=0, zi=at_rest)
    return np.stack([np.interp(t_s, grid_s, axis) for axis in followed.T], axis=1)
