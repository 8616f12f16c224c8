"""Benchmark of recording (`tis bench recording`): its effect on the punctuality of a live run at 1 kHz.

The scenario ``kilohertz`` runs live, alternately with and without recording (`tis.common.runtime.recorder`), so
that other load of the machine affects both equally. The loops of the sides make the same records in both cases.
"""

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from tis.common.channels import Side
from tis.common.errors import EXIT_OK, DataError, Fault
from tis.common.metrics.latency import tick_summary
from tis.common.records import TICKS
from tis.common.runtime.recorder import RECORD_VARIABLE, TICKS_ONLY
from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import load_run
from tis.deploy.present.table import SIMPLE, Column, Table
from tis.deploy.run.resolve import resolve
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.launch import launch

_SCENARIO: Final = "kilohertz"
_SIDES: Final[tuple[Side, ...]] = ("surgeon", "patient")
_SHOWN: Final = ("p50", "p99", "max")

Ticks = Mapping[Side, NDArray[np.int64]]


def bench_recording(seconds: float, rounds: int, out: Console) -> dict[str, Any]:
    """Run ``rounds`` times with and without recording, ``seconds`` each; print and return figures by side."""
    scenario = resolve(_SCENARIO, (), None, seconds)
    found: dict[bool, list[Ticks]] = {True: [], False: []}
    sizes_mb: list[float] = []
    for k in range(rounds):
        for records in (True, False) if k % 2 == 0 else (False, True):
            ticks, n_bytes = _run(scenario, records)
            found[records].append(ticks)
            if records:
                sizes_mb.append(n_bytes * 1e-6)
            missed = ", ".join(f"{side} {int(its[2].sum())}" for side, its in ticks.items())
            what = "with" if records else "without"
            out.print(f"round {k + 1} {what} recording: missed ticks {missed}; load {os.getloadavg()[0]:.1f}")
    words = (Column("side", words=True, wraps=True), Column("recording", words=True, wraps=True))
    numbers = (Column(head, wraps=True) for head in ("ticks", "missed", *(f"late, {name}" for name in _SHOWN)))
    rows = []
    figures: dict[str, Any] = {"seconds": seconds, "rounds": rounds, "log_mb": float(np.mean(sizes_mb))}
    for side in _SIDES:
        figures[side] = {}
        for records, runs in found.items():
            due_ns, begin_ns, missed = np.concatenate([run[side] for run in runs], axis=1)
            entry = tick_summary(scenario.rate_hz, due_ns, begin_ns, missed.astype(np.bool_))
            what = "with" if records else "without"
            figures[side][what] = entry
            late_us = entry["lateness_us"]
            assert isinstance(late_us, dict)
            late = (f"{late_us[name]:.0f} us" for name in _SHOWN)
            rows.append((side, what, entry["count"], entry["missed"], *late))
    out.print(Table(f"Ticks at {scenario.rate_hz} Hz", (*words, *numbers), rows).terminal(SIMPLE))
    out.print(f"Recording wrote {figures['log_mb']:.1f} MB a run, three logs together.", soft_wrap=True)
    return figures


def _run(scenario: Scenario, records: bool) -> tuple[Ticks, int]:
    """Return a live run's ticks, (3, T): due, begun, missed; and the bytes of its logs. Raises `DataError`."""
    with tempfile.TemporaryDirectory() as scratch, _recording(records):
        run_dir = folder.create(Path(scratch) / "run", scenario)
        outcome = launch(scenario, run_dir, lambda _: None)
        if outcome.exit_code != EXIT_OK:
            raise DataError(Fault("tis bench recording", "", f"the run failed: {'; '.join(outcome.reasons)}"))
        logs = load_run(run_dir, (TICKS,))
        ticks = {}
        for side in _SIDES:
            rows = logs.of(side, TICKS)
            ticks[side] = np.stack([rows.column(name).astype(np.int64) for name in ("due_ns", "begin_ns", "missed")])
        return ticks, sum(path.stat().st_size for path in run_dir.glob("*.mcap"))


@contextmanager
def _recording(records: bool) -> Iterator[None]:
    """Make sides started within the block record everything, or their ticks only."""
    before = os.environ.pop(RECORD_VARIABLE, None)
    if not records:
        os.environ[RECORD_VARIABLE] = TICKS_ONLY
    try:
        yield
    finally:
        os.environ.pop(RECORD_VARIABLE, None)
        if before is not None:
            os.environ[RECORD_VARIABLE] = before
