"""Highest rate of ticks that measured steps keep up with."""

from collections.abc import Sequence
from typing import Final

NS_PER_S: Final = 1_000_000_000


def misses_a_tick(steps_ns: Sequence[int], period_ns: int) -> bool:
    """Tell whether steps that take ``steps_ns`` miss a tick where one is due every ``period_ns``.

    A step begins when its tick is due, or when the step before it ends, if that is later. A tick is missed when its
    step has not begun before the next tick is due, as in a run (`common.ticker`). Nothing else takes time here.
    """
    behind_ns = 0
    for step_ns in steps_ns[:-1]:
        behind_ns = max(0, behind_ns + step_ns - period_ns)
        if behind_ns >= period_ns:
            return True
    return False


def highest_rate_hz(steps_ns: Sequence[int]) -> float | None:
    """Return the highest rate at which the steps, in this order, miss no tick; None with fewer than two steps.

    The rate is that of the shortest such period in whole ns, found by bisection: a longer period never misses more.
    The steps are assumed to take at that rate what they were measured to take. Oracle: hand-written sequences, and
    all periods tried in turn, test_tick_rate.
    """
    if len(steps_ns) < 2:
        return None
    low_ns, high_ns = 0, max(1, max(steps_ns))  # a period as long as the longest step misses none
    while high_ns - low_ns > 1:
        middle_ns = (low_ns + high_ns) // 2
        if misses_a_tick(steps_ns, middle_ns):
            low_ns = middle_ns
        else:
            high_ns = middle_ns
    return NS_PER_S / high_ns
