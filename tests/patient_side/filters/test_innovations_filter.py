"""The filter against one-shot conditioning of the joint Gaussian, and the textbook form with its cross term."""

from dataclasses import replace
from decimal import Context, Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.signal import place_poles

from tests.patient_side.movements import drawn, joint_covariance, movement_model
from tis.patient_side.filters.innovations_filter import build_innovations_filter
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import InnovationsModel

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
    assert np.max(np.abs((weights @ mean)[:, 0] - expected_mean)) < 1e-10 * np.max(np.abs(values))
    assert np.max(np.abs(filter_.spread(covariance, steps, fraction) - expected)) < 1e-10 * np.trace(seen)


@STRUCTURES
def test_where_every_axis_moves_alike_the_filter_of_one_is_that_of_all(integrated: bool) -> None:
    of_one = movement_model(4, integrated=integrated)
    A, C, K = (np.asarray(np.kron(m, np.eye(3)), dtype=float) for m in (of_one.A, of_one.C[:1], of_one.K[:, :1]))
    model = replace(of_one, A=0.9 * A, C=C, K=0.2 * K)
    one, whole = (build_innovations_filter(model, 20, whole=whole) for whole in (False, True))
    assert (one.n_axes, whole.n_axes) == (1, 3)
    assert np.allclose(np.kron(one.onward[7], np.eye(3)), whole.onward[7], rtol=1e-12, atol=1e-12)
    rng = np.random.default_rng(5)
    y = drawn(model, 60, rng)
    (mean, covariance), (same, all_axes) = one.start(y[0]), whole.start(y[0])
    at = 0
    for gap in (1, 3, 1, 1, 9, 1, 20, 2, 1):
        at += gap
        mean, covariance, surprise = one.update(mean, covariance, gap, y[at])
        same, all_axes, expected = whole.update(same, all_axes, gap, y[at])
        assert np.max(np.abs(mean.ravel() - same.ravel())) < 1e-12 * np.max(np.abs(same))
        assert surprise == pytest.approx(expected, rel=1e-9)
        assert np.max(np.abs(np.kron(covariance, model.Re) - all_axes)) < 1e-12 * np.max(all_axes)
        spread = whole.spread(all_axes, 7, 0.3)
        assert np.max(np.abs(one.spread(covariance, 7, 0.3) - spread)) < 1e-12 * np.max(spread)


@STRUCTURES
def test_many_steps_at_once_are_as_many_single_ones(integrated: bool) -> None:
    model = movement_model(integrated=integrated)
    filter_ = build_innovations_filter(model, 20)
    for h in (1, 7, 21):
        power = np.linalg.matrix_power(filter_.onward[1], h)
        noise = sum((m := np.linalg.matrix_power(filter_.onward[1], i)) @ filter_.noises[1] @ m.T for i in range(h))
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
    assert filter_.level is not None
    to_z = np.vstack([np.eye(n, n + 6), filter_.level])
    z = to_z @ filter_.onward[1] @ mean[:, 0]
    assert np.allclose(z[n:], y[0], atol=1e-15)  # which is all that is known of the level
    after = filter_.onward[1] @ covariance @ filter_.onward[1].T + filter_.noises[1]
    P = to_z @ after @ to_z.T
    for sample in y[1:]:
        Re = C @ P @ C.T + model.Re
        gain = (A @ P @ C.T + S) @ np.linalg.inv(Re)
        mean, covariance, surprise = filter_.update(mean, covariance, 1, sample)
        innovation = sample - C @ z
        assert surprise == pytest.approx(float(innovation @ innovation / np.trace(Re)), rel=1e-9)
        z, P = A @ z + gain @ innovation, A @ P @ A.T + Q - gain @ Re @ gain.T
        assert np.max(np.abs(filter_.output(1) @ mean[:, 0] - C @ z)) < 1e-10 * np.max(np.abs(y))
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


def quiet_model() -> InnovationsModel:
    """A smooth movement of three axes alike, in modal states: a millionth of its variance is innovation."""
    poles = (0.921 + 0.03j, 0.967 + 0.228j, 0.985 + 0.012j, 0.999)
    zeros = (0.356 + 0.17j, 0.509 + 0.53j, 0.925 + 0.25j, 0.971)
    turns = [np.array([[p.real, p.imag], [-p.imag, p.real]] if p.imag else [[p.real]]) for p in map(complex, poles)]
    A, C, eye = block_diag(*turns), np.array([[1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0]]), np.eye(3)
    both = [root for z in map(complex, zeros) for root in ([z, z.conjugate()] if z.imag else [z])]
    K = place_poles(A.T, C.T, np.array(both)).gain_matrix.T
    A, C, K = (np.kron(matrix, eye) for matrix in (A, C, K))
    return replace(movement_model(3, level_step=0.1), A=A, C=C, K=K, Re=1e-12 * eye)


def textbook_variances(model: InnovationsModel, gaps: list[int]) -> list[float]:
    """The innovations' variances of one axis, in units of the innovations', by the predictor of [x; b] in decimals.

    After a first sample, from which b is known up to x, one for each of ``gaps``. Eighty digits are as good as exact.
    """

    def decimals(values: Array) -> NDArray[np.object_]:
        return np.array([Decimal(float(value)) for value in values.ravel()], dtype=object).reshape(values.shape)

    n = model.order // 3
    one = (model.A[::3, ::3], model.C[::3, ::3], model.K[::3, ::3])
    with localcontext(Context(prec=80)):
        A, C, K = (decimals(matrix) for matrix in one)
        states, power = K @ K.T, A
        for _ in range(20):  # over a million samples
            states, power = states + power @ states @ power.T, power @ power
        F, drift = decimals(np.eye(n + 1)), decimals(np.zeros((n + 1, n + 1)))
        F[:n, :n], drift[n, n] = A, Decimal(model.level_step) ** 2
        H, S = np.hstack([C, decimals(np.ones((1, 1)))]), np.vstack([K, decimals(np.zeros((1, 1)))])
        # given the first sample b is that less C x and e: [x; b] after it, and its covariance with e
        to_z = np.vstack([np.hstack([decimals(np.eye(n)), decimals(np.zeros((n, 1)))]), -H])
        joint = np.vstack([np.hstack([states, 0 * K]), decimals(np.eye(1, n + 1, n))])
        onward = F @ to_z + np.hstack([0 * F[:, :n], S])
        P, variances = onward @ joint @ onward.T + drift, []
        for gap in gaps:
            for _ in range(gap - 1):
                P = F @ P @ F.T + S @ S.T + drift
            expected = (H @ P @ H.T)[0, 0] + 1
            gain = (F @ P @ H.T + S) / expected
            variances.append(float(expected))
            P = F @ P @ F.T + S @ S.T + drift - expected * (gain @ gain.T)
        return variances


@pytest.mark.parametrize("whole", [False, True])
def test_rounding_does_not_outgrow_a_quiet_movement(whole: bool) -> None:
    model = quiet_model()
    filter_ = build_innovations_filter(model, 20, whole=whole)
    gaps = [1] * 120 + [2] + [1] * 30 + [17] + [1] * 30
    covariance, variances = filter_.start_covariance, []
    for gap in gaps:
        _, variance, covariance = filter_.gain(covariance, gap)
        variances.append(variance / np.trace(model.Re))
    expected = textbook_variances(model, gaps)
    assert expected[0] > 1e3
    assert min(expected) < 1.1
    assert variances == pytest.approx(expected, rel=1e-6)
