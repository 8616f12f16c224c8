import numpy as np

from tis.common.streams import Stream
from tis.patient_side.learning.fit_srlsmf import decompose
from tis.patient_side.model_fields import Floats

N, RANK = 60, 4
STREAM = Stream.named(1, "test")


def made(seed: int = 0, n_spikes: int = 20) -> tuple[Floats, Floats]:
    """A symmetric matrix of rank 4, and spikes in few entries."""
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(N, RANK))
    spikes = np.zeros((N, N))
    rows, columns = rng.integers(0, N, (2, n_spikes))
    spikes[rows, columns] = spikes[columns, rows] = 30.0
    return half @ half.T, spikes


def test_both_parts_are_found() -> None:
    low, spikes = made()
    found = decompose(low + spikes, RANK, np.count_nonzero(spikes) / N**2, "largest", STREAM)
    again = (found.vectors * found.values) @ found.vectors.T
    assert np.linalg.norm(again - low) < 0.05 * np.linalg.norm(low)
    sparse = found.sparse.toarray()
    largest = np.abs(sparse) > 15
    assert np.array_equal(largest, spikes != 0)
    np.testing.assert_allclose(found.values, sorted(np.linalg.eigvalsh(low)[-RANK:], reverse=True), rtol=0.05)


def test_a_matrix_of_that_rank_is_its_low_rank_part() -> None:
    low, _ = made()
    found = decompose(low, RANK, 0.01, "largest", STREAM)
    np.testing.assert_allclose((found.vectors * found.values) @ found.vectors.T, low, atol=1e-9 * np.abs(low).max())


def test_shrunk_entries_lose_the_bound_and_the_largest_keep_theirs() -> None:
    matrix = np.diag([5.0, 1.0, 0.5])
    kept, less = (decompose(matrix, 1, 0.1, kind, STREAM).sparse.toarray() for kind in ("largest", "shrunk"))
    # What the first component leaves are seven zeros, 0.5 and 1.0, whose 90 % quantile is 0.6.
    np.testing.assert_allclose(kept, np.diag([0.0, 1.0, 0.0]), atol=1e-6)
    np.testing.assert_allclose(less, np.diag([0.0, 0.4, 0.0]), atol=1e-6)


def test_products_are_those_of_the_sum() -> None:
    low, spikes = made()
    found = decompose(low + spikes, RANK, 0.02, "shrunk", STREAM)
    whole = (found.vectors * found.values) @ found.vectors.T + found.sparse.toarray()
    for x in (np.ones(N), np.random.default_rng(2).normal(size=(N, 5))):
        np.testing.assert_allclose(found.times(x), whole @ x, atol=1e-9)
