"""Safety state of an arm: what drives it while its data are sound, and what it does while they are not.

tracking -> hold -> slow stop -> safe, on one clock that starts when the data become unsound: too old, too uncertain,
in conflict with each other, or no estimate. An emergency stop leads to slow stop at once, and lasts until its
release. Afterwards, and after each break in the data, the set point resumes slowly. Estimates are not shaped.
"""

from dataclasses import dataclass
from math import dist
from typing import Final, NamedTuple

from tis.common.messages import SafetyMode
from tis.common.safety_records import SafetyCause
from tis.common.vector import minus, plus
from tis.patient_side.safety.limits import Limits
from tis.patient_side.safety.set_point import (
    AT_REST,
    NO_CORRECTION,
    STILL,
    Motion,
    Moved,
    Place,
    WristPoint,
    WristPose,
    begin,
    brake,
    brake_wrist,
    follow,
    follow_wrist,
    within,
)

_AT_REST_M: Final = 1e-9
_AT_ONCE: Final = ("emergency_stop", "latched", "contact")
"""Causes that lead to slow stop at once."""


class Seen(NamedTuple):
    """What a tick knows: the newest sample's instant, the active estimate and its largest standard deviation.

    ``wrist`` is the estimated orientation and gripper; ``in_conflict``: the samples contradict each other;
    ``is_pressed``: what the arm touches presses too hard, and the estimate leads no way back.
    """

    sample_ns: int | None
    estimate_m: Place | None
    std_m: float | None
    wrist: WristPose | None = None
    in_conflict: bool = False
    is_pressed: bool = False


class SafetyState(NamedTuple):
    """State between two ticks; at first safe. ``place`` is the set point, None before the first sound estimate.

    ``cause`` is that of the mode, ``motion`` the set point's last movement, ``target`` what it holds or follows,
    ``wrist`` its orientation and gripper. ``fresh_ns`` is the tick that first used the newest sample, ``unsound_ns``
    the instant at which the data became unsound, ``resumed_ns`` the last tick that began to resume.
    ``is_stopped``: an emergency stop is in force.
    """

    mode: SafetyMode = "safe"
    cause: SafetyCause = "no_estimate"
    place: Place | None = None
    motion: Motion = AT_REST
    target: Place = STILL
    wrist: WristPoint | None = None
    newest_ns: int = -1
    fresh_ns: int | None = None
    unsound_ns: int | None = None
    resumed_ns: int | None = None
    is_stopped: bool = False
    is_latched: bool = False


class Left(NamedTuple):
    """Where a process that is gone has left the arm, and in which state; ``wrist`` is None where it is not known."""

    place: Place
    mode: SafetyMode
    wrist: WristPose | None = None


@dataclass(frozen=True)
class SafetyFilter:
    """Safety of one arm, from tick to tick; ``centre_m`` is the middle of its workspace.

    Oracles: test_safety_state, by literal times, by properties over arbitrary data and by a search for the worst.
    """

    limits: Limits
    centre_m: Place

    def stop(self, state: SafetyState, stopped: bool) -> SafetyState:
        """Return the state after an emergency stop, or after its release, which also ends a latch."""
        return state._replace(is_stopped=stopped, is_latched=state.is_latched and stopped)

    def resumed(self, left: Left | None, is_stopped: bool) -> SafetyState:
        """Return the state with which a new process takes over an arm: where and in which mode it was left, if known.

        The arm holds its place until data come, and then resumes slowly; a latch stays.
        """
        if left is None:
            return SafetyState(is_stopped=is_stopped)
        is_latched = self.limits.latch and left.mode == "safe"
        wrist = None if left.wrist is None else begin(left.wrist)
        return SafetyState(
            place=left.place, target=left.place, wrist=wrist, is_stopped=is_stopped, is_latched=is_latched
        )

    def _is_cautious(self, resumed_ns: int | None, t_ns: int) -> bool:
        """Tell whether the limits of resuming hold in tracking, too, as the last break was a short while ago."""
        return resumed_ns is not None and t_ns - resumed_ns < self.limits.cautious_ns

    def step(self, state: SafetyState, t_ns: int, seen: Seen) -> SafetyState:
        """Return the state at tick ``t_ns``, with the set point that drives the arm in ``place`` and ``wrist``.

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
        broke, sample_ns = False, seen.sample_ns
        newest_ns, fresh_ns = state.newest_ns, state.fresh_ns
        if sample_ns is not None and sample_ns > newest_ns:
            broke = fresh_ns is not None and t_ns - fresh_ns > self.limits.break_ns
            newest_ns, fresh_ns = sample_ns, t_ns
        # The mode, then the set point in that mode.
        cause = self._fault(state, t_ns, seen, newest_ns, fresh_ns)
        if cause is not None:
            return self._while_unsound(state._replace(newest_ns=newest_ns, fresh_ns=fresh_ns), t_ns, cause)
        return self._while_sound(state, t_ns, seen, newest_ns, fresh_ns, broke)

    def _fault(
        self, state: SafetyState, t_ns: int, seen: Seen, newest_ns: int, fresh_ns: int | None
    ) -> SafetyCause | None:
        """Return why the estimate must not drive the arm; None when it may."""
        limits = self.limits
        if state.is_stopped:
            return "emergency_stop"
        if fresh_ns is None or seen.estimate_m is None:
            return "no_estimate"
        if seen.in_conflict:
            return "conflict"
        if seen.is_pressed:
            return "contact"
        if t_ns - newest_ns > limits.hold_age_ns:
            return "age"
        if seen.std_m is not None and seen.std_m > limits.std_m:
            return "uncertainty"
        return "latched" if state.is_latched else None

    def _while_unsound(self, state: SafetyState, t_ns: int, cause: SafetyCause) -> SafetyState:
        limits, place, wrist = self.limits, state.place, state.wrist
        if place is None:
            return state._replace(mode="safe", cause=cause)
        began_ns = state.unsound_ns
        if began_ns is None:
            began_ns = state.newest_ns + limits.hold_age_ns if cause == "age" else t_ns
        waited_ns, turns = t_ns - began_ns, limits.wrist
        if waited_ns < limits.stop_after_ns and cause not in _AT_ONCE:
            moved = follow(minus(state.target, place), state.motion, limits.held, NO_CORRECTION, t_ns)
            if wrist is not None:
                wrist = follow_wrist(wrist, wrist.target, turns.slow, NO_CORRECTION, t_ns)
            return self._moved(state, moved)._replace(mode="hold", cause=cause, wrist=wrist, unsound_ns=began_ns)
        # The target is given up: nothing moves any more once the set point has come to a stop.
        state = self._moved(state, brake(state.motion, limits.usual.brake))
        assert state.place is not None
        is_still = dist(state.motion.carried, STILL) <= _AT_REST_M
        is_safe = is_still and (waited_ns >= limits.safe_after_ns or cause in _AT_ONCE)
        return state._replace(
            mode="safe" if is_safe else "slow_stop",
            cause=cause,
            target=state.place,
            wrist=None if wrist is None else brake_wrist(wrist, turns.usual.brake),
            unsound_ns=began_ns,
            is_latched=state.is_latched or (is_safe and limits.latch),
        )

    def _while_sound(
        self, state: SafetyState, t_ns: int, seen: Seen, newest_ns: int, fresh_ns: int | None, broke: bool
    ) -> SafetyState:
        """Return the state after a tick whose estimate may drive the arm."""
        limits, place, wrist = self.limits, state.place, seen.wrist
        assert seen.estimate_m is not None, "without an estimate there is a fault"
        target = within(seen.estimate_m, self.centre_m, limits.workspace_m)
        if place is None:
            return state._replace(
                mode="tracking", cause="first", place=target, motion=Motion(has_met=True), target=target,
                wrist=state.wrist if wrist is None else begin(wrist), newest_ns=newest_ns, fresh_ns=fresh_ns,
                unsound_ns=None,
            )  # fmt: skip
        mode, cause, resumed_ns = state.mode, state.cause, state.resumed_ns
        if mode != "resuming" and mode != "tracking":
            mode, cause, resumed_ns = "resuming", "sound", t_ns
        elif broke:
            mode, cause, resumed_ns = "resuming", "break", t_ns
        elif (
            mode == "resuming"
            and resumed_ns is not None
            and t_ns - resumed_ns >= limits.resume_ns
            and dist(place, target) <= limits.near_m
        ):
            mode, cause = "tracking", "met"
        # After a break an estimator's corrections are large for a while.
        is_slow = mode == "resuming" or self._is_cautious(resumed_ns, t_ns)
        pace, most_corrected = limits.usual, limits.most_corrected_m
        if is_slow:
            is_fast_still = dist(state.motion.carried, STILL) > limits.slow.step
            pace, most_corrected = limits.held if is_fast_still else limits.slow, NO_CORRECTION
        moved = follow(minus(target, place), state.motion, pace, most_corrected, t_ns)
        there, motion = (target, moved.motion) if moved.meets else self._inside(place, moved)
        point = state.wrist if wrist is None else self._steered(state.wrist, wrist, is_slow, t_ns)
        return SafetyState(
            mode, cause, there, motion, target, point, newest_ns, fresh_ns, None, resumed_ns, False, state.is_latched
        )

    def _steered(self, point: WristPoint | None, target: WristPose, is_slow: bool, t_ns: int) -> WristPoint:
        """Return the wrist on its way to the estimate's: slowly after a break, until it has met it."""
        if point is None:
            return begin(target)
        turns = self.limits.wrist
        if not (is_slow or point.is_slow):
            return follow_wrist(point, target, turns.usual, turns.most_corrected, t_ns)
        found = follow_wrist(point._replace(is_slow=True), target, turns.slow, NO_CORRECTION, t_ns)
        return found._replace(is_slow=found.is_slow or is_slow)

    def _moved(self, state: SafetyState, moved: Moved) -> SafetyState:
        """Return the state after a movement of the place."""
        assert state.place is not None, "only a set point moves"
        place, motion = (state.target, moved.motion) if moved.meets else self._inside(state.place, moved)
        return state._replace(place=place, motion=motion)

    def _inside(self, place: Place, moved: Moved) -> tuple[Place, Motion]:
        """Return the place after a movement, and the motion; the border of the workspace ends it."""
        wanted = plus(place, moved.by)
        there = within(wanted, self.centre_m, self.limits.workspace_m)
        return there, moved.motion if there is wanted else moved.motion._replace(carried=minus(there, place))
