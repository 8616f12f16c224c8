"""A host's clock beside the reference clock, for a side netem's: its server, exchanges before and throughout a run.

netem's server answers directly on each network, outside its links; that of a probe's far end answers along the
probe's path. The state of the host's own clock discipline is read by adjtimex.
"""

import contextlib
import ctypes
import json
import queue
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, Final, NamedTuple, Self

import zenoh

from tis.common.clocks import ClockReading, Exchanges, Stamps, read_clock
from tis.common.errors import Fault, PeerError
from tis.common.host_records import CLOCK, EXCHANGES, ClockNote, DisciplineNote, ExchangeNote
from tis.common.node import Record
from tis.common.runtime.clock import WallClock, boot_id, monotonic_ns
from tis.common.runtime.loop import Recorder

_MAX_PENDING: Final = 256


class ClockServer:
    """Answers clock queries with the instants at which each was received and replied to.

    The callback only stamps; a separate thread replies, and its delay cancels out between the two stamps. Queries
    beyond the queue's length are not answered.
    """

    def __init__(self, sessions: Iterable[zenoh.Session], key: str) -> None:
        self._key = key
        self._boot_id = boot_id()
        self._pending: queue.Queue[tuple[int, zenoh.Query] | None] = queue.Queue(_MAX_PENDING)
        self._thread = threading.Thread(target=self._serve, name="clock", daemon=True)
        self._held: list[Any] = [
            session.declare_queryable(self._key, zenoh.handlers.Callback(self._take, indirect=False), complete=True)
            for session in sessions
        ]
        self._thread.start()

    def close(self) -> None:
        """Stop answering; a second call does nothing."""
        for declaration in self._held:
            declaration.undeclare()
        self._held.clear()
        if self._thread.is_alive():
            self._pending.put(None)
            self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _take(self, query: zenoh.Query) -> None:
        received_ns = monotonic_ns()
        with contextlib.suppress(queue.Full):
            self._pending.put_nowait((received_ns, query))

    def _serve(self) -> None:
        while (pending := self._pending.get()) is not None:
            received_ns, query = pending
            with contextlib.suppress(zenoh.ZError), query:  # the client may be gone
                reading = {"boot_id": self._boot_id, "received_ns": received_ns, "replied_ns": monotonic_ns()}
                query.reply(self._key, json.dumps(reading), express=True)


_N_FIRST: Final = 20  # exchanges when the clocks first meet
_N_BURST: Final = 4  # exchanges per round after that: the shortest round trip counts
_N_QUICK: Final = 8  # rounds at the shorter interval
_QUICK_S: Final = 0.25
_EVERY_S: Final = 1.0
_QUERY_S: Final = 1.0
_N_RECENT: Final = 24
_MALFORMED: Final = (ValueError, KeyError, TypeError, RecursionError, OverflowError)
"""Exceptions that a reply of a foreign program can cause."""


class _Answer(NamedTuple):
    stamps: Stamps
    boot_id: str


class ClockWatch:
    """Queries the reference clock from a thread off the hot path; Zenoh's callbacks only stamp.

    Call `meet` first, once netem is present. Then `reading` returns the present offset, and from `follow` to `close`
    each exchange is recorded. On one host (equal boot ids) the clock is shared, and there are no exchanges.
    """

    def __init__(self, session: zenoh.Session, key: str, time_out_s: float = _QUERY_S) -> None:
        self.shared = False
        self._session, self._key, self._time_out_s = session, key, time_out_s
        self._reference_boot_id = ""
        self._recent: deque[Stamps] = deque(maxlen=_N_RECENT)
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._log: Callable[[Stamps], None] | None = None
        self._thread = threading.Thread(target=self._exchange_regularly, name="clock", daemon=True)

    def meet(self) -> None:
        """Compare the clocks for the first time and start regular exchanges; raises `PeerError` without an answer."""
        for _ in range(_N_FIRST):
            answer = self._exchange()
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
        """Return the present offset of netem's clock over this one; exactly 0 on one host."""
        if self.shared:
            return ClockReading(0, 0)
        return read_clock(self.recent(), monotonic_ns())

    def recent(self) -> Exchanges:
        """Return the most recent exchanges; none where the clock is shared."""
        with self._lock:
            return Exchanges.of(self._recent)

    def follow(self, recorder: Recorder, clock: WallClock, reference_epoch_ns: int) -> None:
        """Record the relation of the clocks, the recent exchanges and, from now on, each new one."""
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

        # Under one lock, so that each exchange is logged exactly once.
        with self._lock:
            for stamps in self._recent:
                log(stamps)
            self._log = log

    def close(self) -> None:
        """Stop the exchanges; a second call does nothing."""
        self._over.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _exchange_regularly(self) -> None:
        n_rounds = 0
        while not self._over.wait(_QUICK_S if n_rounds < _N_QUICK else _EVERY_S):
            n_rounds += 1
            for _ in range(_N_BURST):
                try:
                    answer = self._exchange()
                except zenoh.ZError:
                    return  # the session is closed
                if answer is None or self._over.is_set():
                    break
                with self._lock:
                    self._recent.append(answer.stamps)
                    if self._log is not None:
                        self._log(answer.stamps)

    def _exchange(self) -> _Answer | None:
        """Make one exchange; None without a valid reply in time."""
        replies: list[tuple[int, zenoh.Reply]] = []
        done = threading.Event()

        def take(reply: zenoh.Reply) -> None:
            replies.append((monotonic_ns(), reply))

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
        done.wait(2 * self._time_out_s)  # Zenoh ends the query at its time-out; the factor guards against a stall
        for answered_ns, reply in replies:
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
    except _MALFORMED:
        return None
    return _Answer(stamps, boot) if possible else None


def _in_order(stamps: Stamps) -> bool:
    """Tell whether all stamps can be of one clock; two time namespaces have equal boot ids but different clocks."""
    return list(stamps) == sorted(stamps)


_STA_UNSYNC: Final = 0x0040
_TIME_ERROR: Final = 5
_SCALED_PPM: Final = 1 << 16


class _Timex(ctypes.Structure):
    """``struct timex`` of <sys/timex.h>."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        *((name, ctypes.c_long) for name in ("offset", "freq", "maxerror", "esterror")),
        ("status", ctypes.c_int),
        *((name, ctypes.c_long) for name in ("constant", "precision", "tolerance", "seconds", "fraction", "tick")),
        *((name, ctypes.c_long) for name in ("ppsfreq", "jitter")),
        ("shift", ctypes.c_int),
        *((name, ctypes.c_long) for name in ("stabil", "jitcnt", "calcnt", "errcnt", "stbcnt")),
        ("tai", ctypes.c_int),
        ("padding", ctypes.c_int * 11),
    )


def read_discipline(at_ns: int) -> DisciplineNote | None:
    """Return the state of the clock discipline, read at run time ``at_ns``; None where it is not available."""
    call = getattr(ctypes.CDLL(None), "adjtimex", None) if sys.platform.startswith("linux") else None
    if call is None:
        return None
    timex = _Timex(modes=0)  # 0: read only, which needs no privilege
    state = call(ctypes.byref(timex))
    if state < 0:
        return None
    return DisciplineNote(
        at_ns=at_ns,
        synchronised=state != _TIME_ERROR and not timex.status & _STA_UNSYNC,
        estimated_error_us=timex.esterror,
        maximum_error_us=timex.maxerror,
        frequency_ppm=timex.freq / _SCALED_PPM,
    )
