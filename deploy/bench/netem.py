"""Benchmark of the emulator (``tis bench netem``): each figure beside a reference measured in the same run.

References are a native Zenoh router between the same clients, and a loop that only waits for instants, so that the
ratios tell of the emulator and not of the machine. Rounds are interleaved: a change of the machine's load affects
both.
"""

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np
from rich.console import Console

from tis.common.errors import Fault, InputError
from tis.common.runtime.ports import free_endpoints
from tis.common.scenario.network import NetworkPart
from tis.common.units import NS_PER_S
from tis.deploy.bench.relays import Relay, bare_loop, least_relay, native_router, netem
from tis.deploy.bench.traffic import flood, paced
from tis.deploy.present.table import Column, Table
from tis.netem.expected.simulate import simulate

_BYTES: Final = 256
_CLEAN: Final = NetworkPart()
_JITTER: Final[dict[str, Any]] = {"delay": {"kind": "normal", "mean_ms": 5, "std_ms": 1}, "ordering": "fifo"}
_FULL: Final[dict[str, Any]] = {"loss": {"kind": "burst", "p_loss": 0.01, "mean_burst": 3}, **_JITTER}
_PAUSE_S: Final = 0.3
_ROUNDS: Final = 5
_POLL_S: Final = 0.001
_LOOK_S: Final = 0.05
_MB: Final = 1e-6

Row = tuple[str, str, str]


def bench_netem(seconds: float, out: Console) -> dict[str, Any]:
    """Measure all figures, print them as a table and return them by name."""
    figures: dict[str, Any] = {"load_1min": os.getloadavg()[0], "cores": os.cpu_count(), "seconds": seconds}
    rows: list[Row] = []
    for title, step in _STEPS.items():
        with out.status(f"measuring: {title}"):
            rows += step(seconds, figures)
        time.sleep(_PAUSE_S)
    columns = [Column(head, words=True, wraps=True) for head in ("figure", "measured", "bound")]
    title = f"netem on {figures['cores']} cores, {seconds:g} s each"
    out.print(Table(title, columns, rows).terminal())
    out.print(f"load average before: {figures['load_1min']:.2f}; other load on the machine shows in the tails")
    return figures


def bench_beside(other: Path, seconds: float, rounds: int, out: Console) -> dict[str, Any]:
    """Measure this checkout and that of the command ``other`` in turn, so that load meets both; return the figures.

    Raises `InputError` where the other cannot be measured.
    """
    found: dict[str, list[dict[str, Any]]] = {"here": [], "beside": []}
    commands = {"here": [sys.executable, "-m", "tis.deploy.cli.main"], "beside": [str(other.absolute())]}
    for number in range(rounds):
        for name in list(found)[:: 1 if number % 2 == 0 else -1]:
            with out.status(f"measuring: round {number + 1} of {rounds}, {name}"):
                found[name].append(_whole_bench(commands[name], seconds))
    rows = []
    for title, read in _COMPARED.items():
        here, beside = ([read(one) for one in found[name]] for name in found)
        rows.append((title, _spread(here), _spread(beside), f"{median(here) / median(beside):.2f}x"))
    columns = [
        Column(head, words=True, wraps=True) for head in ("median (least to largest)", "here", "beside", "ratio")
    ]
    out.print(Table(f"netem here and by {other}, {rounds} rounds", columns, rows).terminal())
    return found


def _whole_bench(command: Sequence[str], seconds: float) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:  # as the working directory, from which it must import nothing
        words = [*command, "bench", "netem", "--seconds", f"{seconds}", "--json", "f.json"]
        try:
            done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
            reason = (done.stderr.strip() or f"exit code {done.returncode}").splitlines()[-1]
        except OSError as error:
            reason = str(error.strerror)
        try:
            return dict(json.loads((Path(folder) / "f.json").read_text()))
        except (OSError, ValueError):
            raise InputError(Fault("tis bench netem", command[0], f"cannot be measured: {reason}")) from None


def _spread(values: Sequence[float]) -> str:
    return f"{median(values):.3g} ({min(values):.3g} to {max(values):.3g})"


def _release_error_us(figures: Mapping[str, Any], relay: str, quantile: str) -> float:
    return float(median(one[quantile] for one in figures["release_error_1khz_us"][relay]))


_COMPARED: Final[dict[str, Callable[[Mapping[str, Any]], float]]] = {
    "one hop at 1 kHz, p50, us": lambda figures: median(figures["hop_us"]["netem_p50"]),
    "the hop by a native router's": lambda figures: figures["hop_us"]["ratio"],
    "CPU per message, 1 kHz both ways, in order, us": lambda figures: median(figures["cpu_1khz_us"]["in_order"]),
    "this CPU by a native router's": lambda figures: (
        median(figures["cpu_1khz_us"]["in_order"]) / median(figures["cpu_1khz_us"]["native"])
    ),
    "release error there, in order, p50, us": lambda figures: _release_error_us(figures, "in_order", "p50"),
    "release error there, in order, p99, us": lambda figures: _release_error_us(figures, "in_order", "p99"),
    "release error there, an instant each, p99, us": lambda figures: _release_error_us(figures, "reordered", "p99"),
    "release error, 10 000 msg/s, p99, us": lambda figures: median(figures["release_error_10khz_p99_us"]),
    "unthrottled, msg/s": lambda figures: figures["unthrottled_hz"]["netem"],
}


def _network(pipeline: dict[str, Any], **parts: Any) -> NetworkPart:
    return NetworkPart.model_validate({"forward": pipeline, "feedback": pipeline, **parts})


def _hop(seconds: float, figures: dict[str, Any]) -> list[Row]:
    west, east = free_endpoints()
    native, ours = list[float](), list[float]()
    for _ in range(_ROUNDS):
        with native_router(west):
            native.append(float(np.median(paced([west], [west], 1, 1000, seconds / _ROUNDS, _BYTES)[1])))
        with netem(west, east, _CLEAN):
            ours.append(float(np.median(paced([west], [east], 1, 1000, seconds / _ROUNDS, _BYTES)[1])))
    figures["hop_us"] = {"native_p50": native, "netem_p50": ours, "ratio": median(ours) / median(native)}
    return [("one hop at 1 kHz, nothing injected, p50", _beside(ours, native, "us", "a native router"), "1.25x")]


def _one_kilohertz(seconds: float, figures: dict[str, Any]) -> list[Row]:
    """Measure netem, the least relay in Python, and a native router beside which two loops keep their instants.

    In order, netem and the least relay have messages that share an instant: one has to wait for the other. Reordered,
    each message has an instant of its own, as in the loops.
    """
    west, east = free_endpoints()
    errors: dict[str, list[Mapping[str, float]]] = {}
    cpu_us: dict[str, list[float]] = {}
    for _ in range(_ROUNDS):
        relays = {
            "reordered": netem(west, east, _network({**_JITTER, "ordering": "reorder"})),
            "in_order": netem(west, east, _network(_JITTER)),
            "least": least_relay(west, east),
        }
        for name, relay in relays.items():
            with relay as ours:
                cpu_us.setdefault(name, []).append(_cpu_us(ours, [west, east], [east, west], seconds / _ROUNDS))
            errors.setdefault(name, []).append(ours.figures["release_error_us"])
        for name, poll_s in (("bare", None), ("polling", _POLL_S)):
            with native_router(west) as native, bare_loop(2000, poll_s) as loop:
                cpu_us.setdefault("native", []).append(_cpu_us(native, [west, west], [west, west], seconds / _ROUNDS))
            errors.setdefault(name, []).append(loop.figures["release_error_us"])
    figures["release_error_1khz_us"], figures["cpu_1khz_us"] = errors, cpu_us
    text = _beside(cpu_us["in_order"], cpu_us["native"], "us", "a router")
    rows = [("CPU per message, 1 kHz both ways", f"{text}; the least relay {median(cpu_us['least']):.0f}", "")]
    for p in ("p50", "p99"):
        found = {name: [each[p] for each in of_name] for name, of_name in errors.items()}
        polling = f"a loop that polls each ms {median(found['polling']):.0f}"
        text = f"{_beside(found['reordered'], found['bare'], 'us', 'a bare loop')}; {polling}"
        rows.append((f"release error there, an instant each, {p}", text, "1.5x"))
        text = _beside(found["in_order"], found["bare"], "us", "a bare loop")
        rows.append(
            (f"release error there, in order, {p}", f"{text}; the least relay {median(found['least']):.0f}", "1.5x")
        )
    return rows


def _cpu_us(relay: Relay, senders: list[str], receivers: list[str], seconds: float) -> float:
    """Return the processor time per message of 1 kHz on every way, in us."""
    before_s = relay.cpu_s
    n_sent, _ = paced(senders, receivers, 1, 1000, seconds, _BYTES)
    return (relay.cpu_s - before_s) / n_sent * 1e6


def _ten_kilohertz(seconds: float, figures: dict[str, Any]) -> list[Row]:
    west, east = free_endpoints()
    lost: dict[str, list[float]] = {"netem": [], "native": []}
    errors = list[float]()
    for _ in range(_ROUNDS):
        with netem(west, east, _network(_JITTER)) as found:
            lost["netem"].append(_lost(west, east, seconds))
        errors.append(found.figures["release_error_us"]["p99"])
        with native_router(west):
            lost["native"].append(_lost(west, west, seconds))
    figures["release_error_10khz_p99_us"], figures["unplanned_10khz"] = errors, lost
    n = int(seconds * 10_000)
    text = f"{median(lost['netem']):g} of {n}, a native router {median(lost['native']):g}"
    every = ", ".join(f"{one:g}/{other:g}" for one, other in zip(lost["netem"], lost["native"], strict=True))
    return [
        ("unplanned loss, 10 000 msg/s, median", f"{text} ({every})", "the router's"),
        ("release error there, p99", f"{median(errors):.0f} us", ""),
    ]


def _lost(sender: str, receiver: str, seconds: float) -> float:
    n_sent, delays_us = paced([sender], [receiver], 1, 10_000, seconds, _BYTES)
    return float(n_sent - len(delays_us))


def _hundred_sessions(seconds: float, figures: dict[str, Any]) -> list[Row]:
    west, east = free_endpoints()
    with netem(west, east, _network(_JITTER)) as found:
        paced([west, east], [east, west], 100, 30, seconds, _BYTES)
    figures["release_error_100_sessions_us"] = error = found.figures["release_error_us"]
    text = " ".join(f"{name} {error[name]:.0f}" for name in ("p50", "p95", "p99", "p99.9"))
    return [("release error, 100 sessions x 30 Hz x 2", f"{text} us (n {found.figures['n']})", "")]


def _unthrottled(seconds: float, figures: dict[str, Any]) -> list[Row]:
    west, east = free_endpoints()
    n = int(60_000 * seconds)
    with native_router(west):
        _, native_hz = flood(west, west, n, _BYTES)
    with netem(west, east, _network(_FULL)):
        n_arrived, netem_hz = flood(west, east, n, _BYTES)
    figures["unthrottled_hz"] = {"native": native_hz, "netem": netem_hz, "came": n_arrived, "sent": n}
    text = f"{netem_hz:,.0f} msg/s, native router {native_hz:,.0f}; {n_arrived} of {n} came"
    return [("unthrottled, loss + delay + order", text, "")]


def _memory(seconds: float, figures: dict[str, Any]) -> list[Row]:
    """Measure the memory of 50 000 messages held, and that a bound of 20 000 holds."""
    west, east = free_endpoints()
    slow = {"delay": {"kind": "constant", "delay_ms": 5000}}
    seen, over = list[int](), threading.Event()
    with netem(west, east, _network(slow)) as relay:
        idle = relay.resident_bytes

        def watch() -> None:
            while not over.wait(_LOOK_S):
                seen.append(relay.resident_bytes)

        watcher = threading.Thread(target=watch, name="memory")
        watcher.start()
        paced([west], [east], 1, 10_000, 5.0, _BYTES)
        over.set()
        watcher.join()
    above_mb = (max(seen) - idle) * _MB
    with netem(west, east, _network(slow, buffer={"max_packets": 20_000})) as found:
        paced([west], [east], 1, 10_000, max(seconds, 3.0), _BYTES)
    counters = found.figures["counters"]
    figures["memory"] = {"idle_mb": idle * _MB, "above_idle_mb": above_mb, "bounded": counters}
    text = f"{counters['forward.most_held']} held at most, {counters['forward.dropped.overflow']} dropped and counted"
    return [
        ("5 s at 10 000 msg/s held: memory", f"{above_mb:.0f} MB above {idle * _MB:.0f} MB", "150 MB"),
        ("the same with room for 20 000", text, "20 000 held"),
    ]


def _virtual(_: float, figures: dict[str, Any]) -> list[Row]:
    n = 2_000_000
    offered_ns = np.arange(n, dtype=np.int64) * (NS_PER_S // 1000)
    began_s = time.perf_counter()
    simulate(_network(_FULL), "forward", 1, offered_ns)
    rate = n / (time.perf_counter() - began_s)
    figures["virtual_packets_per_s"] = rate
    return [("virtual time, burst loss + normal delay", f"{rate / 1e6:.1f} million packets/s", "")]


def _beside(ours: list[float], others: list[float], unit: str, what: str) -> str:
    one, other = median(ours), median(others)
    return f"{one:.0f} {unit}, {what} {other:.0f}: {one / other:.2f}x"


_STEPS: Final[dict[str, Callable[[float, dict[str, Any]], list[Row]]]] = {
    "one hop at 1 kHz": _hop,
    "1 kHz both ways": _one_kilohertz,
    "10 000 msg/s": _ten_kilohertz,
    "100 sessions x 30 Hz x 2 directions": _hundred_sessions,
    "unthrottled, 256 B, through loss, delay and order": _unthrottled,
    "5 s at 10 000 msg/s": _memory,
    "models in virtual time, delay and loss": _virtual,
}
