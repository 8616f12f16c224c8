import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.special import chdtri

from tests.patient_side.identification.known_systems import Array, hand_like
from tis.patient_side.identification.coverage import independent_windows, prediction_factor
from tis.patient_side.identification.forecast import fit_forecast


def error_by_loop(
    u: Array, span: int, damping: float, persistence: float, horizon: int, first: int
) -> tuple[float, float]:
    """Return the squared errors of the forecast and of hold, summed sample by sample."""
    squared, held = 0.0, 0.0
    for k in range(first, len(u) - horizon):
        way, velocity = np.zeros(u.shape[1]), (u[k] - u[k - span]) / span
        for _ in range(horizon):
            velocity = damping * velocity
            way = persistence * way + velocity
        squared += float(np.sum((u[k + horizon] - u[k] - way) ** 2))
        held += float(np.sum((u[k + horizon] - u[k]) ** 2))
    return squared, held


def criterion(u: Array, span: int, damping: float, persistence: float) -> float:
    ratios = []
    for horizon in (1, 3, 6, 15, 30, 60):
        squared, held = error_by_loop(u, span, damping, persistence, horizon, 3)
        ratios.append(squared / held)
    return float(np.mean(ratios))


def test_no_other_damping_persistence_or_span_is_better_by_a_plain_loop() -> None:
    u = hand_like(300, 0)
    found = fit_forecast([u], 30)
    best = criterion(u, found.velocity_span, found.damping, found.persistence)
    for persistence in (1.0, np.exp(-1 / 300), np.exp(-1 / 60)):
        for span in (1, 2, 3):
            for damping in np.linspace(0, 0.9, 4):
                assert criterion(u, span, float(damping), float(persistence)) >= best - 1e-12
    assert criterion(u, found.velocity_span, found.damping + 0.003, found.persistence) > best
    assert criterion(u, found.velocity_span, found.damping - 0.003, found.persistence) > best


def test_growth_is_the_rms_error_of_each_horizon_and_axis() -> None:
    u = hand_like(300, 1)
    found = fit_forecast([u], 30)
    assert found.growth_m.shape == (75, 3)
    widened: dict[int, list[float]] = {}
    for horizon in (1, 2, 40, 75):
        for axis in range(3):
            squared, _ = error_by_loop(
                u[:, axis : axis + 1],
                found.velocity_span,
                found.damping,
                found.persistence,
                horizon,
                found.velocity_span,
            )
            n_errors = 300 - horizon - found.velocity_span
            by_chance = prediction_factor(independent_windows(n_errors, horizon), 2 / 3, whole=False)
            rms = np.sqrt(by_chance * squared / n_errors)
            wider = found.growth_m[horizon - 1] / rms
            widened.setdefault(horizon, []).append(float(wider[axis]))
    for factors in widened.values():  # one factor for all axes, near 1 for normal movement
        assert factors == pytest.approx([factors[0]] * 3, rel=1e-9)
        assert 0.8 < factors[0] < 1.25


def test_of_few_rows_the_ellipsoids_still_hold_new_errors() -> None:
    """Of forty random hands 8 s are known, and the next 8 s are forecast over half a second."""
    rng, held, n_rows, horizon = np.random.default_rng(0), [], 240, 15
    for _ in range(40):
        driving = rng.normal(size=(2 * n_rows + 200, 3))
        u = lfilter([1.0], np.convolve([1.0, -0.9], [1.0, -0.97]), driving, axis=0)[200:]
        found = fit_forecast([u[:n_rows]], 30)
        now = np.arange(n_rows, 2 * n_rows - horizon)
        velocity = (u[now] - u[now - found.velocity_span]) / found.velocity_span
        steps = sum(found.damping**i * found.persistence ** (horizon - i) for i in range(1, horizon + 1))
        errors = u[now + horizon] - u[now] - steps * velocity
        held.append(np.mean(np.sum(np.square(errors / found.growth_m[horizon - 1]), axis=1) < chdtri(3, 0.05)))
    assert 0.92 < np.mean(held) < 0.98


def test_a_straight_line_is_continued_without_damping() -> None:
    u = np.outer(np.arange(200.0), [1e-3, -2e-3, 5e-4])
    found = fit_forecast([u], 30)
    assert (found.damping, found.persistence) == (1.0, 1.0)
    assert found.growth_m == pytest.approx(np.zeros((50, 3)), abs=1e-12)


def test_a_random_walk_is_best_held() -> None:
    steps = np.random.default_rng(2).normal(size=(20_000, 3))
    assert fit_forecast([np.cumsum(steps, axis=0)], 30).damping < 0.05


def test_a_velocity_that_decays_has_its_damping_found() -> None:
    rng = np.random.default_rng(3)
    velocity, rows = np.zeros(3), []
    for _ in range(20_000):
        velocity = 0.8 * velocity + rng.normal(size=3)
        rows.append(velocity)
    found = fit_forecast([np.cumsum(rows, axis=0)], 30)
    assert found.damping == pytest.approx(0.8, abs=0.01)
    assert found.velocity_span == 1


def test_a_hand_that_is_drawn_back_is_no_worse_forecast_than_held() -> None:
    """One that is slowed within 10 samples and drawn back within 60: two real poles."""
    fit_on, score_on = (drawn_back(2000, seed) for seed in (8, 9))
    found = fit_forecast([fit_on], 30)
    assert found.persistence < 1.0
    for horizon in (60, 90, 120, 150):
        velocity = (score_on[3:-horizon] - score_on[3 - found.velocity_span : -horizon - found.velocity_span]) / (
            found.velocity_span
        )
        ahead = score_on[3 + horizon :] - score_on[3:-horizon]
        gain = sum(found.damping**k * found.persistence ** (horizon - k) for k in range(1, horizon + 1))
        forecast = gain * velocity
        assert np.sum((ahead - forecast) ** 2) < 1.01 * np.sum(ahead**2)


def drawn_back(n_rows: int, seed: int) -> Array:
    noise = np.random.default_rng(seed).normal(size=(n_rows, 3))
    rows, before, now = [], np.zeros(3), np.zeros(3)
    slow, fast = np.exp(-1 / 60), np.exp(-1 / 10)
    for step in noise:
        before, now = now, (slow + fast) * now - slow * fast * before + step
        rows.append(now)
    return np.array(rows)


def test_noise_on_the_positions_asks_for_a_longer_span() -> None:
    slow = 0.02 * np.sin(2 * np.pi * 0.1 * np.arange(2000.0) / 30)[:, None] * np.ones(3)
    noise = np.random.default_rng(4).normal(size=(2000, 3))
    assert fit_forecast([slow], 30).velocity_span == 1
    assert fit_forecast([slow + 1e-4 * noise], 30).velocity_span == 3


def test_trials_pool_without_a_step_across_their_border() -> None:
    u = np.outer(np.arange(120.0), [1e-3, 1e-3, 1e-3])
    found = fit_forecast([u, u + 5.0, u[:2]], 30)  # the last is too short to say anything
    assert found.damping == 1.0
    assert found.growth_m == pytest.approx(np.zeros((30, 3)), abs=1e-12)


def test_horizons_are_times_so_they_count_more_samples_at_a_higher_rate() -> None:
    u = hand_like(1200, 5)
    # at 60 Hz, 33 ms to 500 ms are 2 to 30 samples: other horizons, so another optimum
    assert fit_forecast([u], 60).damping != fit_forecast([u], 30).damping
    assert fit_forecast([u], 60).growth_m.shape == (150, 3)


def test_a_command_at_rest_is_held() -> None:
    found = fit_forecast([np.ones((100, 3))], 30)
    assert found.damping == 0.0
    assert not found.growth_m.any()
