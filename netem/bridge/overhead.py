"""The base overhead of the emulator: the additional delay of a message compared with a router alone.

It is measured at the start with temporary clients, alternately: a message from the west to the west, and one from the
west through an emulator without impairments to the east. A delay below the difference cannot be realised.
"""

import secrets
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from statistics import median
from typing import Final

import zenoh

from tis.common.channels import CONTROL, Network
from tis.common.node import Record
from tis.common.runtime.clock import WallClock
from tis.common.runtime.credentials import own_client
from tis.common.runtime.status import Status
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.common.scenario.network import NetworkPart
from tis.common.trace import Trace
from tis.common.units import NS_PER_US
from tis.common.zenoh_syntax import is_tls
from tis.netem.bridge.bridge import Bridge
from tis.netem.build import build_links
from tis.netem.stages.delay import latency_of

OVERHEAD: Final = f"{CONTROL}/overhead"
"""First chunks of the keys of the measurement."""

_TLS: Final = "transport/link/tls"
_ANY_ADDRESS: Final = f"{_TLS}/verify_name_on_connect:false"  # it need not be in netem's own certificate
_MESSAGES: Final = 60
_GAP_S: Final = 0.002
_PATIENCE_S: Final = 0.2
_ENDLESS_NS: Final = 1 << 62


def warn_of_overhead(
    sessions: Mapping[Network, zenoh.Session],
    endpoints: Mapping[Network, str],
    options: ZenohOptions,
    network: NetworkPart,
    traces: Mapping[str, Trace],
    status: Status,
) -> int:
    """Measure the base overhead, warn of configured delays below it, and return it in ns (0: unknown)."""
    overhead_ns = measure_base_overhead_ns(sessions, endpoints, options)
    if overhead_ns is None:
        return 0
    pipelines = {f"network.{name}": getattr(network, name) for name in ("forward", "feedback")}
    pipelines |= {f"network.rules.{i}": rule.pipeline for i, rule in enumerate(network.rules)}
    for where, pipeline in pipelines.items():
        if pipeline.delay is None:
            continue
        requested_ns = latency_of(pipeline, traces).quantiles_ns([0.5])[0]
        if requested_ns < overhead_ns:
            requested_us, overhead_us = requested_ns / NS_PER_US, overhead_ns / NS_PER_US
            status.warning(
                f"{where} requests {requested_us:.0f} us of delay, but netem itself adds {overhead_us:.0f} "
                "(median of a third of a second before the start: more where a process was just loading)"
            )
    return overhead_ns


class _NullRecorder:
    def record(self, record: Record) -> None:
        """Discard the record: it does not belong to the run."""

    def record_later(self, make: Callable[[], Iterable[Record]]) -> None:
        """Discard the function uncalled."""


def measure_base_overhead_ns(
    sessions: Mapping[Network, zenoh.Session], endpoints: Mapping[Network, str], options: ZenohOptions
) -> int | None:
    """Return the median overhead of the emulator, in ns, at least 0; None if its clients are not let in.

    ``endpoints`` are those of the networks' routers, as netem's own host reaches them; the clients prove with
    what ``options`` have of proof that they are netem. Takes a third of a second.
    """
    cfg = (*options.cfg, "listen/endpoints:[]", _ANY_ADDRESS)
    options = replace(options, listen=(), cfg=cfg, credentials=own_client(options.credentials))
    if not _has_proof(configure("client", options), endpoints.values()):
        return None
    with ExitStack() as stack:
        try:
            west = stack.enter_context(_client(endpoints["west"], options))
            east = stack.enter_context(_client(endpoints["east"], options))
        except zenoh.ZError:
            return None
        # Stage 1: an emulator for one key, which no '**' matches, so that nothing else forwards it.
        name = f"{OVERHEAD}/{secrets.token_hex(8)}"
        direct, crossing = f"{name}/direct", f"{name}/crossing"
        bridge = Bridge(sessions, build_links(NetworkPart(), [crossing], 0, None, "netem"))
        bridge.subscribe("forward", crossing)
        stack.callback(bridge.close)
        bridge.start(WallClock(time.monotonic_ns()))
        done = threading.Event()
        thread = threading.Thread(target=bridge.run, args=(_NullRecorder(), _ENDLESS_NS, done.is_set), daemon=True)
        thread.start()
        stack.callback(thread.join, 1.0)
        stack.callback(bridge.wake)
        stack.callback(done.set)
        took = _Timed(), _Timed()
        # Stage 2: the listeners. A router does not return a client's own messages to it, so the direct way needs a
        # second client.
        listener = stack.enter_context(_client(endpoints["west"], options))
        stack.enter_context(listener.declare_subscriber(direct, took[0].take))
        stack.enter_context(east.declare_subscriber(crossing, took[1].take))
        publishers = [west.declare_publisher(key, express=True) for key in (direct, crossing)]
        time.sleep(_PATIENCE_S / 2)
        # Stage 3: messages both ways, interleaved, so that other load affects both alike.
        for _ in range(_MESSAGES):
            for publisher in publishers:
                publisher.put(time.monotonic_ns().to_bytes(8, "little"))
                time.sleep(_GAP_S / 2)
        time.sleep(_PATIENCE_S / 2)
    if not took[0].ns or not took[1].ns:
        return None
    return max(0, int(median(took[1].ns) - median(took[0].ns)))


class _Timed:
    """The delays of messages that carry their sending time."""

    def __init__(self) -> None:
        self.ns: list[int] = []

    def take(self, sample: zenoh.Sample) -> None:
        self.ns.append(time.monotonic_ns() - int.from_bytes(sample.payload.to_bytes(), "little"))


def _has_proof(config: zenoh.Config, endpoints: Iterable[str]) -> bool:
    """Tell whether a router lets a client with its own configuration in: else netem would refuse itself."""

    def has(key: str) -> bool:
        return config.get_json(key) not in ("null", '""')

    def has_file(name: str) -> bool:
        return has(f"{_TLS}/{name}") or has(f"{_TLS}/{name}_base64")

    if has("transport/auth/usrpwd/dictionary_file") and not has("transport/auth/usrpwd/user"):
        return False
    if not any(is_tls(endpoint) for endpoint in endpoints):
        return True
    is_mutual = config.get_json(f"{_TLS}/enable_mtls") == "true"
    return has_file("root_ca_certificate") and (has_file("connect_certificate") or not is_mutual)


def _client(endpoint: str, options: ZenohOptions) -> zenoh.Session:
    return zenoh.open(configure("client", replace(options, connect=[endpoint])))
