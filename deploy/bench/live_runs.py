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

from tis.common.audit import AUDIT_VARIABLE, NO_AUDIT
from tis.common.channels import FOLLOWER, Direction, Side
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
from tis.deploy.report.subjects.logs import counters_of
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
    environment = _environment(RECORD_VARIABLE, None if records else TICKS_ONLY)
    with tempfile.TemporaryDirectory() as scratch, environment:
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
def _environment(variable: str, value: str | None) -> Iterator[None]:
    """Give a variable to the sides that are started within the block."""
    before = os.environ.pop(variable, None)
    if value is not None:
        os.environ[variable] = value
    try:
        yield
    finally:
        os.environ.pop(variable, None)
        if before is not None:
            os.environ[variable] = before


_BARE: Final = "bare mtls"
_KINDS: Final = ("none", "password", _BARE, "mtls", "signed")
_SETTINGS: Final = (
    "estimators=[hold]", "active_estimator=hold", "network={}", "rate_hz=200", "patient.tick=on_arrival",
)  # fmt: skip


class Price(NamedTuple):
    """Cost of one run: medians end to end and of the network, in ms, and processor time for each message, in us."""

    end_to_end_ms: float
    network_ms: float
    netem_us: float
    sides_us: float


def bench_security(seconds: float, rounds: int, out: Console) -> dict[str, Any]:
    """Run each kind of security ``rounds`` times, ``seconds`` each; print and return the medians over the rounds.

    Bare mtls is neither signed nor audited. What stands beside it are medians of the quotients of each round.
    """
    found: dict[str, list[Price]] = {kind: [] for kind in _KINDS}
    with tempfile.TemporaryDirectory() as scratch:
        secrets = _secrets(Path(scratch))
        for k in range(rounds):
            for kind in _KINDS[k % len(_KINDS) :] + _KINDS[: k % len(_KINDS)]:
                scenario = resolve("default", (*_SETTINGS, f"security={secrets[kind]}"), None, seconds)
                with _environment(AUDIT_VARIABLE, NO_AUDIT if kind == _BARE else None):
                    found[kind].append(_price(scenario, Path(scratch) / f"{kind}{k}"))
            load = os.getloadavg()[0]
            out.print(f"round {k + 1}: {'; '.join(_text(kind, found[kind][-1]) for kind in _KINDS)}; load {load:.1f}")
    figures: dict[str, Any] = {"seconds": seconds, "rounds": rounds}
    rows = []
    for kind, prices in found.items():
        middle = Price(*map(median, zip(*prices, strict=True)))
        quotients = [
            [one / bare for one, bare in zip(*both, strict=True)] for both in zip(prices, found[_BARE], strict=True)
        ]
        beside = Price(*map(median, zip(*quotients, strict=True)))
        figures[kind] = {**middle._asdict(), "beside_bare_mtls": beside._asdict()}
        pairs = zip(middle._asdict().items(), beside, strict=True)
        shown = [
            (f"{value:.0f}" if name.endswith("_us") else f"{value:.3f}", f"{x:.2f}") for (name, value), x in pairs
        ]
        rows.append((kind, *(cell for both in shown for cell in both)))
    columns = [Column("security"), *map(Column, ("end to end", "x", "network", "x", "netem", "x", "sides", "x"))]
    title = (
        f"Medians of {rounds} runs of {seconds:g} s at 200 Hz: ms, processor time per message in us, and x times "
        "bare mtls, which is neither signed nor audited"
    )
    out.print(Table(title, columns, rows).terminal())
    return figures


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
        **dict.fromkeys((_BARE, "mtls"), f"{{kind: mtls, folder: {scratch / 'certs'}}}"),
        "signed": f"{{kind: mtls, folder: {scratch / 'certs'}, sign: true}}",
    }


def _price(scenario: Scenario, where: Path) -> Price:
    """Return the cost of a live run; raises `DataError` when it fails."""
    logs = load_run(_run("security", scenario, where))
    parts = sample_latency(used_samples(logs, scenario.session, {"left": FOLLOWER["left"]}))
    own_ns = {side: sum(note["own_ns"] for note in logs.of(side, PROCESSORS)) for side in get_args(Side)}
    counted = counters_of(logs, "netem")
    n_messages = sum(counted[f"{direction}.offered"] for direction in get_args(Direction))
    of_sides_ns = own_ns["surgeon"] + own_ns["patient"]
    per_message = (1e-3 * found_ns / n_messages for found_ns in (own_ns["netem"], of_sides_ns))
    return Price(_median_ms(parts.end_to_end), _median_ms(parts.network), *per_message)


def _median_ms(durations_ns: NDArray[Any]) -> float:
    return float(np.median(durations_ns)) / NS_PER_MS


def _text(kind: str, price: Price) -> str:
    return f"{kind} {price.end_to_end_ms:.3f} ms, {price.netem_us:.0f} + {price.sides_us:.0f} us"
