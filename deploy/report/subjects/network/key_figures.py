"""Measured figures of one key, or of several together: counts, loss, delay, jitter and order; columns for figures."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction
from tis.common.metrics.delay_variation import (
    first_arrivals,
    inter_packet_delay_variation_ns,
    n_reordering,
    packet_delay_variation_ns,
    reordering_extents,
    rtp_jitter_ns,
)
from tis.common.metrics.delivery import KeyAccount, KeyPackets, Transmissions, account
from tis.common.metrics.latency import lateness_us
from tis.common.metrics.loss import fit_gilbert, loss_interval, loss_runs
from tis.common.metrics.percentiles import TAIL, summarise
from tis.common.units import NS_PER_MS, NS_PER_S, NS_PER_US
from tis.deploy.logs.read.columns import Ints, joined
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import (
    DELIVER,
    NO_FATES,
    NO_RELEASES,
    RELEASED,
    fates_by_key,
    in_order_of_leaving,
    place_in,
    releases_by_key,
)
from tis.deploy.logs.read.side_log import DEPARTURES, OUTCOMES

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LinkColumns:
    """The messages of a link, or of one of its keys, from netem's log, without foreign ones.

    ``sent_s`` (N,) is the instant of offering of each delivered message, ascending, ``seq`` (N,) its number;
    ``decided_ms`` (N,) is the drawn delay, ``realised_ms`` (N,) the measured one, of the first copy to leave.
    ``lost_s`` are the instants of offering of lost messages, ascending, ``run_lengths`` the lengths of the runs of
    losses, key by key, ``error_us`` the release errors of all packets, copies too.
    """

    sent_s: Array
    seq: Ints
    decided_ms: Array
    realised_ms: Array
    lost_s: Array
    run_lengths: Ints
    error_us: Array


def link_columns(logs: RunLogs, direction: Direction) -> LinkColumns:
    """Return one link's columns, empty without netem's log (oracle: records written by hand, test_packets)."""
    offered, left = fates_by_key(logs, direction), releases_by_key(logs, direction)
    each = [_columns(NO_FATES, NO_RELEASES)]
    for key in list(offered):
        # popped, as the columns of a long run are large
        fates, releases = offered.pop(key), left.pop(key, NO_RELEASES)
        each.append(_columns(fates.at(~fates.foreign), releases.at(~releases.foreign)))
    found: dict[str, Any] = {
        one.name: np.concatenate([getattr(columns, one.name) for columns in each]) for one in fields(LinkColumns)
    }
    order = np.argsort(found["sent_s"], kind="stable")
    sent = {name: found[name][order] for name in ("sent_s", "seq", "decided_ms", "realised_ms")}
    return LinkColumns(**found | sent | {"lost_s": np.sort(found["lost_s"])})


def _columns(fates: Frame, releases: Frame) -> LinkColumns:
    """Return the columns of one key, in any order of sending."""
    out = releases.at(releases.departure == RELEASED)
    first = first_copies(in_order_of_leaving(out))
    delivered = fates.at(fates.outcome == DELIVER)
    # a delivered message may still have been dropped from a queue, so fates and releases are matched
    seq, here, there = np.intersect1d(delivered.seq, first.seq, return_indices=True)
    through, left = delivered.at(here), first.at(there)
    lost = (fates.outcome != DELIVER) | np.isin(fates.seq, np.setdiff1d(releases.seq, out.seq))
    return LinkColumns(
        sent_s=through.offered_ns / NS_PER_S,
        seq=seq,
        decided_ms=through.delay_ns / NS_PER_MS,
        realised_ms=(left.released_ns - left.offered_ns) / NS_PER_MS,
        lost_s=fates.offered_ns[lost] / NS_PER_S,
        run_lengths=loss_runs(lost).lengths,
        error_us=(out.released_ns - out.release_ns) / NS_PER_US,
    )


class KeyBooks(NamedTuple):
    """One key's packets at each station; data of a missing log is empty."""

    key: str
    foreign: bool
    sent: Ints
    fates: Frame
    releases: Frame
    received: Ints
    unused: Ints
    n_rejected: int


class KeyFigures(NamedTuple):
    """The measured columns of one key; delays in ns.

    ``decided_ns`` is of delivered packets, originals only, as fates hold no delay of a copy. ``realised_ns``, from
    netem's ingress to its egress, and the variations of delay are of each message's first copy to leave (RFC 7679);
    ``error_ns``, ``left_ns``, ``queued_ns`` and ``recovered_ns`` of everything that left;
    ``n_recovered`` counts the messages whose first sending was lost. Packets are in order of leaving netem.
    """

    account: KeyAccount
    offered_ns: Ints
    decided_ns: Ints
    realised_ns: Ints
    pdv_ns: Ints
    ipdv_ns: Ints
    jitter_ns: NDArray[np.float64]
    error_ns: Ints
    left_ns: Ints
    queued_ns: Ints
    recovered_ns: Ints
    n_recovered: int
    run_lengths: Ints
    loss_distances: Ints
    extents: Ints
    late_behind: Ints
    extents_in_netem: Ints
    dropped_by: dict[str, int]

    @classmethod
    def of(cls, books: KeyBooks) -> Self:
        """Measure one key (oracle: a few packets computed by hand, test_link_summary)."""
        fates, releases = books.fates, books.releases
        out = releases.departure == RELEASED
        delivered = fates.outcome == DELIVER
        left = in_order_of_leaving(releases)
        first = first_copies(left)
        found = account(books.key, _packets(books, out, delivered))
        runs = loss_runs(found.lost)
        realised_ns = first.released_ns - first.offered_ns
        # IPDV compares neighbours in order of sending, jitter (RFC 3550) in order of leaving
        delay_ns, arrived = _in_order_of_offering(fates.seq, first.seq, realised_ns)
        return cls(
            account=found,
            offered_ns=fates.offered_ns,
            decided_ns=fates.delay_ns[delivered],
            realised_ns=realised_ns,
            pdv_ns=packet_delay_variation_ns(realised_ns),
            ipdv_ns=inter_packet_delay_variation_ns(delay_ns, arrived),
            jitter_ns=rtp_jitter_ns(first.offered_ns, first.released_ns),
            error_ns=left.released_ns - left.release_ns,
            left_ns=left.released_ns,
            queued_ns=left.queued_ns,
            recovered_ns=left.recovered_ns,
            n_recovered=int(np.count_nonzero(fates.recovered)),
            run_lengths=runs.lengths,
            loss_distances=runs.distances,
            extents=reordering_extents(first_arrivals(books.received)),
            late_behind=n_reordering(first_arrivals(books.received)),
            extents_in_netem=reordering_extents(first_arrivals(left.seq)),
            dropped_by=_reasons(fates, releases),
        )


def statistics(figures: Sequence[KeyFigures]) -> dict[str, Any]:
    """Return the summary's figures of one key, or of several pooled; an unknown entry is None."""
    figures = figures or [KeyFigures.of(_NO_BOOKS)]
    counts = {name: sum(one.account.counts[name] for one in figures) for name in figures[0].account.counts}
    lost = _merged_lost(figures)
    n_lost, lengths = int(np.count_nonzero(lost)), _all(figures, "run_lengths")
    # runs of losses and jitter are of one stream: keys pooled would interleave them
    fit = fit_gilbert(lost) if len(lost) and len(figures) == 1 else None
    low_high = loss_interval(lost) if len(lost) else None
    jitter_ms = _all(figures, "jitter_ns") / NS_PER_MS
    ipdv_ms = _all(figures, "ipdv_ns") / NS_PER_MS
    recovered_ns = _all(figures, "recovered_ns")
    error_ns, extents = _all(figures, "error_ns"), _all(figures, "extents")
    return {
        **counts,
        "reordered": len(extents),
        "reordered_in_netem": len(_all(figures, "extents_in_netem")),
        "reordering_extent": summarise(extents),
        "n_reordering": summarise(_all(figures, "late_behind")),
        "dropped_by": dict(sum((Counter(one.dropped_by) for one in figures), Counter())),
        "loss_pct": 100 * n_lost / len(lost) if len(lost) else None,
        "loss_pct_interval_95": None if low_high is None else [100 * bound for bound in low_high],
        "loss_runs": {
            "count": len(lengths),
            "mean": n_lost / len(lengths) if len(lengths) else None,
            "mean_interval_95": _finite(fit.mean_burst_interval) if fit else None,
            "longest": int(lengths.max(initial=0)),
            "distance": summarise(_all(figures, "loss_distances"), (50, 95), ("mean",)),
        },
        "delay_ms": {
            kind: summarise(_all(figures, f"{kind}_ns") / NS_PER_MS, TAIL, ("mean", "std", "max"))
            for kind in ("decided", "realised")
        },
        "pdv_ms": summarise(_all(figures, "pdv_ns") / NS_PER_MS, TAIL, ("mean", "max")),
        "ipdv_ms": {
            **summarise(np.abs(ipdv_ms), TAIL, ("mean", "max")),
            "std": float(ipdv_ms.std()) if len(ipdv_ms) else None,
        },
        "rfc3550_jitter_ms": {
            "last": float(jitter_ms[-1]) if len(jitter_ms) and len(figures) == 1 else None,
            **summarise(jitter_ms, (), ("mean", "max")),
        },
        "release_error_us": lateness_us(np.zeros_like(error_ns), error_ns),
        "queued_ms": summarise(_all(figures, "queued_ns") / NS_PER_MS, TAIL, ("mean", "max")),
        "recovered": sum(one.n_recovered for one in figures),
        "recovered_ms": summarise(recovered_ns[recovered_ns > 0] / NS_PER_MS, TAIL, ("mean", "max")),
    }


_NOTHING = np.empty(0, dtype=np.int64)
_NO_BOOKS = KeyBooks("", False, _NOTHING, NO_FATES, NO_RELEASES, _NOTHING, _NOTHING, 0)


def _packets(books: KeyBooks, out: NDArray[np.bool_], delivered: NDArray[np.bool_]) -> KeyPackets:
    fates, releases = books.fates, books.releases
    # dropped at the door, or dropped later out of the queue
    lost, gone = fates.seq[~delivered], releases.at(~out)
    return KeyPackets(
        sent=fates.seq if books.foreign else books.sent,
        offered=fates.seq,
        copied=fates.copies,
        corrupted=fates.flipped > 0,
        released=Transmissions(releases.seq[out], releases.copy_index[out]),
        dropped=Transmissions(
            np.concatenate([lost, gone.seq]), np.concatenate([np.zeros_like(lost), gone.copy_index])
        ),
        received=releases.seq[out] if books.foreign else books.received,
        unused=books.unused,
        n_rejected=books.n_rejected,
    )


def _in_order_of_offering(offered: Ints, left: Ints, delay_ns: Ints) -> tuple[Ints, NDArray[np.bool_]]:
    """Return the delay (N,) of each offered packet, 0 where it did not leave, and whether it left (N,)."""
    seq, first = np.unique(left, return_index=True)
    place, arrived = place_in(seq, offered)
    known_ns = np.append(delay_ns[first], 0)  # where nothing left, all places are that of the 0
    return np.where(arrived, known_ns[place], 0), arrived


def _reasons(fates: Frame, releases: Frame) -> dict[str, int]:
    n: dict[str, int] = {name: int(np.count_nonzero(fates.outcome == code)) for code, name in enumerate(OUTCOMES)}
    for code, name in enumerate(DEPARTURES):  # a full queue drops at the door, or what waits
        n[name] = n.get(name, 0) + int(np.count_nonzero(releases.departure == code))
    passed = (OUTCOMES[DELIVER], DEPARTURES[RELEASED])
    return {name: count for name, count in n.items() if count and name not in passed}


def _merged_lost(figures: Sequence[KeyFigures]) -> NDArray[np.bool_]:
    """Return the lost flags of all keys by instant of offering, as an outage hits all keys at once."""
    if len(figures) == 1:
        return figures[0].account.lost
    lost = joined((one.account.lost for one in figures), np.bool_)
    return np.asarray(lost[np.argsort(_all(figures, "offered_ns"), kind="stable")])


def _all(figures: Sequence[KeyFigures], name: str) -> NDArray[Any]:
    return joined(getattr(one, name) for one in figures)


def _finite(interval: tuple[float, float] | None) -> list[float | None] | None:
    return None if interval is None else [bound if np.isfinite(bound) else None for bound in interval]


def first_copies(left: Frame) -> Frame:
    """Return, of packets in order of leaving, the first one of each message, in the same order.

    A restarted sender uses a number again, so a message is named by number and instant of offering (oracle: a few
    messages by hand, tests/deploy/report/subjects/network/test_link_summary).
    """
    if not left.copy_index.any():
        return left
    order = np.lexsort((np.arange(len(left.seq)), left.offered_ns, left.seq))
    seq, offered_ns = left.seq[order], left.offered_ns[order]
    is_first = np.ones(len(order), dtype=np.bool_)
    is_first[1:] = (seq[1:] != seq[:-1]) | (offered_ns[1:] != offered_ns[:-1])
    return left.at(np.sort(order[is_first]))
