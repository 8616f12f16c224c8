from fractions import Fraction
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tis.common.metrics.tracking import (
    Array,
    Scorable,
    Score,
    angles_deg,
    error_vectors,
    orientation_at,
    ratio_to_hold,
    score,
    scored_ticks,
    truth_at,
)

NAN = float("nan")

# Four scored ticks. x moves 0 2 4 6 mm (mean 3, SST 9 + 1 + 1 + 9 = 20), y 0 0 0 4 (mean 1, SST 12), z stands still.
TRUTH = np.array([[0, 0, 5], [2, 0, 5], [4, 0, 5], [6, 4, 5]]) / 1000
# Off by 1 mm everywhere on x (SSE 4), by 3 mm once on y (9), by 2 mm twice on z (8): together 21.
ESTIMATE = np.array([[1, 0, 5], [3, 0, 7], [3, 0, 3], [7, 1, 5]]) / 1000
# Hold is 2 mm behind on x but for the first (SSE 12), 4 mm once on y (SSE 16): together 28.
HOLD = np.array([[0, 0, 5], [0, 0, 5], [2, 0, 5], [4, 0, 5]]) / 1000
ALL = np.ones(4, dtype=np.bool_)
RANGE = np.array([0.010, 0.005, 0.0])


def one(estimate_m: Array, hold_m: Array, truth_m: Array, scored: NDArray[np.bool_], range_m: Array) -> Score:
    """Return the score of a single hand."""
    return score(Scorable(estimate_m, hold_m, truth_m, scored, range_m))


def test_table_worked_by_hand() -> None:
    assert one(ESTIMATE, HOLD, TRUTH, ALL, RANGE) == {
        "r2_pct": [pytest.approx(100 * (1 - 4 / 20)), pytest.approx(100 * (1 - 9 / 12)), None],
        "nrmse_fit_pct": [
            pytest.approx(100 * (1 - (4 / 20) ** 0.5)),
            pytest.approx(100 * (1 - (9 / 12) ** 0.5)),
            None,
        ],
        "rmse_normalized": [pytest.approx(0.1), pytest.approx(0.3), None],
        "rmse_mm": [pytest.approx(1.0), pytest.approx(1.5), pytest.approx(2**0.5)],
        "max_mm": [pytest.approx(1), pytest.approx(3), pytest.approx(2)],
        "r2_3d_pct": pytest.approx(100 * (1 - 21 / 32)),
        "nrmse_fit_3d_pct": pytest.approx(100 * (1 - (21 / 32) ** 0.5)),
        "rmse_3d_mm": pytest.approx((21 / 4) ** 0.5),
        "max_3d_mm": pytest.approx(10**0.5),  # the last row: 1 mm on x, 3 on y
        "ratio_to_hold": pytest.approx((21 / 28) ** 0.5),
        "n_scored": 4,
        "n_missing": 0,
    }


def test_hold_against_itself_has_ratio_one() -> None:
    assert one(HOLD, HOLD, TRUTH, ALL, RANGE)["ratio_to_hold"] == 1.0


@pytest.mark.parametrize("gap", [NAN, float("inf")])
def test_a_missing_estimate_scores_as_holds_and_is_counted(gap: float) -> None:
    estimate = ESTIMATE.copy()
    estimate[3, 1] = gap  # one axis is enough: the whole position is hold's
    patched = ESTIMATE.copy()
    patched[3] = HOLD[3]
    result = one(estimate, HOLD, TRUTH, ALL, RANGE)
    assert result == {**one(patched, HOLD, TRUTH, ALL, RANGE), "n_missing": 1}


def test_unscored_ticks_change_nothing() -> None:
    far = np.full((2, 3), 9.0)
    rows = [np.vstack([far, part]) for part in (ESTIMATE, HOLD, TRUTH)]
    rows[2][0] = NAN
    rows[0][1] = NAN
    mask = np.array([False, False, True, True, True, True])
    assert one(rows[0], rows[1], rows[2], mask, RANGE) == one(ESTIMATE, HOLD, TRUTH, ALL, RANGE)


def test_two_hands_are_pooled_by_their_ticks_each_about_its_own_mean() -> None:
    elsewhere = np.array([5.0, -3.0, 1.0])  # the other arm stands metres away, which explains no error
    both = score(
        Scorable(ESTIMATE, HOLD, TRUTH, ALL, RANGE),
        Scorable(HOLD + elsewhere, HOLD + elsewhere, TRUTH + elsewhere, ALL, 2 * RANGE),
    )
    assert both["n_scored"] == 8
    assert both["rmse_3d_mm"] == pytest.approx(((21 + 28) / 8) ** 0.5)
    assert both["ratio_to_hold"] == pytest.approx(((21 + 28) / (28 + 28)) ** 0.5)
    assert both["r2_pct"] == [pytest.approx(100 * (1 - 16 / 40)), pytest.approx(100 * (1 - 25 / 24)), None]
    x, y, z = cast("list[float | None]", both["rmse_normalized"])
    # 4 mm^2 in units of 10 mm and 12 mm^2 in units of 20 mm, over 8 ticks
    assert x == pytest.approx(((4 / 100 + 12 / 400) / 8) ** 0.5)
    assert y == pytest.approx(((9 / 25 + 16 / 100) / 8) ** 0.5)
    assert z is None
    assert both["max_mm"] == pytest.approx([2, 4, 2])


def test_without_scored_ticks_every_figure_is_null() -> None:
    result = one(ESTIMATE, HOLD, TRUTH, ~ALL, RANGE)
    assert result["r2_pct"] == result["rmse_mm"] == result["rmse_normalized"] == [None, None, None]
    assert result["rmse_3d_mm"] is None
    assert result["ratio_to_hold"] is None
    assert result["n_scored"] == 0


def test_a_constant_truth_has_no_r2_whatever_it_rounds_to() -> None:
    truth = np.full((7, 3), 0.1)  # the mean of seven 0.1 is not 0.1 in floats
    estimate = truth + 1e-3
    r2 = one(estimate, estimate, truth, np.ones(7, dtype=np.bool_), RANGE)["r2_pct"]
    assert r2 == [None, None, None]


def test_r2_is_the_squared_correlation_of_a_least_squares_fit() -> None:
    t = np.linspace(0, 3, 50)
    truth = np.column_stack([np.sin(t), np.cos(t), np.exp(-t)])
    fit = np.column_stack([np.polyval(np.polyfit(t, y, 1), t) for y in truth.T])
    r2 = one(fit, fit, truth, np.ones(50, dtype=np.bool_), np.ones(3))["r2_pct"]
    correlation = [float(np.corrcoef(f, y)[0, 1]) for f, y in zip(fit.T, truth.T, strict=True)]
    assert r2 == pytest.approx([100 * r**2 for r in correlation])


def test_ratio_pools_ticks_and_not_trials() -> None:
    # 1 of 1 mm^2 in one tick, 3 of 12 in three: pooled 4 / 13, where a mean of ratios would be (1 + 0.5) / 2
    errors = [np.array([[1.0, 0, 0]]), np.array([[0, 1.0, 0]] * 3)]
    hold = [np.array([[0, 0, 1.0]]), np.array([[0, 2.0, 0]] * 3)]
    assert ratio_to_hold(errors, hold) == pytest.approx((4 / 13) ** 0.5)


def test_ratio_without_an_error_of_hold_is_null() -> None:
    assert ratio_to_hold([np.ones((2, 3))], [np.zeros((2, 3))]) is None


def test_scoring_begins_two_seconds_after_the_first_arrival() -> None:
    t = np.array([2_039_999_999, 2_040_000_000, 2_100_000_000, 2_200_000_000])
    known = np.zeros((4, 3))
    assert scored_ticks(t, known, known, 40_000_000).tolist() == [False, True, True, True]
    assert scored_ticks(t, known, known, None).tolist() == [False] * 4


def test_a_tick_without_truth_or_hold_is_not_scored() -> None:
    t = np.array([3, 4, 5]) * 10**9
    truth, hold = np.zeros((3, 3)), np.zeros((3, 3))
    truth[0, 2] = NAN
    hold[2, 0] = NAN
    assert scored_ticks(t, truth, hold, 0).tolist() == [False, True, False]


def test_truth_between_samples_and_outside() -> None:
    sample_ns = np.array([0, 33_333_333, 66_666_666])
    positions = np.array([[0.0, 1.0, 2.0], [3.0, 1.0, 0.0], [3.0, 5.0, 0.0]])
    t = np.array([-1, 0, 11_111_111, 33_333_333, 66_666_666, 66_666_667])
    rows = [[NAN] * 3, [0.0, 1, 2], [1.0, 1, 4 / 3], [3.0, 1, 0], [3.0, 5, 0], [NAN] * 3]
    expected = np.array(rows, dtype=np.float64)
    np.testing.assert_allclose(truth_at(t, sample_ns, positions), expected, rtol=1e-12)


def test_truth_without_samples_is_unknown() -> None:
    none = truth_at(np.array([0, 1]), np.empty(0, dtype=np.int64), np.empty((0, 3)))
    assert none.shape == (2, 3)
    assert np.isnan(none).all()


@settings(deadline=None, max_examples=50)
@given(st.lists(st.integers(1, 10**9), min_size=1, max_size=8), st.integers(0, 2**31), st.data())
def test_truth_is_exact_linear_interpolation(steps: list[int], start: int, data: st.DataObject) -> None:
    sample_ns = [start + sum(steps[:i]) for i in range(len(steps) + 1)]
    values = data.draw(st.lists(st.integers(-1000, 1000), min_size=len(sample_ns), max_size=len(sample_ns)))
    t = data.draw(st.integers(sample_ns[0], sample_ns[-1]))
    i = max(k for k in range(len(steps)) if sample_ns[k] <= t)
    share = Fraction(t - sample_ns[i], sample_ns[i + 1] - sample_ns[i])
    exact = values[i] + share * (values[i + 1] - values[i])
    positions = np.repeat(np.array(values, dtype=np.float64)[:, None], 3, axis=1)
    found = truth_at(np.array([t]), np.array(sample_ns), positions)
    np.testing.assert_allclose(found, float(exact), rtol=1e-12, atol=1e-9)


def about(axis: int, degrees: float) -> list[float]:
    half = np.radians(degrees) / 2
    quaternion = [0.0, 0.0, 0.0, float(np.cos(half))]
    quaternion[axis] = float(np.sin(half))
    return quaternion


def test_the_angle_is_that_of_the_rotation_between() -> None:
    one = np.array([about(2, 10), about(0, 0), about(1, 179), about(0, 90)])
    other = np.array([about(2, 40), [0, 0, 0, -1], about(1, -179), about(1, 90)])
    # 358 degrees the long way are 2 the short one; two quarter turns about x and y are 120 apart
    assert angles_deg(error_vectors(one, other)) == pytest.approx([30, 0, 2, 120], abs=1e-6)
    assert error_vectors(np.empty((0, 4)), np.empty((0, 4))).shape == (0, 3)


def test_the_vector_is_in_the_frame_of_the_estimate_and_unknown_without_both() -> None:
    # turned by 90 degrees about z, the body's x points along y: 10 degrees about the world's y are about its x
    half = np.radians(5)
    estimate = np.array([about(2, 90), about(2, 90), [np.nan] * 4])
    x, y, z, w = 0.0, np.sin(half), 0.0, np.cos(half)
    ax, ay, az, aw = about(2, 90)
    turned = [w * ax + x * aw + y * az - z * ay, w * ay - x * az + y * aw + z * ax,
              w * az + x * ay - y * ax + z * aw, w * aw - x * ax - y * ay - z * az]  # fmt: skip
    truth = np.array([turned, [np.nan] * 4, about(2, 90)])
    found = error_vectors(estimate, truth)
    assert found[0] == pytest.approx([np.radians(10), 0, 0], abs=1e-12)
    assert np.isnan(found[1:]).all()


def test_orientation_turns_at_constant_speed_between_samples_and_is_unknown_outside() -> None:
    sample_ns = np.array([0, 100, 300])
    samples = np.array([about(2, 0), about(2, 20), about(2, 60)])
    t_ns = np.array([-1, 0, 50, 200, 300, 301])
    found = orientation_at(t_ns, sample_ns, samples)
    assert np.isnan(found[[0, -1]]).all()
    expected = np.array([about(2, degrees) for degrees in (0, 10, 40, 60)])
    assert angles_deg(error_vectors(found[1:-1], expected)) == pytest.approx([0] * 4, abs=1e-5)
    assert np.isnan(orientation_at(t_ns, sample_ns[:1], samples[:1])).all()
