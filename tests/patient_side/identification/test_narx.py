from pathlib import Path

import numpy as np
import pytest

from tests.patient_side.identification.known_systems import real_recording
from tis.patient_side.identification import arx, narx
from tis.patient_side.identification.noise import innovations
from tis.patient_side.linear_system import Array


def bilinear(n_rows: int, noise: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return ``y = 0.6 y1 + 0.4 u1 + 0.3 u1 y1 - 0.2 y1^2 + e`` under a uniform input about 0."""
    u, y = rng.uniform(-1, 1, (n_rows, 1)), np.zeros((n_rows, 1))
    u -= u.mean()
    for k in range(1, n_rows):
        y[k] = 0.6 * y[k - 1] + 0.4 * u[k - 1] + 0.3 * u[k - 1] * y[k - 1] - 0.2 * y[k - 1] ** 2
        y[k] += noise * rng.normal()
    return u, y


def predicted(model: narx.NarxModel, u: Array, y: Array) -> Array:
    """Return the one-step predictions (N, p): a free run of one row from the measured outputs before each."""
    rows = [model.free_run(u[k - model.lags : k + 1], y[k - model.lags : k])[-1] for k in range(model.lags, len(u))]
    return np.vstack([np.full((model.lags, y.shape[1]), np.nan), rows])


def test_a_bilinear_system_is_found_by_its_monomials_and_predicted() -> None:
    u, y = bilinear(2500, 0.01, np.random.default_rng(0))
    model = narx.identify(u[:1500], y[:1500], 1, 3)
    # regressors: 0 is y[k-1], 1 is u[k], 2 is u[k-1]; about the mean of y the square gives linear terms too
    assert {(0,), (2,), (0, 2), (0, 0)} <= set(model.terms[0]) <= {(), (0,), (2,), (0, 2), (0, 0)}
    fresh_u, fresh_y = u[1500:], y[1500:]
    one_step = (predicted(model, fresh_u, fresh_y) - fresh_y)[1:]
    assert one_step.std() < 0.0105
    linear = arx.identify(u[:1500], y[:1500], 1, 3)
    free = (model.free_run(fresh_u, fresh_y) - fresh_y)[50:]
    assert free.std() < 0.3 * (linear.space.simulate(fresh_u) - fresh_y)[50:].std()


def test_of_degree_one_it_is_the_arx_model() -> None:
    rng = np.random.default_rng(1)
    u, y = rng.normal(size=(400, 2)), np.zeros((400, 2))
    for k in range(1, 400):
        y[k] = [0.7 * y[k - 1, 0] + u[k, 0], 0.5 * y[k - 1, 1] + 0.3 * y[k - 1, 0] + u[k - 1, 1]]
    u, y = u - u.mean(axis=0), y - y.mean(axis=0)
    model = narx.identify([u[:200], u[200:]], [y[:200], y[200:]], 1, 4, degree=1)
    linear = arx.identify([u[:200], u[200:]], [y[:200], y[200:]], 1, 4)
    assert [set(terms) - {()} for terms in model.terms] == [{(0,), (2,)}, {(0,), (1,), (5,)}]
    (errors,) = innovations(linear.space, linear.noise.gain, [np.zeros(2)], [(u, y)])
    assert predicted(model, u, y)[1:] == pytest.approx((y - errors)[1:], abs=1e-2)


def test_rows_met_in_stretches_and_over_trials_give_the_least_squares_of_all_rows() -> None:
    trials = [bilinear(n, 0.05, np.random.default_rng(n)) for n in (1300, 40, 700)]
    model = narx.identify([u for u, _ in trials], [y for _, y in trials], 1, 3)
    u_mean, y_mean = (np.concatenate([trial[i] for trial in trials]).mean(axis=0) for i in (0, 1))
    rows, targets = [], []
    for u, y in trials:
        scaled_u, scaled_y = (u - u_mean) / model.scaling.input, (y - y_mean) / model.scaling.output
        factors = np.hstack([scaled_y[2:-1], scaled_u[3:], scaled_u[2:-1]])
        rows.append(np.column_stack([np.prod(factors[:, list(term)], axis=1) for term in model.terms[0]]))
        targets.append(scaled_y[3:, 0])
    everything, target = np.vstack(rows), np.concatenate(targets)
    normal = everything.T @ everything
    plain = np.linalg.solve(normal + 1e-6 * np.diag(np.diag(normal)), everything.T @ target)
    assert model.coefficients[0] == pytest.approx(plain, abs=1e-9)


def test_a_free_run_does_not_blow_up() -> None:
    u, y = bilinear(400, 0.0, np.random.default_rng(2))
    model = narx.identify(u, y, 1, 2)
    wild = 50 * np.random.default_rng(3).normal(size=(300, 1))
    run = model.free_run(wild, y)
    assert np.all(np.isfinite(run))
    span = np.ptp(y)
    assert y.min() - 0.51 * span < run.min()
    assert run.max() < y.max() + 0.51 * span


def test_a_free_run_knows_no_later_output() -> None:
    u, y = bilinear(300, 0.01, np.random.default_rng(4))
    model = narx.identify(u, y, 2, 3)
    changed = y.copy()
    changed[2:] += 1.0
    assert np.array_equal(model.free_run(u, y), model.free_run(u, changed))


def test_a_real_arm_is_a_gain_to_it_too(jigsaws_dir: Path) -> None:
    hand = real_recording(jigsaws_dir, "Suturing_D002").hands[0]
    u, y = hand.command.position_m, hand.follower.position_m
    model = narx.identify(u[:1240], y[:1240], 2, 10)
    error = model.free_run(u[1240:], y[1240:]) - y[1240:]
    assert np.sqrt(np.mean(error**2)) < 3e-5
    assert max(len(terms) for terms in model.terms) <= 12


def test_a_trial_shorter_than_the_lags_tells_nothing() -> None:
    u, y = bilinear(400, 0.01, np.random.default_rng(2))
    alone = narx.identify(u, y, 4, 6)
    beside = narx.identify([u, u[:3]], [y, y[:3]], 4, 6)
    assert alone.terms == beside.terms
    # but for the mean of its rows
    assert np.allclose(predicted(alone, u, y)[4:], predicted(beside, u, y)[4:], atol=1e-3)
