"""The books of a link: every packet of each key at each station, and whether netem's own counters agree."""

from collections import Counter
from typing import Final, NamedTuple

import numpy as np

from common.channels import Direction, Side
from common.records import COUNTERS, REJECTED
from deploy.report.batches import DELIVER, RELEASED, Fates, Releases, by_key, link_fates, link_releases
from deploy.report.key_figures import KeyBooks
from deploy.report.load import Ints, MessageColumns, RunLogs

ENDS: Final[dict[Direction, tuple[Side, Side]]] = {
    "forward": ("surgeon", "patient"),
    "feedback": ("patient", "surgeon"),
}


class LinkBooks(NamedTuple):
    """Everything that was offered and that left in one direction, and the books of each key."""

    fates: Fates
    releases: Releases
    keys: list[KeyBooks]


def link_books(logs: RunLogs, direction: Direction, session: str) -> LinkBooks:
    """Return the books of one direction; strangers are in none of the keys'.

    A stranger looks like ours but was never sent: somebody else publishes on our keys. Only a sender's complete log
    can tell.
    """
    sender, receiver = ENDS[direction]
    sent, received = (logs.messages(side, direction, session) for side in (sender, receiver))
    fates, releases = link_fates(logs, direction), link_releases(logs, direction)
    rejected = Counter(row["key"] for row in logs.of(receiver, REJECTED))
    log = logs.sides.get(sender)
    complete = log is not None and log.damage is None
    offered = dict(zip(fates.keys, by_key(fates.key, len(fates.keys)), strict=True))
    left = dict(zip(releases.keys, by_key(releases.key, len(releases.keys)), strict=True))
    nothing = np.empty(0, dtype=np.int64)
    books = []
    for key in dict.fromkeys((*sent, *offered, *left, *received)):
        its_fates, its_releases = fates.at(offered.get(key, nothing)), releases.at(left.get(key, nothing))
        its_sent, its_received = _seq(sent.get(key)), _seq(received.get(key))
        if its_fates.foreign.any():
            theirs = its_fates.at(its_fates.foreign), its_releases.at(its_releases.foreign)
            books.append(KeyBooks(key, True, nothing, *theirs, nothing, 0))
        its_fates, its_releases = its_fates.at(~its_fates.foreign), its_releases.at(~its_releases.foreign)
        if complete:
            strangers = np.setdiff1d(its_fates.seq, its_sent)
            its_fates = its_fates.at(~np.isin(its_fates.seq, strangers))
            its_releases = its_releases.at(~np.isin(its_releases.seq, strangers))
            its_received = its_received[~np.isin(its_received, strangers)]
        if any(len(seq) for seq in (its_fates.seq, its_releases.seq, its_sent, its_received)):
            books.append(KeyBooks(key, False, its_sent, its_fates, its_releases, its_received, rejected[key]))
    return LinkBooks(fates, releases, books)


def _seq(messages: MessageColumns | None) -> Ints:
    return np.empty(0, dtype=np.int64) if messages is None else messages.seq


def against_counters(logs: RunLogs, direction: Direction, books: LinkBooks) -> list[str]:
    """Return where netem's own counters contradict its log, which a complete log never does."""
    if logs.sides["netem"].damage is not None:
        return []
    fates, releases = books.fates, books.releases
    n_delivered = int(np.count_nonzero(fates.outcome == DELIVER))
    n_copied = int(fates.copies.sum())
    by_log = {
        "offered": len(fates.seq),
        "copied": n_copied,
        "released": int(np.count_nonzero(releases.departure == RELEASED)),
        "held_at_end": n_delivered + n_copied - len(releases.seq),
    }
    counted = {name: counter(logs, f"{direction}.{name}") for name in by_log}
    return [
        f"netem counted {counted[name]} packets as {name}, its log has {n}"
        for name, n in by_log.items()
        if counted[name] not in (None, n)
    ]


def counter(logs: RunLogs, name: str) -> int | None:
    """Return what netem counted under a name; None when it did not."""
    return next((row["value"] for row in logs.of("netem", COUNTERS) if row["name"] == name), None)
