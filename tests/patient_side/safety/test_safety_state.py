"""Safety states by literal times at 30 Hz, and properties over arbitrary data."""

from collections.abc import Iterator
from itertools import pairwise
from math import dist

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.scenario.safety import Safety
from common.units import sample_instant_ns
from patient_side.safety.safety_state import SafetyFilter, SafetyState, Seen, limits_of
from patient_side.safety.set_point import STILL, Bounds, Place, minus, within

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
    seen = {k: _fresh(k, 0.005 * k) for k in range(200)}
    states = [*_run(_filter(resume_acceleration_m_s2=1.0), seen, 200, {60: True, 90: False})]
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
    assert places[-1] - places[0] == pytest.approx(0.4, rel=0.1)


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
        step_m, last_m = dist(state.place, before.place), dist(before.step, STILL)
        is_cautious = state.resumed_ns is not None and t_ns - state.resumed_ns < limits.cautious_ns
        is_slow = state.mode != "tracking" or is_cautious
        spent, usual, refill = before.spent, limits.usual, limits.refill
        left = Bounds(
            max(0.0, usual.step_m - max(0.0, spent.step_m - refill.step_m)),
            max(0.0, usual.change_m - max(0.0, spent.change_m - refill.change_m)),
        )
        bounds = limits.slow if is_slow else left
        assert step_m <= max(bounds.step_m, last_m) + 1e-9
        if state.mode != "tracking" and last_m <= limits.slow.step_m:
            assert step_m <= limits.slow.step_m + 1e-9
        if is_stopped:
            assert state.mode in ("slow_stop", "safe")
            assert step_m <= max(0.0, last_m - limits.slow.change_m) + 1e-9
        if state.mode in ("tracking", "resuming"):
            assert estimate_m is not None
            assert newest_ns is not None
            assert t_ns - newest_ns <= limits.hold_age_ns
            assert std_m is None or std_m <= limits.std_m
        if state.mode == "tracking" and estimate_m is not None:
            target = within(estimate_m, STILL, limits.workspace_m)
            way = minus(target, before.place)
            if dist(way, STILL) <= bounds.step_m and dist(way, before.step) <= bounds.change_m:
                assert state.place == target
        if state.mode == "safe":
            assert step_m <= 1e-9


def test_a_new_process_holds_the_arm_where_it_was_left_and_resumes_slowly() -> None:
    """The estimate is 50 mm away: a process that did not know the place would jump."""
    limits = limits_of(Safety(), 30)
    safety = SafetyFilter(limits, (0.0, 0.0, 0.0))
    state = safety.resumed(((0.1, 0.0, 0.0), "tracking"), is_stopped=False)
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
    assert latching.resumed(((0.1, 0.0, 0.0), "safe"), is_stopped=False).is_latched
    assert not latching.resumed(((0.1, 0.0, 0.0), "hold"), is_stopped=False).is_latched
