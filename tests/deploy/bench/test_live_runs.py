"""`tis bench recording`, live for a moment: what it shows is what the sides did."""

import io
import os
from pathlib import Path

import pytest
from rich.console import Console

from tests.deploy.hold_only import HOLD
from tis.common.audit import AUDIT_VARIABLE
from tis.common.runtime.credentials import credentials
from tis.common.runtime.recorder import RECORD_VARIABLE
from tis.common.scenario import Scenario
from tis.deploy.bench import live_runs
from tis.deploy.bench.live_runs import Price, bench_security
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

    monkeypatch.setattr(live_runs, "resolve", with_model)
    text = io.StringIO()
    figures = live_runs.bench_recording(SECONDS, 1, Console(file=text, width=120))
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


def test_each_kind_runs_as_often_with_credentials_that_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[str] = []

    def price(scenario: Scenario, where: Path) -> Price:
        kind = "signed" if scenario.security.sign else str(scenario.security.kind)
        kind = "bare mtls" if AUDIT_VARIABLE in os.environ else kind
        for side in ("surgeon", "netem", "patient"):
            assert bool(credentials(scenario.security, side)) == (kind != "none")
        ran.append(kind)
        return {
            "none": Price(2.0, 1.0, 10.0, 8.0), "password": Price(2.0, 1.0, 11.0, 8.0),
            "bare mtls": Price(2.5, 1.5, 10.0, 8.0 + len(ran)), "mtls": Price(3.0, 1.5, 12.0, 9.0),
            "signed": Price(3.0, 1.5, 12.0, 10.0),
        }[kind]  # fmt: skip

    monkeypatch.setattr(live_runs, "_price", price)
    out = io.StringIO()
    figures = bench_security(1.0, 3, Console(file=out, width=80))
    kinds = ["none", "password", "bare mtls", "mtls", "signed"]
    assert ran == [*kinds, *kinds[1:], *kinds[:1], *kinds[2:], *kinds[:2]], "interleaved"
    assert AUDIT_VARIABLE not in os.environ
    assert figures["mtls"]["end_to_end_ms"] == 3.0
    of_each_round = [9.0 / (8.0 + n) for n in (ran.index("bare mtls") + 1, 7, 11)]
    assert figures["mtls"]["beside_bare_mtls"]["sides_us"] == pytest.approx(sorted(of_each_round)[1])
    [row] = [line for line in out.getvalue().splitlines() if line.strip().startswith("mtls")]
    assert row.split() == ["mtls", "3.000", "1.20", "1.500", "1.00", "12", "1.20", "9", "0.60"]
