import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tis.patient_side.learned.inputs import LAGS, N_FINE, filled, stride_of, window_before, window_of_rows
from tis.patient_side.model_fields import Floats
from tis.patient_side.playout import SourceBuffer

N = 360


def movement(seed: int) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(N, 3)).cumsum(axis=0) * 1e-3, rng.normal(size=N)


@given(seed=st.integers(0, 1000), now=st.integers(2, N - 1), p_lost=st.floats(0, 0.9), stride=st.sampled_from([1, 3]))
def test_a_buffers_window_is_that_of_the_same_arrivals(seed: int, now: int, p_lost: float, stride: int) -> None:
    position_m, gripper_rad = movement(seed)
    rng = np.random.default_rng(seed)
    arrival = np.arange(float(N)) + np.where(rng.random(N) < p_lost, np.inf, rng.uniform(0, 20, N))
    buffer = SourceBuffer(4096)
    for i in np.argsort(arrival).tolist():
        if arrival[i] <= now:
            buffer.add(i, position_m[i], float(gripper_rad[i]))
    if buffer.newest < 0:
        return
    newest = buffer.newest
    found = window_before(newest, stride, buffer.get, buffer.gripper_rad)
    rows = window_of_rows(
        position_m, gripper_rad, arrival, np.array([newest], dtype=np.int64), np.array([float(now)]), stride
    )
    assert np.array_equal(found.present, rows.present)
    np.testing.assert_allclose(found.way_m, rows.way_m, atol=1e-15)
    np.testing.assert_allclose(found.gripper_rad, rows.gripper_rad, atol=1e-12)


def test_missing_samples_are_interpolated_as_numpy_does() -> None:
    rng = np.random.default_rng(3)
    present = rng.random((5, len(LAGS))) < 0.3
    present[:, 0] = True
    way_m, angle = rng.normal(size=(5, len(LAGS), 3)), rng.normal(size=(5, len(LAGS)))
    found = filled(way_m * present[:, :, None], angle * present, present)
    for row in range(5):
        known = np.flatnonzero(present[row])
        for axis in range(3):
            expected = np.interp(LAGS, LAGS[known], way_m[row, known, axis])
            np.testing.assert_allclose(found.way_m[row, :, axis], expected, atol=1e-12)
        np.testing.assert_allclose(
            found.gripper_rad[row], np.interp(LAGS, LAGS[known], angle[row, known]), atol=1e-12
        )


def test_nothing_before_the_first_sample_moves() -> None:
    found = window_before(2, 1, {0: np.ones(3), 1: np.ones(3), 2: np.zeros(3)}.get, lambda _: None)
    assert found.present[0, :3].all()
    assert not found.present[0, 3:].any()
    assert np.array_equal(found.way_m[0, 1:], np.ones((len(LAGS) - 1, 3)))
    assert not found.gripper_rad.any()


def test_a_step_is_a_thirtieth_of_a_second_or_a_sample() -> None:
    assert [stride_of(rate) for rate in (10, 30, 60, 1000)] == [1, 1, 2, 33]
    assert LAGS[N_FINE] == N_FINE
