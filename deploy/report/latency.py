"""From the logs to the ways of single samples: how long each part of a run's latency took."""

from collections import defaultdict
from collections.abc import Mapping

import numpy as np

from common.channels import Arm, Hand, Side, hand_channels
from common.metrics.latency import Instants, LatencyParts, latency_parts, round_trip_ns
from common.records import FRESH, TICKS
from deploy.report.load import NO_INSTANT, MessageColumns, RunLogs


def ways(logs: RunLogs, session: str, arms: Mapping[Hand, Arm]) -> LatencyParts:
    """Return the way of each freshest sample, from its instant to the estimate that used it, all hands together.

    ``arms`` says which arm each hand drives. A sample whose way is not in the logs from end to end is left out.
    Oracle: ways worked by hand in the tests of the summary.
    """
    begin_ns = {row["tick"]: row["begin_ns"] for row in logs.of("patient", TICKS) if not row["missed"]}
    published_ns = {
        hand: dict(zip(answers.seq.tolist(), answers.log_ns.tolist(), strict=True))
        for hand, answers in _answers(logs, "patient", session, arms).items()
    }
    used: dict[str, list[tuple[int, int, int]]] = defaultdict(list)
    for note in logs.of("patient", FRESH):
        begun, answered = begin_ns.get(note["tick"]), published_ns.get(note["hand"], {}).get(note["tick"])
        if begun is not None and answered is not None:
            used[note["key"]].append((note["seq"], begun, answered))
    found = [np.empty((0, 5), dtype=np.int64)]
    for key, arrivals in logs.messages("patient", "forward", session).items():
        seq, first = np.unique(arrivals.seq, return_index=True)
        notes = np.array(used[key], dtype=np.int64).reshape(-1, 3)
        notes = notes[np.isin(notes[:, 0], seq)]
        which = first[np.searchsorted(seq, notes[:, 0])]
        columns = (arrivals.sample_ns[which], arrivals.sent_ns[which], arrivals.log_ns[which])
        found.append(np.column_stack([*columns, notes[:, 1:]]))
    return latency_parts(*np.concatenate(found).T)


def ages_ns(logs: RunLogs) -> Instants:
    """Return the age at every tick, hand by hand: its instant minus that of the freshest sample of either stream.

    Unlike the end-to-end latency, ticks on which nothing new had arrived count too: an outage shows here. Missed
    ticks and those before the first sample have no age. Oracle: an outage of known length in tests/deploy/test_twin.
    """
    due_ns = {row["tick"]: row["due_ns"] for row in logs.of("patient", TICKS) if not row["missed"]}
    fresh = logs.of("patient", FRESH)
    ages: list[int] = []
    for hand in sorted({row["hand"] for row in fresh}):
        newest = {row["tick"]: row["sample_ns"] for row in fresh if row["hand"] == hand}
        sample_ns: int | None = None
        for tick, instant_ns in sorted(due_ns.items()):
            sample_ns = newest.get(tick, sample_ns)
            if sample_ns is not None:
                ages.append(instant_ns - sample_ns)
    return np.array(ages, dtype=np.int64)


def round_trips(logs: RunLogs, session: str, arms: Mapping[Hand, Arm]) -> Instants:
    """Return the round trip of each command sample that an answer carried, in ns on the surgeon's clock."""
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
