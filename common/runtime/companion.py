"""A node that runs beside a side, in a process of its own on the same host: the camera, the screen.

It must not share an interpreter with a loop that ticks a thousand times a second. The side starts it, tells it the
run's clock, which both then read, and ends it; it is a Zenoh client of its own and writes a log of its own beside the
side's. It never has a real-time priority: where the loops have one, they come first.
"""

import contextlib
import json
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, Final, Protocol, Self

import zenoh

from tis.common.channels import Arm, Hand, HandChannels, Network, Side, camera_key, hand_channels
from tis.common.errors import EXIT_OK, DataError, Fault, PeerError
from tis.common.node import Node, Record
from tis.common.records import COUNTERS, CounterNote
from tis.common.runtime.clock import WallClock
from tis.common.runtime.connections import closing
from tis.common.runtime.credentials import credentials
from tis.common.runtime.log_parts import CLOCK_FILE, PartClock, companion_name
from tis.common.runtime.loop import Seat, run
from tis.common.runtime.mcap_log import McapLog
from tis.common.runtime.memory import share_arenas
from tis.common.runtime.process import child_environment, end_by_input, guarded_exit_code, line_of, run_to_end
from tis.common.runtime.recorder import recorder_for
from tis.common.runtime.scheduling import precede_ordinary, settle
from tis.common.runtime.tls_links import of_netem_only
from tis.common.runtime.zenoh_bus import ForeignBound, Inbox, ZenohBus
from tis.common.runtime.zenoh_session import ZenohOptions, configure, lease_ms, open_client
from tis.common.scenario import Scenario
from tis.common.scenario.reading import digest
from tis.common.sight.codec import codec_versions
from tis.common.signing import RunKeys

CODEC_FILE: Final = "codec.json"
_READY: Final = "ready"
_OF_CAMERAS: Final = ForeignBound(n_waiting=8, n_bytes=3 << 20)
_MAX_LAST_LINES: Final = 5
_GRACE_S: Final = 10.0


@dataclass(frozen=True)
class Beside:
    """What runs beside a side: ``builder``, MODULE:FUNCTION of scenario and hands' channels, returns the node."""

    builder: str
    network: Network
    hands: Sequence[tuple[Hand, Arm]] = ()


class CompanionNode(Node, Protocol):
    """A node that runs beside a side."""

    def join(self, run_id: int, from_ns: int = 0, epoch_unix_ns: int = 0) -> None:
        """Take messages of this run only, from now on; it began at ``epoch_unix_ns`` of the host's calendar clock."""

    def believe(self, own: bytes, other: bytes) -> None:
        """Use only what is signed under these keys, that of the node's side and the other side's; from any thread."""


class Companion:
    """The process of a node that runs beside a side, as the side sees it."""

    def __init__(
        self, side: Side, beside: Beside, scenario: Scenario, options: ZenohOptions, changed: Callable[[], None],
        warn: Callable[[str], None],
    ) -> None:  # fmt: skip
        self.side, self.name = side, beside.builder.rpartition(".")[2].partition(":")[0]
        self.is_ready = self._has_begun = False
        self._last_lines: deque[str] = deque(maxlen=_MAX_LAST_LINES)
        self._changed, self._warn, self._is_closing = changed, warn, False
        self._telling = threading.Lock()
        # a separate session: Ctrl-C reaches the side, which then ends it
        self._process = subprocess.Popen(  # noqa: S603  (a module of ours)
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,
            env=child_environment(),
        )
        self._tell(_request(side, beside, scenario, options))
        self._readers = [threading.Thread(target=one, daemon=True) for one in (self._read_words, self._read_errors)]
        for reader in self._readers:
            reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """End the process, at the latest after some seconds, in which it completes its log."""
        self._is_closing = True
        end_by_input(self._process, _GRACE_S)
        for reader in self._readers:
            reader.join()
        for pipe in (self._process.stdout, self._process.stderr):
            if pipe is not None:
                pipe.close()

    @property
    def failure(self) -> str | None:
        """Return why the process failed; None while it runs, or when it ended as it should."""
        code = self._process.poll()
        return None if code in (None, EXIT_OK) else "; ".join(self._last_lines) or f"it ended with code {code}"

    def check(self) -> bool:
        """Tell whether the node is ready; raises `PeerError` when its process is over."""
        if self._process.poll() is not None:
            raise PeerError(Fault(self.side, self.name, self.failure or "it ended before the run"))
        return self.is_ready

    def begin(self, clock: PartClock, log: Path, keys: RunKeys | None = None) -> None:
        """Let the node begin, on this clock, with its log beside the side's; ``keys``: where messages are signed."""
        number = next(n for n in range(1, 1000) if not log.with_name(companion_name(self.side, n)).exists())
        path = log.with_name(companion_name(self.side, number))
        self._tell({"log": str(path), "clock": clock.model_dump(mode="json"), "is_signed": keys is not None})
        self._has_begun = True
        if keys is not None:
            self.renew(keys)

    def renew(self, keys: RunKeys) -> None:
        """Tell the node the run's keys, once it has begun; from any thread."""
        if self._has_begun:
            self._tell({"own": keys.own.hex(), "other": keys.others[0].hex()})

    def _tell(self, words: Mapping[str, Any]) -> None:
        assert self._process.stdin is not None
        with self._telling, contextlib.suppress(OSError):  # it has ended, as `check` tells
            self._process.stdin.write(f"{json.dumps(words)}\n")
            self._process.stdin.flush()

    def _read_words(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.strip() == _READY:
                self.is_ready = True
                self._changed()
        self._changed()
        code = self._process.wait()
        if code != EXIT_OK or (self.is_ready and not self._is_closing):
            self._readers[1].join()
            self._warn(f"the {self.name} ended: {self.failure or 'before the run was over'}")

    def _read_errors(self) -> None:
        assert self._process.stderr is not None
        self._last_lines.extend(line.rstrip() for line in self._process.stderr)


def _request(side: Side, beside: Beside, scenario: Scenario, options: ZenohOptions) -> dict[str, Any]:
    return {
        "side": side,
        "builder": beside.builder,
        "network": beside.network,
        "hands": list(beside.hands),
        "scenario": scenario.model_dump(mode="json"),
        "connect": list(options.connect),
        "config": None if options.config is None else str(options.config),
        "cfg": list(options.cfg),
    }


def _run(request: Mapping[str, Any]) -> int:
    """Run the node of a request from the beginning that standard input tells to the end; return the exit code."""
    share_arenas()
    scenario = Scenario.model_validate(request["scenario"])
    side, network = request["side"], request["network"]
    module, _, function = request["builder"].partition(":")
    hands: list[HandChannels] = [hand_channels(hand, arm) for hand, arm in request["hands"]]
    node: CompanionNode = getattr(import_module(module), function)(scenario, hands)
    config = None if request["config"] is None else Path(request["config"])
    options = ZenohOptions(request["connect"], (), config, request["cfg"])
    proof = credentials(scenario.security, side)
    lease = lease_ms(scenario.peer_timeout_s)
    client = configure("client", replace(options, credentials=proof, lease_ms=lease))
    session = open_client(client, lambda: False, lambda: None)
    assert session is not None
    with closing(session, client), of_netem_only(session, client, side):
        inbox: Inbox[zenoh.Sample] = Inbox()
        bus = ZenohBus({network: session}, WallClock(0), inbox)
        bus.listen(node, {camera_key(scenario.session)}, _OF_CAMERAS)
        bus.announce(node)
        settle(privileged=False)
        precede_ordinary()
        print(_READY, flush=True)  # noqa: T201  (the side reads it)
        line = sys.stdin.readline()
        if not line:
            return EXIT_OK
        begin = json.loads(line)
        part = PartClock.model_validate(begin["clock"])
        ended = threading.Event()
        if begin["is_signed"]:
            bus.keys = RunKeys()
            _take_keys(sys.stdin.readline(), node, bus.keys)

        def follow() -> None:
            for line in sys.stdin:
                if bus.keys is not None:
                    _take_keys(line, node, bus.keys)
            ended.set()
            inbox.alarm()

        threading.Thread(target=follow, daemon=True).start()
        with _log(begin, scenario, side) as log:
            clock = WallClock(part.epoch_monotonic_ns)
            bus.clock, bus.run_id = clock, part.run_id or 0
            recorder = recorder_for(log, lambda _: None)
            node.join(bus.run_id, part.joined_ns or 0, part.epoch_unix_ns)
            inbox.start(clock)
            try:
                run([Seat(node, recorder)], bus, clock, scenario.end_ns, lambda: ended.is_set() or bool(inbox.error))
                unread = CounterNote(name="unread", value=inbox.n_flooded)
                recorder.record(Record(COUNTERS, clock.now_ns(), unread))
            finally:
                recorder.close()
            if recorder.error is not None:
                raise DataError(Fault(begin["log"], "", f"{recorder.error.strerror}"))
        if inbox.error is not None:
            raise RuntimeError("a Zenoh callback failed") from inbox.error
    return EXIT_OK


def _log(begin: Mapping[str, Any], scenario: Scenario, side: Side) -> McapLog:
    metadata = {"version": "1", "side": side, "scenario": scenario.name, "digest": digest(scenario), "mode": "live"}
    log = McapLog(Path(begin["log"]), metadata)
    log.attach(CLOCK_FILE, json.dumps(begin["clock"]).encode())
    if scenario.sight is not None and (side == "surgeon" or not scenario.sight.is_external):
        log.attach(CODEC_FILE, json.dumps(dict(codec_versions(scenario.sight.codec))).encode())
    return log


def _take_keys(line: str, node: CompanionNode, keys: RunKeys) -> None:
    """Sign what is sent, and believe what comes, under the keys that a line tells."""
    if line:
        told = json.loads(line)
        own, other = bytes.fromhex(told["own"]), bytes.fromhex(told["other"])
        keys.agree(own, other)
        node.believe(own, other)


def _main() -> None:
    request = json.loads(sys.stdin.readline())

    def failed(code: int, faults: Sequence[Fault]) -> None:  # noqa: ARG001
        for fault in faults:
            sys.stderr.write(f"{line_of(request['side'], fault)}\n")

    raise SystemExit(guarded_exit_code(request["side"], lambda: _run(request), failed))


if __name__ == "__main__":
    run_to_end(_main)
