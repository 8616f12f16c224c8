"""The summary's ``links``: what became of each packet, how late it was, how exactly netem kept its word."""

from collections import defaultdict
from typing import Any, get_args

import numpy as np

from common.channels import Direction, Side
from common.metrics.loss import LinkPackets, Packet, account, wilson_interval
from common.metrics.ordering import order_counts
from common.metrics.percentiles import summarise
from common.metrics.timing import lateness_us
from common.records import FATES, RELEASES
from common.units import NS_PER_MS
from deploy.report.load import Row, RunLogs

_ENDS: dict[Direction, tuple[Side, Side]] = {
    "forward": ("surgeon", "patient"),
    "feedback": ("patient", "surgeon"),
}


def _names(rows: list[Row]) -> list[Packet]:
    return [(row["key"], row["seq"]) for row in rows]


def _strangers(fates: list[Row], sent: list[Packet], logs: RunLogs, sender: Side) -> set[Packet]:
    """Return the packets that look like ours but were never sent: somebody else publishes on our keys.

    Only a sender's complete log can tell.
    """
    log = logs.sides.get(sender)
    if log is None or log.damage is not None:
        return set()
    return set(_names(fates)) - set(sent)


def _is_ours(row: Row, strangers: set[Packet]) -> bool:
    return not row["foreign"] and (row["key"], row["seq"]) not in strangers


def link_summary(logs: RunLogs, direction: Direction, session: str) -> tuple[dict[str, Any], list[str]]:
    """Return one link's figures and what does not add up; names and meanings as in the definitions.

    A figure for which a log is missing is None, and then nobody can tell whether the books balance.
    """
    sender, receiver = _ENDS[direction]
    sent = [(key, row["_seq"]) for key, row in logs.messages(sender, direction, session)]
    fates = [row for row in logs.of("netem", FATES) if row["direction"] == direction]
    strangers = _strangers(fates, sent, logs, sender)
    ours = [row for row in fates if _is_ours(row, strangers)]
    releases = [
        row for row in logs.of("netem", RELEASES) if row["direction"] == direction and _is_ours(row, strangers)
    ]
    left = [row for row in releases if not row["late"]]
    overtaken = [row for row in releases if row["late"]]
    lost = [row for row in ours if row["outcome"] != "deliver"]
    gone = {*_names(lost), *_names(releases)}
    arrived = [(key, row["_seq"]) for key, row in logs.messages(receiver, direction, session)]
    received = [name for name in arrived if name not in strangers]
    books = account(
        LinkPackets(
            sent=sent,
            offered=_names(ours),
            released=_names(left),
            dropped=[*_names(lost), *_names(overtaken)],
            held_at_end=[name for name in _names(ours) if name not in gone],
            received=received,
        )
    )
    streams: dict[str, list[int]] = defaultdict(list)
    for key, seq in received:
        streams[key].append(seq)
    order = order_counts({key: np.array(seqs, dtype=np.int64) for key, seqs in streams.items()})
    offered_ns = np.array([row["offered_ns"] for row in left], dtype=np.int64)
    due_ns = np.array([row["release_ns"] for row in left], dtype=np.int64)
    left_ns = np.array([row["released_ns"] for row in left], dtype=np.int64)
    decided_ns = np.array([row["delay_ns"] for row in ours if row["outcome"] == "deliver"], dtype=np.int64)
    counts, whole = books.counts, len(logs.sides) == len(get_args(Side))
    share = wilson_interval(counts["dropped"], counts["offered"])
    reasons: dict[str, int] = defaultdict(int)
    for row in lost:
        reasons[row["outcome"]] += 1
    if overtaken:
        reasons["late"] = len(overtaken)
    figures = {**counts, "reordered": order.reordered, "foreign": len(fates) - len(ours)}
    keepers = {"sent": sender, "received": receiver, "duplicated": receiver, "reordered": receiver}
    known = {name for name in figures if keepers.get(name, "netem") in logs.sides}
    if not whole:
        known.discard("unplanned_loss")
    summary = {
        **{name: value if name in known else None for name, value in figures.items()},
        "dropped_by": dict(reasons),
        "loss_pct": 100 * counts["dropped"] / counts["offered"] if counts["offered"] else None,
        "loss_pct_interval_95": None if share is None else [100 * share[0], 100 * share[1]],
        "delay_ms": {
            "decided": summarise(decided_ns / NS_PER_MS, also=("mean", "std", "max")),
            "realised": summarise((left_ns - offered_ns) / NS_PER_MS, also=("mean", "std", "max")),
        },
        "release_error_us": lateness_us(due_ns, left_ns),
    }
    return summary, [f"links.{direction}: {text}" for text in books.violations] if whole else []
