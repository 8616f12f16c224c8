"""Packet accounts of a link: each key at each station, checked against netem's own counters."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from operator import itemgetter
from typing import Final, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import VIDEO, Direction, Side
from tis.common.errors import problem
from tis.common.metrics.delivery import distinct, without
from tis.common.records import REJECTED
from tis.common.safety_records import QUARANTINE
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.logs.read.columns import Ints, joined
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import (
    DELIVER,
    NO_FATES,
    NO_RELEASES,
    RELEASED,
    fates_by_key,
    late_ns,
    releases_by_key,
)
from tis.deploy.logs.read.side_log import no_messages
from tis.deploy.report.subjects.logs import LogGaps, count_of
from tis.deploy.report.subjects.network.key_figures import KeyBooks
from tis.deploy.report.subjects.network.link_ends import ENDS, all_arrivals, both_ends, refused_arrivals

_AROUND_END_NS: Final = (-20 * NS_PER_MS, 500 * NS_PER_MS)
"""Time before and after netem's end in which what never reached it was under way, or sent to nobody."""


class LinkBooks(NamedTuple):
    """The packet accounts of one direction: totals, lateness, and the books of each key.

    ``counts`` are of everything that was offered and that left. ``error_ns`` (N,): how much later than decided each
    packet or copy left, and ``left_ns`` (N,) when, strangers and foreign ones too. ``n_unlogged`` messages are in no
    key's books, as they fall into the gaps of damaged logs; ``n_unlogged_offered`` of them were offered to netem.
    """

    counts: dict[str, int]
    error_ns: Ints
    left_ns: Ints
    keys: list[KeyBooks]
    n_unlogged: int
    n_unlogged_offered: int


def link_books(logs: RunLogs, direction: Direction, session: str) -> LinkBooks:
    """Return the books of one direction, without strangers.

    A stranger looks like a message of the testbed but was never sent: another program publishes on its keys. Only a
    complete log of the sender can tell.
    """
    sender, receiver = ENDS[direction]
    ends, nothing = both_ends(logs, direction, session), no_messages()
    offered, left = fates_by_key(logs, direction), releases_by_key(logs, direction)
    rejected = Counter(row["key"] for row in logs.of(receiver, REJECTED))
    refused: defaultdict[str, list[int]] = defaultdict(list)
    for row in logs.of(receiver, QUARANTINE):
        refused[row["key"]].append(row["seq"])
    covered = logs.coverage(sender)
    complete = covered is not None and covered.whole
    unused_by_key = refused_arrivals(logs, direction, session)
    gaps = LogGaps.of(logs, direction, session, get_args(Side))
    n_unlogged = n_unlogged_offered = 0
    counts = counted(offered.values(), left.values())
    error_ns = joined(late_ns(one) for one in left.values())
    left_ns = joined(one.released_ns[one.departure == RELEASED] for one in left.values())
    books = []
    sent = (key for key, (out, _) in ends.items() if len(out))
    for key in dict.fromkeys((*sent, *offered, *left, *ends)):
        # popped, as the columns of a long run are large
        fates, releases = offered.pop(key, NO_FATES), left.pop(key, NO_RELEASES)
        out, back = ends.get(key, (nothing, nothing))
        arrived = all_arrivals(out, back, unused_by_key.get(key))
        out = out.at(~_past_the_end(logs, out, fates.seq))
        sent_seq, received_seq = out.seq, arrived.seq
        # foreign messages have no sequence number of ours: books of their own, without sender and receiver
        if fates.foreign.any():
            foreign = fates.at(fates.foreign), releases.at(releases.foreign)
            books.append(KeyBooks(key, True, nothing.seq, *foreign, nothing.seq, nothing.seq, 0))
        fates, releases = fates.at(~fates.foreign), releases.at(~releases.foreign)
        # a message that one log may lack is taken out of all, or it would count as lost there
        if gaps.any:
            left_out = gaps.affected(
                (sent_seq, out.sent_ns),
                (fates.seq, fates.offered_ns),
                (releases.seq, releases.offered_ns),
                (received_seq, arrived.sent_ns),
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
            unused = without(distinct(received_seq), back.seq)
            # what the patient's gate refuses of a flipped message arrived all the same
            n_refused = int(np.isin(refused[key], fates.seq[fates.flipped > 0]).sum())
            n_refused += rejected[key]
            books.append(KeyBooks(key, False, sent_seq, fates, releases, received_seq, unused, n_refused))
    return LinkBooks(counts, error_ns, left_ns, books, n_unlogged, n_unlogged_offered)


def _past_the_end(logs: RunLogs, out: Frame, offered: Ints) -> NDArray[np.bool_]:
    """Return which messages (N,) were sent as netem ended: as of Ctrl-C the sides end one after the other."""
    covered = logs.coverage("netem")
    if covered is None or not covered.whole:  # where a damaged log ends, netem may have gone on
        return np.zeros(len(out), dtype=np.bool_)
    since_ns = out.sent_ns - logs.sides["netem"].last_ns
    around = (since_ns > _AROUND_END_NS[0]) & (since_ns < _AROUND_END_NS[1])
    return around & ~np.isin(out.seq, offered)


def _without(packets: Frame, seq: Ints) -> Frame:
    return packets.at(~np.isin(packets.seq, seq))


def counted(fates: Iterable[Frame], releases: Iterable[Frame]) -> dict[str, int]:
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


OF_TIS: Final = "this is a fault of tis: please report it"


def against_counters(logs: RunLogs, direction: Direction, by_log: Mapping[str, int]) -> list[str]:
    """Return the contradictions between netem's counters and its log; a complete log has none."""
    covered = logs.coverage("netem")
    if covered is None or not covered.whole or covered.away:
        return []
    by_netem = {name: count_of(logs, "netem", f"{direction}.{name}") for name in by_log}
    return [
        problem(f"netem counted {by_netem[name]} packets as {name}, its log has {n}", OF_TIS)
        for name, n in by_log.items()
        if by_netem[name] not in (None, n)
    ]


_SPREAD = np.int64(0x2545_F491_4F6C_DD1D)  # an odd factor: sequence numbers beside fingerprints in 64 bits


class Unsent(NamedTuple):
    """Number of forged messages, and key and run time in ns of the first one to arrive."""

    n: int
    key: str
    first_ns: int


def unsent(logs: RunLogs, direction: Direction, session: str) -> Unsent | None:
    """Return the messages used by the receiver of a direction that its sender's log does not hold.

    What the receiver quarantined is not in its messages, and of several copies with one sequence number only the
    first is used. A message whose bits netem flipped is not forged. None when the sender's log is missing or damaged,
    as it may then lack what was sent; and without a testbed. The same goes for the picture and the camera's log.
    Oracle: literals, test_unsent.
    """
    sender = ENDS[direction][0]
    covered = logs.coverage(sender)
    if not session or covered is None or not covered.whole:
        return None
    unknown: dict[str, Frame] = {}  # by key, the messages used that were not sent like this
    is_cut = any(not one.whole for one in logs.sides[sender].beside)
    for key, (out, back) in both_ends(logs, direction, session).items():
        if is_cut and key == VIDEO.key(session):
            continue
        used = back.first_of_each("seq")
        unknown[key] = used.at(~np.isin(_identity(used), _identity(out)))
    # The fates are only read when there is a message whose bits netem may have flipped.
    flipped = _flipped(logs, direction) if any(map(len, unknown.values())) else {}
    forged = {key: one.at(~np.isin(one.seq, flipped.get(key, ()))) for key, one in unknown.items()}
    first = [(int(one.log_ns.min()), key) for key, one in forged.items() if len(one)]
    first_ns, first_key = min(first, key=itemgetter(0), default=(0, ""))
    return Unsent(sum(map(len, forged.values())), first_key, first_ns)


def unsent_problem(found: Unsent | None, direction: Direction) -> list[str]:
    """Return the problem that forged messages are for a run; empty without any."""
    if found is None or not found.n:
        return []
    sender, receiver = ENDS[direction]
    how_many = f"{found.n} message{'s' if found.n > 1 else ''}"
    text = (
        f"links.{direction}: the {receiver} used {how_many} that the {sender} did not send; the first on "
        f"{found.key}, which arrived at {found.first_ns / NS_PER_S:.3f} s"
    )
    return [problem(text, "end the program that forges them, or let certificates keep it out (tis certs)")]


def _identity(messages: Frame) -> Ints:
    """Return a number (N,) for each sequence number with its payload."""
    with np.errstate(over="ignore"):
        return np.asarray(messages.fingerprint ^ (messages.seq * _SPREAD))


def _flipped(logs: RunLogs, direction: Direction) -> dict[str, Ints]:
    """Return by key the sequence numbers of the messages whose bits netem flipped."""
    return {key: fates.seq[fates.flipped > 0] for key, fates in fates_by_key(logs, direction).items()}
