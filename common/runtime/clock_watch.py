"""How a host follows the reference clock, a side netem's: exchanges when they meet, and all through the run."""

import json
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import zenoh

from common.clocks.exchange import Exchanges, Stamps
from common.clocks.reading import ClockReading, read_clock
from common.errors import Fault, PeerError
from common.node import Record
from common.records import CLOCK, EXCHANGES, ClockNote, ExchangeNote
from common.runtime.clock import WallClock, boot_id, monotonic_ns
from common.runtime.loop import Recorder

_FIRST: Final = 20
_QUICK_S: Final = 0.25
_QUICK: Final = 8
_BURST: Final = 4
_EVERY_S: Final = 1.0
_QUERY_S: Final = 1.0
_KEPT: Final = 24
_NOT_OURS: Final = (ValueError, KeyError, TypeError, RecursionError, OverflowError)
"""What reading an answer raises that is no clock's."""


class _Answer(NamedTuple):
    stamps: Stamps
    boot_id: str


class ClockWatch:
    """Asks the reference, netem, for its time, from a thread off the hot path; Zenoh's callbacks only stamp.

    `meet` comes first, once netem is there. Then `reading` says what is known now, and from `follow` to `close` each
    exchange is recorded. On one host (equal boot ids) there is nothing to follow: the clock is shared, exactly.
    """

    def __init__(self, session: zenoh.Session, key: str, time_out_s: float = _QUERY_S) -> None:
        self.shared = False
        self._session, self._key, self._time_out_s = session, key, time_out_s
        self._reference_boot_id = ""
        self._recent: deque[Stamps] = deque(maxlen=_KEPT)
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._log: Callable[[Stamps], None] | None = None
        self._thread = threading.Thread(target=self._keep_asking, name="clock", daemon=True)

    def meet(self) -> None:
        """Compare the clocks for the first time and go on doing so; raises `PeerError` when nobody answers."""
        for _ in range(_FIRST):
            answer = self._ask()
            if answer is None:
                break
            self._reference_boot_id = answer.boot_id
            if answer.boot_id and answer.boot_id == boot_id() and _in_order(answer.stamps):
                self.shared = True
                return
            self._recent.append(answer.stamps)
        if not self._recent:
            raise PeerError(Fault("netem", self._key, "does not answer clock queries"))
        self._thread.start()

    def reading(self) -> ClockReading:
        """Return how far netem's clock is ahead now; exactly 0 on one host."""
        if self.shared:
            return ClockReading(0, 0)
        return read_clock(self.recent(), monotonic_ns())

    def recent(self) -> Exchanges:
        """Return the newest exchanges; none where the clock is shared."""
        with self._lock:
            return Exchanges.of(self._recent)

    def follow(self, recorder: Recorder, clock: WallClock, reference_epoch_ns: int) -> None:
        """Record how the clocks stand to each other and, from now on, each exchange; the recent ones first."""
        note = ClockNote(
            boot_id=boot_id(),
            reference_boot_id=self._reference_boot_id,
            shared=self.shared,
            epoch_ns=clock.epoch_ns,
            reference_epoch_ns=reference_epoch_ns,
        )
        recorder.record(Record(CLOCK, 0, note))

        def log(stamps: Stamps) -> None:
            asked_ns, received_ns, replied_ns, answered_ns = stamps
            exchange = ExchangeNote(
                asked_ns=asked_ns - clock.epoch_ns,
                received_ns=received_ns - reference_epoch_ns,
                replied_ns=replied_ns - reference_epoch_ns,
                answered_ns=answered_ns - clock.epoch_ns,
            )
            recorder.record(Record(EXCHANGES, exchange.answered_ns, exchange))

        with self._lock:
            for stamps in self._recent:
                log(stamps)
            self._log = log

    def close(self) -> None:
        """Ask no more; a second call does nothing."""
        self._over.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _keep_asking(self) -> None:
        n_quick = 0
        while not self._over.wait(_QUICK_S if n_quick < _QUICK else _EVERY_S):
            n_quick += 1
            for _ in range(_BURST):
                try:
                    answer = self._ask()
                except zenoh.ZError:
                    return  # the session is closed
                if answer is None or self._over.is_set():
                    break
                with self._lock:
                    self._recent.append(answer.stamps)
                    if self._log is not None:
                        self._log(answer.stamps)

    def _ask(self) -> _Answer | None:
        """Make one exchange; None when nobody answers in time, or nothing that is a clock."""
        came: list[tuple[int, zenoh.Reply]] = []
        done = threading.Event()

        def take(reply: zenoh.Reply) -> None:
            came.append((monotonic_ns(), reply))

        asked_ns = monotonic_ns()
        self._session.get(
            self._key,
            zenoh.handlers.Callback(take, done.set, indirect=False),
            target=zenoh.QueryTarget.BEST_MATCHING,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=self._time_out_s,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        done.wait(2 * self._time_out_s)
        for answered_ns, reply in came:
            answer = _read(asked_ns, answered_ns, reply)
            if answer is not None:
                return answer
        return None


def _read(asked_ns: int, answered_ns: int, reply: Any) -> _Answer | None:
    if reply.ok is None:
        return None
    try:
        content = json.loads(reply.ok.payload.to_bytes())
        stamps = (asked_ns, content["received_ns"], content["replied_ns"], answered_ns)
        boot = content["boot_id"]
        possible = all(type(ns) is int for ns in stamps) and isinstance(boot, str) and len(Exchanges.of([stamps]))
    except _NOT_OURS:
        return None
    return _Answer(stamps, boot) if possible else None


def _in_order(stamps: Stamps) -> bool:
    """Tell whether one clock can have made all stamps; equal boot ids in two time namespaces are not one clock."""
    return list(stamps) == sorted(stamps)
