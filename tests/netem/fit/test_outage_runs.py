"""Outages that the tests cut out of records are found; bursts are not taken for outages."""

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from tis.common.scenario.network.conditions import Outages
from tis.common.trace import LOST, Trace
from tis.netem.fit.outages import find_outages

MS = 1_000_000


def trace(cut: list[tuple[float, float]], n: int = 30_000, p: float = 0.01, burst: float = 4.0) -> Trace:
    """300 s at 100 Hz with geometric bursts; ``cut`` are outages, in s from .. to."""
    rng = np.random.default_rng(1)
    lost = np.zeros(n, dtype=bool)
    at = 0
    while p > 0 and at < n:
        at += rng.geometric(p / burst)
        length = rng.geometric(1 / burst)
        lost[at : at + length] = True
        at += length
    sent_ns = np.arange(n) * 10 * MS
    for begin, end in cut:
        lost[(sent_ns >= begin * 1e9) & (sent_ns < end * 1e9)] = True
    return Trace("t", sent_ns, np.where(lost, LOST, 20 * MS))


def process_of(cut: list[tuple[float, float]], p: float = 0.01) -> dict[str, Any]:
    found = find_outages(trace(cut, p=p))
    assert found.begins_s == pytest.approx([begin for begin, _ in cut], abs=0.06)
    assert found.lengths_s == pytest.approx([end - begin for begin, end in cut], abs=0.1)
    assert found.process is not None
    TypeAdapter(Outages).validate_python(found.process)
    return found.process


@pytest.mark.parametrize(("p", "burst"), [(0.0, 1.0), (0.01, 1.0), (0.05, 1.5), (0.02, 4.0), (0.3, 8.0)])
def test_bursts_are_no_outages(p: float, burst: float) -> None:
    found = find_outages(trace([], p=p, burst=burst))
    assert found.process is None
    assert not found.within.any()


def test_a_single_outage_is_found_with_its_length() -> None:
    process = process_of([(100.0, 102.5)])
    assert (process["kind"], process["lengths"]) == ("poisson", "constant")
    assert process["mean_s"] == pytest.approx(2.5, abs=0.1)
    assert process["mean_gap_s"] == pytest.approx(297.5, abs=0.1)


def test_equal_outages_at_equal_intervals_are_periodic() -> None:
    process = process_of([(20 + 30 * k, 20.5 + 30 * k) for k in range(9)])
    assert process == {
        "kind": "periodic",
        "every_s": pytest.approx(30, abs=0.02),
        "for_s": pytest.approx(0.5, abs=0.05),
        "first_s": pytest.approx(20, abs=0.05),
    }


def test_memoryless_outages_keep_their_share_of_time() -> None:
    rng = np.random.default_rng(3)
    begins = np.cumsum(5 + rng.exponential(25, 8))
    lengths = 0.5 + rng.exponential(1, 8)
    cut = [(float(begin), float(begin + length)) for begin, length in zip(begins, lengths, strict=True)]
    cut = [(begin, end) for begin, end in cut if end < 300]
    process = process_of(cut)
    down_s = sum(end - begin for begin, end in cut)
    assert process["mean_s"] / (process["mean_s"] + process["mean_gap_s"]) == pytest.approx(down_s / 300, rel=0.1)


def test_uniform_ups_and_downs_are_told_from_memoryless_ones() -> None:
    cut, at = [], 5.0
    for k in range(15):
        cut.append((at, at + 1 + k % 5 / 4))
        at = cut[-1][1] + 14 + k % 4
    process = process_of(cut[:14])
    assert process["kind"] == "alternating"
    assert process["down"]["low_s"] <= 1
    assert process["down"]["high_s"] >= 2
    assert 13 <= process["up"]["low_s"] <= 14.1


def test_an_outage_of_a_record_without_other_losses_is_found() -> None:
    assert process_of([(10.0, 10.6), (200.0, 200.5)], p=0.0)["kind"] == "poisson"
