"""Safety states by literal times at 30 Hz, and properties over arbitrary data."""

from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from math import degrees, dist, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patient_side.safety.worst_case import overshot, run_on, search
from tis.common.scenario.safety import Safety
from tis.common.units import sample_instant_ns
from tis.common.vector import minus
from tis.patient_side.rotations import Quaternion, turn_to
from tis.patient_side.safety.limits import limits_of
from tis.patient_side.safety.safety_state import Left, SafetyFilter, SafetyState, Seen
from tis.patient_side.safety.set_point import STILL, Place, WristPose, within

_RATE_HZ = 30
_S = 1_000_000_000


def _filter(rate_hz: int = _RATE_HZ, **fields: float) -> SafetyFilter:
    return SafetyFilter(limits_of(Safety.model_validate(fields), rate_hz), STILL)


def _instants(n: int, rate_hz: int = _RATE_HZ) -> list[int]:
    return [sample_instant_ns(k, rate_hz) for k in range(n)]


def _run(
    safety: SafetyFilter, seen: dict[int, Seen], n: int, stops: dict[int, bool] | None = None
) -> Iterator[tuple[int, SafetyState]]:
    """Yield each tick's instant and state; ``seen`` and ``stops`` hold what changes at a tick."""
    state, now = SafetyState(), Seen(None, None, None)
    for k, t_ns in enumerate(_instants(n)):
        if stops and k in stops:
            state = safety.stop(state, stops[k])
        now = seen.get(k, now)
        state = safety.step(state, t_ns, now)
        yield t_ns, state


def _fresh(k: int, x_m: float, std_m: float | None = 0.001) -> Seen:
    return Seen(sample_instant_ns(max(k - 2, 0), _RATE_HZ), (x_m, 0.0, 0.0), std_m)


def _modes(states: list[tuple[int, SafetyState]]) -> list[tuple[float, str, str]]:
    """Return the changes of the state: instant in s, state and cause."""
    found: list[tuple[float, str, str]] = [(round(states[0][0] / _S, 2), states[0][1].mode, states[0][1].cause)]
    for (_, one), (t_ns, two) in pairwise(states):
        if two.mode != one.mode:
            found.append((round(t_ns / _S, 2), two.mode, two.cause))
    return found


def test_in_tracking_the_set_point_is_the_estimate_bit_for_bit() -> None:
    seen = {k: _fresh(k, 0.001 * (k % 7)) for k in range(100)}
    for k, (_, state) in enumerate(_run(_filter(), seen, 100)):
        assert (state.mode, state.place) == ("tracking", seen[k].estimate_m)


def test_before_the_first_estimate_nothing_is_driven() -> None:
    states = [*_run(_filter(), {3: _fresh(3, 0.2)}, 5)]
    assert [state.place for _, state in states] == [None] * 3 + [(0.2, 0.0, 0.0)] * 2
    assert _modes(states) == [(0.0, "safe", "no_estimate"), (0.1, "tracking", "first")]


def test_old_data_lead_through_hold_and_slow_stop_to_safe() -> None:
    """The newest sample is of 1 s; the limits are 1.5, 3 and 5 s of age."""
    states = [*_run(_filter(), {k: _fresh(k, 0.001 * k) for k in range(33)}, 200)]
    assert _modes(states) == [
        (0.0, "tracking", "first"),
        (2.53, "hold", "age"),
        (4.0, "slow_stop", "age"),
        (6.0, "safe", "age"),
    ]
    assert states[-1][1].place == states[80][1].place == (0.032, 0.0, 0.0)


def test_what_was_uncertain_for_long_holds_stops_and_is_safe_too() -> None:
    seen = {k: _fresh(k, 0.01, 0.5 if k >= 30 else 0.001) for k in range(200)}
    assert _modes([*_run(_filter(), seen, 200)]) == [
        (0.0, "tracking", "first"),
        (1.0, "hold", "uncertainty"),
        (2.5, "slow_stop", "uncertainty"),
        (4.5, "safe", "uncertainty"),
    ]


def test_estimates_beyond_the_horizon_are_not_followed() -> None:
    seen = {k: _fresh(k, 0.0) for k in range(30)} | {
        k: Seen(27 * _S // 30, (0.5, 0.0, 0.0), 0.001) for k in range(80, 120)
    }
    states = [*_run(_filter(), seen, 120)]
    assert all(state.place == STILL for _, state in states)


def test_after_a_break_the_way_back_is_slow_until_the_estimate_is_met() -> None:
    seen = {k: _fresh(k, 0.0) for k in range(30)} | {k: _fresh(k, 0.060) for k in range(50, 120)}
    states = [*_run(_filter(), seen, 120)]
    assert _modes(states) == [
        (0.0, "tracking", "first"),
        (1.67, "resuming", "break"),
        (2.67, "tracking", "met"),
    ]
    steps_mm = [1e3 * dist(two.place or STILL, one.place or STILL) for (_, one), (_, two) in pairwise(states)]
    assert [round(step, 6) for step in steps_mm[48:58]] == [0, *[8.0] * 7, 4.0, 0]


def test_a_gap_as_long_as_the_limit_is_no_break() -> None:
    gap = {k: _fresh(k, 0.0) for k in range(30)} | {k: _fresh(k, 0.060) for k in range(41, 60)}
    assert _modes([*_run(_filter(), gap, 60)]) == [(0.0, "tracking", "first")]


def test_an_emergency_stop_brakes_at_once_and_lasts_until_its_release() -> None:
    """By the acceleration of tracking, here 1 m/s^2."""
    seen = {k: _fresh(k, 0.005 * k) for k in range(200)}
    safety = _filter(acceleration_m_s2=1.0, resume_acceleration_m_s2=1.0, correction_mm=0.0)
    states = [*_run(safety, seen, 200, {60: True, 90: False})]
    assert _modes(states)[1:4] == [
        (2.0, "slow_stop", "emergency_stop"),
        (2.13, "safe", "emergency_stop"),
        (3.0, "resuming", "sound"),
    ]
    steps = [dist(two.place or STILL, one.place or STILL) for (_, one), (_, two) in pairwise(states)]
    change = 1.0 / 30**2
    assert all(b <= a - change + 1e-9 or b == 0 for a, b in pairwise(steps[58:70]) if a > change)
    assert steps[66:89] == [0.0] * 23


def test_a_latched_arm_resumes_only_after_a_release() -> None:
    seen = {k: _fresh(k, 0.0) for k in range(30)} | {k: _fresh(k, 0.0) for k in range(300, 400)}
    states = [*_run(_filter(latch=True), seen, 400, {330: False})]
    assert states[320][1].mode == "safe"
    assert states[320][1].cause == "latched"
    assert _modes(states)[-1][:2] in ((11.0, "resuming"), (12.0, "tracking"))


def test_a_tick_after_missed_ones_moves_no_further_than_any_other() -> None:
    safety, state = _filter(), SafetyState()
    state = safety.step(state, 0, Seen(0, (0.0, 0.0, 0.0), 0.001))
    state = safety.step(state, 3 * _S, Seen(3 * _S, (0.3, 0.0, 0.0), 0.001))
    assert state.mode == "resuming"
    assert state.place is not None
    assert dist(state.place, STILL) == pytest.approx(0.008)


@pytest.mark.parametrize("rate_hz", [30, 100, 1000])
def test_over_a_tenth_of_a_second_an_arm_in_tracking_moves_no_faster_than_allowed(rate_hz: int) -> None:
    safety, state = _filter(rate_hz, speed_m_s=0.4, workspace_m=5.0), SafetyState()
    places = []
    for t_ns in _instants(rate_hz, rate_hz):
        state = safety.step(state, t_ns, Seen(t_ns, (3.0 * t_ns / _S, 0.0, 0.0), 0.001))
        assert state.place is not None
        places.append(state.place[0])
    window = rate_hz // 10
    farthest = max(b - a for a, b in zip(places, places[window:], strict=False))
    assert farthest <= 0.4 * (0.1 + max(0.033, 1 / rate_hz)) + 1e-9
    # what is kept for corrections does not serve a chase
    assert 0.27 <= places[-1] - places[0] <= 0.4


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"hold_age_ms": 3000}, "must ascend"),
        ({"resume_speed_m_s": 3}, "must not exceed speed_m_s"),
        ({"resume_acceleration_m_s2": 300}, "must not exceed acceleration_m_s2"),
    ],
)
def test_limits_that_contradict_each_other_are_refused(fields: dict[str, float], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        Safety.model_validate(fields)


def is_at_border(state: SafetyState) -> bool:
    """Tell whether the workspace of 1.5 m has ended the movement."""
    return state.place is not None and dist(state.place, STILL) >= 1.5 - 1e-9


_ESTIMATE = st.one_of(st.none(), st.tuples(*[st.floats(-3.0, 3.0)] * 3))
_STD = st.one_of(st.none(), st.floats(0.0, 1.0))
_TICK = st.tuples(
    st.integers(-2, 400),  # age of a fresher sample, in ticks; below 0: nothing new
    _ESTIMATE,
    _STD,
    st.sampled_from([None] * 8 + [True, False]),
)


@settings(max_examples=300)
@given(st.lists(_TICK, min_size=1, max_size=120), st.sampled_from([30, 1000]), st.booleans())
def test_whatever_arrives_the_set_point_stays_within_its_limits(
    ticks: list[tuple[int, Place | None, float | None, bool | None]], rate_hz: int, latch: bool
) -> None:
    safety = _filter(rate_hz, workspace_m=1.5, latch=latch)
    limits = safety.limits
    state, newest_ns, is_stopped = SafetyState(), None, False
    for t_ns, (age, estimate_m, std_m, stop) in zip(_instants(len(ticks), rate_hz), ticks, strict=True):
        if stop is not None:
            is_stopped, state = stop, safety.stop(state, stop)
        if age >= 0:
            newest_ns = max(newest_ns or 0, t_ns - age * _S // rate_hz)
        before, state = state, safety.step(state, t_ns, Seen(newest_ns, estimate_m, std_m))
        if state.place is None:
            assert state.mode == "safe"
            continue
        # the workspace, the speed, and the states that follow no estimate
        assert dist(state.place, STILL) <= limits.workspace_m + 1e-9
        if before.place is None:
            continue
        step_m, last_m = dist(state.place, before.place), dist(before.motion.carried, STILL)
        carried_m = dist(state.motion.carried, STILL)
        is_cautious = state.resumed_ns is not None and t_ns - state.resumed_ns < limits.cautious_ns
        is_slow = state.mode != "tracking" or is_cautious
        # what is carried on has the limits of a movement; a correction is more, once
        assert carried_m <= max(limits.usual.step, limits.slow.step) + 1e-9
        assert dist(state.motion.carried, before.motion.carried) <= limits.usual.change + 1e-9 or is_at_border(state)
        corrected_m = dist(minus(state.place, before.place), state.motion.carried)
        assert corrected_m <= (1e-9 if is_slow else limits.most_corrected_m + 1e-9)
        if state.mode != "tracking" and last_m <= limits.slow.step:
            assert step_m <= limits.slow.step + 1e-9
        if is_stopped:
            assert state.mode in ("slow_stop", "safe")
            assert step_m <= max(0.0, last_m - limits.usual.change) + 1e-9
        if state.mode in ("tracking", "resuming"):
            assert estimate_m is not None
            assert newest_ns is not None
            assert t_ns - newest_ns <= limits.hold_age_ns
            assert std_m is None or std_m <= limits.std_m
        if state.mode == "tracking" and estimate_m is not None:
            target = within(estimate_m, STILL, limits.workspace_m)
            pace, way = limits.slow if is_slow else limits.usual, minus(target, before.place)
            near = dist(way, before.motion.carried) <= pace.change and dist(way, STILL) <= pace.step
            if before.motion.has_met and near and last_m <= pace.step:
                assert state.place == target
        if state.mode == "safe":
            assert step_m <= 1e-9


def test_a_new_process_holds_the_arm_where_it_was_left_and_resumes_slowly() -> None:
    """The estimate is 50 mm away: a process that did not know the place would jump."""
    limits = limits_of(Safety(), 30)
    safety = SafetyFilter(limits, (0.0, 0.0, 0.0))
    state = safety.resumed(Left((0.1, 0.0, 0.0), "tracking"), is_stopped=False)
    places = []
    for k in range(1, 120):
        t_ns = sample_instant_ns(k, 30)
        seen = Seen(None, None, None) if k < 10 else Seen(t_ns - 20_000_000, (0.15, 0.0, 0.0), 0.001)
        state = safety.step(state, t_ns, seen)
        assert state.place is not None
        places.append(state.place[0])
    assert places[:9] == [0.1] * 9
    assert max(b - a for a, b in pairwise(places)) <= 0.00801
    assert places[-1] == pytest.approx(0.15)
    assert safety.resumed(None, is_stopped=True) == SafetyState(is_stopped=True)
    latching = SafetyFilter(limits._replace(latch=True), (0.0, 0.0, 0.0))
    assert latching.resumed(Left((0.1, 0.0, 0.0), "safe"), is_stopped=False).is_latched
    assert not latching.resumed(Left((0.1, 0.0, 0.0), "hold"), is_stopped=False).is_latched


def test_limits_that_are_not_given_follow_from_training_rows() -> None:
    usual = limits_of(Safety(), 50)
    assert usual == limits_of(Safety(workspace_m=1.0, speed_m_s=2.0, acceleration_m_s2=200.0), 50)
    assert limits_of(Safety(), 50, (0.2, 0.4, 30.0)) == usual
    assert limits_of(Safety(), 50, (200.0, 300.0, 900.0)) == usual  # millimetres
    assert limits_of(Safety(), 50, (3.0, 2.0, 80.0)) == limits_of(
        Safety(
            workspace_m=12.0,
            speed_m_s=8.0,
            acceleration_m_s2=320.0,
            resume_speed_m_s=3.0,
            resume_acceleration_m_s2=125.0,
        ),
        50,
    )
    given = Safety(workspace_m=0.5, speed_m_s=1.0, acceleration_m_s2=20.0)
    assert limits_of(given, 50, (3.0, 2.0, 80.0)) == limits_of(given, 50)


def _tracking(
    rate_hz: int, jump_m: float, after: str = "", jump_deg: float = 0.0, **fields: float
) -> list[SafetyState]:
    """Return the states from a jump of the estimate in tracking on; ``after`` a tick: "stop" or "uncertain"."""
    safety, state, found = _filter(rate_hz, workspace_m=5.0, **fields), SafetyState(), list[SafetyState]()
    for k, t_ns in enumerate(_instants(rate_hz // 2, rate_hz)):
        jumped, failed = k >= 10, k >= 11
        if after == "stop" and k == 11:
            state = safety.stop(state, True)
        std_m = 1.0 if after == "uncertain" and failed else 0.001
        wrist = WristPose(_about_z(jump_deg if jumped else 0.0), 0.02 * jump_deg if jumped else 0.0)
        state = safety.step(state, t_ns, Seen(t_ns, (jump_m if jumped else 0.0, 0.0, 0.0), std_m, wrist))
        if jumped:
            found.append(state)
    return found


def _about_z(angle_deg: float) -> Quaternion:
    half = np.radians(angle_deg) / 2
    return (0.0, 0.0, float(np.sin(half)), float(np.cos(half)))


def _x_m(states: list[SafetyState]) -> list[float]:
    assert all(state.place is not None for state in states)
    return [state.place[0] for state in states if state.place is not None]


@pytest.mark.parametrize(("rate_hz", "jump_mm"), [(1000, 10), (1000, 5), (200, 30), (30, 60), (5000, 10), (100, 40)])
def test_a_jump_of_the_estimate_is_never_overshot(rate_hz: int, jump_mm: float) -> None:
    places_m = _x_m(_tracking(rate_hz, jump_mm / 1000))
    assert max(places_m) == places_m[-1] == jump_mm / 1000
    assert all(a <= b for a, b in pairwise(places_m))


@pytest.mark.parametrize("after", ["stop", "uncertain"])
@pytest.mark.parametrize(("rate_hz", "jump_mm"), [(1000, 2), (1000, 5), (200, 30), (5000, 5)])
def test_one_tick_after_a_jump_a_stop_stops(rate_hz: int, jump_mm: float, after: str) -> None:
    """Of the jump only what is carried on goes on: the acceleration of one tick, 0.2 mm at 1 kHz.

    A hold goes on to the last sound estimate, slowly, and not beyond.
    """
    places_m = _x_m(_tracking(rate_hz, jump_mm / 1000, after))
    carried_m = 200.0 / rate_hz**2
    allowed_m = places_m[0] + carried_m**2 / (2 * carried_m)
    assert places_m[0] <= jump_mm / 1000
    assert max(places_m) <= (allowed_m if after == "stop" else max(allowed_m, jump_mm / 1000)) + 1e-9


def test_the_way_after_a_stop_is_that_of_the_speed() -> None:
    """At 1.5 m/s and 200 m/s^2: 5.6 mm, in 7.5 ms."""
    safety, state, places = _filter(1000, workspace_m=5.0), SafetyState(), []
    for k, t_ns in enumerate(_instants(1000, 1000)):
        if k == 500:
            state = safety.stop(state, True)
        state = safety.step(state, t_ns, Seen(t_ns, (0.0015 * min(k, 500), 0.0, 0.0), 0.001))
        assert state.place is not None
        places.append(state.place[0])
    assert places[499] == 0.0015 * 499
    assert places[-1] - places[499] == pytest.approx(1.5**2 / 400 - 0.0015 / 2, abs=1e-4)
    assert places[508] == places[-1]
    assert safety.limits.run_out_m <= 0.010


def test_a_turned_estimate_is_followed_within_the_speed_of_turning() -> None:
    """180 degrees and a gripper 206 degrees off: at 30 Hz 80 degrees a tick, and met without overshoot."""
    states = _tracking(30, 0.0, jump_deg=179.0)
    wrists = [state.wrist.at for state in states if state.wrist is not None]
    angles = [degrees(dist(turn_to(_about_z(0.0), at.orientation), STILL)) for at in wrists]
    assert angles[0] < 80.0
    assert angles[-1] == pytest.approx(179.0)
    assert max(degrees(abs(b.gripper_rad - a.gripper_rad)) for a, b in pairwise(wrists)) <= 80.0
    assert max(at.gripper_rad for at in wrists) == wrists[-1].gripper_rad == 0.02 * 179.0


def test_samples_in_conflict_hold_the_arm() -> None:
    seen = {k: _fresh(k, 0.001 * k)._replace(in_conflict=30 <= k < 45) for k in range(120)}
    states = [*_run(_filter(), seen, 120)]
    assert _modes(states)[1:3] == [(1.0, "hold", "conflict"), (1.5, "resuming", "sound")]
    assert states[40][1].place == (0.029, 0.0, 0.0)


@pytest.mark.parametrize("rate_hz", [5, 30, 200, 1000])
def test_a_search_for_the_worst_finds_nothing_beyond_the_bounds(rate_hz: int) -> None:
    for part in range(3):
        over = search(rate_hz, 6, partial(overshot, part=part))
        assert overshot(over, part) <= 1e-6
        stopped = search(rate_hz, 6, partial(run_on, part=part))
        assert run_on(stopped, part) <= 1e-6
    assert search(rate_hz, 6, lambda one: one.moved).moved <= 2.0 * max(0.033, 1 / rate_hz) + 1e-9


@pytest.mark.parametrize(("trained", "ends"), [(None, "resuming"), ((10.0, 8.0, 6.4), "tracking")])
def test_a_fast_arm_of_a_table_resumes_as_its_training_rows_need(
    trained: tuple[float, float, float] | None, ends: str
) -> None:
    """A drone at up to 8 m/s, away for 2 s: at the usual 0.24 m/s it is never met."""
    given = {} if trained else {"speed_m_s": 40.0, "workspace_m": 50.0}
    safety = SafetyFilter(limits_of(Safety.model_validate(given), _RATE_HZ, trained), STILL)
    sound = {k: _fresh(k, 10.0 * sin(0.8 * k / _RATE_HZ)) for k in (*range(30), *range(90, 500))}
    *_, (_, state) = _run(safety, sound, 500)
    assert state.mode == ends


def test_an_arm_within_the_usual_limits_resumes_as_usual() -> None:
    usual = limits_of(Safety(), _RATE_HZ)
    assert limits_of(Safety(), _RATE_HZ, (0.2, 0.45, 9.0)) == usual
    assert limits_of(Safety(resume_speed_m_s=0.1), _RATE_HZ, (20.0, 10.0, 20.0)).near_m < usual.near_m


def test_modes_that_change_all_the_time_free_no_corrections() -> None:
    """Where resuming and caution last no time, an adversary toggles the deviation: 66 mm in 33 ms stay the bound."""
    safety = _filter(1000, resume_ms=0, cautious_ms=0, correction_mm=100, resume_speed_m_s=2, workspace_m=100)
    state, places = SafetyState(), []
    for k, t_ns in enumerate(_instants(500, 1000)):
        target = 0.03 * (k // 3)
        state = safety.step(state, t_ns, Seen(t_ns, (target, 0.0, 0.0), 1.0 if k % 3 == 1 else 0.001))
        if state.place is not None:
            places.append(state.place[0])
    assert max(b - a for a, b in zip(places, places[33:], strict=False)) <= 0.066 + 1e-9


@pytest.mark.parametrize("field", ["speed_m_s", "acceleration_m_s2", "turn_acceleration_deg_s2", "resume_speed_m_s"])
@pytest.mark.parametrize("value", [0.0, 1e-300, 5e-324, 1e300])
def test_limits_whose_steps_cannot_be_computed_are_refused(field: str, value: float) -> None:
    with pytest.raises(ValueError, match="than or equal to"):
        Safety.model_validate({field: value})
