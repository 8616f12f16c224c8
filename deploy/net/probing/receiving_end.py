"""Receiving end of a probe, in the sender's process or far, and the pairing of what was sent with what arrived."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
import zenoh
from numpy.typing import NDArray

from tis.common.clocks import SHARED, ClockModel, Exchanges
from tis.common.header import Header
from tis.common.runtime.clock import monotonic_ns
from tis.common.trace import LOST

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
    an asymmetric path (tests/deploy/net/probing/test_message_pairing).
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
