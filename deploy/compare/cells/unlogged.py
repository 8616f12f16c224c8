"""A twin that nobody looks into: the same samples, fates and estimates as a logged one, without records and messages.

The loop is that of every run, and the surgeon's samples, the link and the patient's gates and hands are those of its
nodes. What the nodes do besides is left out: no message is written to bytes and read again, nothing is answered, the
arm does not move, and no packet is noted. That takes a fraction of the time (`tis bench cells`). Oracle: the logged
twin, test_unlogged.

The arm's movement and flipped bits need all of that; such a scenario is not `is_plain`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Hand, Network
from tis.common.intake import Accepted
from tis.common.messages import HEADER_BYTES, Header
from tis.common.metrics.tracking import scored_ticks, truth_at
from tis.common.node import Arrival, Emission, Output, Record
from tis.common.records import SENT_BYTES, SENT_PACKETS
from tis.common.runtime.clock import VirtualClock
from tis.common.runtime.loop import Delivery, Seat, run
from tis.common.scenario import Scenario
from tis.common.sources.trajectory import HandRecording, Recording
from tis.common.ticker import SendPlan
from tis.common.units import ms_to_ns, sample_instant_ns
from tis.deploy.report.subjects.tracking import HandTrack
from tis.netem.link.ledger import NoLedger
from tis.netem.link.link import Link
from tis.patient_side.hand import PatientHand, bounded
from tis.patient_side.node import PatientNode
from tis.surgeon_side.motion import SampleMessage

Ints = NDArray[np.int64]
Take = Callable[[int], list[SampleMessage]]
"""Returns the messages of a sample."""

_NOTHING: Final = (float("nan"),) * 3


class Scored(NamedTuple):
    """The track of one hand, and its freshest sample's age at each tick (T,), 0 before one."""

    track: HandTrack
    ages_ns: Ints


class Unlogged(NamedTuple):
    """The results of a twin, by hand.

    ``traffic`` are the surgeon's packets and bytes; ``arrived`` are recv_ns, key and sequence number of all packets
    that were admitted.
    """

    scored: dict[Hand, Scored]
    traffic: dict[str, int]
    arrived: list[tuple[int, str, int]]


def is_plain(scenario: Scenario) -> bool:
    """Tell whether nothing that scores need depends on what an unlogged twin leaves out."""
    if scenario.patient.plant.kind != "replay" or scenario.sight is not None or scenario.touch is not None:
        return False
    return not _corrupts(scenario.network.model_dump(exclude_none=True))


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
    estimating = _Estimating(patient)
    sending = _Sending(scenario, samples, link, estimating)
    time, log = _Time(), NoLog()
    run([Seat(sending, log), Seat(estimating, log)], time, time, scenario.end_ns)
    first_ns = min(estimating.seen.values(), default=None)
    recorded = {hand.hand: hand for hand in recording.hands}
    scored = {}
    for hand, its in zip(patient.hands, estimating.watched, strict=True):
        of_hand, names = hand.channels.hand, [estimator.name for estimator in hand.estimators]
        track = _track(its, names, scenario, recording, recorded[of_hand], first_ns)
        fresh_ns = np.array(its.fresh_ns, dtype=np.int64)
        scored[of_hand] = Scored(track, np.where(fresh_ns >= 0, track.t_ns - fresh_ns, 0))
    arrived = [(recv_ns, key, seq) for (key, seq), recv_ns in estimating.seen.items()]
    return Unlogged(scored, sending.traffic, arrived)


class NoLog:
    """Keeps nothing, for twins whose results are no part of a log."""

    def record(self, record: Record) -> None:
        """Drop a record."""


class _Time(VirtualClock):
    """Virtual time, and a bus on which no message is under way."""

    def send(self, seat: int, emission: Emission) -> int:
        raise NotImplementedError

    def wait(self, deadline_ns: int) -> Delivery | None:
        self._now_ns = deadline_ns
        return None


class _Silent:
    """A node that sends no message and keeps no record: it only wakes."""

    name: Final = "unlogged"

    def listens(self) -> Sequence[tuple[Network, str]]:
        return ()

    publishes = listens

    def receive(self, arrival: Arrival) -> Sequence[Output]:  # noqa: ARG002  nothing arrives
        return ()

    def finish(self, now_ns: int) -> Sequence[Record]:  # noqa: ARG002  nothing is kept
        return ()

    def counters(self) -> dict[str, int]:
        return {}


class _Sending(_Silent):
    """The surgeon's samples and the forward link; what the link releases has arrived, as on a virtual bus."""

    def __init__(self, scenario: Scenario, take: Take, link: Link, patient: "_Estimating") -> None:
        part = scenario.surgeon
        self.traffic = {SENT_PACKETS: 0, SENT_BYTES: 0}
        self._plan = SendPlan(scenario.rate_hz, scenario.n_samples, part.copies, ms_to_ns(part.copy_spacing_ms))
        self._last_copy = part.copies - 1
        self._take, self._link, self._patient = take, link, patient
        self._to_repeat: dict[int, list[SampleMessage]] = {}

    def next_wake_ns(self) -> int | None:
        due_ns, release_ns = self._plan.next_due_ns(), self._link.next_release_ns()
        return release_ns if due_ns is None or (release_ns is not None and release_ns < due_ns) else due_ns

    def wake(self, now_ns: int) -> Sequence[Output]:
        if self._plan.next_due_ns() == now_ns:
            self._send(now_ns)
        else:
            self._release(now_ns)
        return ()

    def _send(self, now_ns: int) -> None:
        packet = self._plan.pop()
        if packet.copy == 0:
            messages = self._take(packet.k)
            if self._last_copy > 0:
                self._to_repeat[packet.k] = messages
        else:
            last = packet.copy == self._last_copy
            messages = self._to_repeat.pop(packet.k) if last else self._to_repeat[packet.k]
        attachment = Header(packet.seq, now_ns).pack()
        link, traffic = self._link, self.traffic
        for message in messages:
            n_bytes = len(message.content)
            traffic[SENT_PACKETS] += 1
            traffic[SENT_BYTES] += n_bytes + HEADER_BYTES
            link.offer(message.key, attachment, n_bytes, now_ns, message)
            next_ns = link.next_release_ns()
            if next_ns is not None and next_ns <= now_ns:
                self._release(now_ns)

    def _release(self, now_ns: int) -> None:
        for due in self._link.release(now_ns):
            if due.departure == "released":
                self._patient.take(due.item, due.seq, now_ns)


@dataclass
class _Watched:
    """What scores need of a hand, by tick: instants, sample instant of the freshest sample (-1: none), estimates."""

    t_ns: list[int] = field(default_factory=list)
    fresh_ns: list[int] = field(default_factory=list)
    estimates: list[list[tuple[float, float, float]]] = field(default_factory=list)


class _Estimating(_Silent):
    """The patient's gates, hands and ticks."""

    def __init__(self, patient: PatientNode) -> None:
        self.watched = [_Watched(estimates=[[] for _ in hand.estimators]) for hand in patient.hands]
        self.seen: dict[tuple[str, int], int] = {}
        """When a packet arrived that was admitted, by its key and sequence number."""
        self._patient = patient
        self.next_wake_ns = patient.ticker.next_due_ns

    def take(self, message: SampleMessage, seq: int, recv_ns: int) -> None:
        """Give a packet to the patient's gates, and what they admit to the hand; a second copy is not used."""
        key = message.key
        if (key, seq) in self.seen:
            return
        accepted = Accepted(message.channel, Header(seq), message.message, duplicate=False)
        admitted = self._patient.gated.admitted(accepted, key, recv_ns)
        if isinstance(admitted, Accepted):
            self.seen[key, seq] = recv_ns
            self._patient.insert(key, admitted, recv_ns)

    def wake(self, now_ns: int) -> Sequence[Output]:
        patient, ticker = self._patient, self._patient.ticker
        k = ticker.begin()
        for hand, its in zip(patient.hands, self.watched, strict=True):
            _tick(hand, now_ns, its)
        shift = None if patient.phase_lock is None else patient.phase_lock.decide(k, ticker.phase_ns)
        if shift is not None:
            ticker.phase_ns = shift.phase_ns
        return ()


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
