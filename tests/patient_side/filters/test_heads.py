"""Inputs of heads against plain loops, what their forecasts add, and samples that are missing."""

import sys
from dataclasses import replace
from math import dist, exp, log, sin, tanh
from types import FrameType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.patient_side.arm_models import RATE_HZ
from tests.patient_side.filters.test_correction import KNOTS, at_lag, correction, filter_of, some_mean
from tis.common.units import NS_PER_S
from tis.patient_side.filters.correction import movements
from tis.patient_side.filters.heads import (
    Heads,
    Surroundings,
    head_inputs,
    lags,
)
from tis.patient_side.filters.innovations_filter import AXES
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import N_HEAD_INPUTS, Correction, Head
from tis.patient_side.playout import Playout, SourceBuffer

LAGS = lags((0.0, 1 / 30, 0.1, 0.2, 1 / 3, 2 / 3), RATE_HZ)


def heads(seed: int = 0, n_features: int = 7) -> list[Head]:
    rng = np.random.default_rng(seed)
    return [
        Head(
            rng.normal(size=n),
            rng.uniform(0.5, 2, n),
            0.3 * rng.normal(size=(len(KNOTS), AXES, n_features)),
            rng.uniform(-1, 1, (n_features, n)),
        )
        for n in N_HEAD_INPUTS
    ]


def with_heads(seed: int = 0) -> Correction:
    return replace(correction(seed), heads=heads(seed))


def wrists(n: int, seed: int = 0) -> Array:
    """Orientations that wander, of either sign, and gripper angles (n, 5)."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(np.cumsum(0.05 * rng.normal(size=(n, 3)), axis=0)).as_quat()
    return np.column_stack([turns * rng.choice([-1, 1], n)[:, None], rng.normal(-0.4, 0.5, n)])


def surroundings(n: int, seed: int = 0, others: Array | None = None) -> Surroundings:
    """Those of the last four rows of n."""
    if others is None:
        others = np.full((n, 4), np.nan)
    return Surroundings.of_rows(wrists(n, seed), others, n - 4, RATE_HZ)


def others_of(n: int) -> Array:
    rng = np.random.default_rng(9)
    return np.column_stack([0.1 + np.cumsum(1e-3 * rng.normal(size=(n, 3)), axis=0), rng.normal(-0.4, 0.5, n)])


def test_inputs_are_numbers_in_both_frames() -> None:
    model, filter_ = with_heads(), filter_of()
    means = np.stack([some_mean(filter_, seed).ravel() for seed in range(4)])
    moved = movements(filter_, model.span, means)
    track, others = wrists(150), others_of(150)
    activity = np.array([1.0, 0.3, 2.0, 1.0])
    (movement, base), frames = head_inputs(model, moved, activity, surroundings(150, others=others))
    assert (movement.shape[1], base.shape[1]) == N_HEAD_INPUTS
    for k in range(4):
        row = 146 + k
        unit = model.usual_m * activity[k] ** 0.5
        v = moved.parts[k, 1:4].sum(axis=0)
        along = v / np.linalg.norm(v)
        upright = np.array([0, 0, 1]) - along[2] * along
        upright /= np.linalg.norm(upright)
        axes = np.array([along, upright, np.cross(along, upright)])
        assert frames[k] == pytest.approx(axes, abs=1e-4)
        # Vectors of the path, in one frame and in the other.
        for i, way in enumerate(moved.ways[k]):
            at = slice(3 * (3 + i), 3 * (4 + i))
            assert base[k, at] == pytest.approx(np.tanh(way / unit / model.widths[i]))
            turned = movement[k, 7 + at.start : 7 + at.stop]
            assert turned == pytest.approx(np.tanh(axes @ way / unit / model.widths[i]), abs=1e-4)
        speed = np.linalg.norm(v) / unit * model.span / 2.0
        assert base[k, -1] == movement[k, 6] == pytest.approx(tanh(tanh(log(speed))))
        # The tool: SciPy's rotations.
        turns = [Rotation.from_quat(track[row - lag, :4]) for lag in LAGS]
        matrix = turns[0].as_matrix()
        assert sorted(np.arctanh(base[k, 27:33])) == pytest.approx(sorted([*matrix[:, 2] / 2, *matrix[:, 0] / 2]))
        for i, lag in enumerate((2, 4)):
            angle = (turns[0] * turns[lag].inv()).as_rotvec()
            size = np.linalg.norm(angle)
            large = 1.1 * (0.1, 1 / 3)[i] ** 0.5
            assert base[k, 42 + 3 * i : 45 + 3 * i] == pytest.approx(np.tanh(angle * sin(size) / size / large))
        # The other arm, and both grippers.
        assert base[k, 33:36] == pytest.approx(np.tanh(others[row, :3]))
        for i, lag in enumerate((RATE_HZ, 3 * RATE_HZ)):
            moved_m = others[row, :3] - others[row - lag, :3]
            assert base[k, 48 + 3 * i : 51 + 3 * i] == pytest.approx(np.tanh(moved_m / 0.03))
        for first, angles in ((37, others[:, 3]), (54, track[:, 4])):
            for i, lag_s in enumerate((1 / 30, 0.1, 0.2, 1 / 3, 2 / 3)):
                changed = (angles[row] - angles[row - LAGS[1 + i]]) / (1.2 * model.gripper_spread_rad * lag_s**0.5)
                assert base[k, first + i] == pytest.approx(tanh(changed))
        opened = (track[row, 4] - model.gripper_usual_rad) / model.gripper_spread_rad
        assert base[k, 59] == movement[k, 5] == pytest.approx(tanh(opened))


def test_at_rest_inputs_are_finite_but_for_what_is_unknown() -> None:
    model, filter_ = with_heads(), filter_of()
    moved = movements(filter_, model.span, np.zeros((4, some_mean(filter_, 0).size)))
    (movement, base), _ = head_inputs(model, moved, np.zeros(4), surroundings(90))
    assert np.all(np.isfinite(movement))
    assert np.isnan(base[0]).nonzero()[0].tolist() == [*range(33, 42), *range(48, 54)]


@pytest.mark.parametrize("alike", [False, True])
@pytest.mark.parametrize("is_known", [False, True])
def test_they_add_their_features_in_their_frames_to_the_forecast(alike: bool, is_known: bool) -> None:
    model, filter_ = with_heads(), filter_of(alike=alike)
    found = Heads.of(model, filter_, RATE_HZ)
    assert found is not None
    mean, activity, track, others = some_mean(filter_, 3), 1.7, wrists(150), others_of(150)
    playout, other = Playout(RATE_HZ), SourceBuffer(200)
    for k, each in enumerate(track):
        playout.arm.add(k, np.zeros(3), each[4], each[:4])
        other.add(k, others[k, :3], others[k, 3])
    if is_known:
        playout.other_arm = other
    seen = found.seen(mean, activity, playout, 149)
    moved = movements(filter_, model.span, np.tile(mean.reshape(1, -1), (4, 1)))
    around = surroundings(150, others=others if is_known else None)
    inputs, frames = head_inputs(model, moved, np.full(4, activity), around)
    for lag in (0.5, 1.0, 4.0, 6.5):
        expected = at_lag(model, filter_, lag).position(mean, activity, -0.3, (0j, 0.0))
        for i, (head, each) in enumerate(zip(model.heads, inputs, strict=True)):
            weights = np.array(
                [[np.interp(lag, [0.0, *KNOTS], [0.0, *column]) for column in row] for row in head.weights.T]
            ).T
            known = np.where(np.isnan(each[-1]), head.centre, each[-1])
            ways = [dist((known - head.centre) / head.deviation, place) for place in head.landmarks]
            features = [exp(-((way / (12.0, 14.0)[i]) ** 2) / 2.0) for way in ways]
            added = model.usual_m * activity**0.5 * weights @ features
            expected = expected + (frames[-1].T @ added if i == 0 else added)
        forecast = at_lag(model, filter_, lag).position(mean, activity, -0.3, (0j, 0.0), seen)
        assert forecast == pytest.approx(expected, abs=1e-8)


def test_a_sample_costs_few_calls() -> None:
    """Times are noise, but what is called is the same on every machine: 76 calls on CPython 3.11."""
    found = Heads.of(with_heads(), filter_of(), RATE_HZ)
    assert found is not None
    playout, other = Playout(RATE_HZ), SourceBuffer(200)
    playout.other_arm = other
    for k, each in enumerate(wrists(150)):
        playout.arm.add(k, np.zeros(3), each[4], each[:4])
        other.add(k, np.ones(3), each[4])
    mean, n_calls = some_mean(filter_of(), 3), 0

    def count(_frame: FrameType, event: str, _called: object) -> None:
        nonlocal n_calls
        n_calls += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        found.seen(mean, 1.0, playout, 149)
    finally:
        sys.setprofile(None)
    assert n_calls < 76


def test_nothing_seen_is_the_forecast_without_them() -> None:
    filter_ = filter_of()
    mean = some_mean(filter_, 1)
    bare, headed = (at_lag(each, filter_, 3.0) for each in (correction(), with_heads()))
    expected = bare.position(mean, 1.0, None, (0j, 0.0))
    assert np.array_equal(headed.position(mean, 1.0, None, (0j, 0.0), None), expected)
    assert Heads.of(correction(), filter_, RATE_HZ) is None


def test_a_missing_wrist_is_the_next_newer_one() -> None:
    track, buffer = wrists(60), SourceBuffer(100)
    lost = {59 - int(LAGS[2]), 59 - int(LAGS[3])}
    for k in set(range(60)) - lost:
        buffer.add(k, np.zeros(3), track[k, 4], track[k, :4])
    expected = track[59 - LAGS]
    expected[2:4] = expected[1]
    assert np.array_equal(buffer.wrists_before(59, LAGS.tolist()), expected)
    # As at the beginning of a run: nothing is older.
    assert np.array_equal(buffer.wrists_before(0, LAGS.tolist()), np.repeat(track[:1], len(LAGS), axis=0))


def test_what_is_missing_of_the_other_arm_is_looked_for_before() -> None:
    found = Heads.of(with_heads(), filter_of(), RATE_HZ)
    assert found is not None
    playout, other = Playout(RATE_HZ), SourceBuffer(200)
    playout.other_arm = other
    for k in range(100):
        playout.arm.add(k, np.array([1.0 * k, 0, 0]), 0.0)
    for k in (2, 60, 97):
        other.add(k, np.array([0, 1.0 * k, 0]), 0.1 * k)
    around = found._around(playout, 99)
    assert around.ways_m == [(-99, 97, 0), (-69, 60, 0), (-9, 2, 0)]
    assert around.other_rad[0] == pytest.approx(9.7)
    assert not np.any(np.isnan(around.other_rad))


def test_lags_are_times() -> None:
    assert LAGS.tolist() == [0, 1, 3, 6, 10, 20]
    assert lags((2 / 3,), 1000)[-1] == round(2 / 3 * NS_PER_S / 1e6)
