"""The receiving end of a probe, as its sender knows it, and one that is in the sender's process."""

from typing import Any, Final, Protocol

import zenoh

from common.clocks.exchange import Exchanges
from common.clocks.model import SHARED, ClockModel
from common.header import Header
from common.runtime.clock import monotonic_ns
from deploy.net.probing.message_pairing import FOREIGN, WARMING_UP, Stamp

WARM_UP: Final = b"tis probe, warming up"
"""The attachment of a message that does not count."""


class Arrivals:
    """What the receiving end has stamped so far."""

    def __init__(self) -> None:
        self.rows: list[Stamp] = []
        self._seen: set[int] = set()

    def add(self, row: Stamp) -> None:
        """Take one more."""
        self.rows.append(row)
        if row[0] >= 0:
            self._seen.add(row[0])

    @property
    def n_messages(self) -> int:
        """Return how many messages came, each counted once."""
        return len(self._seen)


class ReceivingEnd(Protocol):
    """The receiving end, as the sender knows it."""

    def arrivals(self) -> Arrivals:
        """Return what is known to have arrived; raises what went wrong there."""
        ...

    def unavailable(self) -> bool:
        """Tell whether nothing more will be known."""
        ...

    def settle(self, hurry: bool) -> None:
        """Be quick to know of arrivals from now on, or, without ``hurry``, be sure to know of all by now."""
        ...

    def clock(self) -> tuple[ClockModel, Exchanges]:
        """Return the sender's clock against this end's."""
        ...


class LocalReceivingEnd:
    """A receiving end in this process: a callback that stamps and appends, nothing else."""

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
        """Return what has arrived; raises what failed in the callback."""
        if self._error is not None:
            raise self._error
        for came_ns, attachment in self._received[len(self._arrivals.rows) :]:
            self._arrivals.add(read_arrival(came_ns, attachment))
        return self._arrivals

    def unavailable(self) -> bool:
        """Return False: it lives as long as the sender."""
        return False

    def settle(self, hurry: bool) -> None:
        """Do nothing: what arrived is known."""

    def clock(self) -> tuple[ClockModel, Exchanges]:
        """Return the one clock of both ends."""
        return SHARED, Exchanges.of([])

    def close(self) -> None:
        """Hear no more."""
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


def read_arrival(came_ns: int, attachment: Any) -> Stamp:
    """Return whose message an attachment was on, its mark, and when it came."""
    octets = b"" if attachment is None else attachment.to_bytes()
    header = Header.unpack(octets)
    if header is None:
        return (WARMING_UP if octets == WARM_UP else FOREIGN), 0, came_ns
    return header.seq, header.sent_ns, came_ns
