"""From the logs to the ways of single samples: how long each part of a run's latency took."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from common.channels import Arm, Hand, hand_channels
from common.metrics.latency import Instants, LatencyParts, latency_parts, round_trip_ns
from common.records import FRESH, TICKS
from deploy.report.load import RunLogs


def ways(logs: RunLogs, session: str, arms: Mapping[Hand, Arm]) -> LatencyParts:
    """Return the way of each freshest sample, from its instant to the estimate that used it, all hands together.

    ``arms`` says which arm each hand drives. A sample whose way is not in the logs from end to end is left out.
    Oracle: ways worked by hand in the tests of the summary.
    """
    arrivals: dict[tuple[str, int], Any] = {}
    for key, row in logs.messages("patient", "forward", session):
        arrivals.setdefault((key, row["_seq"]), row)
    begin_ns = {row["tick"]: row["begin_ns"] for row in logs.of("patient", TICKS) if not row["missed"]}
    published_ns = {
        (hand, row["_seq"]): row["_log_ns"]
        for hand, key in _answer_keys(session, arms).items()
        for row in logs.of("patient", key)
    }
    found = []
    for note in logs.of("patient", FRESH):
        arrival = arrivals.get((note["key"], note["seq"]))
        begun, answered = begin_ns.get(note["tick"]), published_ns.get((note["hand"], note["tick"]))
        if arrival is not None and begun is not None and answered is not None:
            found.append((arrival["sample_ns"], arrival["_sent_ns"], arrival["_log_ns"], begun, answered))
    return latency_parts(*np.array(found, dtype=np.int64).reshape(-1, 5).T)


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
    for key in _answer_keys(session, arms).values():
        carried = [(row["command_sample_ns"], row["_log_ns"]) for row in logs.of("surgeon", key)]
        pairs = np.array([pair for pair in carried if pair[0] is not None], dtype=np.int64).reshape(-1, 2)
        trips.append(round_trip_ns(pairs[:, 0], pairs[:, 1]))
    return np.concatenate(trips)


def _answer_keys(session: str, arms: Mapping[Hand, Arm]) -> dict[Hand, str]:
    return {hand: hand_channels(hand, arm).estimated.key(session) for hand, arm in arms.items()}
