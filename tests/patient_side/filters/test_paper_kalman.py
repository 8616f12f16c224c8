"""Algorithm 1 on arrays, against numbers worked by hand and against the Gaussian conditioned at one stroke."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.patient_side.filters.paper_kalman import paper_filter
from tis.patient_side.linear_system import Array, StateSpace

# One state, two outputs. D is there to be dropped.
SPACE = StateSpace(np.array([[0.5]]), np.array([[1.0]]), np.array([[1.0], [2.0]]), np.array([[100.0], [100.0]]))
Q, R = np.array([[0.75]]), np.array([[1.0, 0.3], [0.3, 4.0]])
MTM = np.array([[1.0], [-1.0], [9.0]])
PSM = np.array([[0.0, 0.0], [3.0, 7.0], [8.0, 8.0]])


def on_all(psm: Array, *, as_printed: bool) -> Array:
    n_samples = len(psm)
    return paper_filter(
        MTM, psm, SPACE, Q, R, np.zeros(n_samples, dtype=np.int64), np.zeros(n_samples, bool), as_printed=as_printed
    )


def test_as_printed_by_hand() -> None:
    """k=1: x_pred = 1, P_pred = 1; K = 2/8, x = 1 + (7 - 2)/4 = 2.25, P = (1 - 1/2) 1 = 0.5.

    k=2, lost: x_pred = 0.125, P_pred = 0.875; K = 1.75/7.5 = 7/30, x = 0.125 + 7/30 6.75 = 1.7.
    """
    lost = np.array([False, False, True])
    z = paper_filter(MTM, PSM, SPACE, Q, R, np.zeros(3, dtype=np.int64), lost, as_printed=True)
    np.testing.assert_allclose(z, [[0.0, 0.0], [2.25, 4.5], [1.7, 3.4]], rtol=1e-14)


def test_repaired_by_hand() -> None:
    """k=1: x = 1 + (3 - 1)/2 = 2, P = 1/2; then S = 6, K = 1/6, x = 2 + (7 - 4)/6 = 2.5, P = 1/3.

    k=2, lost: x_pred = 0.25, P_pred = 5/6; K = 5/11, x = 1.5, P = 5/11; K = 5/32, x = 1.5 + 5/32 4 = 2.125.
    """
    lost = np.array([False, False, True])
    z = paper_filter(MTM, PSM, SPACE, Q, R, np.zeros(3, dtype=np.int64), lost, as_printed=False)
    np.testing.assert_allclose(z, [[0.0, 0.0], [2.5, 5.0], [2.125, 4.25]], rtol=1e-14)


def test_as_printed_assimilates_the_last_channel_alone() -> None:
    first_moved, last_moved = PSM + np.array([5.0, 0.0]), PSM + np.array([0.0, 5.0])
    before = on_all(PSM, as_printed=True)
    assert np.array_equal(on_all(first_moved, as_printed=True), before)
    assert np.all(on_all(last_moved, as_printed=True)[1:] != before[1:])
    assert np.all(on_all(first_moved, as_printed=False)[1:] != on_all(PSM, as_printed=False)[1:])


def test_a_mode_that_the_last_channel_does_not_see_runs_away_as_printed() -> None:
    space = StateSpace(np.diag([1.1, 0.5]), np.ones((2, 1)), np.eye(2), np.zeros((2, 1)))
    truth = space.simulate(np.zeros((60, 1)), np.ones(2))
    nothing = (np.zeros(60, dtype=np.int64), np.zeros(60, bool))
    arguments = (np.zeros((60, 1)), truth, space, 0.01 * np.eye(2), 0.01 * np.eye(2), *nothing)
    printed, repaired = paper_filter(*arguments, as_printed=True), paper_filter(*arguments, as_printed=False)
    assert np.all(printed[:, 0] == 0.0)
    assert truth[-1, 0] > 270
    assert abs(repaired[-1, 0] - truth[-1, 0]) < 0.01 * truth[-1, 0]


def test_delays_read_the_past_the_future_and_never_beyond_the_ends() -> None:
    psm = np.arange(10.0).reshape(5, 2)
    delays, read = np.array([3, 9, -1, 2, -7]), [0, 0, 3, 1, 4]
    none_lost = np.zeros(5, bool)
    mtm = np.zeros((5, 1))
    for as_printed in (True, False):
        drawn = paper_filter(mtm, psm, SPACE, Q, R, delays, none_lost, as_printed=as_printed)
        sorted_out = paper_filter(mtm, psm[read], SPACE, Q, R, 0 * delays, none_lost, as_printed=as_printed)
        assert np.array_equal(drawn, sorted_out)


def test_what_is_lost_is_read_again_and_before_that_the_operating_point() -> None:
    psm = np.arange(1.0, 11.0).reshape(5, 2)
    lost = np.array([True, True, False, True, True])
    seen = np.vstack([np.zeros((2, 2)), psm[[2, 2, 2]]])
    no_delay, mtm = np.zeros(5, dtype=np.int64), np.zeros((5, 1))
    z = paper_filter(mtm, psm, SPACE, Q, R, no_delay, lost, as_printed=True)
    assert np.array_equal(z, paper_filter(mtm, seen, SPACE, Q, R, no_delay, np.zeros(5, bool), as_printed=True))


@given(seed=st.integers(0, 10_000), n=st.integers(1, 3), n_samples=st.integers(2, 6))
@settings(max_examples=25, deadline=None)
def test_repaired_is_the_conditioned_gaussian(seed: int, n: int, n_samples: int) -> None:
    rng = np.random.default_rng(seed)
    p = 3
    A, B, C = rng.normal(size=(n, n)) / 2, rng.normal(size=(n, 2)), rng.normal(size=(p, n))
    root = rng.normal(size=(n, n))
    noise_q, noise_r = root @ root.T, np.diag(rng.uniform(0.2, 2.0, p))
    mtm, psm = rng.normal(size=(n_samples, 2)), rng.normal(size=(n_samples, p))
    z = paper_filter(
        mtm,
        psm,
        StateSpace(A, B, C, np.zeros((p, 2))),
        noise_q,
        noise_r,
        np.zeros(n_samples, dtype=np.int64),
        np.zeros(n_samples, bool),
        as_printed=False,
    )
    # All states are a linear map of (x[0], w[1], ..., w[N-1]); the measurements 1..N-1 condition them.
    blocks = np.zeros((n_samples, n, n_samples, n))
    mean = np.zeros((n_samples, n))
    blocks[0, :, 0] = np.eye(n)
    for k in range(1, n_samples):
        blocks[k] = np.tensordot(A, blocks[k - 1], axes=1)
        blocks[k, :, k] += np.eye(n)
        mean[k] = A @ mean[k - 1] + B @ mtm[k - 1]
    to_states = blocks.reshape(n_samples * n, n_samples * n)
    drive = np.kron(np.eye(n_samples), noise_q)
    drive[:n, :n] = np.eye(n)
    states = to_states @ drive @ to_states.T
    see = np.kron(np.eye(n_samples), C)[p:]
    innovation = psm[1:].ravel() - see @ mean.ravel()
    S = see @ states @ see.T + np.kron(np.eye(n_samples - 1), noise_r)
    last = mean[-1] + (states @ see.T @ np.linalg.solve(S, innovation))[-n:]
    np.testing.assert_allclose(z[-1], C @ last, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("as_printed", [True, False])
def test_without_states_it_stays_at_the_operating_point(as_printed: bool) -> None:
    none = StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((2, 0)), np.ones((2, 1)))
    nothing = (np.zeros(3, dtype=np.int64), np.zeros(3, bool))
    z = paper_filter(MTM, PSM, none, np.zeros((0, 0)), R, *nothing, as_printed=as_printed)
    assert np.array_equal(z, np.zeros((3, 2)))
