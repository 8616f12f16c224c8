"""Properties that every estimator has: it sees what has arrived by the tick, and not in which order.

But for those that go by what has arrived last.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patient_side.arm_models import (
    LOST,
    RATE_HZ,
    Streams,
    arm_model,
    delayed,
    play,
    positions,
    random_command,
    random_noise,
    random_space,
    simulate,
    tick_ns,
)
from tests.patient_side.filters.test_correction import correction
from tis.common.estimators import ESTIMATORS
from tis.common.units import sample_instant_ns
from tis.patient_side.estimators.builders import build_estimator
from tis.patient_side.linear_system import Array
from tis.patient_side.statespace import ArmModel

N = 40
BY_LAST_ARRIVAL: list[str] = ["paper", "paper_as_printed", "hold_last_arrived"]
EACH = pytest.mark.parametrize("name", ESTIMATORS)
BY_SOURCE_TIME = pytest.mark.parametrize("name", [n for n in ESTIMATORS if n not in BY_LAST_ARRIVAL])


def random_model(rng: np.random.Generator) -> ArmModel:
    n = int(rng.integers(0, 3))
    model = arm_model(random_space(rng, n), random_noise(rng, n, 1e-4, 1e-5))
    assert model.innovations is not None
    of_movement = correction(int(rng.integers(1000)))
    return replace(model, innovations=replace(model.innovations, correction=of_movement))


def random_streams(model: ArmModel, rng: np.random.Generator) -> Streams:
    u = random_command(rng, N, 0.9, 1e-4)

    def arrivals() -> list[int]:
        late_ns = rng.integers(0, 400_000_000, N)
        lost = rng.random(N) < 0.2
        return [LOST if lost[i] else sample_instant_ns(i, RATE_HZ) + int(late_ns[i]) for i in range(N)]

    return Streams(u, simulate(model, u, rng), arrivals(), arrivals(), rng.normal(size=N))


@EACH
@given(seed=st.integers(0, 10_000), k=st.integers(0, N - 1))
@settings(max_examples=15, deadline=None)
def test_what_arrives_after_a_tick_does_not_change_it(name: str, seed: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    model = random_model(rng)
    streams = random_streams(model, rng)

    def later_ones_moved(samples: Array, arrivals_ns: Sequence[int]) -> Array:
        later = np.array(arrivals_ns) > tick_ns(k)
        return np.asarray(samples + np.outer(later, rng.normal(size=3)))

    moved = replace(
        streams,
        u=later_ones_moved(streams.u, streams.u_arrival_ns),
        y=later_ones_moved(streams.y, streams.y_arrival_ns),
        gripper_rad=np.asarray(streams.gripper_rad) + (np.array(streams.y_arrival_ns) > tick_ns(k)),
    )
    estimator = build_estimator(name, model)
    before, after = play(estimator, streams)[: k + 1], play(estimator, moved)[: k + 1]
    assert np.array_equal(positions(before), positions(after), equal_nan=True)
    for one, other in zip(before, after, strict=True):
        assert (one.covariance_m2 is None) == (other.covariance_m2 is None)
        if one.covariance_m2 is not None:
            assert np.array_equal(one.covariance_m2, np.asarray(other.covariance_m2))


@EACH
def test_what_has_arrived_does_change_it(name: str) -> None:
    rng = np.random.default_rng(1)
    model = random_model(rng)
    streams = Streams(rng.normal(size=(N, 3)), rng.normal(size=(N, 3)), delayed(N, 0), delayed(N, 0))
    moved = replace(streams, u=streams.u.copy(), y=streams.y.copy())
    moved.u[-1] += 0.1
    moved.y[-1] += 0.1
    estimator = build_estimator(name, model)
    before, after = positions(play(estimator, streams)), positions(play(estimator, moved))
    assert np.array_equal(before[:-1], after[:-1])
    assert np.all(before[-1] != after[-1])


@BY_SOURCE_TIME
@given(seed=st.integers(0, 10_000))
@settings(max_examples=10, deadline=None)
def test_order_of_arrival_within_a_tick_leaves_no_trace(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = random_model(rng)
    streams = random_streams(model, rng)
    estimator = build_estimator(name, model)
    first, turned = play(estimator, streams), play(estimator, streams, last_first=True)
    assert np.array_equal(positions(first), positions(turned), equal_nan=True)


@pytest.mark.parametrize("name", BY_LAST_ARRIVAL)
def test_those_that_look_at_no_source_stamp_go_by_the_last_arrival(name: str) -> None:
    rng = np.random.default_rng(1)
    model = arm_model(random_space(rng, 2), random_noise(rng, 2, 1e-4, 1e-5))
    two_at_a_time = [tick_ns(i | 1) - i % 2 for i in range(N)]
    streams = Streams(rng.normal(size=(N, 3)), rng.normal(size=(N, 3)), delayed(N, 0), two_at_a_time)
    estimator = build_estimator(name, model)
    first, turned = positions(play(estimator, streams)), positions(play(estimator, streams, last_first=True))
    assert np.all(first[3:] != turned[3:])
