"""Thinning of points for long runs: figures stay small and keep extremes."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
MAX_POINTS = 8000
"""Points of one line or cloud; a minute at 30 Hz is drawn in full, even all messages of two hands."""


def evenly(n: int, most: int = MAX_POINTS) -> Indices:
    """Return at most ``most`` of the indices 0..n-1, evenly spaced."""
    return np.arange(0, n, max(-(-n // most), 1), dtype=np.int64)


def evenly_and_largest(values: ArrayLike, most: int = MAX_POINTS) -> Indices:
    """Return at most ``most`` indices, in order: evenly spaced ones, so that a cloud keeps its shape, and the peaks.

    One in twenty of them goes to the largest values. Oracle: sorting in the tests.
    """
    column = np.asarray(values, dtype=np.float64)
    if len(column) <= most:
        return evenly(len(column), most)
    n_largest = most // 20
    largest = np.argsort(column, kind="stable")[-n_largest:] if n_largest else np.empty(0, dtype=np.int64)
    return np.union1d(evenly(len(column), most - n_largest), largest)


def worst(values: ArrayLike, most: int = MAX_POINTS) -> Indices:
    """Return the index of the largest value of each of at most ``most`` runs of neighbours, in order.

    NaN counts as smaller than any number, so a peak is never dropped. Oracle: a loop in the tests.
    """
    column = np.nan_to_num(np.asarray(values, dtype=np.float64), nan=-np.inf, neginf=-np.inf)
    n = len(column)
    width = max(-(-n // most), 1)
    padded = np.full(-(-n // width) * width, -np.inf)
    padded[:n] = column
    chosen = np.argmax(padded.reshape(-1, width), axis=1) + np.arange(0, len(padded), width)
    # argmax takes the first of equals, so padding never wins, not even in a last run of NaN alone
    return np.asarray(chosen, dtype=np.int64)


def distribution(values: ArrayLike, most: int = 600) -> tuple[Array, Array]:
    """Return (value, percent of all that are at or below it): nearest-rank percentiles, as in the tables.

    The largest value is always among them. Oracle: counting in the tests.
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    n = len(ordered)
    rank = np.arange(n) if n <= most else np.unique(np.linspace(0, n - 1, most).round().astype(np.int64))
    return ordered[rank], 100 * (rank + 1) / max(n, 1)


def column(values: ArrayLike) -> NDArray[np.float32]:
    """Return values for drawing, in single precision: more digits than a screen shows, at half the size."""
    return np.asarray(values, dtype=np.float32)
