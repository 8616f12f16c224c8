"""Relays under test, each in a separate process: a native Zenoh router, or netem."""

import contextlib
import multiprocessing
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any, Final

import numpy as np
import zenoh

from common.node import Record
from common.records import ReleaseBatch
from common.runtime.clock import WallClock
from common.runtime.side import settle
from common.runtime.zenoh_session import ZenohOptions, configure
from common.scenario.network import NetworkPart
from netem.bridge.alarm import measure_lead_ns
from netem.bridge.bridge import Bridge
from netem.build import build_links

_READY_S: Final = 20.0
_SPAWN: Final = multiprocessing.get_context("spawn")


class ReleaseRecorder:
    """Recorder that keeps records in memory, at the cost of a run's recorder, and evaluates them at the end."""

    def __init__(self) -> None:
        self._makers: list[Callable[[], Iterable[Record]]] = []

    def record(self, record: Record) -> None:
        """Keep one record."""
        self._makers.append(lambda: (record,))

    def record_later(self, make: Callable[[], Iterable[Record]]) -> None:
        """Keep a function that makes records."""
        self._makers.append(make)

    def errors_ns(self) -> list[int]:
        """Return the release errors of all packets, in ns."""
        batches = (record.data for make in self._makers for record in make())
        return [
            left - due
            for batch in batches
            if isinstance(batch, ReleaseBatch) and not batch.foreign  # foreign: the first message of a key
            for left, due in zip(batch.released_ns, batch.release_ns, strict=True)
            if left
        ]


@contextmanager
def native_router(endpoint: str) -> Iterator[None]:
    """Run a Zenoh router in a separate process, as the reference."""
    with _process(_route, endpoint):
        yield


@contextmanager
def netem(west: str, east: str, network: NetworkPart) -> Iterator[dict[str, Any]]:
    """Run netem in a separate process; the mapping holds its figures after the block."""
    figures: dict[str, Any] = {}
    with _process(_bridge, west, east, network.model_dump(mode="json", exclude_none=True)) as pipe:
        yield figures
        pipe.send("stop")
        if pipe.poll(_READY_S):
            figures.update(pipe.recv())
        else:
            raise TimeoutError("netem did not return its figures")


@contextmanager
def _process(target: Any, *arguments: Any) -> Iterator[Connection]:
    ours, theirs = _SPAWN.Pipe()
    process = _SPAWN.Process(target=target, args=(theirs, *arguments), daemon=True)
    process.start()
    try:
        if not ours.poll(_READY_S):
            raise TimeoutError("a process of the benchmark did not start")
        ours.recv()
        yield ours
    finally:
        with contextlib.suppress(OSError):
            ours.send("stop")
        process.join(3.0)
        if process.is_alive():
            process.kill()


def _route(pipe: Connection, endpoint: str) -> None:
    with zenoh.open(configure("router", ZenohOptions(listen=[endpoint]))):
        pipe.send("ready")
        pipe.recv()


def _bridge(pipe: Connection, west: str, east: str, raw: dict[str, Any]) -> None:
    links = build_links(NetworkPart.model_validate(raw), ["tis/**"], 1, None, "bench")
    with (
        zenoh.open(configure("router", ZenohOptions(listen=[west]))) as one,
        zenoh.open(configure("router", ZenohOptions(listen=[east]))) as two,
    ):
        # as in netem's own process: declared keys, timer lead, then the release loop
        bridge = Bridge({"west": one, "east": two}, links)
        bridge.subscribe("forward", "tis/**")
        bridge.subscribe("feedback", "tis/**")
        settle(privileged=False)  # the bounds apply to an unprivileged process
        bridge.alarm.lead_ns = measure_lead_ns()
        bridge.start(WallClock(time.monotonic_ns()))
        recorder = ReleaseRecorder()
        pipe.send("ready")
        started_s = time.process_time(), time.monotonic()
        stop = threading.Event()

        def wait_for_stop() -> None:
            pipe.recv()
            stop.set()
            bridge.wake()

        threading.Thread(target=wait_for_stop, daemon=True).start()
        bridge.run(recorder, 1 << 62, stop.is_set)
        # figures are computed after the measurement, from records kept in memory
        cpu = (time.process_time() - started_s[0]) / (time.monotonic() - started_s[1])
        bridge.close()
        errors_ns = recorder.errors_ns()
        errors_us = np.array(errors_ns or [0]) * 1e-3
        pipe.send(
            {
                "counters": bridge.counters(),
                "cpu_share": cpu,
                "n": len(errors_ns),
                "release_error_us": {
                    name: float(np.percentile(errors_us, q))
                    for name, q in (("p50", 50), ("p95", 95), ("p99", 99), ("p99.9", 99.9), ("max", 100))
                },
            }
        )
