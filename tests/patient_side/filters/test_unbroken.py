import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from tests.patient_side.movements import movement_model
from tis.patient_side.filters.innovations_filter import build_innovations_filter
from tis.patient_side.filters.unbroken import Unbroken

STRUCTURES = pytest.mark.parametrize("integrated", [False, True])


@STRUCTURES
def test_stages_are_the_filters_own_covariances_and_gains(integrated: bool) -> None:
    model = movement_model(5, integrated=integrated)
    filter_ = build_innovations_filter(model, 10)
    unbroken = Unbroken.of(filter_, 400)
    mean, covariance = filter_.start(np.zeros(3))
    innovation = 1e-4 * np.array([1.0, -2.0, 0.5])
    for length in range(2, 401):
        predicted = filter_.onward[1] @ mean
        mean, covariance, surprise = filter_.update(mean, covariance, 1, predicted[-3:, 0] + innovation)
        stage = unbroken.stage(length)
        if unbroken.lengths[stage] == length:
            assert np.allclose(unbroken.covariances[stage], covariance, rtol=1e-9, atol=1e-9 * covariance.max())
            assert np.allclose(unbroken.gains[stage] @ innovation, (mean - predicted)[:, 0], rtol=1e-9, atol=1e-15)
            assert float(innovation @ innovation) / unbroken.variances[stage] == pytest.approx(surprise, rel=1e-9)
        else:
            # a stage stands for lengths within 2 %: what is learnt as 1/length differs by as much
            known = covariance[:-3, :-3]
            nothing = 1e-12 * filter_.start_covariance.max()
            assert np.allclose(
                unbroken.covariances[stage][:-3, :-3], known, rtol=0.1, atol=0.05 * known.max() + nothing
            )
    assert unbroken.stage(10_000) == len(unbroken.lengths) - 1


def test_it_ends_at_the_riccati_equations_solution() -> None:
    model = movement_model(4, level_step=0.5)
    filter_ = build_innovations_filter(model, 10)
    unbroken = Unbroken.of(filter_)
    n, last = model.order, unbroken.covariances[-1]
    A, C = np.eye(n + 3), np.hstack([model.C, np.eye(3)])
    A[:n, :n] = model.A
    S = np.vstack([model.K @ model.Re, np.zeros((3, 3))])
    Q = S @ np.linalg.solve(model.Re, S.T)
    Q[n:, n:] += model.level_step**2 * model.Re
    scale = 1e8  # scipy's solver wants numbers of about one
    P = solve_discrete_are(A.T, C.T, scale * Q, scale * model.Re, s=scale * S) / scale
    after = filter_.onward[1] @ last @ filter_.onward[1].T + filter_.noises[1]
    assert filter_.level is not None
    to_z = np.vstack([np.eye(n, n + 6), filter_.level])
    assert np.max(np.abs(to_z @ after @ to_z.T - P)) < 1e-6 * np.max(np.abs(P))


def test_of_an_integrated_model_everything_is_known_in_the_end() -> None:
    model = movement_model(4, integrated=True)
    unbroken = Unbroken.of(build_innovations_filter(model, 10), 300)
    assert np.max(np.abs(unbroken.covariances[-1])) < 1e-9 * np.max(np.abs(unbroken.covariances[0]))


@STRUCTURES
def test_after_a_gap_a_row_counts_as_unbroken_again_only_when_it_is_like_one(integrated: bool) -> None:
    model = movement_model(4, integrated=integrated, level_step=0.005)
    filter_ = build_innovations_filter(model, 20)
    unbroken = Unbroken.of(filter_)
    covariance, sample = unbroken.covariances[unbroken.stage(500)], np.zeros(3)
    mean = np.zeros((len(covariance), 1))
    # without a level everything is known long before, and no length is told from a longer one
    assert unbroken.length_like(covariance) >= (unbroken.lengths[-1] if integrated else 490)
    _, covariance, _ = filter_.update(mean, covariance, 15, sample)
    assert unbroken.length_like(covariance) == 0
    n_needed = 0
    while not (like := unbroken.length_like(covariance)):
        _, covariance, _ = filter_.update(mean, covariance, 1, sample)
        n_needed += 1
        assert n_needed < 200
    expected = filter_.spread(covariance, 5, 0.0)
    taken = filter_.spread(unbroken.covariances[unbroken.stage(like)], 5, 0.0)
    assert np.allclose(taken, expected, rtol=0.02, atol=0.02 * np.trace(expected))
    if not integrated:
        assert 300 < like < 700
