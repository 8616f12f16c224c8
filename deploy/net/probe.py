"""Probe of a path: messages at a constant rate, received in this process or by a far end, and paired."""

import time
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
import zenoh
from numpy.typing import NDArray

from tis.common.clocks import SHARED, ClockModel, Exchanges
from tis.common.errors import Fault, PeerError
from tis.common.messages import Header
from tis.common.runtime.clock import monotonic_ns
from tis.common.trace import LOST
from tis.common.units import NS_PER_S, s_to_ns
from tis.deploy.net.ends import low_latency

Ints = NDArray[np.int64]
Stamp = tuple[int, int, int]
"""Sequence number, mark and instant (ns) of an arrival; other messages have `WARMING_UP` or `FOREIGN` as number."""

WARMING_UP: Final = -2
FOREIGN: Final = -1


class Paired(NamedTuple):
    """N messages in the order of sending: delay, `LOST` if not in time, and its uncertainty.

    ``n_impossible`` arrived before they were sent, by more than the uncertainty: a clock was set meanwhile.
    """

    delay_ns: Ints
    uncertainty_ns: Ints
    n_duplicates: int = 0
    n_late: int = 0
    n_foreign: int = 0
    n_impossible: int = 0


def pair(sent_ns: Ints, marks: Ints, stamps: Sequence[Stamp], timeout_ns: int, clock: ClockModel = SHARED) -> Paired:
    """Pair messages (N,), sent at ``sent_ns`` by the sender's clock with these ``marks``, with their stamps.

    ``stamps`` are in order of arrival, by the receiver's clock, the reference of ``clock``. The first arrival counts;
    one after ``timeout_ns`` counts as lost (RFC 7680); one with a different mark is foreign. A negative delay is
    raised to 0, which is closer to the truth and within the uncertainty. Oracle: literal stamps behind
    an asymmetric path (tests/deploy/net/test_probe).
    """
    n = len(sent_ns)
    left_ns = clock.to_reference_ns(sent_ns)
    uncertainty_ns = clock.uncertainty_ns(sent_ns)
    # own messages by number and mark, everything else is foreign
    rows = np.array(stamps, dtype=np.int64).reshape(-1, 3)
    rows = rows[rows[:, 0] != WARMING_UP]
    ours = (rows[:, 0] >= 0) & (rows[:, 0] < n)
    ours[ours] = marks[rows[ours, 0]] == rows[ours, 1]
    seq, _, came_ns = rows[ours].T
    delay_ns = np.full(n, LOST, dtype=np.int64)
    # the first arrival of each number; `stamps` are in order of arrival
    arrived, first = np.unique(seq, return_index=True)
    delay_in_ns = came_ns[first] - left_ns[arrived]
    in_time = delay_in_ns <= timeout_ns
    delay_ns[arrived[in_time]] = np.maximum(delay_in_ns[in_time], 0)
    return Paired(
        delay_ns,
        uncertainty_ns,
        n_duplicates=len(seq) - len(arrived),
        n_late=int((~in_time).sum()),
        n_foreign=int((~ours).sum()),
        n_impossible=int((delay_in_ns < -uncertainty_ns[arrived]).sum()),
    )


def last_received(marks: Ints, stamps: Sequence[Stamp]) -> int:
    """Return the number of messages sent up to the last one known to have arrived."""
    found = [seq for seq, mark, _ in stamps if 0 <= seq < len(marks) and marks[seq] == mark]
    return max(found, default=-1) + 1


WARM_UP: Final = b"tis probe, warming up"
"""The attachment of a message that does not count."""


class Arrivals:
    """Stamps of the receiving end so far."""

    def __init__(self) -> None:
        self.rows: list[Stamp] = []
        self._seen: set[int] = set()

    def add(self, row: Stamp) -> None:
        """Append a stamp."""
        self.rows.append(row)
        if row[0] >= 0:
            self._seen.add(row[0])

    @property
    def n_messages(self) -> int:
        """Return the number of distinct messages."""
        return len(self._seen)


class ReceivingEnd(Protocol):
    """Interface of a receiving end for the sender."""

    def arrivals(self) -> Arrivals:
        """Return the known arrivals; raises an error of the receiving end."""
        ...

    def unavailable(self) -> bool:
        """Tell whether no further stamps will come."""
        ...

    def settle(self, hurry: bool) -> None:
        """Update the arrivals often from now on (``hurry``), or wait until all arrivals so far are known."""
        ...

    def clock(self) -> tuple[ClockModel, Exchanges]:
        """Return the sender's clock relative to this end's, and the exchanges behind it."""
        ...


class LocalReceivingEnd:
    """Receiving end in this process: the callback stamps and appends, nothing else."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._received: list[tuple[int, Any]] = []
        self._error: BaseException | None = None
        self._arrivals = Arrivals()
        self._subscriber = session.declare_subscriber(key, self._on_sample)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        try:
            self._received.append((monotonic_ns(), sample.attachment))
        except BaseException as error:
            self._error = error

    def arrivals(self) -> Arrivals:
        """Return the arrivals; raises an error of the callback."""
        if self._error is not None:
            raise self._error
        for came_ns, attachment in self._received[len(self._arrivals.rows) :]:
            self._arrivals.add(read_arrival(came_ns, attachment))
        return self._arrivals

    def unavailable(self) -> bool:
        """Return False: this end lives as long as the sender."""
        return False

    def settle(self, hurry: bool) -> None:
        """Do nothing: all arrivals are known."""

    def clock(self) -> tuple[ClockModel, Exchanges]:
        """Return the shared clock of both ends."""
        return SHARED, Exchanges.of([])

    def close(self) -> None:
        """Stop receiving."""
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


def read_arrival(came_ns: int, attachment: Any) -> Stamp:
    """Return the number (or kind), the mark and the instant of an arrival."""
    octets = b"" if attachment is None else attachment.to_bytes()
    header = Header.unpack(octets)
    if header is None:
        return (WARMING_UP if octets == WARM_UP else FOREIGN), 0, came_ns
    return header.seq, header.sent_ns, came_ns


_WARM_UP_EVERY_S: Final = 0.05
_SETTLE_S: Final = 0.2
_POLL_S: Final = 0.02


class Plan(NamedTuple):
    """Messages to send, timeout of a message (``timeout_s``) and of the first arrival (``wait_s``)."""

    key: str
    rate_hz: float
    n_messages: int
    n_bytes: int
    timeout_s: float
    wait_s: float


class Probed(NamedTuple):
    """N sent messages in order: instants, (N,) ns after the first, and delays.

    ``n_skipped`` were not sent because their instant had passed; the last ``n_unknown``, not among the N, were sent
    to an unavailable far end. ``clock`` is this host's relative to the far end's, fitted to ``exchanges``.
    """

    sent_ns: NDArray[np.int64]
    paired: Paired
    n_skipped: int
    n_unknown: int
    clock: ClockModel
    exchanges: Exchanges


def probe(sender: zenoh.Session, receiver: ReceivingEnd, plan: Plan) -> Probed:
    """Send from a session to the ``receiver``; raises `PeerError` when no message arrives.

    Message i is due ``i / rate_hz`` after the first; an instant that has passed is skipped, so that a stall of this
    process causes no burst. The delay is from just before the call of ``put`` to the callback (RFC 7679). A message
    later than ``timeout_s`` counts as lost (RFC 7680). Ctrl-C ends the sending early, and so does an unavailable far
    end; then the messages up to the last one known to have arrived are kept.
    """
    publisher = sender.declare_publisher(
        plan.key,
        congestion_control=zenoh.CongestionControl.DROP,
        reliability=zenoh.Reliability.RELIABLE,
        priority=zenoh.Priority.REAL_TIME,
        express=True,
    )
    try:
        with low_latency():
            _warm_up(publisher, receiver, plan)
            sent, n_skipped = _send(publisher, plan, receiver.unavailable)
            _drain(receiver, len(sent), plan.timeout_s)
    finally:
        publisher.undeclare()  # type: ignore[no-untyped-call]
    # Without a far end the last messages are of unknown fate, so they are cut off.
    sent_ns, marks = np.array(sent, dtype=np.int64).reshape(-1, 2).T
    stamps = receiver.arrivals().rows
    n_known = last_received(marks, stamps) if receiver.unavailable() else len(sent)
    clock, exchanges = receiver.clock()
    kept_ns = sent_ns[:n_known]
    paired = pair(kept_ns, marks[:n_known], stamps, s_to_ns(plan.timeout_s), clock)
    origin_ns = kept_ns[0] if n_known else 0
    return Probed(kept_ns - origin_ns, paired, n_skipped, len(sent) - n_known, clock, exchanges)


def _warm_up(publisher: zenoh.Publisher, receiver: ReceivingEnd, plan: Plan) -> None:
    """Send messages that do not count until one arrives, then wait for the others."""
    payload = bytes(plan.n_bytes)
    give_up = time.monotonic() + plan.wait_s
    receiver.settle(hurry=True)
    while not receiver.arrivals().rows:
        if time.monotonic() >= give_up or receiver.unavailable():
            raise PeerError(Fault("probe", plan.key, f"no message arrived within {plan.wait_s:g} s"))
        publisher.put(payload, attachment=WARM_UP)
        time.sleep(_WARM_UP_EVERY_S)
    time.sleep(_SETTLE_S)
    receiver.settle(hurry=False)


def _send(
    publisher: zenoh.Publisher, plan: Plan, unavailable: Callable[[], bool]
) -> tuple[list[tuple[int, int]], int]:
    """Return the instant and mark of each sent message, and the number of skipped ones."""
    payload = bytes(plan.n_bytes)
    sent: list[tuple[int, int]] = []
    n_skipped = 0
    period_ns = NS_PER_S / plan.rate_hz
    begin_ns = monotonic_ns()
    try:
        for i in range(plan.n_messages):
            due_ns = begin_ns + int(i * period_ns)
            now_ns = monotonic_ns()
            # more than a period late: skip, or the stall would become a burst
            if now_ns > due_ns + period_ns:
                n_skipped += 1
                continue
            while now_ns < due_ns:
                time.sleep((due_ns - now_ns) * 1e-9)
                now_ns = monotonic_ns()
            if unavailable():
                break
            mark = now_ns - begin_ns  # tells this probe's messages from those of another on the same key
            attachment = Header(len(sent), mark).pack()
            sent.append((monotonic_ns(), mark))
            publisher.put(payload, attachment=attachment)
    except KeyboardInterrupt:
        pass
    return sent, n_skipped


def _drain(receiver: ReceivingEnd, n_expected: int, timeout_s: float) -> None:
    """Wait for the last messages, at most until a later one would count as lost."""
    give_up = time.monotonic() + timeout_s
    receiver.settle(hurry=True)
    while receiver.arrivals().n_messages < n_expected and time.monotonic() < give_up and not receiver.unavailable():
        time.sleep(_POLL_S)
    time.sleep(_POLL_S)
    receiver.settle(hurry=False)
