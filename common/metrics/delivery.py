"""Delivery: an account of the packets of one key, from the logs of sender, netem and receiver, and of their samples.

A message is identified by its sequence number, a *transmission* by that and the number of the copy, 0 for the
original. The three logs are matched by these identifiers after the drain. Packets repeat samples and carry earlier
ones as history, so samples have an account of their own.
"""

from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]

_NONE: Final[Ints] = np.empty(0, dtype=np.int64)


class Transmissions(NamedTuple):
    """Messages and their copies: arrays (N,)."""

    seq: Ints
    copy_index: Ints

    @classmethod
    def of(cls, *named: tuple[int, int]) -> Self:
        """Return the transmissions (number, copy)."""
        both = np.array(named, dtype=np.int64).reshape(-1, 2)
        return cls(both[:, 0], both[:, 1])

    def names(self, n_each: int) -> Ints:
        """Return one number for each transmission, where a message has at most ``n_each`` of them."""
        return self.seq * n_each + self.copy_index


class KeyPackets(NamedTuple):
    """The packets of one key at each station; a number may appear more than once in ``received`` only.

    ``sent`` is from the sender's log; ``offered`` (N,), ``copied`` (N,), the number of copies of each, ``corrupted``
    (N,), true where bits were flipped, ``released`` and ``dropped`` are from netem's; ``received`` is from the
    receiver's, whose gate refused all that came of the messages ``unused``, and which rejected ``n_rejected``
    messages of the key as undecodable.
    """

    sent: Ints
    offered: Ints
    copied: Ints
    corrupted: NDArray[np.bool_]
    released: Transmissions
    dropped: Transmissions
    received: Ints
    unused: Ints = _NONE
    n_rejected: int = 0


class KeyAccount(NamedTuple):
    """Counts under the summary's names, the loss of each offered message, and sentences on inconsistencies."""

    counts: dict[str, int]
    lost: NDArray[np.bool_]
    """(N,), in the order of offering: true where neither the message nor a copy of it was released or is held."""
    violations: tuple[str, ...]


def account(key: str, packets: KeyPackets) -> KeyAccount:
    """Count the packets of one key and check that the counts are consistent.

    ``sent``, ``offered``, ``received``, ``lost`` count messages; ``released``, ``dropped``, ``held_at_end``
    transmissions: offered + copied = released + dropped + held_at_end. ``duplicated`` are arrivals beyond the first
    of each message (RFC 5560), ``duplicated_by_netem`` those that netem made. ``corrupted_rejected`` left netem with
    flipped bits and were rejected by the receiver. ``unplanned_loss`` is any other loss on either side of netem. Loss
    is as in RFC 7680, with the drain as its time-out.

    Violations: an identifier twice at one station; a packet that is offered but not sent, released or dropped but
    never offered, both released and dropped, or received but not released. Oracle: tables and sets, in the tests.
    """
    # Transmissions as single integers, so that stations are compared as sets of integers.
    offered, sent = distinct(packets.offered), distinct(packets.sent)
    indices = (packets.copied, packets.released.copy_index, packets.dropped.copy_index)
    n_each = 1 + max(int(index.max(initial=0)) for index in indices)
    made = _copies(packets, n_each)
    known = distinct(np.concatenate([offered * n_each, made]))
    released, dropped = packets.released.names(n_each), packets.dropped.names(n_each)
    left, gone = distinct(released), distinct(dropped)
    held = without(without(known, left), gone)
    # After netem a copy cannot be told from its original, so messages are counted there.
    n_released, n_received = _counted(left // n_each), _counted(packets.received)
    n_lost, n_repeated = _after_netem(n_released, n_received)
    was_corrupted = np.isin(n_released.value, packets.offered[packets.corrupted])
    rejected = min(int(n_lost[was_corrupted].sum()), packets.n_rejected)
    lost_before, lost_after = len(without(sent, offered)), int(n_lost.sum()) - rejected
    lost = ~(np.isin(packets.offered, n_released.value) | np.isin(packets.offered, held // n_each))
    counts = {
        "sent": len(sent),
        "offered": len(offered),
        "copied": len(made),
        "released": len(left),
        "dropped": len(gone),
        "held_at_end": len(held),
        "lost": int(np.count_nonzero(lost)),
        "received": len(n_received.value),
        "not_used": len(packets.unused),
        "duplicated": len(packets.received) - len(n_received.value),
        "duplicated_by_netem": int(n_repeated.sum()),
        "corrupted": int(np.count_nonzero(packets.corrupted)),
        "corrupted_rejected": rejected,
        "lost_before_netem": lost_before,
        "lost_after_netem": lost_after,
        "unplanned_loss": lost_before + lost_after,
    }
    stations = {"sent": packets.sent, "offered": packets.offered, "released": released, "dropped": dropped}
    impossible = {
        "offered but never sent": without(offered, sent),
        "released or dropped but never offered": without(distinct(np.concatenate([left, gone])), known) // n_each,
        "both released and dropped": left[np.isin(left, gone)] // n_each,
        "received but never released": without(n_received.value, n_released.value),
    }
    repeated = {name: len(entries) - counts[name] for name, entries in stations.items()}
    twice = (f"{n} packets appear more than once in {name}: {key}" for name, n in repeated.items() if n > 0)
    first = ((what, len(seq), seq.min()) for what, seq in impossible.items() if len(seq))
    found = (f"{n} packets: {what}; the first is {key} seq {seq}" for what, n, seq in first)
    return KeyAccount(counts, lost, (*twice, *found))


def _copies(packets: KeyPackets, n_each: int) -> Ints:
    """Return the identifiers of the copies that netem made."""
    seq, n = packets.offered, packets.copied
    each = (Transmissions(seq[n >= i], np.full(int((n >= i).sum()), i)) for i in range(1, n_each))
    return np.concatenate([_NONE, *(copies.names(n_each) for copies in each)])


class _Counted(NamedTuple):
    """Distinct numbers, ascending, and the number of occurrences of each."""

    value: Ints
    n: Ints

    def at(self, value: Ints) -> Ints:
        """Return the number of occurrences of each of ``value``."""
        if not len(self.value):
            return np.zeros(len(value), dtype=np.int64)
        # searchsorted returns the length for values beyond the last one, which is no valid index
        place = np.minimum(np.searchsorted(self.value, value), len(self.value) - 1)
        return np.where(self.value[place] == value, self.n[place], 0)


def _after_netem(released: _Counted, received: _Counted) -> tuple[Ints, Ints]:
    """Return how many of each message released were lost behind netem, and how many arrived repeated by netem.

    Of a message with copies, as many are lost as fewer arrived than were released; arrivals beyond the first are
    netem's duplicates as far as netem released as many.
    """
    n_arrived = received.at(released.value)
    return np.maximum(released.n - n_arrived, 0), np.maximum(np.minimum(n_arrived, released.n) - 1, 0)


def distinct(values: Ints) -> Ints:
    """Return the distinct ``values``, ascending: as `numpy.unique`, but faster for sorted input."""
    ordered = np.sort(values, kind="stable")
    first = np.diff(ordered, prepend=ordered[:1] - 1) != 0
    return np.asarray(ordered[first])


def without(values: Ints, others: Ints) -> Ints:
    """Return the ``values`` that are not among ``others``."""
    return values[~np.isin(values, others)]


def _counted(values: Ints) -> _Counted:
    value = distinct(values)
    ordered = np.sort(values, kind="stable")
    return _Counted(value, np.diff(np.searchsorted(ordered, value), append=len(ordered)))


Flags = NDArray[np.bool_]


class PlannedSamples(NamedTuple):
    """The packets of one key and their samples, by ascending sequence number.

    ``sample_ns`` (S,) holds the sample instants, ascending; ``own`` (N,) the index of each packet's own sample;
    ``is_first`` (N,) marks the first packet of each sample, before its copies.
    """

    sample_ns: Ints
    own: Ints
    is_first: Flags

    @classmethod
    def of(cls, seq: Ints, sample_ns: Ints) -> Self:
        """Return the plan of packets from their sequence numbers (N,) and sample instants (N,).

        Raises `ValueError` where the numbers do not ascend.
        """
        if (np.diff(seq) <= 0).any():
            raise ValueError("the sequence numbers of packets must ascend")
        instants, first, own = np.unique(sample_ns, return_index=True, return_inverse=True)
        is_first = np.zeros(len(seq), dtype=np.bool_)
        is_first[first] = True
        return cls(instants, own.reshape(-1), is_first)

    def carried(self, packets: Flags, history: int) -> Flags:
        """Mark the samples (S,) that the marked ``packets`` (N,) carry, each its own and the ``history`` before it.

        Oracle: a set filled packet by packet, tests/common/metrics/test_delivery.
        """
        # +1 at the first sample that a packet carries, -1 after its last; the running sum counts the carriers.
        edges = np.zeros(len(self.sample_ns) + 1, dtype=np.int64)
        own = self.own[packets]
        np.add.at(edges, np.maximum(own - history, 0), 1)
        np.add.at(edges, own + 1, -1)
        return np.asarray(np.cumsum(edges[:-1]) > 0)
