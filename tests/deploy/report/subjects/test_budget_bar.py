"""The bar of the latency's parts: means that add up, drawn in proportion."""

import re

import numpy as np
import pytest

from tis.common.metrics.latency import latency_parts
from tis.deploy.report.subjects.latency import budget_bar, budget_ms

MS = 1_000_000


def test_the_means_of_the_parts_add_up_to_the_mean_of_the_whole() -> None:
    rng = np.random.default_rng(3)
    instants = np.cumsum(rng.integers(0, 40 * MS, (5, 200)), axis=0)
    parts = latency_parts(*instants)
    means = budget_ms(parts)
    assert list(means) == ["surgeon", "network", "tick_wait", "compute"]
    assert sum(means.values()) == pytest.approx(parts.end_to_end.mean() / MS)


def test_a_piece_is_as_wide_as_its_share_and_the_longest_is_named() -> None:
    markup = budget_bar({"surgeon": 0.0, "network": 30.0, "tick_wait": 8.0, "compute": 2.0})
    assert re.findall(r"width:([\d.]+)%", markup) == ["75.00", "20.00", "5.00"]
    assert "40.0\u00a0ms pass in the mean" in markup
    assert "here network, mean 30.0\u00a0ms, 75\u00a0% of the whole" in markup
    for text in ("surgeon 0 ms", "network 30.0 ms", "wait for the tick 8.00 ms", "compute 2.00 ms"):
        assert f"</i>{text}</li>" in markup


def test_without_samples_there_is_no_bar() -> None:
    nothing = np.empty(0, dtype=np.int64)
    assert budget_ms(latency_parts(*[nothing] * 5)) == {}
    assert budget_bar({}) == ""
