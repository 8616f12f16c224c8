"""The filter against one-shot conditioning of the joint Gaussian, and the textbook form with its cross term."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from patient_side.innovations_filter import build_innovations_filter
from patient_side.statespace import Array, InnovationsModel
from tests.patient_side.movements import drawn, joint_covariance, movement_model

N = 30
STRUCTURES = pytest.mark.parametrize("integrated", [False, True])


def conditioned(
    model: InnovationsModel, known: list[int], values: Array, errors: list[Array | None], weights: Array
) -> tuple[Array, Array]:
    """Mean and covariance of ``weights`` (3, 3 N) times the positions, given some of them, with errors.

    The constant that all positions share is unknown: it is found by generalised least squares (universal kriging).
    """
    joint = joint_covariance(model, N)
    rows = np.concatenate([np.arange(3 * i, 3 * i + 3) for i in known])
    seen = joint[np.ix_(rows, rows)]
    for at, error in enumerate(errors):
        if error is not None:
            seen[3 * at : 3 * at + 3, 3 * at : 3 * at + 3] += error
    gain = np.linalg.solve(seen, joint[rows] @ weights.T).T
    everywhere = np.tile(np.eye(3), (len(known), 1))
    weighted = np.linalg.solve(seen, everywhere)
    uncertain = np.linalg.inv(everywhere.T @ weighted)
    constant = uncertain @ weighted.T @ values.reshape(-1)
    left = np.eye(3) - gain @ everywhere
    mean = constant + gain @ (values.reshape(-1) - everywhere @ constant)
    covariance = weights @ joint @ weights.T - gain @ joint[rows] @ weights.T + left @ uncertain @ left.T
    return mean, covariance


def interpolation(at: float) -> Array:
    """The weights of position ``at``, linear between samples."""
    weights = np.zeros((3, 3 * N))
    for i, share in ((int(at), 1 - at % 1), (int(at) + 1, at % 1)):
        weights[:, 3 * i : 3 * i + 3] += share * np.eye(3)
    return weights


@STRUCTURES
@given(
    seed=st.integers(0, 1000),
    arrived=st.sets(st.integers(0, 20), min_size=1, max_size=12),
    ahead=st.floats(0, 7.99),
    noisy=st.booleans(),
)
@settings(max_examples=25, deadline=None)
def test_it_is_one_shot_conditioning(
    integrated: bool, seed: int, arrived: set[int], ahead: float, noisy: bool
) -> None:
    rng = np.random.default_rng(seed)
    model = movement_model(int(rng.integers(1, 6)), integrated=integrated, seed=seed % 7)
    y = drawn(model, N, rng, level_m=0.0)
    known = sorted(arrived)
    values = y[known]
    errors: list[Array | None] = [
        1e-10 * np.diag(rng.uniform(1, 9, 3)) if noisy and rng.random() < 0.5 else None for _ in known
    ]
    filter_ = build_innovations_filter(model, N)
    mean, covariance = filter_.start(values[0], errors[0])
    for last, index, sample, error in zip(known, known[1:], values[1:], errors[1:], strict=False):
        mean, covariance, _ = filter_.update(mean, covariance, index - last, sample, error)
    steps, fraction = int(ahead), ahead % 1
    weights = filter_.weights(steps, fraction)
    expected_mean, expected = conditioned(model, known, values, errors, interpolation(known[-1] + ahead))
    seen = joint_covariance(model, N)[-3:, -3:]
    assert np.max(np.abs(weights @ mean - expected_mean)) < 1e-10 * np.max(np.abs(values))
    assert np.max(np.abs(filter_.spread(covariance, steps, fraction) - expected)) < 1e-10 * np.trace(seen)


@STRUCTURES
def test_where_every_axis_moves_alike_the_filter_of_one_is_that_of_all(integrated: bool) -> None:
    of_one = movement_model(4, integrated=integrated)
    A, C, K = (np.asarray(np.kron(m, np.eye(3)), dtype=float) for m in (of_one.A, of_one.C[:1], of_one.K[:, :1]))
    model = replace(of_one, A=0.9 * A, C=C, K=0.2 * K)
    one, whole = (build_innovations_filter(model, 20, whole=whole) for whole in (False, True))
    assert (one.n_axes, whole.n_axes) == (1, 3)
    assert np.allclose(one.transitions, whole.transitions, rtol=1e-12, atol=1e-12)
    rng = np.random.default_rng(5)
    y = drawn(model, 60, rng)
    (mean, covariance), (same, all_axes) = one.start(y[0]), whole.start(y[0])
    at = 0
    for gap in (1, 3, 1, 1, 9, 1, 20, 2, 1):
        at += gap
        mean, covariance, surprise = one.update(mean, covariance, gap, y[at])
        same, all_axes, expected = whole.update(same, all_axes, gap, y[at])
        assert np.max(np.abs(mean - same)) < 1e-12 * np.max(np.abs(same))
        assert surprise == pytest.approx(expected, rel=1e-9)
        assert np.max(np.abs(np.kron(covariance, model.Re) - all_axes)) < 1e-12 * np.max(all_axes)
        spread = whole.spread(all_axes, 7, 0.3)
        assert np.max(np.abs(one.spread(covariance, 7, 0.3) - spread)) < 1e-12 * np.max(spread)


@STRUCTURES
def test_many_steps_at_once_are_as_many_single_ones(integrated: bool) -> None:
    model = movement_model(integrated=integrated)
    filter_ = build_innovations_filter(model, 20)
    for h in (1, 7, 21):
        power = np.linalg.matrix_power(filter_.one_step, h)
        noise = sum((m := np.linalg.matrix_power(filter_.one_step, i)) @ filter_.noises[1] @ m.T for i in range(h))
        assert np.allclose(filter_.transitions[h], power, rtol=1e-12, atol=1e-14)
        assert np.allclose(filter_.noises[h], noise, rtol=1e-10, atol=1e-22)


def test_it_is_the_textbook_filter_with_the_cross_term() -> None:
    """A predictor of [x; b] with Q = K Re K', S = K Re, R = Re, from the same beginning, to rounding."""
    model = movement_model(5)
    n, rng = model.order, np.random.default_rng(3)
    y = drawn(model, 60, rng)
    filter_ = build_innovations_filter(model, 10)
    mean, covariance = filter_.start(y[0])

    A = np.eye(n + 3)
    A[:n, :n] = model.A
    C = np.hstack([model.C, np.eye(3)])
    drift = np.zeros((n + 3, n + 3))
    drift[n:, n:] = model.level_step**2 * model.Re
    S = np.vstack([model.K @ model.Re, np.zeros((3, 3))])
    Q = S @ np.linalg.solve(model.Re, S.T) + drift
    # the filter's state after y[0], taken to the next instant
    z = np.concatenate([model.A @ mean[:n] + model.K @ (y[0] - C @ mean[: n + 3]), mean[n : n + 3]])
    after = filter_.one_step @ covariance @ filter_.one_step.T + filter_.noises[1]
    P = after[: n + 3, : n + 3]
    for sample in y[1:]:
        Re = C @ P @ C.T + model.Re
        gain = (A @ P @ C.T + S) @ np.linalg.inv(Re)
        mean, covariance, surprise = filter_.update(mean, covariance, 1, sample)
        innovation = sample - C @ z
        assert surprise == pytest.approx(float(innovation @ innovation / np.trace(Re)), rel=1e-9)
        z, P = A @ z + gain @ innovation, A @ P @ A.T + Q - gain @ Re @ gain.T
        assert np.max(np.abs(filter_.outputs[1] @ mean - C @ z)) < 1e-10 * np.max(np.abs(y))
        ahead = filter_.spread(covariance, 1, 0.0)
        assert np.max(np.abs(ahead - C @ P @ C.T - model.Re)) < 1e-10 * np.trace(model.Re)


@STRUCTURES
def test_covariances_stay_symmetric_and_positive(integrated: bool) -> None:
    model = movement_model(6, integrated=integrated)
    filter_ = build_innovations_filter(model, 40)
    rng = np.random.default_rng(1)
    mean, covariance = filter_.start(np.zeros(3))
    for _ in range(500):
        mean, covariance, _ = filter_.update(mean, covariance, int(rng.integers(1, 40)), rng.normal(size=3))
        assert np.max(np.abs(covariance - covariance.T)) < 1e-12 * np.max(covariance)
    values = np.linalg.eigvalsh(covariance)
    assert values[0] > -1e-12 * values[-1]
    assert np.linalg.eigvalsh(filter_.spread(covariance, 12, 0.3))[0] > 0
