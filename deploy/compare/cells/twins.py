"""A twin that nobody looks into: the same samples, fates and estimates as a logged one, without records and messages.

The surgeon's samples, the link and the patient's hands are those of the nodes. What the nodes do besides is left out:
no message is written to bytes and read again, nothing is answered, the arm does not move, and no packet is noted.
That takes a fraction of the time (`tis bench cells`). Oracle: the logged twin, test_unlogged.

The arm's movement and flipped bits need all of that; such a scenario is not `is_plain`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Hand, Side
from tis.common.header import HEADER_BYTES, Header
from tis.common.intake import Accepted
from tis.common.metrics.tracking import scored_ticks, truth_at
from tis.common.node import Record
from tis.common.records import COUNTERS, ESTIMATES, FRESH, PLANT, SENT_BYTES, SENT_PACKETS, TICKS, TRUTH
from tis.common.scenario import Scenario
from tis.common.send_plan import SendPlan
from tis.common.sources.trajectory import HandRecording, Recording
from tis.common.units import ms_to_ns, sample_instant_ns
from tis.deploy.logs.read.memory import MemoryLog
from tis.deploy.report.measures.estimation.tracking import HandTrack
from tis.netem.link.ledger import NoLedger
from tis.netem.link.link import Link
from tis.patient_side.hand import PatientHand, bounded
from tis.patient_side.node import PatientNode
from tis.surgeon_side.samples import SampleMessage

# Logs of a cell: one in memory that keeps only the records that scores need, and one that keeps nothing.

_KEPT: Final = (COUNTERS, FRESH, PLANT, TICKS, TRUTH)


class KeptLog(MemoryLog):
    """Keeps estimates, truth, ticks and counters, and the first message of each key, which begins the scoring.

    With several copies of each sample the packets' records would be most of a run's memory.
    """

    def __init__(self, side: Side) -> None:
        super().__init__(side)
        self._begun: set[str] = set()

    def record(self, record: Record) -> None:
        """Keep or drop a record."""
        topic = record.topic
        is_message = not topic.startswith("/")
        if topic in _KEPT or topic.startswith(ESTIMATES) or (is_message and topic not in self._begun):
            super().record(record)
        if is_message:
            self._begun.add(topic)


class NoLog:
    """Keeps nothing, for cells whose results are no part of a log."""

    def record(self, record: Record) -> None:
        """Drop a record."""


Ints = NDArray[np.int64]
Take = Callable[[int], list[SampleMessage]]
"""Returns the messages of a sample."""

_NOTHING: Final = (float("nan"),) * 3


class Arrived(NamedTuple):
    """A packet that crossed the network: when it arrives, its sequence number, and the message."""

    recv_ns: int
    seq: int
    message: SampleMessage


@dataclass
class _Watched:
    """What scores need of a hand, by tick: instants, sample instant of the freshest sample (-1: none), estimates."""

    t_ns: list[int] = field(default_factory=list)
    fresh_ns: list[int] = field(default_factory=list)
    estimates: list[list[tuple[float, float, float]]] = field(default_factory=list)


class Unlogged(NamedTuple):
    """The results of a twin: the track of each hand, and its freshest sample's age at each tick (T,), 0 before one.

    ``traffic`` are the surgeon's packets and bytes; ``arrived`` are recv_ns, key and sequence number of all packets
    that were admitted.
    """

    tracks: dict[Hand, HandTrack]
    ages_ns: dict[Hand, Ints]
    traffic: dict[str, int]
    arrived: list[tuple[int, str, int]]


def is_plain(scenario: Scenario) -> bool:
    """Tell whether nothing that scores need depends on what an unlogged twin leaves out."""
    return scenario.patient.plant.kind == "replay" and not _corrupts(scenario.network.model_dump(exclude_none=True))


def _corrupts(part: Any) -> bool:
    """Tell whether a network, or a part of one, flips bits anywhere."""
    if isinstance(part, dict):
        return "corrupt" in part or any(_corrupts(value) for value in part.values())
    return isinstance(part, (list, tuple)) and any(_corrupts(value) for value in part)


def run_unlogged(
    scenario: Scenario, recording: Recording, samples: Take, link: Link, patient: PatientNode
) -> Unlogged:
    """Send all samples through the link, and step the estimators at each tick with what has arrived by then."""
    link.ledger = NoLedger(link.direction)
    traffic = {SENT_PACKETS: 0, SENT_BYTES: 0}
    watched = [_Watched(estimates=[[] for _ in hand.estimators]) for hand in patient.hands]
    seen: dict[tuple[str, int], int] = {}
    packets = _crossing(scenario, samples, link, traffic)
    ticker, packet = patient.ticker, next(packets, None)
    while (t_ns := ticker.next_due_ns()) is not None and t_ns < scenario.end_ns:
        while packet is not None and packet.recv_ns <= t_ns:
            _receive(patient, packet, seen)
            packet = next(packets, None)
        k = ticker.begin()
        for hand, its in zip(patient.hands, watched, strict=True):
            _tick(hand, t_ns, its)
        shift = None if patient.phase_lock is None else patient.phase_lock.decide(k, ticker.phase_ns)
        if shift is not None:
            ticker.phase_ns = shift.phase_ns
    # What is sent or arrives after the last tick counts as traffic.
    while packet is not None:
        _receive(patient, packet, seen)
        packet = next(packets, None)
    first_ns = min(seen.values(), default=None)
    recorded = {hand.hand: hand for hand in recording.hands}
    tracks, ages = {}, {}
    for hand, its in zip(patient.hands, watched, strict=True):
        of_hand, names = hand.channels.hand, [estimator.name for estimator in hand.estimators]
        tracks[of_hand] = _track(its, names, scenario, recording, recorded[of_hand], first_ns)
        ages[of_hand] = _ages_ns(its)
    return Unlogged(
        tracks,
        ages,
        traffic,
        [(recv_ns, key, seq) for (key, seq), recv_ns in seen.items()],
    )


def _crossing(scenario: Scenario, take: Take, link: Link, traffic: dict[str, int]) -> Iterator[Arrived]:
    """Yield the packets in the order of their arrival, as the surgeon's node sends them and the emulator's passes."""
    part = scenario.surgeon
    plan = SendPlan(scenario.rate_hz, scenario.n_samples, part.copies, ms_to_ns(part.copy_spacing_ms))
    to_repeat: dict[int, list[SampleMessage]] = {}
    while (due_ns := plan.next_due_ns()) is not None and due_ns < scenario.end_ns:
        while (next_ns := link.next_release_ns()) is not None and next_ns < due_ns:
            yield from _left(link, next_ns)
        packet = plan.pop()
        if packet.copy == 0:
            messages = take(packet.k)
            if part.copies > 1:
                to_repeat[packet.k] = messages
        else:
            last = packet.copy == part.copies - 1
            messages = to_repeat.pop(packet.k) if last else to_repeat[packet.k]
        attachment = Header(packet.seq, due_ns).pack()
        for message in messages:
            n_bytes = len(message.content)
            traffic[SENT_PACKETS] += 1
            traffic[SENT_BYTES] += n_bytes + HEADER_BYTES
            link.offer(message.key, attachment, n_bytes, due_ns, message)
            next_ns = link.next_release_ns()
            if next_ns is not None and next_ns <= due_ns:
                yield from _left(link, due_ns)
    while (next_ns := link.next_release_ns()) is not None and next_ns < scenario.end_ns:
        yield from _left(link, next_ns)


def _left(link: Link, now_ns: int) -> list[Arrived]:
    """Return what leaves the link now."""
    return [Arrived(now_ns, due.seq, due.item) for due in link.release(now_ns) if due.departure == "released"]


def _receive(patient: PatientNode, packet: Arrived, seen: dict[tuple[str, int], int]) -> None:
    """Give a packet to the patient's gates, and what they admit to the hand; a second copy is not used."""
    recv_ns, seq, message = packet
    key = message.key
    if (key, seq) in seen:
        return
    accepted = Accepted(message.channel, Header(seq), message.message, duplicate=False)
    admitted = patient.gated.admitted(accepted, key, recv_ns)
    if isinstance(admitted, Accepted):
        seen[key, seq] = recv_ns
        patient.insert(key, admitted, recv_ns)


def _tick(hand: PatientHand, t_ns: int, watched: _Watched) -> None:
    """Step the hand's estimators, and note the estimates and the freshest sample."""
    playout, states = hand.playout, hand.states
    for i, estimator in enumerate(hand.estimators):
        states[i], estimate = estimator.step(states[i], playout, t_ns)
        watched.estimates[i].append(bounded(estimate.position_m) or _NOTHING)
    for i in range(len(hand.methods)):
        hand.wrist_at(i, t_ns)  # the measured methods keep their estimates
    watched.t_ns.append(t_ns)
    watched.fresh_ns.append(-1 if hand.freshest is None else hand.freshest.sample_ns)


def _track(
    watched: _Watched,
    names: list[str],
    scenario: Scenario,
    recording: Recording,
    hand: HandRecording,
    first_ns: int | None,
) -> HandTrack:
    """Return the track of one hand, as its logs would give it; ``first_ns`` is the instant of the first arrival."""
    # The surgeon logs the truth one sample beyond the last, if it is recorded.
    n = min(scenario.n_samples + 1, len(recording) - recording.start)
    sample_ns = np.array([sample_instant_ns(k, scenario.rate_hz) for k in range(n)], dtype=np.int64)
    recorded_m = hand.follower.position_m[recording.start : recording.start + n]
    t_ns = np.array(watched.t_ns, dtype=np.int64)
    truth_m = truth_at(t_ns, sample_ns, recorded_m)
    by_name = dict(zip(names, watched.estimates, strict=True))
    in_order = dict.fromkeys([*(name for name in scenario.estimators if name in by_name), *names])
    estimates = {name: np.array(by_name[name]) for name in in_order}
    scored = scored_ticks(t_ns, truth_m, estimates["hold"], first_ns)
    return HandTrack(t_ns, np.arange(len(t_ns)), truth_m, estimates, scored, {})


def _ages_ns(watched: _Watched) -> Ints:
    t_ns, fresh_ns = np.array(watched.t_ns, dtype=np.int64), np.array(watched.fresh_ns, dtype=np.int64)
    return np.where(fresh_ns >= 0, t_ns - fresh_ns, 0)
