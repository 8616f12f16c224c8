"""The patient as a state machine: at each tick the estimators answer from what has arrived, and the arm moves."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np

from common.channels import Channel, HandChannels, Network
from common.header import Header
from common.intake import Accepted, Intake
from common.messages import FeedbackPose, Pose, Quaternion, SampledPose, Vector3, position_m
from common.node import Arrival, Emission, Output, Record
from common.records import (
    COUNTERS,
    ESTIMATES,
    FRESH,
    PLANT,
    TICKS,
    CounterNote,
    EstimateNote,
    FreshNote,
    PlantNote,
    TickNote,
)
from common.ticker import Ticker
from patient_side.estimators.protocol import Estimate, Estimator
from patient_side.plant import Plant
from patient_side.playout import Playout, SourceBuffer
from patient_side.statespace import Array

_LEVEL = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)


def _vector(values: Array) -> Vector3:
    x, y, z = values.tolist()
    return Vector3(x=x, y=y, z=z)


def _finite(values: Array | None) -> Array | None:
    """Return ``values`` if there are any and all are finite; what is not finite counts as missing."""
    return values if values is not None and isfinite(values.sum()) else None


@dataclass
class PatientHand:
    """One hand: its channels, what has arrived of it, its estimators (the first is the active one) and its arm."""

    channels: HandChannels
    playout: Playout
    estimators: Sequence[Estimator]
    plant: Plant | None
    states: list[Any] = field(init=False)
    plant_state: Any = field(init=False)
    freshest: FreshNote | None = None
    used_sample_ns: int = -1
    pose: Pose | None = None

    def __post_init__(self) -> None:
        self.states = [estimator.initial() for estimator in self.estimators]
        self.plant_state = None if self.plant is None else self.plant.initial()


@dataclass
class PatientNode:
    """Ticks at a fixed rate; tick k uses exactly the arrivals stamped at or before it."""

    session: str
    hands: Sequence[PatientHand]
    ticker: Ticker
    stopwatch_ns: Callable[[], int]
    name: str = "patient"
    intake: Intake = field(init=False)
    n_superseded: int = 0
    n_repeated: int = 0
    n_recovered: int = 0
    n_estimates: int = 0

    def __post_init__(self) -> None:
        incoming = [channel for hand in self.hands for channel in (hand.channels.command, hand.channels.arm)]
        self.intake = Intake(self.session, incoming)
        self._hand_of = {
            channel.key(self.session): hand
            for hand in self.hands
            for channel in (hand.channels.command, hand.channels.arm)
        }

    def listens(self) -> Sequence[tuple[Network, str]]:
        """Return the keys of the surgeon's streams."""
        return [("east", key) for key in self.intake.wanted()]

    def next_wake_ns(self) -> int | None:
        """Return the next tick's instant."""
        return self.ticker.next_due_ns()

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        """Sort a sample into the playout buffer of its hand."""
        accepted, records = self.intake.take(arrival)
        if accepted is not None and not accepted.duplicate:
            self._sort_in(arrival.key, accepted)
        return records

    def _sort_in(self, key: str, accepted: Accepted) -> None:
        """Take in the packet's sample, after those that ride with it; what is known already costs a look."""
        hand, pose = self._hand_of[key], accepted.message
        is_command = accepted.channel is hand.channels.command
        buffer = hand.playout.command if is_command else hand.playout.arm
        if isinstance(pose, SampledPose):
            for earlier in pose.history:
                self.n_recovered += self._take_in(hand.playout, buffer, earlier)
        if not self._take_in(hand.playout, buffer, pose):
            self.n_repeated += 1
            return
        newest = hand.freshest
        if newest is None or pose.sample_ns > newest.sample_ns:
            if newest is not None and newest.sample_ns > hand.used_sample_ns:
                self.n_superseded += 1
            hand.freshest = FreshNote(
                tick=0, hand=hand.channels.hand, key=key, seq=accepted.header.seq, sample_ns=pose.sample_ns
            )
            hand.pose = pose

    @staticmethod
    def _take_in(playout: Playout, buffer: SourceBuffer, pose: Pose) -> bool:
        """Put a sample into its buffer; False when it is there already, or too old."""
        index = playout.index(pose.sample_ns)
        return buffer.get(index) is None and buffer.add(index, np.array(position_m(pose)))

    def wake(self, now_ns: int) -> Sequence[Output]:
        """Run the tick that is due. After missed ticks it only counts them: the next call sees later arrivals."""
        missed = self.ticker.skip_missed(now_ns)
        if missed:
            return [self._tick_note(k, now_ns, missed=True) for k in missed]
        k = self.ticker.begin()
        t_ns = self.ticker.due_ns(k)
        outputs: list[Output] = []
        for hand in self.hands:
            outputs += self._tick_hand(hand, k, t_ns)
        outputs.append(self._tick_note(k, now_ns))
        return outputs

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the counters."""
        return [
            Record(COUNTERS, now_ns, CounterNote(name=name, value=value)) for name, value in self.counters().items()
        ]

    def counters(self) -> dict[str, int]:
        """Return messages received, duplicated, rejected, superseded, estimates made and missed ticks.

        ``repeated`` counts packets whose own sample was known already (or too old), ``recovered`` the samples that
        came first in another one's history.
        """
        return {
            "received": self.intake.n_accepted,
            "duplicates": self.intake.n_duplicates,
            "rejected": self.intake.n_rejected,
            "repeated": self.n_repeated,
            "recovered": self.n_recovered,
            "superseded": self.n_superseded,
            "estimates": self.n_estimates,
            "ticks": self.ticker.k,
            "ticks_missed": self.ticker.n_missed,
        }

    def _tick_hand(self, hand: PatientHand, k: int, t_ns: int) -> list[Output]:
        notes: list[Output] = []
        active: Estimate | None = None
        for i, estimator in enumerate(hand.estimators):
            begun_ns = self.stopwatch_ns()
            hand.states[i], estimate = estimator.step(hand.states[i], hand.playout, t_ns)
            step_ns = self.stopwatch_ns() - begun_ns
            active = estimate if active is None else active
            notes.append(self._estimate_note(hand, estimator.name, estimate, k, t_ns, step_ns))
        reference = None if active is None else _finite(active.position_m)
        answers: list[Output] = []
        if reference is not None:
            self.n_estimates += 1
            answers.append(self._answer(hand, hand.channels.estimated, reference, k, t_ns))
        if hand.plant is not None:
            hand.plant_state, moved = hand.plant.step(hand.plant_state, reference, k, t_ns)
            if moved is not None:
                answers.append(self._answer(hand, hand.channels.measured, moved.measured_m, k, t_ns))
                plant_note = PlantNote(
                    tick=k, t_ns=t_ns, hand=hand.channels.hand, position_m=_vector(moved.position_m)
                )
                notes.append(Record(PLANT, t_ns, plant_note))
        fresh = hand.freshest
        if fresh is not None and fresh.sample_ns > hand.used_sample_ns:
            hand.used_sample_ns = fresh.sample_ns
            notes.append(Record(FRESH, t_ns, fresh.model_copy(update={"tick": k})))
        # Answers go first: what is only logged must not delay what is published.
        return answers + notes

    def _answer(self, hand: PatientHand, channel: Channel, where_m: Array, k: int, t_ns: int) -> Emission:
        key = channel.key(self.session)
        pose = hand.pose
        message = FeedbackPose(
            sample_ns=t_ns,
            position_m=_vector(where_m),
            orientation=_LEVEL if pose is None else pose.orientation,
            gripper_rad=0.0 if pose is None else pose.gripper_rad,
            tick=k,
            command_sample_ns=None if hand.freshest is None else hand.freshest.sample_ns,
        )
        payload = message.model_dump_json().encode()

        def on_sent(sent_ns: int) -> Sequence[Record]:
            return (Record(key, sent_ns, payload, channel.payload, sent_ns, k),)

        return Emission("east", key, payload, Header(k), on_sent)

    def _estimate_note(
        self, hand: PatientHand, name: str, estimate: Estimate, k: int, t_ns: int, step_ns: int
    ) -> Record:
        where_m = _finite(estimate.position_m)
        covariance = estimate.covariance_m2
        std_m = None if where_m is None or covariance is None else _finite(np.sqrt(np.diag(covariance)))
        note = EstimateNote(
            tick=k,
            t_ns=t_ns,
            hand=hand.channels.hand,
            estimator=name,
            position_m=None if where_m is None else _vector(where_m),
            std_m=None if std_m is None else _vector(std_m),
            step_ns=step_ns,
        )
        return Record(f"{ESTIMATES}/{name}", t_ns, note)

    def _tick_note(self, k: int, begin_ns: int, missed: bool = False) -> Record:
        note = TickNote(tick=k, due_ns=self.ticker.due_ns(k), begin_ns=begin_ns, missed=missed)
        return Record(TICKS, begin_ns, note)
