"""The books of a link: every packet of each key at each station, and whether netem's own counters agree."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple, get_args

import numpy as np

from common.channels import Direction, Side
from common.metrics.loss import without
from common.records import COUNTERS, REJECTED
from deploy.logs.read.batches import (
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
from deploy.logs.read.load import Ints, RunLogs
from deploy.logs.read.message_columns import MessageColumns
from deploy.report.measures.key_figures import KeyBooks
from deploy.report.measures.log_gaps import LogGaps

ENDS: Final[dict[Direction, tuple[Side, Side]]] = {
    "forward": ("surgeon", "patient"),
    "feedback": ("patient", "surgeon"),
}


class LinkBooks(NamedTuple):
    """What was counted of all that was offered and that left in one direction, how late it left, each key's books.

    ``error_ns`` (N,): how much later than decided each packet or copy left, strangers and foreign ones too.
    ``n_unlogged``: so many messages are in no key's books, since a damaged log may not tell of them; of these netem was
    offered ``n_unlogged_offered``.
    """

    counts: dict[str, int]
    error_ns: Ints
    keys: list[KeyBooks]
    n_unlogged: int
    n_unlogged_offered: int


def link_books(logs: RunLogs, direction: Direction, session: str) -> LinkBooks:
    """Return the books of one direction; strangers are in none of the keys'.

    A stranger looks like ours but was never sent: somebody else publishes on our keys. Only a sender's complete log
    can tell.
    """
    sender, receiver = ENDS[direction]
    sent, received = (logs.messages(side, direction, session) for side in (sender, receiver))
    offered, left = fates_by_key(logs, direction), releases_by_key(logs, direction)
    rejected = Counter(row["key"] for row in logs.of(receiver, REJECTED))
    covered = logs.coverage(sender)
    complete = covered is not None and covered.whole
    untold = LogGaps.of(logs, direction, session, get_args(Side))
    n_unlogged = n_unlogged_offered = 0
    nothing = np.empty(0, dtype=np.int64)
    counts = counted(offered.values(), left.values())
    error_ns = np.concatenate([nothing, *(late_ns(one) for one in left.values())])
    books = []
    for key in list(dict.fromkeys((*sent, *offered, *left, *received))):
        its_fates, its_releases = offered.pop(key, NO_FATES), left.pop(key, NO_RELEASES)
        out, back = sent.get(key, MessageColumns()), received.get(key, MessageColumns())
        its_sent, its_received = out.seq, back.seq
        if its_fates.foreign.any():
            theirs = its_fates.at(its_fates.foreign), its_releases.at(its_releases.foreign)
            books.append(KeyBooks(key, True, nothing, *theirs, nothing, 0))
        its_fates, its_releases = its_fates.at(~its_fates.foreign), its_releases.at(~its_releases.foreign)
        if untold.any:
            left_out = untold.numbers(
                (its_sent, out.sent_ns),
                (its_fates.seq, its_fates.offered_ns),
                (its_releases.seq, its_releases.offered_ns),
                (its_received, back.sent_ns),
            )
            n_unlogged += len(left_out)
            n_unlogged_offered += int(np.isin(its_fates.seq, left_out).sum())
            its_fates = its_fates.at(~np.isin(its_fates.seq, left_out))
            its_releases = its_releases.at(~np.isin(its_releases.seq, left_out))
            its_sent, its_received = without(its_sent, left_out), without(its_received, left_out)
        if complete:
            strangers = np.setdiff1d(its_fates.seq, its_sent)
            its_fates = its_fates.at(~np.isin(its_fates.seq, strangers))
            its_releases = its_releases.at(~np.isin(its_releases.seq, strangers))
            its_received = its_received[~np.isin(its_received, strangers)]
        if any(len(seq) for seq in (its_fates.seq, its_releases.seq, its_sent, its_received)):
            books.append(KeyBooks(key, False, its_sent, its_fates, its_releases, its_received, rejected[key]))
    return LinkBooks(counts, error_ns, books, n_unlogged, n_unlogged_offered)


def counted(fates: Iterable[Fates], releases: Iterable[Releases]) -> dict[str, int]:
    """Return what a log holds, under the names of netem's own counters."""
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
    """Return where netem's own counters contradict its log, which a complete log never does."""
    covered = logs.coverage("netem")
    if covered is None or not covered.whole:
        return []
    by_netem = {name: counter(logs, f"{direction}.{name}") for name in by_log}
    return [
        f"netem counted {by_netem[name]} packets as {name}, its log has {n}"
        for name, n in by_log.items()
        if by_netem[name] not in (None, n)
    ]


def counter(logs: RunLogs, name: str) -> int | None:
    """Return what netem counted under a name; None when it did not."""
    return next((row["value"] for row in logs.of("netem", COUNTERS) if row["name"] == name), None)
