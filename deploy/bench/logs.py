"""Benchmark of logs (`tis bench logs`): size of recordings, and time and memory to merge and report them.

The recordings are twins of the default scenario, faster than live runs; all are made first, one on each core. Then
each command runs alone, in a child process.
"""

import os
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from tis.common.channels import Side
from tis.common.errors import EXIT_INVALID_RUN, EXIT_LOSSY_RECOVERY, EXIT_OK, DataError, Fault
from tis.deploy.bench.measured_command import measure
from tis.deploy.compare.engine.workers import begin_worker
from tis.deploy.present.table import Column, Row, Table
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides, run_twin
from tis.deploy.shell import run_dir as folder

_MB: Final = 1e-6
_HOUR_S: Final = 3600.0
_SHORTER_BY: Final = 3
_LOGS: Final[tuple[Side, ...]] = ("surgeon", "netem", "patient")
_TIS: Final = ("-m", "tis.deploy.cli.main")
_STEPS: Final[Mapping[str, tuple[str, ...]]] = {
    "tis merge": (*_TIS, "merge"),
    "tis report": (*_TIS, "report"),
    "tis summarize (all)": (*_TIS, "summarize"),
    "tis export --csv": (*_TIS, "export", "--csv"),
    "tis.deploy.logs.read.load": ("-c", "import sys; from tis.deploy.report import load; load(sys.argv[1])"),
}
_BOUNDED: Final = ("tis summarize (all)", "tis export --csv", "tis.deploy.logs.read.load")
"""Steps with bounds of time and memory."""


@dataclass(frozen=True)
class Case:
    """Rate and full length of a recording; bounds are for that length.

    ``max_mb`` applies to all files of a run together.
    """

    rate_hz: int
    whole_s: float
    settings: tuple[str, ...] = ()
    max_mb: float | None = None
    max_s: float | None = None
    max_peak_mb: float | None = None


CASES: Final = (
    Case(30, _HOUR_S, max_mb=250.0),
    Case(
        1000,
        600.0,
        # four estimators, as at 30 Hz, but fast ones: only their records matter here
        (
            "rate_hz=1000",
            "patient.tick_phase_ms=0.2",
            "identification.block_rows=2",
            "estimators=[hold, damped_velocity, moesp_kf, arx_kf]",
            "active_estimator=damped_velocity",
        ),
        max_s=60.0,
        max_peak_mb=1000.0,
    ),
)


def bench_logs(seconds: float, whole: bool, out: Console) -> dict[str, Any]:
    """Measure both cases; print figures and bounds, return them.

    ``whole``: recordings of the full length. Otherwise two, of ``seconds`` and a third of it, with a linear
    extrapolation to the full length.
    """
    rows: list[Row] = []
    lengths = {k: (case.whole_s,) if whole else (seconds, seconds / _SHORTER_BY) for k, case in enumerate(CASES)}
    figures: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as scratch:
        recorded = _record_all([(k, length_s) for k in lengths for length_s in lengths[k]], Path(scratch), out)
        for k, case in enumerate(CASES):
            found, *less = (_measure(recorded[k, length_s], length_s, out) for length_s in lengths[k])
            figures[f"{case.rate_hz}_hz"] = found
            rows += [*_rows(case, found, less[0] if less else None), ()]
    heads = ("rate", "recorded", "what", "measured", "for the whole", "bound", "load")
    columns = [Column(head, words=head not in ("measured", "for the whole", "bound")) for head in heads]
    out.print(Table("Recordings", columns, rows).terminal())
    out.print("The whole is an hour at 30 Hz, and ten minutes at 1 kHz.", soft_wrap=True)
    return figures


def _record_all(cases: Sequence[tuple[int, float]], scratch: Path, out: Console) -> dict[tuple[int, float], Path]:
    """Record each case (by its place in `CASES`) and length, the longest first; return the run folders."""
    places = {one: scratch / f"{CASES[one[0]].rate_hz}_hz_{one[1]:.0f}_s" for one in cases}
    begun_s = time.perf_counter()
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), begin_worker) as pool:
        jobs = [pool.submit(_record, *one, places[one]) for one in sorted(cases, reverse=True)]
        for job in jobs:
            job.result()
    took_s = time.perf_counter() - begun_s
    out.print(f"{len(jobs)} recordings made in {took_s:.0f} s, {sum(one[1] for one in cases):.0f} s of run time")
    return places


def _record(k: int, length_s: float, run_dir: Path) -> None:
    scenario = resolve("default", CASES[k].settings, None, length_s)
    folder.create(run_dir, scenario)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, run_dir)


def _measure(run_dir: Path, recorded_s: float, out: Console) -> dict[str, float]:
    found = {"recorded_s": recorded_s, "logs_mb": sum(_mb(run_dir / f"{side}.mcap") for side in _LOGS)}
    for step, command in _STEPS.items():
        load = os.getloadavg()[0]
        used = measure([sys.executable, *command, str(run_dir)])
        if used.exit_code not in (EXIT_OK, EXIT_INVALID_RUN, EXIT_LOSSY_RECOVERY):
            raise DataError(Fault("tis bench logs", step, "must succeed", used.exit_code))
        found |= {f"{step}, s": used.wall_s, f"{step}, cpu s": used.cpu_s, f"{step}, MB": used.peak_mb}
        found |= {f"{step}, load": load}
        out.print(
            f"{run_dir.name}: {step} took {used.wall_s:.1f} s ({used.cpu_s:.1f} s of CPU), {used.peak_mb:.0f} MB, "
            f"load {load:.1f} before"
        )
    found["merged_mb"] = _mb(run_dir / folder.MERGED_FILE)
    return {**found, "both_mb": found["logs_mb"] + found["merged_mb"]}


def _mb(path: Path) -> float:
    return path.stat().st_size * _MB


def _rows(case: Case, found: Mapping[str, float], less: Mapping[str, float] | None) -> Iterator[Row]:
    lines = [
        ("logs_mb", "the three logs", "MB", None),
        ("merged_mb", "run.mcap", "MB", None),
        ("both_mb", "all four", "MB", case.max_mb),
    ]
    for step in _STEPS:
        bounds = (case.max_s, case.max_peak_mb) if step in _BOUNDED else (None, None)
        lines += [(f"{step}, s", step, "s", bounds[0]), (f"{step}, MB", f"{step}, memory", "MB", bounds[1])]
    for name, what, unit, bound in lines:
        value = found[name]
        if less is not None:
            slope = (value - less[name]) / (found["recorded_s"] - less["recorded_s"])
            value += slope * (case.whole_s - found["recorded_s"])
        verdict = "" if bound is None else f"{bound:g} {unit} {'met' if value <= bound else 'MISSED'}"
        load = found.get(f"{what}, load")
        shown = "" if load is None else f"{load:.1f}"
        measured = (f"{found[name]:.2f} {unit}", f"{value:.1f} {unit}")
        yield f"{case.rate_hz} Hz", f"{found['recorded_s']:g} s", what, *measured, verdict, shown
