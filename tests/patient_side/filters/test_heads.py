"""Inputs of heads against plain loops, what their forecasts add, and samples that are missing."""

from dataclasses import replace
from math import cos, sin, tanh

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.patient_side.arm_models import RATE_HZ
from tests.patient_side.filters.test_correction import KNOTS, at_lag, correction, filter_of, some_mean
from tis.common.units import NS_PER_S
from tis.patient_side.filters.correction import movements
from tis.patient_side.filters.heads import Heads, head_inputs, looked_back, looked_back_in, wrist_lags
from tis.patient_side.filters.innovations_filter import AXES
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import N_HEAD_INPUTS, Correction, Head
from tis.patient_side.playout import Playout, SourceBuffer

LAGS = wrist_lags(RATE_HZ)


def heads(seed: int = 0, n_features: int = 7) -> list[Head]:
    rng = np.random.default_rng(seed)
    return [
        Head(rng.normal(size=n), rng.uniform(0.5, 2, n), 0.3 * rng.normal(size=(len(KNOTS), AXES, n_features)))
        for n in N_HEAD_INPUTS
    ]


def with_heads(seed: int = 0) -> Correction:
    return replace(correction(seed), heads=heads(seed))


def wrists(n: int, seed: int = 0) -> Array:
    """Orientations that wander, of either sign, and gripper angles (n, 5)."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(np.cumsum(0.05 * rng.normal(size=(n, 3)), axis=0)).as_quat()
    return np.column_stack([turns * rng.choice([-1, 1], n)[:, None], rng.normal(-0.4, 0.5, n)])


def test_inputs_are_numbers_in_both_frames() -> None:
    model, filter_ = with_heads(), filter_of()
    means = np.stack([some_mean(filter_, seed).ravel() for seed in range(4)])
    moved = movements(filter_, model.span, means)
    back = looked_back(wrists(90), 86, RATE_HZ)
    activity = np.array([1.0, 0.3, 2.0, 1.0])
    movement, base = head_inputs(model, moved, activity, back)
    assert (movement.values.shape[1], base.values.shape[1]) == N_HEAD_INPUTS
    for k in range(4):
        unit = model.usual_m * activity[k] ** 0.5
        v = moved.parts[k, 1:4].sum(axis=0)
        along = v / np.linalg.norm(v)
        upright = np.array([0, 0, 1]) - along[2] * along
        axes = np.array(
            [along, upright / np.linalg.norm(upright), np.cross(along, upright / np.linalg.norm(upright))]
        )
        assert movement.axes is not None
        assert movement.axes[k] == pytest.approx(axes)
        # Vectors of the path, in one frame and in the other.
        for i, way in enumerate(moved.ways[k]):
            at = slice(3 * (3 + i), 3 * (4 + i))
            assert base.values[k, at] == pytest.approx(np.tanh(way / unit / model.widths[i]))
            assert movement.values[k, at] == pytest.approx(np.tanh(axes @ way / unit / model.widths[i]))
        # The tool: SciPy's rotations.
        turns = Rotation.from_quat(back[k, :, :4])
        matrix = turns[0].as_matrix()
        tool = base.values[k, 34:40]
        assert sorted(tool) == pytest.approx(sorted([*matrix[:, 2], *matrix[:, 0]]))
        for i in range(1, len(LAGS)):
            angle = (turns[0] * turns[i].inv()).as_rotvec()
            size = np.linalg.norm(angle)
            chord = angle * (2 * sin(size / 2) / size) if size else angle
            large = 1.1 * (0.0, 1 / 30, 0.1, 0.2, 1 / 3, 2 / 3)[i] ** 0.5
            at = slice(40 + 3 * (i - 1), 40 + 3 * i)
            assert base.values[k, at] == pytest.approx(np.tanh(chord / large), abs=1e-12)
            changed = tanh((back[k, 0, 4] - back[k, i, 4]) / (1.2 * model.gripper_spread_rad * large / 1.1))
            assert movement.values[k, 28 + i] == pytest.approx(changed)


def test_at_rest_and_without_wrists_inputs_are_finite() -> None:
    model, filter_ = with_heads(), filter_of()
    moved = movements(filter_, model.span, np.zeros((1, some_mean(filter_, 0).size)))
    unknown = head_inputs(model, moved, np.zeros(1), np.full((1, len(LAGS), 5), np.nan))
    for each, head in zip(unknown, model.heads, strict=True):
        known = each.known(head.centre)
        assert np.all(np.isfinite(known))
        assert np.array_equal(known[0, 55:], head.centre[55:])  # the way to another arm


@pytest.mark.parametrize("alike", [False, True])
def test_they_add_their_features_in_their_frames_to_the_forecast(alike: bool) -> None:
    model, filter_ = with_heads(), filter_of(alike=alike)
    found = Heads.of(model, filter_, RATE_HZ)
    assert found is not None
    mean, activity, track = some_mean(filter_, 3), 1.7, wrists(60)
    playout, other = Playout(RATE_HZ), SourceBuffer(100)
    playout.other_arm = other
    for k, each in enumerate(track):
        playout.arm.add(k, np.zeros(3), each[4], each[:4])
    other.add(57, np.array([0.1, 0.2, 0.3]))
    seen = found.seen(mean, activity, playout, 59)
    moved, back = movements(filter_, model.span, mean.reshape(1, -1)), looked_back(track, 59, RATE_HZ)
    inputs = head_inputs(model, moved, np.array([activity]), back, np.array([[0.1, 0.2, 0.3]]))
    for lag in (0.5, 1.0, 4.0, 6.5):
        expected = at_lag(model, filter_, lag).position(mean, activity, -0.3, (0j, 0.0))
        for head, drawn, each in zip(model.heads, found.drawn, inputs, strict=True):
            weights = np.array(
                [[np.interp(lag, [0.0, *KNOTS], [0.0, *column]) for column in row] for row in head.weights.T]
            ).T
            features = [cos(angle) for angle in drawn[:, :-1] @ each.known(head.centre)[0] + drawn[:, -1]]
            added = model.usual_m * activity**0.5 * weights @ features
            expected = expected + (added if each.axes is None else each.axes[0].T @ added)
        assert at_lag(model, filter_, lag).position(mean, activity, -0.3, (0j, 0.0), seen) == pytest.approx(expected)


def test_nothing_seen_is_the_forecast_without_them() -> None:
    filter_ = filter_of()
    mean = some_mean(filter_, 1)
    bare, headed = (at_lag(each, filter_, 3.0) for each in (correction(), with_heads()))
    expected = bare.position(mean, 1.0, None, (0j, 0.0))
    assert np.array_equal(headed.position(mean, 1.0, None, (0j, 0.0), ()), expected)
    assert Heads.of(correction(), filter_, RATE_HZ) is None


def test_a_missing_wrist_is_the_next_newer_one() -> None:
    track, buffer = wrists(60), SourceBuffer(100)
    lost = {59 - int(LAGS[2]), 59 - int(LAGS[3])}
    for k in set(range(60)) - lost:
        buffer.add(k, np.zeros(3), track[k, 4], track[k, :4])
    (found,) = looked_back_in(buffer, 59, LAGS)
    expected = track[59 - LAGS]
    expected[2:4] = expected[1]
    assert np.array_equal(found, expected)
    # As at the beginning of a run: nothing is older.
    (first,) = looked_back_in(buffer, 0, LAGS)
    assert np.array_equal(first, np.repeat(track[:1], len(LAGS), axis=0))


def test_lags_are_times() -> None:
    assert wrist_lags(30).tolist() == [0, 1, 3, 6, 10, 20]
    assert wrist_lags(1000)[-1] == round(2 / 3 * NS_PER_S / 1e6)
