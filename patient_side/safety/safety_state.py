"""Safety state of an arm: what drives it while its data are sound, and what it does while they are not.

tracking -> hold -> slow stop -> safe, on one clock that starts when the data become unsound: too old, too uncertain,
or no estimate. An emergency stop leads to slow stop at once, and lasts until its release. Afterwards, and after each
break in the data, the set point resumes slowly. The estimates themselves are not shaped.
"""

from dataclasses import dataclass
from math import dist, radians
from typing import Final, NamedTuple

from common.messages import SafetyMode
from common.safety_records import SafetyCause
from common.scenario.safety import Safety
from common.units import MM_PER_M, NS_PER_S, ms_to_ns
from patient_side.safety.set_point import STILL, Bounds, Place, brake, follow, minus, within

_BASE_S: Final = 0.033
"""Time over which speed and acceleration are measured at least in tracking: at 1 kHz a filter's correction on a late
sample is a step of millimetres in one tick, and no movement at metres a second."""
_MIN_BREAK_TICKS: Final = 3
_AT_REST_M: Final = 1e-9


class Seen(NamedTuple):
    """What a tick knows: the newest sample's instant, the active estimate and its largest standard deviation."""

    sample_ns: int | None
    estimate_m: Place | None
    std_m: float | None


class SafetyState(NamedTuple):
    """State between two ticks; at first safe. ``place`` is the set point, None before the first sound estimate.

    ``cause`` is that of the mode, ``step`` the set point's last movement, ``target`` what it holds or follows.
    ``fresh_ns`` is the tick that first used the newest sample, ``unsound_ns`` the instant at which the data became
    unsound, ``resumed_ns`` the last tick that began to resume. ``spent`` is what recent ticks used of the
    movement that the limits of tracking allow in 33 ms. ``is_stopped``: an emergency stop is in force.
    """

    mode: SafetyMode = "safe"
    cause: SafetyCause = "no_estimate"
    place: Place | None = None
    step: Place = STILL
    target: Place = STILL
    newest_ns: int = -1
    fresh_ns: int | None = None
    unsound_ns: int | None = None
    resumed_ns: int | None = None
    spent: Bounds = Bounds(0.0, 0.0)
    is_stopped: bool = False
    is_latched: bool = False


class Limits(NamedTuple):
    """Limits in the units of the kernel; times count from the instant at which the data became unsound."""

    hold_age_ns: int
    stop_after_ns: int
    safe_after_ns: int
    std_m: float
    workspace_m: float
    usual: Bounds
    refill: Bounds
    slow: Bounds
    break_ns: int
    resume_ns: int
    cautious_ns: int
    near_m: float
    turn_rad: float
    latch: bool


def limits_of(part: Safety, rate_hz: int) -> Limits:
    """Return the limits of a scenario for ticks at ``rate_hz``.

    The bounds hold for a nominal tick: an arm whose ticks were missed moves no further in the next one. ``usual`` is
    the movement of 33 ms, of which each tick gives back ``refill``. A break lasts three ticks at least.
    """
    tick_s = 1.0 / rate_hz
    base_s, hold_ns = max(tick_s, _BASE_S), ms_to_ns(part.hold_age_ms)
    return Limits(
        hold_age_ns=hold_ns,
        stop_after_ns=ms_to_ns(part.slow_stop_age_ms) - hold_ns,
        safe_after_ns=ms_to_ns(part.safe_age_ms) - hold_ns,
        std_m=part.max_std_mm / MM_PER_M,
        workspace_m=part.workspace_m,
        usual=Bounds(part.speed_m_s * base_s, part.acceleration_m_s2 * base_s * tick_s),
        refill=Bounds(part.speed_m_s * tick_s, part.acceleration_m_s2 * tick_s**2),
        slow=Bounds(part.resume_speed_m_s * tick_s, part.resume_acceleration_m_s2 * tick_s**2),
        break_ns=max(ms_to_ns(part.break_ms), _MIN_BREAK_TICKS * NS_PER_S // rate_hz),
        resume_ns=ms_to_ns(part.resume_ms),
        cautious_ns=ms_to_ns(part.cautious_ms),
        near_m=part.resume_speed_m_s * base_s,
        turn_rad=radians(part.resume_turn_deg_s) * tick_s,
        latch=part.latch,
    )


@dataclass(frozen=True)
class SafetyFilter:
    """Safety of one arm, from tick to tick; ``centre_m`` is the middle of its workspace.

    Oracles: test_safety_state, by literal times and by properties over arbitrary data.
    """

    limits: Limits
    centre_m: Place

    def stop(self, state: SafetyState, stopped: bool) -> SafetyState:
        """Return the state after an emergency stop, or after its release, which also ends a latch."""
        return state._replace(is_stopped=stopped, is_latched=state.is_latched and stopped)

    def resumed(self, left: "tuple[Place, SafetyMode] | None", is_stopped: bool) -> SafetyState:
        """Return the state with which a new process takes over an arm: where and in which mode it was left, if known.

        The arm holds its place until data come, and then resumes slowly; a latch stays.
        """
        if left is None:
            return SafetyState(is_stopped=is_stopped)
        place, mode = left
        is_latched = self.limits.latch and mode == "safe"
        return SafetyState(place=place, target=place, is_stopped=is_stopped, is_latched=is_latched)

    def is_cautious(self, state: SafetyState, t_ns: int) -> bool:
        """Tell whether the limits of resuming hold in tracking, too, as the last break was a short while ago."""
        return self._is_cautious(state.resumed_ns, t_ns)

    def _is_cautious(self, resumed_ns: int | None, t_ns: int) -> bool:
        return resumed_ns is not None and t_ns - resumed_ns < self.limits.cautious_ns

    def step(self, state: SafetyState, t_ns: int, seen: Seen) -> SafetyState:
        """Return the state at tick ``t_ns``, with the set point that drives the arm in ``place``.

        Parameters
        ----------
        state
            State of the last tick.
        t_ns
            Instant of the tick in run time.
        seen
            Newest sample and active estimate of the tick.
        """
        # The data: a fresher sample after a long wait ends a break.
        broke = False
        if seen.sample_ns is not None and seen.sample_ns > state.newest_ns:
            broke = state.fresh_ns is not None and t_ns - state.fresh_ns > self.limits.break_ns
            state = state._replace(newest_ns=seen.sample_ns, fresh_ns=t_ns)
        # The mode, then the set point in that mode.
        cause = self._fault(state, t_ns, seen)
        if cause is not None:
            return self._while_unsound(state, t_ns, cause)
        assert seen.estimate_m is not None, "without an estimate there is a fault"
        return self._while_sound(state, t_ns, seen.estimate_m, broke)

    def _fault(self, state: SafetyState, t_ns: int, seen: Seen) -> SafetyCause | None:
        """Return why the estimate must not drive the arm; None when it may."""
        limits = self.limits
        if state.is_stopped:
            return "emergency_stop"
        if state.fresh_ns is None or seen.estimate_m is None:
            return "no_estimate"
        if t_ns - state.newest_ns > limits.hold_age_ns:
            return "age"
        if seen.std_m is not None and seen.std_m > limits.std_m:
            return "uncertainty"
        return "latched" if state.is_latched else None

    def _while_unsound(self, state: SafetyState, t_ns: int, cause: SafetyCause) -> SafetyState:
        limits, place = self.limits, state.place
        if place is None:
            return state._replace(mode="safe", cause=cause)
        began_ns = state.unsound_ns
        if began_ns is None:
            began_ns = state.newest_ns + limits.hold_age_ns if cause == "age" else t_ns
        waited_ns = t_ns - began_ns
        if waited_ns < limits.stop_after_ns and cause not in ("emergency_stop", "latched"):
            there = within(follow(place, state.step, state.target, limits.slow), self.centre_m, limits.workspace_m)
            return state._replace(
                mode="hold", cause=cause, place=there, step=minus(there, place), unsound_ns=began_ns
            )
        # The target is given up: nothing moves any more once the set point has come to a stop.
        there = within(brake(place, state.step, limits.slow), self.centre_m, limits.workspace_m)
        step = minus(there, place)
        is_still = dist(step, STILL) <= _AT_REST_M
        is_safe = is_still and (waited_ns >= limits.safe_after_ns or cause in ("emergency_stop", "latched"))
        return state._replace(
            mode="safe" if is_safe else "slow_stop",
            cause=cause,
            place=there,
            step=step,
            target=there,
            unsound_ns=began_ns,
            is_latched=state.is_latched or (is_safe and limits.latch),
        )

    def _while_sound(self, state: SafetyState, t_ns: int, estimate_m: Place, broke: bool) -> SafetyState:
        limits = self.limits
        target = within(estimate_m, self.centre_m, limits.workspace_m)
        if state.place is None:
            return state._replace(mode="tracking", cause="first", place=target, target=target, unsound_ns=None)
        mode, cause, resumed_ns = state.mode, state.cause, state.resumed_ns
        if mode != "resuming" and mode != "tracking":
            mode, cause, resumed_ns = "resuming", "sound", t_ns
        elif broke:
            mode, cause, resumed_ns = "resuming", "break", t_ns
        elif (
            mode == "resuming"
            and resumed_ns is not None
            and t_ns - resumed_ns >= limits.resume_ns
            and dist(state.place, target) <= limits.near_m
        ):
            mode, cause = "tracking", "met"
        # After a break an estimator's corrections are large for a while.
        is_cautious = self._is_cautious(resumed_ns, t_ns)
        spent = _less(state.spent, limits.refill)
        left = _less(limits.usual, spent)
        bounds = limits.slow if mode == "resuming" or is_cautious else left
        there = within(follow(state.place, state.step, target, bounds), self.centre_m, limits.workspace_m)
        step = minus(there, state.place)
        return state._replace(
            mode=mode,
            cause=cause,
            place=there,
            step=step,
            target=target,
            unsound_ns=None,
            resumed_ns=resumed_ns,
            spent=Bounds(spent.step_m + dist(step, STILL), spent.change_m + dist(step, state.step)),
        )


def _less(one: Bounds, other: Bounds) -> Bounds:
    """Return what is left of ``one``, never below nothing."""
    return Bounds(max(0.0, one.step_m - other.step_m), max(0.0, one.change_m - other.change_m))
