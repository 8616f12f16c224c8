"""Where a rising function crosses zero."""

from collections.abc import Callable
from typing import Final

_MOST_STEPS: Final = 200


def crossing(f: Callable[[float], float], low: float, high: float, width: float) -> float:
    """Return an x in [low, high] within ``width`` of where a continuous ``f`` that does not fall crosses zero.

    ``f`` is at most 0 at ``low`` and at least 0 at ``high``. False position with the Illinois weights (Dowell,
    Jarratt 1971); every third step halves, so that it ends for any ``f``. Oracle: known roots in the tests.
    """
    f_low, f_high = f(low), f(high)
    side = 0
    for step in range(_MOST_STEPS):
        if high - low <= width or f_low >= 0.0 or f_high <= 0.0:
            break
        x = (low + high) / 2.0 if step % 3 == 2 else (low * f_high - high * f_low) / (f_high - f_low)
        if not low < x < high:
            x = (low + high) / 2.0
        f_x = f(x)
        if f_x == 0.0:
            return x
        if f_x < 0.0:
            low, f_low = x, f_x
            f_high = f_high / 2.0 if side < 0 else f_high
            side = -1
        else:
            high, f_high = x, f_x
            f_low = f_low / 2.0 if side > 0 else f_low
            side = 1
    return low if f_low >= 0.0 else high if f_high <= 0.0 else (low + high) / 2.0
