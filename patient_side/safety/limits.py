"""Limits of a set point for a rate of ticks, in the units of the safety state."""

from math import radians
from typing import Final, NamedTuple

from tis.common.scenario.safety import (
    MOST_TRAINED_M,
    TIMES_RESUMED,
    TIMES_TRAINED,
    USUAL_RESUMED,
    USUAL_SET_POINT,
    Safety,
)
from tis.common.units import MM_PER_M, NS_PER_S, ms_to_ns
from tis.patient_side.safety.set_point import WINDOW_NS, Pace, WristLimits

_MOST_CORRECTED: Final = 0.25
"""Share of the movement that the speed allows in this time, which corrections take at most."""
_MIN_BREAK_TICKS: Final = 3


Three = tuple[float, float, float]
"""Reach, speed and acceleration, in m, m/s and m/s^2."""


class Limits(NamedTuple):
    """Limits in the units of the kernel; times count from the instant at which the data became unsound.

    ``usual`` and ``most_corrected_m`` bound the place in tracking, ``slow`` while it resumes, ``held`` while it goes
    to the last sound estimate.
    """

    hold_age_ns: int
    stop_after_ns: int
    safe_after_ns: int
    std_m: float
    workspace_m: float
    usual: Pace
    most_corrected_m: float
    slow: Pace
    held: Pace
    wrist: WristLimits
    break_ns: int
    resume_ns: int
    cautious_ns: int
    near_m: float
    latch: bool

    @property
    def run_out_m(self) -> float:
        """Longest way of a set point after an emergency stop, in m: v^2 / (2 a) of the carried step in tracking."""
        return self.usual.step**2 / (2.0 * self.usual.change)


def limits_of(part: Safety, rate_hz: int, trained: Three | None = None) -> Limits:
    """Return the limits of a scenario for ticks at ``rate_hz``.

    The bounds hold for a nominal tick: an arm whose ticks were missed moves no further in the next one. In any 33 ms
    the carried steps and the corrections together move no further than the speed allows. A break lasts three ticks at
    least. ``trained`` is what the arm did in the training rows, for limits that are not given.
    """
    tick_s = 1.0 / rate_hz
    base_s, hold_ns = max(tick_s, WINDOW_NS / NS_PER_S), ms_to_ns(part.hold_age_ms)
    given = part.workspace_m, part.speed_m_s, part.acceleration_m_s2
    workspace_m, speed_m_s, acceleration_m_s2 = limits_from(given, USUAL_SET_POINT, trained)
    usual, most_corrected_m = _tracking(speed_m_s, acceleration_m_s2, part.correction_mm / MM_PER_M, tick_s, base_s)
    # no faster than in tracking, where corrections take a share of the speed
    resumed = part.resume_speed_m_s, part.resume_acceleration_m_s2
    resume_speed_m_s, resume_acceleration_m_s2 = resumed_from(resumed, trained if part.speed_m_s is None else None)
    slow_step = min(resume_speed_m_s * tick_s, usual.step)
    slow_change = min(resume_acceleration_m_s2 * tick_s**2, usual.change)
    turn, most_turned = _tracking(
        radians(part.turn_deg_s),
        radians(part.turn_acceleration_deg_s2),
        radians(part.turn_correction_deg),
        tick_s,
        base_s,
    )
    slow_turn = Pace(min(radians(part.resume_turn_deg_s) * tick_s, turn.step), turn.change, turn.brake)
    return Limits(
        hold_age_ns=hold_ns,
        stop_after_ns=ms_to_ns(part.slow_stop_age_ms) - hold_ns,
        safe_after_ns=ms_to_ns(part.safe_age_ms) - hold_ns,
        std_m=part.max_std_mm / MM_PER_M,
        workspace_m=workspace_m,
        usual=usual,
        most_corrected_m=most_corrected_m,
        slow=Pace(slow_step, slow_change, slow_change),
        held=Pace(slow_step, slow_change, usual.brake),
        wrist=WristLimits(turn, slow_turn, most_turned),
        break_ns=max(ms_to_ns(part.break_ms), _MIN_BREAK_TICKS * NS_PER_S // rate_hz),
        resume_ns=ms_to_ns(part.resume_ms),
        cautious_ns=ms_to_ns(part.cautious_ms),
        near_m=resume_speed_m_s * base_s,
        latch=part.latch,
    )


def _tracking(
    speed: float, acceleration: float, correction: float, tick_s: float, base_s: float
) -> tuple[Pace, float]:
    """Return the bounds of tracking: the speed, shared between what is carried on and corrections."""
    most = min(correction, _MOST_CORRECTED * speed * base_s)
    change = acceleration * tick_s**2
    return Pace((speed - most / base_s) * tick_s, change, change), most


# Limits of place and movement that a scenario does not give: the usual ones, or more where training rows need it.


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
