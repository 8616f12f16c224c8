"""A table of quantiles is near the sample it stands for, and small."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tis.netem.fit.marginal import QuantileTable, quantile_table


def sample(name: str, n: int = 20_000) -> np.ndarray:
    """Return delays in ns at the midpoints of n equal shares: no random numbers."""
    p = (np.arange(n) + 0.5) / n
    law = {
        "normal": stats.norm(20, 2),
        "exponential": stats.expon(5, 10),
        "pareto": stats.lomax(4.5, loc=1, scale=30),
        "two_peaks": None,
    }[name]
    ms = np.where(p < 0.5, 20 + p, 80 + p) if law is None else law.ppf(p)
    return np.rint(ms * 1e6).astype(np.int64)


def distance(table: QuantileTable, delay_ns: np.ndarray) -> float:
    """Return the 2-Wasserstein distance on a grid of probabilities, in standard deviations of the sample."""
    p = np.linspace(0, 1, 50_001)
    of_sample = np.quantile(delay_ns, p)  # definition 7 of Hyndman and Fan, by numpy
    return float(np.sqrt(np.mean((np.interp(p, table.p, table.delay_ns) - of_sample) ** 2)) / delay_ns.std())


@pytest.mark.parametrize("name", ["normal", "exponential", "pareto", "two_peaks"])
@pytest.mark.parametrize("tolerance", [0.02, 0.005])
def test_no_farther_than_asked_and_not_all_points(name: str, tolerance: float) -> None:
    delay_ns = sample(name)
    table = quantile_table(delay_ns, tolerance)
    assert distance(table, delay_ns) <= tolerance * 1.01
    assert len(table.p) <= 60


def test_the_usual_quantiles_are_exact() -> None:
    delay_ns = sample("exponential")
    table = quantile_table(delay_ns, tolerance=0.1)
    for p in (0.5, 0.9, 0.99, 0.999):
        assert np.interp(p, table.p, table.delay_ns) == pytest.approx(np.quantile(delay_ns, p), rel=1e-3)


def test_a_bound_on_points_is_kept() -> None:
    assert len(quantile_table(sample("pareto"), tolerance=0, most=12).p) == 12


@given(st.lists(st.integers(0, 10**9), min_size=2, max_size=60))
def test_a_table_is_what_a_scenario_takes(values: list[int]) -> None:
    """From p = 0 to p = 1, strictly; from minimum to maximum, ascending; small samples are kept whole."""
    delay_ns = np.array(values)
    table = quantile_table(delay_ns, tolerance=0)
    assert (table.p[0], table.p[-1]) == (0, 1)
    assert np.all(np.diff(table.p) > 0)
    assert np.all(np.diff(table.delay_ns) >= 0)
    assert (table.delay_ns[0], table.delay_ns[-1]) == (min(values), max(values))
    assert delay_ns.std() == 0 or distance(table, delay_ns) <= 1e-9
