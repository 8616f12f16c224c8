"""Packet accounts of a link: each key at each station, checked against netem's own counters."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple, TypeVar, get_args

import numpy as np

from tis.common.channels import Direction, Side
from tis.common.metrics.delivery import without
from tis.common.records import COUNTERS, REJECTED
from tis.common.safety_records import QUARANTINE
from tis.deploy.logs.read.batches import (
    DELIVER,
    NO_FATES,
    NO_RELEASES,
    RELEASED,
    Fates,
    Releases,
    fates_by_key,
    late_ns,
    releases_by_key,
)
from tis.deploy.logs.read.load import Ints, RunLogs
from tis.deploy.logs.read.message_columns import MessageColumns
from tis.deploy.report.measures.key_figures import KeyBooks
from tis.deploy.report.measures.log_gaps import LogGaps

Packets = TypeVar("Packets", Fates, Releases)

ENDS: Final[dict[Direction, tuple[Side, Side]]] = {
    "forward": ("surgeon", "patient"),
    "feedback": ("patient", "surgeon"),
}


class LinkBooks(NamedTuple):
    """The packet accounts of one direction: totals, lateness, and the books of each key.

    ``counts`` are of everything that was offered and that left. ``error_ns`` (N,): how much later than decided each
    packet or copy left, strangers and foreign ones too. ``n_unlogged`` messages are in no key's books, as they fall
    into the gaps of damaged logs; ``n_unlogged_offered`` of them were offered to netem.
    """

    counts: dict[str, int]
    error_ns: Ints
    keys: list[KeyBooks]
    n_unlogged: int
    n_unlogged_offered: int


def link_books(logs: RunLogs, direction: Direction, session: str) -> LinkBooks:
    """Return the books of one direction, without strangers.

    A stranger looks like a message of the testbed but was never sent: another program publishes on its keys. Only a
    complete log of the sender can tell.
    """
    sender, receiver = ENDS[direction]
    sent, received = (logs.messages(side, direction, session) for side in (sender, receiver))
    offered, left = fates_by_key(logs, direction), releases_by_key(logs, direction)
    rejected = Counter(row["key"] for row in logs.of(receiver, REJECTED))
    refused: defaultdict[str, list[int]] = defaultdict(list)
    for row in logs.of(receiver, QUARANTINE):
        refused[row["key"]].append(row["seq"])
    covered = logs.coverage(sender)
    complete = covered is not None and covered.whole
    gaps = LogGaps.of(logs, direction, session, get_args(Side))
    n_unlogged = n_unlogged_offered = 0
    nothing = np.empty(0, dtype=np.int64)
    counts = counted(offered.values(), left.values())
    error_ns = np.concatenate([nothing, *(late_ns(one) for one in left.values())])
    books = []
    for key in list(dict.fromkeys((*sent, *offered, *left, *received))):
        # popped, as the columns of a long run are large
        fates, releases = offered.pop(key, NO_FATES), left.pop(key, NO_RELEASES)
        out, back = sent.get(key, MessageColumns()), received.get(key, MessageColumns())
        sent_seq, received_seq = out.seq, back.seq
        # foreign messages have no sequence number of ours: books of their own, without sender and receiver
        if fates.foreign.any():
            foreign = fates.at(fates.foreign), releases.at(releases.foreign)
            books.append(KeyBooks(key, True, nothing, *foreign, nothing, 0))
        fates, releases = fates.at(~fates.foreign), releases.at(~releases.foreign)
        # a message that one log may lack is taken out of all, or it would count as lost there
        if gaps.any:
            left_out = gaps.affected(
                (sent_seq, out.sent_ns),
                (fates.seq, fates.offered_ns),
                (releases.seq, releases.offered_ns),
                (received_seq, back.sent_ns),
            )
            n_unlogged += len(left_out)
            n_unlogged_offered += int(np.isin(fates.seq, left_out).sum())
            fates, releases = _without(fates, left_out), _without(releases, left_out)
            sent_seq, received_seq = without(sent_seq, left_out), without(received_seq, left_out)
        if complete:
            strangers = np.setdiff1d(fates.seq, sent_seq)
            fates, releases = _without(fates, strangers), _without(releases, strangers)
            received_seq = received_seq[~np.isin(received_seq, strangers)]
        if any(len(seq) for seq in (fates.seq, releases.seq, sent_seq, received_seq)):
            # what the patient's gate refuses of a flipped message arrived all the same
            n_refused = int(np.isin(refused[key], fates.seq[fates.flipped > 0]).sum())
            books.append(KeyBooks(key, False, sent_seq, fates, releases, received_seq, rejected[key] + n_refused))
    return LinkBooks(counts, error_ns, books, n_unlogged, n_unlogged_offered)


def _without(packets: Packets, seq: Ints) -> Packets:
    return packets.at(~np.isin(packets.seq, seq))


def counted(fates: Iterable[Fates], releases: Iterable[Releases]) -> dict[str, int]:
    """Return the counts of a log under the names of netem's own counters."""
    n = Counter(offered=0, copied=0, released=0, held_at_end=0)
    for one in fates:
        n_copied = int(one.copies.sum())
        n_delivered = int(np.count_nonzero(one.outcome == DELIVER))
        n.update(offered=len(one.seq), copied=n_copied, held_at_end=n_delivered + n_copied)
    for other in releases:
        n.update(released=int(np.count_nonzero(other.departure == RELEASED)))
        n["held_at_end"] -= len(other.seq)
    return dict(n)


def against_counters(logs: RunLogs, direction: Direction, by_log: Mapping[str, int]) -> list[str]:
    """Return the contradictions between netem's counters and its log; a complete log has none."""
    covered = logs.coverage("netem")
    if covered is None or not covered.whole or covered.away:
        return []
    by_netem = {name: counter(logs, f"{direction}.{name}") for name in by_log}
    return [
        f"netem counted {by_netem[name]} packets as {name}, its log has {n}"
        for name, n in by_log.items()
        if by_netem[name] not in (None, n)
    ]


def counter(logs: RunLogs, name: str) -> int | None:
    """Return one of netem's counters, None when its log has none of that name."""
    return next((row["value"] for row in logs.of("netem", COUNTERS) if row["name"] == name), None)
