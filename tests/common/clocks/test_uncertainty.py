import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.clocks.uncertainty import is_resolvable, uncertainties
from tis.common.metrics.percentiles import summarise


@given(st.lists(st.tuples(st.integers(0, 100), st.integers(0, 30)), min_size=1, max_size=60), st.integers(0, 2**32))
@settings(max_examples=100)
def test_the_figure_of_the_true_values_lies_within_its_uncertainty(pairs: list[tuple[int, int]], seed: int) -> None:
    """The true values are drawn within the uncertainty of the measured ones."""
    measured, open_ = np.array(pairs, dtype=float).T
    true = measured + open_ * np.random.default_rng(seed).uniform(-1, 1, len(measured))
    names = {"percentiles": (5, 50, 95, 99), "also": ("mean", "max")}
    found, right = (summarise(values, **names) for values in (measured, true))  # type: ignore[arg-type]
    bounds = uncertainties(measured, open_, **names)  # type: ignore[arg-type]
    assert bounds.keys() == found.keys()
    for name, bound in bounds.items():
        value, expected = found[name], right[name]
        assert value is not None and expected is not None and bound is not None  # noqa: PT018
        assert abs(value - expected) <= bound + 1e-9


def test_worked_on_paper() -> None:
    """Of 10, 20 and 30 the middle one may be off by 15: it can be the largest, and the median by 10 less."""
    assert uncertainties([10, 20, 30], [0, 15, 0], percentiles=(50,)) == {"p50": 10, "max": 5}
    assert uncertainties([], []) == {"p50": None, "p95": None, "p99": None, "max": None}


def test_what_is_open_by_more_than_its_size_is_not_resolvable() -> None:
    assert is_resolvable(12.41, 0.08)
    assert is_resolvable(0.08, 0.08)
    assert not is_resolvable(0.05, 0.08)
    assert not is_resolvable(-0.05, 0.08)  # an arrival before the sending
    assert is_resolvable(None, 0.08)
    assert is_resolvable(0.0, 0.0)
    assert is_resolvable(1.0, None)
