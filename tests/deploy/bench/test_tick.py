"""The tick's budget: times are noise, but what a tick sends, records and calls is the same on every machine."""

import io

import pytest
from rich.console import Console

from tis.deploy.bench.tick import bench_tick, counts_of
from tis.deploy.run.resolve import resolve

MOST_CALLS = {"[left]": 440, "[left, right]": 860}
"""Calls of functions, Python's and C's, in a tick of the first second at 1 kHz; 439 and 858 on CPython 3.11."""


@pytest.mark.parametrize("hands", MOST_CALLS)
def test_a_tick_keeps_its_budget(hands: str) -> None:
    counts = counts_of(resolve("kilohertz", (f"source.hands={hands}", "duration_s=1"), None, None))
    n_hands = hands.count(",") + 1
    assert counts.messages == pytest.approx(3 * n_hands, abs=0.1)  # estimate, measured place, set point
    assert counts.records == pytest.approx(1 + 11 * n_hands, abs=0.1)
    assert counts.calls < MOST_CALLS[hands]


def test_the_table_shows_each_part_beside_a_bare_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tis.deploy.bench.tick._RATES_HZ", (30,))
    monkeypatch.setattr("tis.deploy.bench.tick._HANDS", {"one hand": "[left]"})
    text = io.StringIO()
    figures = bench_tick(2.0, 1, Console(file=text, width=120))
    for name in ("tangent_ls", "innovations_kf", "safety", "arm", "bare loop", "receive", "calls"):
        assert name in text.getvalue()
    for hands in figures["30"].values():
        assert set(hands["counts"]) == {"messages", "records", "calls"}
        assert hands["us"]["bare loop"] < hands["us"]["tick"]
