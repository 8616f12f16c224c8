"""Limits of place and movement that a scenario does not give: the usual ones, or more where training rows need it."""

from tis.common.scenario.safety import MOST_TRAINED_M, TIMES_TRAINED

Three = tuple[float, float, float]
"""Reach, speed and acceleration, in m, m/s and m/s^2."""


def limits_from(given: tuple[float | None, float | None, float | None], usual: Three, trained: Three | None) -> Three:
    """Return the limits: as ``given``, else ``usual`` or what follows from training rows. Oracle: test_gate."""
    if trained is not None and TIMES_TRAINED * trained[0] <= MOST_TRAINED_M:
        reach, speed, acceleration = (max(u, TIMES_TRAINED * t) for u, t in zip(usual, trained, strict=True))
        usual = reach, speed, acceleration
    reach, speed, acceleration = (u if g is None else g for u, g in zip(usual, given, strict=True))
    return reach, speed, acceleration
