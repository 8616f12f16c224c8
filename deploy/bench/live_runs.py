"""Benchmarks by live runs: what recording (`tis bench recording`) and security (`tis bench security`) cost.

The kinds of a run take turns, so that other load of the machine affects all equally. For recording the scenario
``kilohertz`` runs with and without it (`tis.common.runtime.recorder`); the loops of the sides make the same records
in both cases. For security the scenario ``default`` runs without impairments of its network.
"""

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any, Final, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from tis.common.channels import FOLLOWER, Side
from tis.common.errors import EXIT_OK, DataError, Fault
from tis.common.host_records import PROCESSORS
from tis.common.metrics.latency import tick_summary
from tis.common.records import TICKS
from tis.common.runtime.recorder import RECORD_VARIABLE, TICKS_ONLY
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.load import load_run
from tis.deploy.present.table import Column, Table
from tis.deploy.report.subjects.latency import sample_latency, used_samples
from tis.deploy.run.resolve import resolve
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.launch import launch
from tis.deploy.tools.certificates import issue, new_authority

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
            ticks, n_bytes = _ticks(scenario, records)
            found[records].append(ticks)
            if records:
                sizes_mb.append(n_bytes * 1e-6)
            missed = ", ".join(f"{side} {int(its[2].sum())}" for side, its in ticks.items())
            what = "with" if records else "without"
            out.print(f"round {k + 1} {what} recording: missed ticks {missed}; load {os.getloadavg()[0]:.1f}")
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
            cells = (f"{late_us[name]:.0f} us" for name in _SHOWN)
            rows.append((side, what, entry["count"], entry["missed"], *cells))
    columns = [Column("side", words=True), Column("recording", words=True)]
    columns += [Column(head) for head in ("ticks", "missed", *(f"late, {name}" for name in _SHOWN))]
    out.print(Table(f"Ticks at {scenario.rate_hz} Hz", columns, rows).terminal())
    out.print(f"Recording wrote {figures['log_mb']:.1f} MB a run, three logs together.", soft_wrap=True)
    return figures


def _ticks(scenario: Scenario, records: bool) -> tuple[Ticks, int]:
    """Return a live run's ticks, (3, T): due, begun, missed; and the bytes of its logs. Raises `DataError`."""
    with tempfile.TemporaryDirectory() as scratch, _recording(records):
        run_dir = _run("recording", scenario, Path(scratch) / "run")
        logs = load_run(run_dir, (TICKS,))
        ticks = {}
        for side in _SIDES:
            rows = logs.of(side, TICKS)
            ticks[side] = np.stack([rows.column(name).astype(np.int64) for name in ("due_ns", "begin_ns", "missed")])
        return ticks, sum(path.stat().st_size for path in run_dir.glob("*.mcap"))


def _run(bench: str, scenario: Scenario, where: Path) -> Path:
    """Run a scenario live in a new folder; raises `DataError` when it fails."""
    run_dir = folder.create(where, scenario)
    outcome = launch(scenario, run_dir, lambda _: None)
    if outcome.exit_code != EXIT_OK:
        raise DataError(Fault(f"tis bench {bench}", "", f"the run failed: {'; '.join(outcome.reasons)}"))
    return run_dir


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


_KINDS: Final = ("none", "password", "mtls", "signed")
_SETTINGS: Final = (
    "estimators=[hold]", "active_estimator=hold", "network={}", "rate_hz=200", "patient.tick=on_arrival",
)  # fmt: skip


class Price(NamedTuple):
    """Cost of one run: medians end to end and of the network, in ms, and netem's share of a processor, in %."""

    end_to_end_ms: float
    network_ms: float
    netem_cpu_pct: float
    sides_cpu_pct: float


def bench_security(seconds: float, rounds: int, out: Console) -> dict[str, Any]:
    """Run each kind of security ``rounds`` times, ``seconds`` each; print and return the medians over the rounds."""
    found: dict[str, list[Price]] = {kind: [] for kind in _KINDS}
    with tempfile.TemporaryDirectory() as scratch:
        secrets = _secrets(Path(scratch))
        for k in range(rounds):
            for kind in _KINDS[k % len(_KINDS) :] + _KINDS[: k % len(_KINDS)]:
                scenario = resolve("default", (*_SETTINGS, f"security={secrets[kind]}"), None, seconds)
                found[kind].append(_price(scenario, Path(scratch) / f"{kind}{k}"))
            load = os.getloadavg()[0]
            out.print(f"round {k + 1}: {'; '.join(_text(kind, found[kind][-1]) for kind in _KINDS)}; load {load:.1f}")
    middle = {kind: Price(*map(median, zip(*prices, strict=True))) for kind, prices in found.items()}
    rows = []
    for kind, price in middle.items():
        slower, dearer, sides = (price[i] / middle["none"][i] for i in (0, 2, 3))
        rows.append((
            kind, f"{price.end_to_end_ms:.3f} ms", f"{price.network_ms:.3f} ms", f"{price.netem_cpu_pct:.1f} %",
            f"{slower:.2f} x", f"{dearer:.2f} x", f"{price.sides_cpu_pct:.1f} %", f"{sides:.2f} x",
        ))  # fmt: skip
    columns = (
        "security", "end to end", "network", "netem's CPU", "end to end beside none", "CPU beside none", "sides' CPU",
        "beside none",
    )  # fmt: skip
    title = f"Medians of {rounds} runs of {seconds:g} s at 200 Hz"
    out.print(Table(title, columns, rows).terminal())
    figures: dict[str, Any] = {kind: price._asdict() for kind, price in middle.items()}
    return {"seconds": seconds, "rounds": rounds, **figures}


def _secrets(scratch: Path) -> dict[str, str]:
    """Make certificates and passwords; return the scenario's ``security`` of each kind, in YAML."""
    new_authority(scratch / "certs")
    for name in get_args(Side):
        issue(scratch / "certs", name)
    passwords = scratch / "passwords.txt"
    passwords.touch(mode=0o600)
    passwords.write_text("".join(f"{name}:{name}\n" for name in get_args(Side)))
    return {
        "none": "{kind: none}",
        "password": f"{{kind: password, file: {passwords}}}",
        "mtls": f"{{kind: mtls, folder: {scratch / 'certs'}}}",
        "signed": f"{{kind: mtls, folder: {scratch / 'certs'}, sign: true}}",
    }


def _price(scenario: Scenario, where: Path) -> Price:
    """Return the cost of a live run; raises `DataError` when it fails."""
    logs = load_run(_run("security", scenario, where))
    parts = sample_latency(used_samples(logs, scenario.session, {"left": FOLLOWER["left"]}))
    shares = {}
    for side in get_args(Side):
        [note] = logs.of(side, PROCESSORS)
        shares[side] = 100.0 * note["own_ns"] / (note["to_ns"] - note["from_ns"])
    of_sides = shares["surgeon"] + shares["patient"]
    return Price(_median_ms(parts.end_to_end), _median_ms(parts.network), shares["netem"], of_sides)


def _median_ms(durations_ns: NDArray[Any]) -> float:
    return float(np.median(durations_ns)) / NS_PER_MS


def _text(kind: str, price: Price) -> str:
    return f"{kind} {price.end_to_end_ms:.3f} ms, {price.netem_cpu_pct:.1f} % CPU"
