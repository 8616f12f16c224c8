"""`tis bench recording`, live for a moment: what it shows is what the sides did."""

import io
import os
from pathlib import Path

import pytest
from rich.console import Console

from tests.deploy.hold_only import HOLD
from tis.common.runtime.recorder import RECORD_VARIABLE
from tis.common.scenario import Scenario
from tis.deploy.bench import recording
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides
from tis.patient_side.identification.model_file import dump_models

SECONDS = 1.0
SMALL = ("identification.train_samples=600", "identification.block_rows=3", "identification.order=2")


@pytest.mark.slow
@pytest.mark.live
def test_both_ways_are_run_and_the_ticks_of_both_are_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a model from a file: at 1 kHz the patient would take longer to find one than the runs last."""
    _, models, _ = build_sides(resolve("kilohertz", (*HOLD, *SMALL), None, SECONDS))
    (tmp_path / "model.json").write_bytes(dump_models(models))
    settings = (
        *HOLD,
        f"identification.train={tmp_path / 'model.json'}",
    )

    def with_model(name: str, _: object, seed: int | None, duration_s: float) -> Scenario:
        return resolve(name, settings, seed, duration_s)

    monkeypatch.setattr(recording, "resolve", with_model)
    text = io.StringIO()
    figures = recording.bench_recording(SECONDS, 1, Console(file=text, width=120))
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
