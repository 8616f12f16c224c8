"""Smoothing against the enumeration of all paths."""

from itertools import product
from math import log

import numpy as np
import pytest

from tis.netem.fit.switching import smooth


@pytest.mark.parametrize(("n", "k"), [(1, 2), (2, 2), (5, 2), (7, 3), (10, 2)])
def test_posteriors_and_likelihood_are_those_of_all_paths(n: int, k: int) -> None:
    rng = np.random.default_rng(n)
    first, steps = rng.random(k), rng.random((n - 1, k, k)) * 1e-3
    states, pairs, total = np.zeros((n, k)), np.zeros((n - 1, k, k)), 0.0
    for path in product(range(k), repeat=n):
        weight = first[path[0]] * np.prod([steps[i, path[i], path[i + 1]] for i in range(n - 1)])
        total += weight
        states[np.arange(n), path] += weight
        for i in range(n - 1):
            pairs[i, path[i], path[i + 1]] += weight
    found = smooth(first, steps)
    assert found.states == pytest.approx(states / total)
    assert found.steps == pytest.approx(pairs / total)
    assert found.log_likelihood == pytest.approx(log(total))


def test_a_long_record_neither_vanishes_nor_grows() -> None:
    steps = np.broadcast_to(np.array([[1e-9, 1e-12], [1e-12, 1e-9]]), (50_000, 2, 2))
    found = smooth(np.array([1.0, 1e-30]), steps)
    assert np.isfinite(found.log_likelihood)
    assert found.states.sum(axis=1) == pytest.approx(np.ones(50_001))
    assert found.states[-1] == pytest.approx([0.5, 0.5], abs=1e-6)
