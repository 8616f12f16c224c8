"""Both ends of a link: messages as sent and as received, and those that arrived and were refused."""

from typing import Final

import numpy as np

from tis.common.channels import Direction, Side
from tis.common.safety_records import QUARANTINE
from tis.deploy.logs.read.columns import Ints
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import (
    NO_FATES,
    NO_RELEASES,
    RELEASED,
    fates_by_key,
    place_in,
    releases_by_key,
)
from tis.deploy.logs.read.side_log import no_messages

ENDS: Final[dict[Direction, tuple[Side, Side]]] = {
    "forward": ("surgeon", "patient"),
    "feedback": ("patient", "surgeon"),
}


def both_ends(logs: RunLogs, direction: Direction, session: str) -> dict[str, tuple[Frame, Frame]]:
    """Return by key the messages of a direction as sent and as received, in the order of each log."""
    sent, received = (logs.messages(side, direction, session) for side in ENDS[direction])
    nothing = no_messages()
    return {key: (sent.get(key, nothing), received.get(key, nothing)) for key in dict.fromkeys((*sent, *received))}


def refused_arrivals(logs: RunLogs, direction: Direction, session: str) -> dict[str, Frame]:
    """Return by key the messages that the network delivered and the receiver quarantined, in order of arrival.

    Columns: ``seq``, ``offered_ns`` to netem, and ``log_ns`` of the arrival (N,). Of each number there are at most as
    many as left netem, with its copies, beyond those that the receiver used: any others were forged. A message whose
    bits netem flipped is none. Without netem's log nobody can tell, and there are none. Oracle: literals,
    test_link_ends.
    """
    notes = logs.of(ENDS[direction][1], QUARANTINE)
    if not len(notes):
        return {}
    fates, left = fates_by_key(logs, direction), releases_by_key(logs, direction)
    used = logs.messages(ENDS[direction][1], direction, session)
    found = {}
    for key in np.unique(notes.column("key")).tolist():
        of_key = notes.at(notes.where("key", key))
        packets = fates.get(key, NO_FATES)
        flipped = packets.seq[packets.flipped > 0]
        one = _delivered(of_key, left.get(key, NO_RELEASES), used.get(key, no_messages()).seq, flipped)
        if len(one):
            found[key] = one
    return found


def all_arrivals(out: Frame, used: Frame, refused: Frame | None) -> Frame:
    """Return what arrived of the messages ``out`` of a key, used or refused, as it came.

    Columns: ``seq``, ``sent_ns`` and ``log_ns`` (N,). What was refused and is not in the sender's log counts as sent
    when it was offered to netem.
    """
    known = {"seq": used.seq, "log_ns": used.log_ns, "sent_ns": used.sent_ns}
    if refused is None:
        return Frame.of_arrays(**known)
    sent = out.first_of_each("seq")
    place, is_logged = place_in(sent.seq, refused.seq)
    sent_ns = np.where(is_logged, np.append(sent.sent_ns, 0)[place], refused.offered_ns)
    others = {"seq": refused.seq, "log_ns": refused.log_ns, "sent_ns": sent_ns}
    together = Frame.of_arrays(**{name: np.concatenate([known[name], others[name]]) for name in known})
    return together.at(np.argsort(together.log_ns, kind="stable"))


def _delivered(notes: Frame, left: Frame, used: Ints, flipped: Ints) -> Frame:
    """Return the messages of one key that left netem with whole bits and were refused."""
    out = left.at((left.departure == RELEASED) & ~left.foreign)
    copies = np.unique(np.stack([out.seq, out.copy_index.astype(np.int64)], axis=1), axis=0)[:, 0]
    seq, n_left = np.unique(copies, return_counts=True)
    known, n_used = np.unique(used, return_counts=True)
    at, is_used = place_in(known, seq)
    n_free = n_left - (np.where(is_used, n_used[at], 0) if len(known) else 0)
    recv_ns = notes.column("recv_ns").astype(np.int64)
    order = np.argsort(recv_ns, kind="stable")
    refused, recv_ns = notes.column("seq").astype(np.int64)[order], recv_ns[order]
    place, has_left = place_in(seq, refused)
    has_left &= ~np.isin(refused, flipped)
    refused, recv_ns, place = refused[has_left], recv_ns[has_left], place[has_left]
    true = _rank(refused) < n_free[place]
    offered_ns = out.first_of_each("seq").offered_ns
    return Frame.of_arrays(seq=refused[true], offered_ns=offered_ns[place[true]], log_ns=recv_ns[true])


def _rank(values: Ints) -> Ints:
    """Return how many equal values stand before each of the values (N,)."""
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    rank = np.empty(len(values), dtype=np.int64)
    rank[order] = np.arange(len(values)) - np.searchsorted(ordered, ordered)
    return rank
