"""`tis bench recording`, live for a moment: what it shows is what the sides did."""

import io
import os

import pytest
from rich.console import Console

from common.runtime.ticks_only import RECORD_VARIABLE
from deploy.bench.recording import bench_recording

SECONDS = 2.0


@pytest.mark.live
def test_both_ways_are_run_and_the_ticks_of_both_are_there() -> None:
    text = io.StringIO()
    figures = bench_recording(SECONDS, 1, Console(file=text, width=120))
    for side in ("surgeon", "patient"):
        for what in ("with", "without"):
            entry = figures[side][what]
            assert entry["count"] == 1000 * SECONDS
            assert 0 <= entry["missed"] <= entry["count"]
            assert entry["lateness_us"]["p50"] > 0
            assert entry["lateness_us"]["p50"] <= entry["lateness_us"]["p99"]
    assert figures["log_mb"] > 0.1
    assert "without recording: missed ticks surgeon" in text.getvalue()
    assert RECORD_VARIABLE not in os.environ
