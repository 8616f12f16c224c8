"""The patient as a state machine: at each tick the estimators use the arrived samples, and the arm moves.

The ticks' phase may follow the arrivals (`tis.patient_side.phase_lock`), and the active estimator may also answer at
arrivals. Such a prompt answer discards the estimator's new state, so the ticks do not depend on it.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from tis.common.channels import Network
from tis.common.intake import Accepted, Intake
from tis.common.messages import Pose, SampledPose, components, position_m
from tis.common.node import Arrival, Output, Record
from tis.common.peer_life import Alarm
from tis.common.records import (
    COUNTERS,
    FRESH,
    PHASES,
    PROMPT,
    TICKS,
    CounterNote,
    FreshNote,
    PhaseNote,
    PromptNote,
    TickNote,
)
from tis.common.safety_records import SINCE_MS, STOPS, STOPS_IN_FORCE
from tis.common.signing import Identity, RunKeys
from tis.common.stop_messages import ReleaseRule
from tis.common.ticker import Ticker
from tis.common.units import NS_PER_MS
from tis.patient_side.answers import OwnEstimators, answer, estimate_record
from tis.patient_side.arm_motion import feel, move, moved_notes
from tis.patient_side.driven import drive, foreign_set_point, left_place, safety_change, set_point
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.external_arm import external_arms
from tis.patient_side.hand import Begun, Fresh, PatientHand, finite, std_m
from tis.patient_side.orientation.wrist import Stated, answered, orientation_note, stated
from tis.patient_side.phase_lock import PhaseLock
from tis.patient_side.playout import Playout, SourceBuffer
from tis.patient_side.rotations import unit
from tis.patient_side.safety.emergency_stop import EmergencyStops
from tis.patient_side.safety.gate import StreamGate
from tis.patient_side.safety.gated_intake import Evidence, GatedIntake
from tis.patient_side.touch import MotionIntake

_LEAST_BETWEEN_NS: Final = 25_000
"""More time passes on average between two answers at arrivals; a day of them has numbers of 32 bits."""


@dataclass
class PatientNode:
    """Ticks at a fixed rate; tick k uses exactly the arrivals stamped at or before it.

    ``phase_lock`` moves the ticks' phase; ``on_arrival``: a fresher sample is answered immediately, from exactly the
    arrivals stamped at or before its own, and answers are numbered in their order and not by the tick.
    ``conflicts_are_forged``: the network changes no message, so contradictions between samples raise an alarm.
    """

    session: str
    hands: Sequence[PatientHand]
    ticker: Ticker
    stopwatch_ns: Callable[[], int]
    phase_lock: PhaseLock | None = None
    on_arrival: bool = False
    gates: Mapping[str, StreamGate] = field(default_factory=dict)
    release: ReleaseRule = "anyone"
    releasers: Collection[str] = ()
    conflicts_are_forged: bool = True
    name: str = "patient"
    doing: str = ""
    intake: Intake[Pose] = field(init=False)
    n_superseded: int = 0
    n_repeated: int = 0
    n_recovered: int = 0
    n_estimates: int = 0

    def __post_init__(self) -> None:
        incoming = [channel for hand in self.hands for channel in (hand.channels.command, hand.channels.arm)]
        self.intake = Intake(self.session, incoming)
        # The hand of each key, and whether it carries the commands.
        self._hand_of = {
            channel.key(self.session): (hand, is_command)
            for hand in self.hands
            for channel, is_command in ((hand.channels.command, True), (hand.channels.arm, False))
        }
        conflicts = {key: hand.conflicts for key, (hand, _) in self._hand_of.items()}
        self.gated = GatedIntake(self.intake, self.gates, conflicts)
        self._driven = {h.channels.driven.key(self.session): h for h in self.hands if h.safety is not None}
        self._arms = external_arms(self.session, self.hands)
        self._own = OwnEstimators.among(self.hands)
        self._motions = MotionIntake(self.session, [hand.touch for hand in self.hands if hand.touch is not None])
        self._stops = EmergencyStops(self.session, self.release, self.releasers)

    def remembers(self) -> Sequence[str]:
        """Return the topics of the set points, and that of the stops in force."""
        with_safety = [hand for hand in self.hands if hand.safety is not None]
        driven = [hand.channels.driven.key(self.session) for hand in with_safety]
        return [*driven, *([STOPS_IN_FORCE] if with_safety else ())]

    def resume(self, last: Mapping[str, bytes]) -> None:
        """Begin where the arm was left, and stopped if it was; what cannot be read is not known."""
        is_stopped = self._stops.resume(last.get(STOPS_IN_FORCE), last.get(STOPS))
        for hand in self.hands:
            left = left_place(last.get(hand.channels.driven.key(self.session)))
            if hand.safety is not None:
                hand.safety_state = hand.safety.resumed(left, is_stopped)

    def believe(self, keys: RunKeys, own: Identity) -> None:
        """Use only what the surgeon has signed, and let nobody release whose name is not proved."""
        self.intake.keys = self._motions.intake.keys = keys
        self._stops.own = own

    def join(self, run_id: int, from_ns: int = 0) -> None:
        """Take messages of this run only, and tick from ``from_ns`` on."""
        self.intake.run_id = self._motions.intake.run_id = run_id
        self.ticker.start_at(from_ns)
        for hand in self.hands:  # above all numbers that answers at arrivals had before
            hand.n_answers = from_ns // _LEAST_BETWEEN_NS

    def listens(self) -> Sequence[tuple[Network, str]]:
        """Return the keys of the surgeon's streams; with a safety state those of emergency stops and set points, too.

        On the keys of set points only strangers can be heard: a side does not hear itself.
        """
        stops = self._stops.keys if self._driven else ()
        keys = (*self.intake.wanted(), *self._motions.keys, *stops, *self._arms, *self._driven)
        return [("east", key) for key in keys]

    def foreign_keys(self) -> Collection[str]:
        """Return the keys of external arms, which are programs of others, and those of set points."""
        return frozenset((*self._arms, *self._driven))

    def publishes(self) -> Sequence[tuple[Network, str]]:
        """Return the keys of the patient's answers."""
        answers = [c for h in self.hands for c in (h.channels.estimated, h.channels.measured, h.channels.driven)]
        forces = [h.channels.force for h in self.hands if h.touch is not None]
        keys = [channel.key(self.session) for channel in (*answers, *forces)]
        return [("east", key) for key in (*keys, self._stops.answer_key)]

    def next_wake_ns(self) -> int | None:
        """Return the instant of the next tick, or of an arrival to be answered before it."""
        due_ns = self.ticker.next_due_ns()
        prompt_ns = self._prompt_ns() if self.on_arrival else None
        return due_ns if due_ns is None or prompt_ns is None else min(due_ns, prompt_ns)

    def _prompt_ns(self) -> int | None:
        """Return the instant of the first unanswered arrival; a tick at or before that instant answers it as well."""
        return min((hand.prompt_ns for hand in self.hands if hand.prompt_ns is not None), default=None)

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        """Insert a sample into the playout buffer of its hand, if it is new and the gate admits it."""
        if arrival.key in self._stops.keys:
            return self._take_stop(arrival)
        if arrival.key in self._arms:
            if self.ticker.next_due_ns() is not None:  # else no tick would take it
                self._arms[arrival.key].take(arrival)
            return ()
        if arrival.key in self._motions.keys:
            return self._motions.take(arrival)
        if arrival.key in self._driven:
            return foreign_set_point(self._driven[arrival.key], arrival)
        accepted, records = self.gated.take(arrival)
        if accepted is not None:
            self.insert(arrival.key, accepted, arrival.recv_ns)
        return records

    def _take_stop(self, arrival: Arrival) -> Sequence[Output]:
        is_latched = any(hand.safety_state.is_latched for hand in self.hands)
        outputs, is_done = self._stops.take(arrival, is_latched)
        if is_done:
            self.stop(self._stops.is_stopped)
        return outputs

    def stop(self, is_stopped: bool) -> None:
        """Stop all arms, or release them, from the next tick on."""
        for hand in self.hands:
            if hand.safety is not None:
                hand.safety_state = hand.safety.stop(hand.safety_state, is_stopped)

    def insert(self, key: str, accepted: Accepted[Pose], recv_ns: int) -> None:
        """Insert the packet's sample, after the earlier ones in its history; known samples are skipped."""
        (hand, is_command), pose = self._hand_of[key], accepted.message
        buffer = hand.playout.command if is_command else hand.playout.arm
        if isinstance(pose, SampledPose):
            for earlier in pose.history:
                self.n_recovered += self._add(hand.playout, buffer, earlier)
        if not self._add(hand.playout, buffer, pose):
            self.n_repeated += 1
            return
        newest = hand.freshest
        if newest is None or pose.sample_ns > newest.sample_ns:
            if newest is not None and newest.sample_ns > max(hand.used_sample_ns, hand.answered_sample_ns):
                self.n_superseded += 1
            if self.on_arrival:
                hand.prompt_ns = recv_ns
            if self.phase_lock is not None:
                self.phase_lock.note(hand.channels.hand, recv_ns, pose.sample_ns)
            hand.freshest = Fresh(key, accepted.header.seq, pose.sample_ns)
        if not is_command and (hand.pose is None or pose.sample_ns > hand.pose.sample_ns):
            hand.pose = pose  # the arm's alone: the master's orientation and gripper are other quantities

    def _add(self, playout: Playout, buffer: SourceBuffer, pose: Pose) -> bool:
        """Add a sample to its buffer; False when it is there already, or too old."""
        index = playout.index(pose.sample_ns)
        if buffer.get(index) is not None:
            return False
        where_m, orientation = np.array(position_m(pose)), unit(components(pose.orientation))
        if self._own.guarded:  # user-defined estimators share the arrays with all others
            where_m.setflags(write=False)
        late = playout.late(index, pose.sample_ns)
        return buffer.add(index, where_m, pose.gripper_rad, orientation, late)

    def wake(self, now_ns: int) -> Iterable[Output]:
        """Run the tick that is due, or answer an arrival before it.

        Missed ticks are only counted: the next call runs the tick that is due, with later arrivals.
        """
        due_ns, prompt_ns = self.ticker.next_due_ns(), self._prompt_ns()
        if due_ns is not None and prompt_ns is not None and prompt_ns < due_ns:
            return self._answer_arrival(prompt_ns, now_ns)
        missed = self.ticker.skip_missed(now_ns)
        if missed:
            return [self._tick_note(k, now_ns, missed=True) for k in missed]
        k = self.ticker.begin()
        return self._tick(k, self.ticker.due_ns(k), now_ns)

    def _tick(self, k: int, t_ns: int, begin_ns: int) -> Iterator[Output]:
        """Yield the answers as soon as they are computed, then the records: logging must not delay publishing."""
        # For each hand the active estimate and the set point.
        begun: list[Begun] = []
        for hand in self.hands:
            estimate, step_ns = self._step(hand, 0, t_ns)
            where_m, number = finite(estimate.position_m), None
            turn, turn_step_ns = self._turn(hand, 0, t_ns)
            wrist = answered(turn, hand.pose)
            if where_m is not None:
                number = self._number(hand, k)
                yield answer(self.session, hand, hand.channels.estimated, where_m, wrist, k, t_ns, number)
            std = std_m(where_m, estimate.covariance_m2)
            before = hand.safety_state.mode
            is_certain = std is not None or estimate.covariance_m2 is None
            if hand.touch is not None:
                feel(hand, hand.touch, k, t_ns)
            driven = drive(hand, where_m, std, is_certain, wrist, t_ns)
            if driven.place is not None and hand.safety is not None:
                yield set_point(self.session, hand, driven.place, driven.wrist, k, t_ns)
            begun.append(Begun(where_m, std, step_ns, turn, turn_step_ns, number, driven, before))
        # The arms move after all answers have left, as physics takes its time.
        for hand, done in zip(self.hands, begun, strict=True):
            yield from move(self.session, hand, done.driven, k, t_ns)
        # The other estimators and the records.
        for hand, done in zip(self.hands, begun, strict=True):
            yield from self._notes(hand, done, k, t_ns)  # a list: each step of a generator costs time
        if self._own.guarded:
            yield from self._own.first_faults()
        yield self._tick_note(k, begin_ns)
        # The phase of the ticks to come.
        shift = None if self.phase_lock is None else self.phase_lock.decide(k, self.ticker.phase_ns)
        if shift is not None:
            self.ticker.phase_ns = shift.phase_ns
            ages_ns = {"age_ns": round(shift.age_ns), "age_before_ns": round(shift.age_before_ns)}
            yield Record(PHASES, t_ns, PhaseNote(tick=k, phase_ns=shift.phase_ns, **ages_ns))

    def _answer_arrival(self, t_ns: int, begin_ns: int) -> Sequence[Output]:
        """Answer the samples that arrived at ``t_ns``; the estimators keep the states of the last tick."""
        answers: list[Output] = []
        notes: list[Output] = []
        for hand in self.hands:
            fresh = hand.freshest
            if hand.prompt_ns != t_ns or fresh is None:
                continue
            hand.prompt_ns = None
            estimator = hand.estimators[0]
            begun_ns, self.doing = self.stopwatch_ns(), estimator.name
            _, estimate = estimator.step(hand.states[0], hand.playout, t_ns)
            step_ns, self.doing = self.stopwatch_ns() - begun_ns, ""
            where_m = finite(estimate.position_m)
            turn, _ = self._turn(hand, 0, t_ns)
            number = None
            if where_m is not None:
                number, channel = self._number(hand, self.ticker.k), hand.channels.estimated
                hand.answered_sample_ns = fresh.sample_ns
                wrist = answered(turn, hand.pose)
                answers.append(answer(self.session, hand, channel, where_m, wrist, self.ticker.k, t_ns, number))
            note = PromptNote(
                t_ns=t_ns,
                begin_ns=begin_ns,
                hand=hand.channels.hand,
                estimator=estimator.name,
                key=fresh.key,
                seq=fresh.seq,
                sample_ns=fresh.sample_ns,
                answer=number,
                position_m=where_m,
                std_m=std_m(where_m, estimate.covariance_m2),
                orientation=turn.orientation,
                turn_std_rad=turn.std_rad,
                gripper_rad=turn.gripper_rad,
                gripper_std_rad=turn.gripper_std_rad,
                step_ns=step_ns,
            )
            notes.append(Record(PROMPT, t_ns, note))
        return answers + notes

    def _number(self, hand: PatientHand, k: int) -> int:
        """Return the sequence number of the next estimate: the tick, unless arrivals are answered as well."""
        self.n_estimates += 1
        if not self.on_arrival:
            return k
        hand.n_answers += 1
        return hand.n_answers - 1

    def alarms(self) -> Mapping[Alarm, int]:
        """Return what somebody must have done on purpose, and the run time at which it began."""
        kinds: dict[Alarm, list[Evidence]] = {"foreign_set_point": [hand.foreign for hand in self.hands]}
        if self.conflicts_are_forged:
            kinds["conflict"] = [hand.conflicts for hand in self.hands]
        since = [self.intake.forged_since_ns, self._motions.intake.forged_since_ns]
        found = [each for each in since if each is not None]
        forged: dict[Alarm, int] = {"forged": min(found)} if found and self.conflicts_are_forged else {}
        return self._alarms_of(kinds) | forged

    def _alarms_of(self, kinds: Mapping[Alarm, list[Evidence]]) -> dict[Alarm, int]:
        begun = {kind: [one.begun_ns for one in all_ if one.begun_ns is not None] for kind, all_ in kinds.items()}
        return {**self._stops.alarms, **{kind: min(instants) for kind, instants in begun.items() if instants}}

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the counters."""
        return [Record(COUNTERS, now_ns, CounterNote(name=name, value=n)) for name, n in self.counters().items()]

    def counters(self) -> dict[str, int]:
        """Return the numbers of messages received, duplicated, rejected, superseded; of estimates and ticks missed.

        ``not_stated`` counts estimates and places of the arm that no message can state, ``foreign_set_points`` what
        others sent on the patient's own keys.
        ``repeated`` counts packets whose own sample was already known (or too old), ``recovered`` the samples that
        arrived first in another one's history. Each user-defined estimator adds the number of its failed steps.
        """
        received = self.gated.counters()
        return {
            **received,
            **self._stops.counters(),
            "rejected": received["rejected"] + self._stops.n_rejected,
            "repeated": self.n_repeated,
            "recovered": self.n_recovered,
            "superseded": self.n_superseded,
            "estimates": self.n_estimates,
            "ticks": self.ticker.k,
            "ticks_missed": self.ticker.n_missed,
            "foreign_set_points": sum(hand.foreign.n for hand in self.hands),
            "not_stated": sum(hand.n_not_stated for hand in self.hands),
            **{f"{SINCE_MS}.{alarm}": at_ns // NS_PER_MS for alarm, at_ns in self.alarms().items()},
            **self._own.counters(),
            **self._motions.counters(),
            **{name: n for arm in self._arms.values() for name, n in arm.counters().items()},
        }

    def _step(self, hand: PatientHand, i: int, t_ns: int) -> tuple[Estimate, int]:
        """Advance a hand's estimator ``i``; return its estimate and the step's duration in ns."""
        begun_ns, self.doing = self.stopwatch_ns(), hand.estimators[i].name
        hand.states[i], estimate = hand.estimators[i].step(hand.states[i], hand.playout, t_ns)
        self.doing = ""
        return estimate, self.stopwatch_ns() - begun_ns

    def _turn(self, hand: PatientHand, i: int, t_ns: int) -> tuple[Stated, int]:
        """Return the estimate of a hand's orientation method ``i``, and its duration in ns."""
        begun_ns = self.stopwatch_ns()
        found, is_whole = stated(hand.wrist_at(i, t_ns))
        hand.n_not_stated += not is_whole
        return found, self.stopwatch_ns() - begun_ns

    def _notes(self, hand: PatientHand, begun: Begun, k: int, t_ns: int) -> list[Record]:
        """Run the hand's other estimators, and return the records of its tick."""
        of_hand = hand.channels.hand
        notes = [estimate_record(hand, 0, k, t_ns, begun.where_m, begun.std_m, begun.step_ns)]
        for i in range(1, len(hand.estimators)):
            estimate, step_ns = self._step(hand, i, t_ns)
            stated_m = finite(estimate.position_m)
            spread_m = std_m(stated_m, estimate.covariance_m2)
            notes.append(estimate_record(hand, i, k, t_ns, stated_m, spread_m, step_ns))
        for i, (method, topic) in enumerate(zip(hand.methods, hand.method_topics, strict=True)):
            turn, step_ns = self._turn(hand, i, t_ns) if i else (begun.wrist, begun.wrist_step_ns)
            notes.append(Record(topic, t_ns, orientation_note(k, t_ns, of_hand, method.name, turn, step_ns)))
        change = safety_change(hand, begun.mode_before, t_ns)
        if change is not None:
            notes.append(change)
        notes += moved_notes(hand, k, t_ns)
        fresh = hand.freshest
        if fresh is not None and fresh.sample_ns > hand.used_sample_ns:
            hand.used_sample_ns = fresh.sample_ns
            fresh_note = FreshNote(
                tick=k,
                hand=of_hand,
                key=fresh.key,
                seq=fresh.seq,
                sample_ns=fresh.sample_ns,
                answer=begun.number if self.on_arrival else None,
            )
            notes.append(Record(FRESH, t_ns, fresh_note))
        if hand.prompt_ns is not None and hand.prompt_ns <= t_ns:
            hand.prompt_ns = None
        return notes

    def _tick_note(self, k: int, begin_ns: int, missed: bool = False) -> Record:
        note = TickNote(tick=k, due_ns=self.ticker.due_ns(k), begin_ns=begin_ns, missed=missed)
        return Record(TICKS, begin_ns, note)
