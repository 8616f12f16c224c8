"""Motion of a second-order servo, ``x'' = w^2 (r - x) - 2 zeta w x'``, from one instant to another."""

from math import exp, expm1, pi, sqrt

import numpy as np
from numpy.typing import NDArray


def servo_transition(bandwidth_hz: float, damping: float, dt_s: float) -> NDArray[np.float64]:
    """Return the (2, 2) transition of (x - r, x') over ``dt_s`` at constant r, exactly, for any damping."""
    w = 2.0 * pi * bandwidth_hz
    decay = damping * w
    s = w * sqrt(abs(damping**2 - 1.0))
    if damping < 1.0:
        even = exp(-decay * dt_s) * float(np.cos(s * dt_s))
        odd = exp(-decay * dt_s) * dt_s * float(np.sinc(s * dt_s / pi))
    else:
        # cosh and sinh times the decay: neither overflows; w^2 / (decay + s) is decay - s without cancellation.
        slow = exp(-(w**2) / (decay + s) * dt_s)
        even = slow * (1.0 + exp(-2.0 * s * dt_s)) / 2.0
        odd = slow * (-expm1(-2.0 * s * dt_s) / (2.0 * s) if s else dt_s)
    return np.array([[even + decay * odd, odd], [-(w**2) * odd, even - decay * odd]])
