"""Latency of single samples from the logs, part by part; ages and round trips."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Arm, Hand, Side, hand_channels
from tis.common.metrics.latency import Instants, LatencyParts, latency_parts, round_trip_ns
from tis.common.records import FRESH
from tis.common.units import NS_PER_MS
from tis.deploy.logs.coverage import WRITTEN_WITHIN_NS, lies_in
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.message_columns import MessageColumns
from tis.deploy.logs.read.note_columns import first_uses, notes, place_in, ticks
from tis.deploy.logs.read.payload_instants import NO_INSTANT


class UsedSamples(NamedTuple):
    """The samples at their first use by an estimate, all hands together; instants (N,) in ns.

    A sample is taken, sent and received; the estimate that uses it is begun, published, and returned to the surgeon's
    side (`NO_INSTANT` where it never arrived).
    """

    sample_ns: Instants
    sent_ns: Instants
    recv_ns: Instants
    begin_ns: Instants
    published_ns: Instants
    returned_ns: Instants


def used_samples(logs: RunLogs, session: str, arms: Mapping[Hand, Arm]) -> UsedSamples:
    """Return each sample at its first use, at a tick or on arrival; ``arms`` maps a hand to the arm that it drives.

    A sample whose path is not in the logs from end to end is left out. Oracle: paths computed by hand, test_summary.
    """
    arrivals = logs.messages("patient", "forward", session)
    published, returned = (_answers(logs, side, session, arms) for side in ("patient", "surgeon"))
    found = [np.empty((0, len(UsedSamples._fields)), dtype=np.int64)]
    for hand in arms:
        uses = first_uses(logs, hand)
        published_ns = _instants(published.get(hand), uses.answer)
        returned_ns = _instants(returned.get(hand), uses.answer)
        # sequence numbers are per key, so packets are matched key by key; the first arrival counts
        for key in np.unique(uses.key):
            columns = arrivals.get(str(key), MessageColumns())
            seq, first = np.unique(columns.seq, return_index=True)
            place, arrived = place_in(seq, uses.seq)
            used = arrived & (uses.key == key) & (published_ns != NO_INSTANT)
            which = first[place[used]]
            path_ns = (columns.sample_ns[which], columns.sent_ns[which], columns.log_ns[which], uses.begin_ns[used])
            found.append(np.column_stack([*path_ns, published_ns[used], returned_ns[used]]))
    return UsedSamples(*np.concatenate(found).T)


def sample_latency(used: UsedSamples) -> LatencyParts:
    """Return the latency of each used sample by part, from its instant to the estimate that used it."""
    return latency_parts(used.sample_ns, used.sent_ns, used.recv_ns, used.begin_ns, used.published_ns)


def network_round_trips(used: UsedSamples) -> Instants:
    """Return the network's share (N,) of each round trip in ns: forward the sample, back its first estimate.

    The time between arrival and answer is left out, like the reflector's time in TWAMP (RFC 5357); the offset between
    the two clocks cancels with it. Oracle: paths computed by hand, test_summary.
    """
    back = used.returned_ns != NO_INSTANT
    trips_ns = used.recv_ns - used.sent_ns + used.returned_ns - used.published_ns
    return np.asarray(trips_ns[back])


def ages_ns(logs: RunLogs) -> Instants:
    """Return the age at every tick, hand by hand: its instant minus that of the freshest sample of either stream.

    Ticks without a new arrival count too, so an outage shows here and not in the end-to-end latency. Missed ticks and
    those before the first sample have no age. Oracle: an outage of known length, tests/deploy/run/test_twin.
    """
    hands: list[Hand] = np.unique(notes(logs, "patient", FRESH).column("hand")).tolist()
    return np.concatenate([np.empty(0, dtype=np.int64), *(ages_of_hand(logs, hand)[1] for hand in hands)])


def ages_of_hand(logs: RunLogs, hand: Hand) -> tuple[Instants, Instants]:
    """Return the instants (N,) of the ticks at which one hand has an age, and the ages (N,), both in ns."""
    begun, fresh = ticks(logs), notes(logs, "patient", FRESH)
    ours = fresh.where("hand", hand)
    order = np.argsort(fresh.column("tick")[ours], kind="stable")
    tick, sample_ns = (fresh.column(name)[ours][order] for name in ("tick", "sample_ns"))
    # notes exist only for ticks with a new freshest sample; the others keep the one before
    newest = np.searchsorted(tick, begun.tick, side="right") - 1
    known = (newest >= 0) & ~_near_gap(logs, begun.due_ns)
    return begun.due_ns[known], begun.due_ns[known] - sample_ns[newest[known]]


def ages_at_ms(logs: RunLogs, hand: Hand, t_ns: Instants) -> NDArray[np.float64]:
    """Return one hand's ages (T,) in ms at the tick instants ``t_ns`` (T,), NaN for none."""
    at_ns, age_ns = ages_of_hand(logs, hand)
    place, known = place_in(at_ns, t_ns)
    age_ms = np.full(len(t_ns), np.nan)
    age_ms[known] = age_ns[place[known]] / NS_PER_MS
    return age_ms


def _near_gap(logs: RunLogs, due_ns: Instants) -> NDArray[np.bool_]:
    """Mark the ticks (T,) near a gap of the patient's log: the note of their freshest sample may be lost in it."""
    covered = logs.coverage("patient")
    gaps = logs.left_out if covered is None else (*covered.unknown, *covered.away, *logs.left_out)
    return lies_in(due_ns, gaps, WRITTEN_WITHIN_NS, WRITTEN_WITHIN_NS)


def round_trips(logs: RunLogs, session: str, arms: Mapping[Hand, Arm]) -> Instants:
    """Return the round trip (N,) of each command sample that an estimate answers, in ns on the surgeon's clock."""
    trips = [np.empty(0, dtype=np.int64)]
    for answers in _answers(logs, "surgeon", session, arms).values():
        command_ns, log_ns = answers.command_sample_ns, answers.log_ns
        carries = command_ns != NO_INSTANT
        trips.append(round_trip_ns(command_ns[carries], log_ns[carries]))
    return np.concatenate(trips)


def _answers(logs: RunLogs, side: Side, session: str, arms: Mapping[Hand, Arm]) -> dict[Hand, MessageColumns]:
    """Return the estimates that a side sent or received, by hand."""
    log = logs.sides.get(side)
    known = {} if log is None else log.messages
    keys = {hand: hand_channels(hand, arm).estimated.key(session) for hand, arm in arms.items()}
    return {hand: known[key] for hand, key in keys.items() if key in known}


def _instants(answers: MessageColumns | None, number: Instants) -> Instants:
    """Return the instant of the first copy of each answer ``number`` (N,); `NO_INSTANT` where there is none."""
    if answers is None or not len(answers):
        return np.full(len(number), NO_INSTANT)
    seq, first = np.unique(answers.seq, return_index=True)
    place, known = place_in(seq, number)
    return np.where(known, answers.log_ns[first[place]], NO_INSTANT)
