"""Exchanges of four timestamps with the reference clock, and the shortest round trip of each window."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Stamps = tuple[int, int, int, int]


@dataclass(frozen=True)
class Exchanges:
    """N exchanges, columns (N,) in ns; T1 to T4 of RFC 5905, section 8.

    ``asked_ns`` (query sent) and ``answered_ns`` (reply received) are this host's stamps, ``received_ns`` and
    ``replied_ns`` the reference's. The offset of the reference is at most ``received - asked`` at T1 and at least
    ``replied - answered`` at T4, however the round trip divides into its two ways.
    """

    asked_ns: Ints
    received_ns: Ints
    replied_ns: Ints
    answered_ns: Ints

    @classmethod
    def of(cls, stamps: Iterable[Stamps]) -> Self:
        """Return the exchanges of stamps given one by one, by ascending T1, without impossible ones.

        Impossible: T3 before T2, or T3 - T2 longer than T4 - T1.
        """
        asked_ns, received_ns, replied_ns, answered_ns = np.array(list(stamps), dtype=np.int64).reshape(-1, 4).T
        made_ns = replied_ns - received_ns
        kept = np.flatnonzero((made_ns >= 0) & (answered_ns - asked_ns >= made_ns))
        kept = kept[np.argsort(asked_ns[kept], kind="stable")]
        return cls(asked_ns[kept], received_ns[kept], replied_ns[kept], answered_ns[kept])

    def __len__(self) -> int:
        """Return N."""
        return len(self.asked_ns)

    @property
    def offset_ns(self) -> Ints:
        """Return the offset of the reference over this host, (N,): RFC 5905's theta, rounded down."""
        found: Ints = (self.received_ns - self.asked_ns + self.replied_ns - self.answered_ns) // 2
        return found

    @property
    def round_trip_ns(self) -> Ints:
        """Return the round-trip time without the reference's processing, (N,): RFC 5905's delta."""
        return (self.answered_ns - self.asked_ns) - (self.replied_ns - self.received_ns)

    @property
    def bound_ns(self) -> Ints:
        """Return the bound on the error of `offset_ns`, (N,): half the round trip, rounded up.

        It is reached when one way took all the time. Oracle: random asymmetric paths, test_exchange.
        """
        found: Ints = -(-self.round_trip_ns // 2)
        return found

    def at(self, which: Ints) -> "Exchanges":
        """Return the exchanges with the indices ``which``."""
        return Exchanges(
            self.asked_ns[which], self.received_ns[which], self.replied_ns[which], self.answered_ns[which]
        )


def shortest(exchanges: Exchanges, window_ns: int) -> Exchanges:
    """Return the exchange with the smallest round trip of each window of ``window_ns``, the earlier of equals.

    Queueing only adds to a round trip, so the shortest has the smallest bound (the clock filter of RFC 5905, section
    10, over eight exchanges). Oracle: a dictionary of windows in the tests.
    """
    if not len(exchanges):
        return exchanges
    window = (exchanges.asked_ns - exchanges.asked_ns[0]) // window_ns
    order = np.lexsort((exchanges.round_trip_ns, window))
    _, first = np.unique(window[order], return_index=True)
    return exchanges.at(order[first])
