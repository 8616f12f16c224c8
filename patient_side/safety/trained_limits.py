"""Limits of place and movement that a scenario does not give: the usual ones, or more where training rows need it."""

from tis.common.scenario.safety import MOST_TRAINED_M, TIMES_RESUMED, TIMES_TRAINED, USUAL_RESUMED, USUAL_SET_POINT

Three = tuple[float, float, float]
"""Reach, speed and acceleration, in m, m/s and m/s^2."""


def limits_from(given: tuple[float | None, float | None, float | None], usual: Three, trained: Three | None) -> Three:
    """Return the limits: as ``given``, else ``usual`` or what follows from training rows. Oracle: test_gate."""
    if trained is not None and trained[0] <= MOST_TRAINED_M:
        reach, speed, acceleration = (max(u, TIMES_TRAINED * t) for u, t in zip(usual, trained, strict=True))
        usual = min(reach, MOST_TRAINED_M), speed, acceleration
    reach, speed, acceleration = (u if g is None else g for u, g in zip(usual, given, strict=True))
    return reach, speed, acceleration


def resumed_from(given: tuple[float | None, float | None], trained: Three | None) -> tuple[float, float]:
    """Return speed and acceleration of a set point that resumes: as ``given``, else usual, or as training rows need.

    They grow in proportion, as the way behind a moving estimate is v^2 / (2 a). Where the speed of tracking is the
    usual one, so are these. Oracle: a fast arm, test_safety_state.
    """
    speed, acceleration = USUAL_RESUMED
    follows = trained is not None and trained[0] <= MOST_TRAINED_M
    if trained is not None and follows and TIMES_TRAINED * trained[1] > USUAL_SET_POINT[1]:
        times = max(1.0, TIMES_RESUMED * trained[1] / speed)
        speed, acceleration = times * speed, times * acceleration
    return speed if given[0] is None else given[0], acceleration if given[1] is None else given[1]
