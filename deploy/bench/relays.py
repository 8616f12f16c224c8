"""Relays under test, each in a process: a native router, netem, the least one in Python, and loops that only wait."""

import contextlib
import heapq
import multiprocessing
import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

import numpy as np
import zenoh
from numpy.typing import NDArray

from tis.common.runtime.clock import WallClock
from tis.common.runtime.mcap_log import McapLog
from tis.common.runtime.recorder import ThreadedRecorder
from tis.common.runtime.scheduling import let_zenoh_wait, settle
from tis.common.runtime.zenoh_session import ZenohOptions, configure, merge_acceptor
from tis.common.scenario.network import NetworkPart
from tis.common.units import NS_PER_S
from tis.deploy.bench.measured_command import resident_bytes
from tis.netem.bridge.alarm import Alarm, measure_lead_ns
from tis.netem.bridge.bridge import Bridge
from tis.netem.bridge.tally import Tally
from tis.netem.build import build_links

_READY_S: Final = 20.0
_SPAWN: Final = multiprocessing.get_context("spawn")
_LONGEST_S: Final = 600
_AHEAD_NS: Final = 20_000  # as netem takes packets
_QUANTILES: Final = (("p50", 0.5), ("p95", 0.95), ("p99", 0.99), ("p99.9", 0.999), ("max", 1.0))

_Held = tuple[int, int, zenoh.Publisher, zenoh.ZBytes, zenoh.ZBytes | None]
"""A message that waits: its release in ns, a number, publisher, payload and attachment."""


@dataclass
class Relay:
    """A process under test; ``figures`` holds what it tells of itself, after its block."""

    pid: int
    figures: dict[str, Any] = field(default_factory=dict)

    @property
    def cpu_s(self) -> float:
        """Return the processor time that it has used."""
        text = Path(f"/proc/{self.pid}/stat").read_text()
        used = text[text.rindex(")") + 2 :].split()
        return (int(used[11]) + int(used[12])) / os.sysconf("SC_CLK_TCK")

    @property
    def resident_bytes(self) -> int:
        """Return its resident memory."""
        return resident_bytes(self.pid)


def native_router(endpoint: str) -> AbstractContextManager[Relay]:
    """Run a Zenoh router, as the reference."""
    return _process(_route, endpoint)


def netem(west: str, east: str, network: NetworkPart) -> AbstractContextManager[Relay]:
    """Run netem with a log, as a run has one; its figures are counters and the quantiles of the release error."""
    return _process(_bridge, west, east, network.model_dump(mode="json", exclude_none=True))


def least_relay(west: str, east: str) -> AbstractContextManager[Relay]:
    """Run the least that delays messages in Python: two routers, callbacks, a heap and one thread that puts.

    It has no models, keeps no books and no log, and carries one key of each direction with one quality of service.
    Its threads are scheduled as netem's are.
    """
    return _process(_delay, west, east)


def bare_loop(rate_hz: float, poll_s: float | None = None) -> AbstractContextManager[Relay]:
    """Run a loop that waits for ``rate_hz`` instants a second as netem does, and does nothing else.

    With ``poll_s`` it looks that often whether an instant has passed, as published fault injectors do.
    """
    return _process(_keep_instants, rate_hz, poll_s)


@contextmanager
def _process(target: Any, *arguments: Any) -> Iterator[Relay]:
    ours, theirs = _SPAWN.Pipe()
    process = _SPAWN.Process(target=target, args=(theirs, *arguments), daemon=True)
    process.start()
    try:
        if not ours.poll(_READY_S):
            raise TimeoutError("a process of the benchmark did not start")
        ours.recv()
        relay = Relay(process.pid or 0)
        yield relay
        ours.send("stop")
        if not ours.poll(_READY_S):
            raise TimeoutError("a process of the benchmark did not return its figures")
        relay.figures.update(ours.recv())
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
        pipe.send({})


def _bridge(pipe: Connection, west: str, east: str, raw: dict[str, Any]) -> None:
    links = build_links(NetworkPart.model_validate(raw), ["tis/**"], 1, None, "bench")
    for link in links.values():
        link.prepare(["tis/way0/0", "tis/way1/0"])
    merge_acceptor()
    with (
        tempfile.TemporaryDirectory() as scratch,
        zenoh.open(configure("router", ZenohOptions(listen=[west]))) as one,
        zenoh.open(configure("router", ZenohOptions(listen=[east]))) as two,
    ):
        # as in netem's own process: declared keys, timer lead, then the release loop
        bridge = Bridge({"west": one, "east": two}, links)
        bridge.subscribe("forward", "tis/**")
        bridge.subscribe("feedback", "tis/**")
        bridge.settle(privileged=False)  # the bounds apply to an unprivileged process
        bridge.start(WallClock(time.monotonic_ns()))
        tally = Tally(McapLog(Path(scratch) / "netem.mcap", {}), lambda _: None)
        recorder = ThreadedRecorder(tally)
        stopped = _stop_of(pipe, bridge.wake)
        bridge.run(recorder, 1 << 62, stopped.is_set)
        recorder.close()
        bridge.close()
        tally.errors["forward"].add_all(tally.errors["feedback"])
        errors = tally.errors["forward"]
        quantiles = {name: errors.quantile_ns(p) * 1e-3 for name, p in _QUANTILES}
        pipe.send({"counters": bridge.counters(), "n": errors.n, "release_error_us": quantiles})


def _delay(pipe: Connection, west: str, east: str) -> None:
    merge_acceptor()
    with (
        zenoh.open(configure("router", ZenohOptions(listen=[west]))) as one,
        zenoh.open(configure("router", ZenohOptions(listen=[east]))) as two,
    ):
        alarm, errors_ns, heap, lock = Alarm(), list[int](), list[_Held](), threading.Lock()
        late_ns = (_late_s(int(_LONGEST_S * 2000)) * NS_PER_S).astype(np.int64).tolist()
        asleep_until_ns, held = 0, list[object]()

        def delayed(session: zenoh.Session, key: str) -> Callable[[zenoh.Sample], None]:
            publisher = session.declare_publisher(
                key,
                priority=zenoh.Priority.REAL_TIME,
                express=True,
                congestion_control=zenoh.CongestionControl.DROP,
                allowed_destination=zenoh.Locality.REMOTE,
            )
            last_ns = 0

            def offer(sample: zenoh.Sample) -> None:
                nonlocal last_ns
                with lock:
                    last_ns = max(last_ns, clock.now_ns() + late_ns.pop())
                    heapq.heappush(heap, (last_ns, len(late_ns), publisher, sample.payload, sample.attachment))
                    wakes = last_ns < asleep_until_ns
                if wakes:
                    alarm.ring()

            return offer

        settle(privileged=False)
        let_zenoh_wait()
        alarm.lead_ns = measure_lead_ns()
        clock = WallClock(time.monotonic_ns())
        for here, there, way in ((one, two, 0), (two, one, 1)):
            offer = delayed(there, f"tis/way{way}/0")
            held.append(here.declare_subscriber(f"tis/way{way}/**", offer, allowed_origin=zenoh.Locality.REMOTE))
        stopped = _stop_of(pipe, alarm.ring)
        while not stopped.is_set():
            due = list[_Held]()
            with lock:
                now_ns = clock.now_ns()
                while heap and heap[0][0] <= now_ns + _AHEAD_NS:
                    due.append(heapq.heappop(heap))
                asleep_until_ns = heap[0][0] if heap else now_ns + NS_PER_S
            for release_ns, _, publisher, payload, attachment in due:
                while (now_ns := clock.now_ns()) < release_ns:
                    pass
                publisher.put(payload, attachment=attachment)
                errors_ns.append(now_ns - release_ns)
            if not due:
                alarm.sleep(clock, asleep_until_ns - _AHEAD_NS)
        pipe.send({"n": len(errors_ns), "release_error_us": _quantiles_us(errors_ns)})


def _keep_instants(pipe: Connection, rate_hz: float, poll_s: float | None) -> None:
    settle(privileged=False)
    alarm = Alarm()
    alarm.lead_ns = measure_lead_ns()
    # as the releases of two directions whose messages have a jitter of 1 ms
    n = int(rate_hz / 2 * _LONGEST_S)
    sent_s = np.tile(np.arange(n) * 2 / rate_hz, 2)
    due_ns = np.sort((sent_s + _late_s(2 * n)) * NS_PER_S).astype(np.int64).tolist()
    clock, errors_ns = WallClock(time.monotonic_ns()), []
    stopped = _stop_of(pipe, alarm.ring)
    for instant_ns in due_ns:
        while (now_ns := clock.now_ns()) < instant_ns and not stopped.is_set():
            if poll_s is None:
                alarm.sleep(clock, instant_ns)
            else:
                time.sleep(poll_s)
        if stopped.is_set():
            break
        errors_ns.append(now_ns - instant_ns)
    pipe.send({"n": len(errors_ns), "release_error_us": _quantiles_us(errors_ns)})


def _quantiles_us(errors_ns: list[int]) -> dict[str, float]:
    return {name: float(np.quantile(errors_ns or [0], p)) * 1e-3 for name, p in _QUANTILES}


def _late_s(n: int) -> NDArray[np.float64]:
    """Return delays with a jitter of 1 ms."""
    return np.random.default_rng(1).normal(0.005, 0.001, n)


def _stop_of(pipe: Connection, wake: Callable[[], None]) -> threading.Event:
    """Tell that the process is ready; return the event of its end, at which ``wake`` is called."""
    stop = threading.Event()

    def wait() -> None:
        with contextlib.suppress(EOFError):  # the benchmark was killed
            pipe.recv()
        stop.set()
        wake()

    threading.Thread(target=wait, daemon=True).start()
    pipe.send("ready")
    return stop
