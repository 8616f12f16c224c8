"""Statistics by hand and by numpy's own functions."""

import numpy as np
import pytest

from tis.netem.fit.statistics import NAMES, statistics_of

MS = 1_000_000


def of(delay_ns: list[int] | np.ndarray, every_ms: float = 100) -> dict[str, float]:
    sent_ns = np.arange(len(delay_ns)) * round(every_ms * MS)
    return dict(zip(NAMES, statistics_of(sent_ns, np.asarray(delay_ns)), strict=True))


def test_by_hand() -> None:
    """Ten messages a second: seconds 0 and 2 lose 2 and 3 of ten; 20 % is not above 20 %."""
    delay_ns = np.full(30, 10 * MS)
    delay_ns[[3, 4, 25, 26, 27]] = -1
    delay_ns[[5, 24]] = 30 * MS
    found = of(delay_ns)
    assert found["loss, %"] == pytest.approx(100 * 5 / 30)
    assert found["mean delay, ms"] == pytest.approx((23 * 10 + 2 * 30) / 25)
    assert found["p50, ms"] == 10
    assert found["delay beside losses, ms"] == pytest.approx((6 * 10 + 2 * 30) / 8)
    assert found["longest run of losses"] == 3
    assert found["seconds above 20 % loss"] == 1


def test_the_autocorrelation_is_that_of_pairs_at_the_lag() -> None:
    rng = np.random.default_rng(1)
    delay_ns = np.rint(20 * MS + np.cumsum(rng.normal(size=5000)) * MS / 10 + 20 * MS).astype(np.int64)
    found = of(delay_ns, every_ms=10)
    for lag_s, k in ((0.1, 10), (1, 100), (10, 1000)):
        expected = np.corrcoef(delay_ns[:-k], delay_ns[k:])[0, 1]
        assert found[f"autocorrelation at {lag_s:g} s"] == pytest.approx(expected, abs=1e-9)


def test_what_a_record_cannot_have_is_undefined() -> None:
    rare = of([10 * MS, 11 * MS] * 200, every_ms=1000)
    assert np.isnan(rare["autocorrelation at 0.1 s"])
    assert rare["autocorrelation at 1 s"] == pytest.approx(-1)
    assert np.isnan(of([10 * MS] * 200)["autocorrelation at 1 s"])
    assert np.isnan(of([10 * MS] * 200)["delay beside losses, ms"])
    none = of([-1] * 30)
    assert (none["loss, %"], none["longest run of losses"], none["seconds above 20 % loss"]) == (100, 30, 3)
