"""Cycles with stalls, outages and slow parts are found with their period and parts; noise has none."""

from typing import Any

import numpy as np
import pytest

from tests.netem.fit.synthetic_records import Parameters, record
from tis.common.trace import LOST, Trace
from tis.netem.fit.cycle import fit_cycle


def cycling(period_s: float, effect: Any, seconds: float = 300, rate_hz: float = 100, seed: int = 1) -> Trace:
    """Gamma delays; ``effect(phase_s, delay_ms, rng)`` returns those of the cycle, nan where lost."""
    rng = np.random.default_rng(seed)
    sent_s = np.arange(int(seconds * rate_hz)) / rate_hz
    delay_ms = effect(sent_s % period_s, 20 + rng.gamma(4, 2, len(sent_s)), rng)
    return Trace(
        "t",
        np.rint(sent_s * 1e9).astype(np.int64),
        np.where(np.isnan(delay_ms), LOST, np.rint(np.nan_to_num(delay_ms) * 1e6)).astype(np.int64),
    )


@pytest.mark.parametrize("period_s", [4.0, 15.0, 12.345])
def test_slow_parts_are_found_where_they_are(period_s: float) -> None:
    found = fit_cycle(cycling(period_s, lambda at, delay, _: delay + 40 * ((at >= 1) & (at < 1.5))))
    assert found is not None
    assert sum(found.lengths_s) == pytest.approx(period_s, abs=0.005)
    edges = np.cumsum([0, *found.lengths_s])
    slow = [(edges[i], edges[i + 1]) for i, leaf in enumerate(found.leaves) if leaf != found.base]
    assert slow[0][0] == pytest.approx(1, abs=0.05)
    assert slow[-1][1] == pytest.approx(1.5, abs=0.05)
    assert sum(end - begin for begin, end in slow) == pytest.approx(0.5, abs=0.08)


def test_parts_that_only_lose_are_found() -> None:
    found = fit_cycle(
        cycling(10, lambda at, delay, rng: np.where((at < 1) & (rng.random(len(at)) < 0.5), np.nan, delay))
    )
    assert found is not None
    assert sum(found.lengths_s) == pytest.approx(10, abs=0.01)
    assert found.lengths_s[0] == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("half_life", [0.05, 0.5, 3.0])
def test_correlated_delays_have_no_cycle(half_life: float) -> None:
    for seed in range(3):
        assert fit_cycle(record("bursts", Parameters(seconds=200, half_life=half_life), seed)) is None


@pytest.mark.parametrize("n", [2, 50])
def test_a_short_record_has_no_cycle(n: int) -> None:
    assert fit_cycle(Trace("t", np.arange(n) * 10_000_000, np.arange(n) * 1000 + 10**6)) is None
