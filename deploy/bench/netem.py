"""Benchmark of the emulator (``tis bench netem``): release error and throughput, beside a native Zenoh router."""

import os
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.table import Table

from common.runtime.free_endpoints import free_endpoints
from common.scenario.network import NetworkPart
from common.units import NS_PER_S
from deploy.bench.relays import native_router, netem
from deploy.bench.traffic import flood, paced
from netem.expected.simulate import simulate

_BYTES: Final = 256
_CLEAN: Final = NetworkPart()
_FULL: Final[dict[str, Any]] = {
    "loss": {"kind": "burst", "p_loss": 0.01, "mean_burst": 3},
    "delay": {"kind": "normal", "mean_ms": 5, "std_ms": 1},
    "ordering": "fifo",
}
_PAUSE_S: Final = 0.3
_HOP_ROUNDS: Final = 5

Row = tuple[str, str, str]


def bench_netem(seconds: float, out: Console) -> dict[str, Any]:
    """Measure all figures, print them as a table and return them by name."""
    figures: dict[str, Any] = {"load_1min": os.getloadavg()[0], "cores": os.cpu_count(), "seconds": seconds}
    rows: list[Row] = []
    for title, step in _STEPS.items():
        with out.status(f"measuring: {title}"):
            rows += step(seconds, figures)
        time.sleep(_PAUSE_S)
    table = Table("figure", "measured", "bound", title=f"netem on {figures['cores']} cores, {seconds:g} s each")
    for row in rows:
        table.add_row(*row)
    out.print(table)
    out.print(f"load average before: {figures['load_1min']:.2f}; other load on the machine shows in the tails")
    return figures


def _network(pipeline: dict[str, Any], **parts: Any) -> NetworkPart:
    return NetworkPart.model_validate({"forward": pipeline, "feedback": pipeline, **parts})


def _hop(seconds: float, figures: dict[str, Any]) -> list[Row]:
    west, east = free_endpoints()
    native: list[Any] = []
    ours: list[Any] = []
    for _ in range(_HOP_ROUNDS):  # interleaved, so that a change of the machine's load affects both
        with native_router(west):
            native.append(paced([west], [west], 1, 1000, seconds / _HOP_ROUNDS, _BYTES)[1])
        with netem(west, east, _CLEAN):
            ours.append(paced([west], [east], 1, 1000, seconds / _HOP_ROUNDS, _BYTES)[1])
    one, two = np.median(np.concatenate(native)), np.median(np.concatenate(ours))
    figures["hop_us"] = {"native_p50": float(one), "netem_p50": float(two), "ratio": float(two / one)}
    return [("one hop at 1 kHz, p50", f"{two:.0f} us, native router {one:.0f} us: {two / one:.2f}x", "1.4x")]


def _one_kilohertz(seconds: float, figures: dict[str, Any]) -> list[Row]:
    found = _both_ways(seconds, figures, "release_error_1khz_us", 1, 1000)
    return [("release error, 1 kHz both ways", _quantiles(found), "p50 15, p95 60, p99 150 us")]


def _ten_kilohertz(seconds: float, figures: dict[str, Any]) -> list[Row]:
    west, east = free_endpoints()
    with netem(west, east, _network(_FULL | {"loss": None})) as found:
        sent, delays_us = paced([west], [east], 1, 10_000, seconds, _BYTES)
    figures["release_error_10khz_us"] = found["release_error_us"]
    figures["unplanned_10khz"] = sent - len(delays_us)
    return [
        ("release error, 10 000 msg/s", _quantiles(found), "p99 500 us"),
        ("unplanned loss there", f"{sent - len(delays_us)} of {sent}", "0"),
    ]


def _hundred_sessions(seconds: float, figures: dict[str, Any]) -> list[Row]:
    found = _both_ways(seconds, figures, "release_error_100_sessions_us", 100, 30)
    return [("release error, 100 sessions x 30 Hz x 2", _quantiles(found), "p99 300 us")]


def _unthrottled(seconds: float, figures: dict[str, Any]) -> list[Row]:
    west, east = free_endpoints()
    n = int(60_000 * seconds)
    with native_router(west):
        _, native_hz = flood(west, west, n, _BYTES)
    with netem(west, east, _network(_FULL)):
        n_arrived, netem_hz = flood(west, east, n, _BYTES)
    figures["unthrottled_hz"] = {"native": native_hz, "netem": netem_hz, "came": n_arrived, "sent": n}
    text = f"{netem_hz:,.0f} msg/s, native router {native_hz:,.0f}; {n_arrived} of {n} came"
    return [("unthrottled, loss + delay + order", text, "60,000 msg/s")]


def _bounded(seconds: float, figures: dict[str, Any]) -> list[Row]:
    west, east = free_endpoints()
    slow = {"delay": {"kind": "constant", "delay_ms": 5000}}
    with netem(west, east, _network(slow, buffer={"max_packets": 20_000})) as found:
        paced([west], [east], 1, 10_000, max(seconds, 3.0), _BYTES)
    counters = found["counters"]
    figures["bounded"] = counters
    text = f"{counters['forward.most_held']} held at most, {counters['forward.dropped.overflow']} dropped and counted"
    return [("5 s at 10 000 msg/s, room for 20 000", text, "20 000 held")]


def _virtual(_: float, figures: dict[str, Any]) -> list[Row]:
    n = 2_000_000
    offered_ns = np.arange(n, dtype=np.int64) * (NS_PER_S // 1000)
    began_s = time.perf_counter()
    simulate(_network(_FULL), "forward", 1, offered_ns)
    rate = n / (time.perf_counter() - began_s)
    figures["virtual_packets_per_s"] = rate
    return [("virtual time, burst loss + normal delay", f"{rate / 1e6:.1f} million packets/s", "1 million")]


def _both_ways(seconds: float, figures: dict[str, Any], name: str, n_keys: int, rate_hz: float) -> dict[str, Any]:
    west, east = free_endpoints()
    with netem(west, east, _network(_FULL | {"loss": None})) as found:
        paced([west, east], [east, west], n_keys, rate_hz, seconds, _BYTES)
    figures[name] = found["release_error_us"] | {"cpu_share": found["cpu_share"], "n": found["n"]}
    return found


def _quantiles(found: dict[str, Any]) -> str:
    error = found["release_error_us"]
    figures = " ".join(f"{name} {error[name]:.0f}" for name in ("p50", "p95", "p99", "p99.9"))
    return f"{figures} us (n {found['n']}, {100 * found['cpu_share']:.0f} % of a core)"


_STEPS: Final[dict[str, Callable[[float, dict[str, Any]], list[Row]]]] = {
    "one hop at 1 kHz, nothing injected": _hop,
    "release error at 1 kHz both ways": _one_kilohertz,
    "release error at 10 000 msg/s": _ten_kilohertz,
    "100 sessions x 30 Hz x 2 directions": _hundred_sessions,
    "unthrottled, 256 B, through loss, delay and order": _unthrottled,
    "a delay of 5 s at 10 000 msg/s with room for 20 000": _bounded,
    "models in virtual time, delay and loss": _virtual,
}
