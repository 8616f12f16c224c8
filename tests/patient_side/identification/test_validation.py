import numpy as np
import pytest

from tests.patient_side.identification.known_systems import four_states
from tis.patient_side.identification.validation import (
    PREDICTED_STEPS,
    fit_text,
    initial_state,
    prediction_error,
    simulation_fit,
    split_trials,
)
from tis.patient_side.linear_system import StateSpace


def test_the_true_model_explains_everything_from_any_start() -> None:
    rng, system = np.random.default_rng(0), four_states()
    u, x0 = rng.normal(size=(80, 2)), rng.normal(size=4)
    y = system.simulate(u, x0)
    assert initial_state(system, u[:10], y[:10]) == pytest.approx(x0, abs=1e-10)
    fit = simulation_fit(system, [(u, y)], 10)
    assert fit.fit_pct == pytest.approx((100.0, 100.0, 100.0))
    assert fit.error < 1e-10


def test_the_fit_is_the_share_of_variance_over_the_rows_after_the_start() -> None:
    static = StateSpace(np.empty((0, 0)), np.empty((0, 1)), np.empty((2, 0)), np.array([[1.0], [0.0]]))
    u = np.array([[9.0], [1.0], [-1.0], [1.0], [-1.0]])
    y = np.column_stack([2 * u[:, 0], [5.0, 1.0, 2.0, 3.0, 2.0]])
    # first axis: error 1 of deviation 2; second: it simulates 0, SSE 1 + 4 + 9 + 4 about 0, SST 2 about the mean
    fit = simulation_fit(static, [(u, y)], 1)
    assert fit.fit_pct == pytest.approx((75.0, 100 * (1 - 18 / 2)))
    assert fit.error == pytest.approx(np.sqrt((0.25 + 9) / 2))


def test_trials_pool_and_those_too_short_or_still_say_nothing() -> None:
    static = StateSpace(np.empty((0, 0)), np.empty((0, 1)), np.empty((1, 0)), np.array([[1.0]]))
    one = (np.array([[0.0], [1.0], [-1.0]]), np.array([[0.0], [2.0], [-2.0]]))  # SSE 2, SST 8
    two = (np.array([[0.0], [3.0], [-3.0]]), np.array([[7.0], [3.0], [-3.0]]))  # SSE 0, SST 18
    short = (np.ones((1, 1)), np.ones((1, 1)))
    assert simulation_fit(static, [one, two, short], 1).fit_pct == pytest.approx((100 * (1 - 2 / 26),))
    still = (np.ones((4, 1)), np.ones((4, 1)))
    assert simulation_fit(static, [still], 1).fit_pct == (0.0,)


def test_a_prediction_is_that_of_a_filter_that_stops_hearing_outputs() -> None:
    rng, system, n_start = np.random.default_rng(1), four_states(), 15
    gain = 0.1 * rng.normal(size=(4, 3))
    trials = [(rng.normal(size=(n, 2)), rng.normal(size=(n, 3))) for n in (60, 12, 45)]
    sse, sst = np.zeros(3), np.zeros(3)
    for u, y in trials:
        if len(u) <= n_start + PREDICTED_STEPS:
            continue
        x = initial_state(system, u[:n_start], y[:n_start])
        for k in range(len(u) - PREDICTED_STEPS):
            x = system.A @ x + system.B @ u[k] + gain @ (y[k] - system.C @ x - system.D @ u[k])
            ahead, last = x, k + PREDICTED_STEPS
            for j in range(k + 1, last):
                ahead = system.A @ ahead + system.B @ u[j]
            if k >= n_start:
                sse += (y[last] - system.C @ ahead - system.D @ u[last]) ** 2
                sst += (y[last] - y[k]) ** 2
    wanted = np.sqrt(np.mean(sse / sst))
    assert prediction_error(system, gain, trials, n_start) == pytest.approx(wanted, rel=1e-9)


def test_the_last_rows_of_every_trial_are_held_back() -> None:
    trials = [(np.arange(n, dtype=float)[:, None], -np.arange(n, dtype=float)[:, None]) for n in (10, 25)]
    first, last = split_trials(trials)
    assert [(len(u), len(y)) for u, y in first] == [(7, 7), (18, 18)]
    assert [len(u) for u, _ in last] == [3, 7]
    assert last[1][0][0, 0] == 18.0


def test_a_simulation_that_runs_away_scores_a_finite_number() -> None:
    runs_away = StateSpace(np.array([[9.0]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))
    u, y = np.ones((900, 1)), np.sin(np.arange(900.0))[:, None]  # 9^900 overflows
    fit = simulation_fit(runs_away, [(u, y)], 5)
    assert fit.fit_pct == (100 * (1 - 1e6),)
    assert fit.error == 1e3


@pytest.mark.parametrize(
    ("fit_pct", "decimals", "text"),
    [
        (99.9994, 3, "99.999"),
        (99.99963, 3, "99.999"),
        (100.0, 3, "100.000"),
        (99.7, 0, "99"),
        (-614.25, 0, "-614"),
        (-99999900.0, 3, "-1e+08"),
        (-1000.0, 2, "-1e+03"),
    ],
)
def test_a_fit_is_written_so_that_it_can_be_read(fit_pct: float, decimals: int, text: str) -> None:
    assert fit_text(fit_pct, decimals) == text
