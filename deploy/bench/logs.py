"""`tis bench logs`: what recordings cost on disk, and what merging and reporting them costs in time and memory.

The recordings are twins of the default scenario, so none has to be waited for. Each command runs in a child process,
whose own peak of memory the kernel reports.
"""

import os
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rich.box import SIMPLE
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from common.channels import Side
from common.errors import EXIT_INVALID_RUN, EXIT_LOSSY_RECOVERY, EXIT_OK, DataError, Fault
from common.scenario import Scenario
from deploy import run_dir as folder
from deploy.resolve import resolve
from deploy.twin import build_sides, run_twin

_MB: Final = 1e-6
_HOUR_S: Final = 3600.0
_SHORTER: Final = 3
_LOGS: Final[tuple[Side, ...]] = ("surgeon", "netem", "patient")
_STEPS: Final = {"merge": "tis merge", "report": "tis report", "summarize": "tis summarize (all)"}


@dataclass(frozen=True)
class Case:
    """A rate to record at, and what the whole recording is meant to be; bounds are for that length."""

    rate_hz: int
    whole_s: float
    settings: tuple[str, ...] = ()
    most_mb: float | None = None
    most_s: float | None = None
    most_peak_mb: float | None = None


CASES: Final = (
    Case(30, _HOUR_S, most_mb=250.0),
    Case(
        1000,
        600.0,
        # four estimators, as at 30 Hz, but quick ones: what counts here is their records
        (
            "rate_hz=1000",
            "patient.tick_phase_ms=0.2",
            "identification.block_rows=2",
            "estimators=[hold, hold_last_arrived, velocity, damped_velocity]",
            "active_estimator=velocity",
        ),
        most_s=60.0,
        most_peak_mb=1000.0,
    ),
)


def bench_logs(seconds: float, whole: bool, out: Console) -> dict[str, Any]:
    """Measure both cases; print figures and bounds, return them.

    ``whole``: recordings of the full length. Otherwise two, of ``seconds`` and a third of it, and what the whole
    would come to on the line through both.
    """
    table = Table(title="Recordings", title_justify="left", box=SIMPLE)
    for name in ("rate", "recorded", "what", "measured", "for the whole", "bound"):
        table.add_column(name, justify="right" if name in ("measured", "for the whole", "bound") else "left")
    figures: dict[str, Any] = {}
    for case in CASES:
        found = _measure(case, case.whole_s if whole else seconds)
        less = None if whole else _measure(case, seconds / _SHORTER)
        figures[f"{case.rate_hz}_hz"] = found
        for row in _rows(case, found, less):
            table.add_row(*row)
        table.add_section()
    out.print(table)
    out.print("The whole is an hour at 30 Hz, and ten minutes at 1 kHz.", soft_wrap=True)
    return figures


def _measure(case: Case, recorded_s: float) -> dict[str, float]:
    scenario = resolve("default", case.settings, None, recorded_s)
    found = {"recorded_s": recorded_s}
    with tempfile.TemporaryDirectory() as scratch:
        run_dir = Path(scratch) / "run"
        _record(scenario, run_dir)
        found["logs_mb"] = sum(_mb(run_dir / f"{side}.mcap") for side in _LOGS)
        for step in _STEPS:
            found[f"{step}_s"], found[f"{step}_peak_mb"] = _child(step, run_dir)
        found["merged_mb"] = _mb(run_dir / folder.MERGED_FILE)
    return {**found, "both_mb": found["logs_mb"] + found["merged_mb"]}


def _record(scenario: Scenario, run_dir: Path) -> None:
    folder.create(run_dir, scenario)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, run_dir)


def _mb(path: Path) -> float:
    return path.stat().st_size * _MB


def _child(step: str, run_dir: Path) -> tuple[float, float]:
    """Return how long a command took in s and the most memory it had in MB; raises `DataError` when it fails."""
    command = [sys.executable, "-m", "deploy.cli", step, str(run_dir)]
    begun_s = time.perf_counter()
    silent = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
    pid = os.posix_spawn(sys.executable, command, os.environ, file_actions=silent)
    _, status, usage = os.wait4(pid, 0)
    code = os.waitstatus_to_exitcode(status)
    if code not in (EXIT_OK, EXIT_INVALID_RUN, EXIT_LOSSY_RECOVERY):
        raise DataError(Fault("tis bench logs", f"tis {step}", "must succeed", code))
    return time.perf_counter() - begun_s, usage.ru_maxrss * 1024 * _MB


def _rows(case: Case, found: Mapping[str, float], less: Mapping[str, float] | None) -> Iterator[Sequence[str]]:
    lines = [
        ("logs_mb", "the three logs", "MB", case.most_mb),
        ("merged_mb", "run.mcap", "MB", case.most_mb),
        ("both_mb", "both", "MB", None),
    ]
    for step, what in _STEPS.items():
        most = (case.most_s, case.most_peak_mb) if step == "summarize" else (None, None)
        lines += [(f"{step}_s", what, "s", most[0]), (f"{step}_peak_mb", f"{what}, memory", "MB", most[1])]
    for name, what, unit, bound in lines:
        value = found[name]
        if less is not None:
            slope = (value - less[name]) / (found["recorded_s"] - less["recorded_s"])
            value += slope * (case.whole_s - found["recorded_s"])
        verdict = "" if bound is None else f"{bound:g} {unit} {'met' if value <= bound else 'MISSED'}"
        yield tuple(
            map(
                escape,
                (
                    f"{case.rate_hz} Hz", f"{found['recorded_s']:g} s", what, f"{found[name]:.2f} {unit}",
                    f"{value:.1f} {unit}", verdict,
                ),
            )
        )  # fmt: skip
