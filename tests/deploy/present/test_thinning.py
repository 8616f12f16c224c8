"""What is left out of a figure, and that nothing extreme is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.deploy.present.thinning import distribution, evenly, evenly_and_largest, worst

VALUES = st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), max_size=200)
NUMBERS = st.lists(st.floats(0, 1e6), max_size=200)
MOST = st.integers(20, 60)


@given(st.integers(0, 1000), st.integers(1, 100))
@settings(max_examples=60)
def test_even_spacing_keeps_all_or_skips_as_many_each_time(n: int, most: int) -> None:
    kept = evenly(n, most)
    assert len(kept) <= most
    assert list(kept) == list(range(n)) if n <= most else len(set(np.diff(kept))) <= 1
    assert n == 0 or kept[0] == 0


@given(VALUES, MOST)
@settings(max_examples=60)
def test_the_worst_of_each_run_of_neighbours_is_kept(values: list[float], most: int) -> None:
    kept = [int(i) for i in worst(values, most)]
    width = max(-(-len(values) // most), 1)
    expected = []
    for first in range(0, len(values), width):
        run = range(first, min(first + width, len(values)))
        numbers = [i for i in run if values[i] == values[i]]
        expected.append(max(numbers, key=lambda i: values[i]) if numbers else first)
    assert kept == expected


@given(NUMBERS, MOST)
@settings(max_examples=60)
def test_a_thinned_cloud_is_in_order_and_has_the_largest(values: list[float], most: int) -> None:
    kept = [int(i) for i in evenly_and_largest(values, most)]
    assert len(kept) <= most
    assert kept == sorted(set(kept))
    largest = sorted(values)[-(most // 20) :]
    remaining = [values[i] for i in kept]
    for value in largest:
        assert value in remaining


def test_a_thinned_cloud_keeps_its_shape() -> None:
    """Of a uniform cloud, about half of what is kept lies in its lower half."""
    values = (np.arange(100_000) * 0.618033988749895) % 1.0
    kept = values[evenly_and_largest(values, 8000)]
    assert np.mean(kept < 0.5) == pytest.approx(0.475, abs=0.02)  # one in twenty is a peak


@given(st.lists(st.integers(0, 30), min_size=1, max_size=80), st.integers(2, 20))
@settings(max_examples=60)
def test_a_distribution_says_how_many_values_are_at_or_below(values: list[int], most: int) -> None:
    at, percent = distribution(values, most)
    assert len(at) <= max(most, 2)
    assert at[-1] == max(values)
    assert percent[-1] == 100
    for value, share in zip(at, percent, strict=True):
        below = sum(1 for v in values if v < value)
        at_or_below = sum(1 for v in values if v <= value)
        assert below < share * len(values) / 100 + 1e-9 <= at_or_below + 1e-6


def test_nothing_has_an_empty_distribution() -> None:
    at, percent = distribution([])
    assert len(at) == len(percent) == len(worst([])) == len(evenly(0)) == 0
