"""Receiving end of a probe: interface for the sender, and an end within the sender's process."""

from typing import Any, Final, Protocol

import zenoh

from tis.common.clocks import SHARED, ClockModel, Exchanges
from tis.common.header import Header
from tis.common.runtime.clock import monotonic_ns
from tis.deploy.net.probing.message_pairing import FOREIGN, WARMING_UP, Stamp

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
