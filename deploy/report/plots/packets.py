"""Columns of a link's messages for figures."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction
from tis.common.metrics.loss import loss_runs
from tis.common.units import NS_PER_MS, NS_PER_S, NS_PER_US
from tis.deploy.logs.read.batches import (
    DELIVER,
    NO_RELEASES,
    RELEASED,
    Fates,
    Releases,
    fates_by_key,
    in_order_of_leaving,
    releases_by_key,
)
from tis.deploy.logs.read.load import Ints, RunLogs
from tis.deploy.report.measures.first_copies import first_copies

Array = NDArray[np.float64]


@dataclass(frozen=True)
class KeyColumns:
    """One key's messages, from netem's log.

    ``sent_s`` (N,) is the instant of offering of each delivered message, ascending; ``decided_ms`` (N,) is the drawn
    delay, ``realised_ms`` (N,) the measured one, of the first copy to leave. ``lost_s`` are the instants of offering
    of lost messages, ``error_us`` the release errors of all packets, copies too.
    """

    sent_s: Array
    seq: Ints
    decided_ms: Array
    realised_ms: Array
    lost_s: Array
    lost: NDArray[np.bool_]
    """Whether each message offered was lost, in the order of offering."""
    error_us: Array


@dataclass(frozen=True)
class LinkColumns:
    """One link's messages, without foreign ones."""

    keys: dict[str, KeyColumns]

    def all(self, name: str) -> Array:
        """Return a column of all keys together, key by key."""
        return np.concatenate([np.empty(0), *(getattr(key, name) for key in self.keys.values())])


def link_columns(logs: RunLogs, direction: Direction) -> LinkColumns:
    """Return one link's columns; no keys without netem's log (oracle: records written by hand, test_packets)."""
    offered, left = fates_by_key(logs, direction), releases_by_key(logs, direction)
    found = {}
    for key in list(offered):
        fates, releases = offered.pop(key), left.pop(key, NO_RELEASES)
        fates, releases = fates.at(~fates.foreign), releases.at(~releases.foreign)
        if len(fates.seq):
            found[key] = _columns(fates, releases)
    return LinkColumns(found)


def _columns(fates: Fates, releases: Releases) -> KeyColumns:
    out = releases.at(releases.departure == RELEASED)
    first = first_copies(in_order_of_leaving(out))
    delivered = fates.at(fates.outcome == DELIVER)
    # a delivered message may still have been dropped from a queue, so fates and releases are matched
    seq, here, there = np.intersect1d(delivered.seq, first.seq, return_indices=True)
    through, left = delivered.at(here), first.at(there)
    order = np.argsort(through.offered_ns, kind="stable")
    gone = np.setdiff1d(releases.seq, out.seq)
    lost = (fates.outcome != DELIVER) | np.isin(fates.seq, gone)
    return KeyColumns(
        sent_s=through.offered_ns[order] / NS_PER_S,
        seq=seq[order],
        decided_ms=through.delay_ns[order] / NS_PER_MS,
        realised_ms=(left.released_ns - left.offered_ns)[order] / NS_PER_MS,
        lost_s=np.sort(fates.offered_ns[lost]) / NS_PER_S,
        lost=lost,
        error_us=(out.released_ns - out.release_ns) / NS_PER_US,
    )


def run_lengths(links: Mapping[Direction, LinkColumns]) -> dict[Direction, Ints]:
    """Return the lengths of the runs of losses, key by key, of directions with any loss."""
    none = np.empty(0, dtype=np.int64)
    runs = {
        d: np.concatenate([none, *(loss_runs(key.lost).lengths for key in k.keys.values())]) for d, k in links.items()
    }
    return {direction: lengths for direction, lengths in runs.items() if len(lengths)}
