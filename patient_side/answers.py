"""Messages and records of a hand's estimates, and the faults of user-defined estimators."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self

from tis.common.channels import Channel, Hand
from tis.common.messages import FeedbackPose, Header, Vector3, encode
from tis.common.node import Emission, Record
from tis.common.records import ESTIMATOR_FAULTS, FAULTY_STEPS, EstimateNote, EstimatorFault
from tis.patient_side.estimators.guarded import Guarded
from tis.patient_side.hand import PatientHand
from tis.patient_side.orientation.wrist import Wrist


def answer(
    session: str,
    hand: PatientHand,
    channel: Channel[FeedbackPose],
    where_m: Vector3,
    wrist: Wrist,
    k: int,
    t_ns: int,
    number: int,
) -> Emission:
    """Return the message with a pose of the arm, estimated or measured, at tick ``k``; ``number`` is its own."""
    key = channel.key(session)
    message = FeedbackPose(
        sample_ns=t_ns,
        position_m=where_m,
        orientation=wrist.orientation,
        gripper_rad=wrist.gripper_rad,
        tick=k,
        command_sample_ns=None if hand.freshest is None else hand.freshest.sample_ns,
    )
    payload = encode(message)

    def on_sent(sent_ns: int) -> Sequence[Record]:
        return (Record(key, sent_ns, payload, channel.payload, sent_ns, number),)

    return Emission("east", key, payload, Header(number), on_sent)


def estimate_record(
    hand: PatientHand, i: int, k: int, t_ns: int, where_m: Vector3 | None, std_m: Vector3 | None, step_ns: int
) -> Record:
    """Return the record of the hand's estimator ``i`` at a tick."""
    note = EstimateNote(
        tick=k,
        t_ns=t_ns,
        hand=hand.channels.hand,
        estimator=hand.estimators[i].name,
        position_m=where_m,
        std_m=std_m,
        step_ns=step_ns,
    )
    return Record(hand.topics[i], t_ns, note)


@dataclass(frozen=True)
class OwnEstimators:
    """All user-defined estimators, each with its hand; usually none."""

    guarded: Sequence[tuple[Hand, Guarded]]

    @classmethod
    def among(cls, hands: Sequence[PatientHand]) -> Self:
        """Return the user-defined estimators of these hands."""
        own = [(hand.channels.hand, each) for hand in hands for each in hand.estimators if isinstance(each, Guarded)]
        return cls(own)

    def first_faults(self) -> Iterator[Record]:
        """Yield the first fault of each, once."""
        for hand, guarded in self.guarded:
            if guarded.first is not None and not guarded.reported:
                guarded.reported = True
                t_ns, reason = guarded.first
                fault = EstimatorFault(t_ns=t_ns, hand=hand, estimator=guarded.name, reason=reason)
                yield Record(ESTIMATOR_FAULTS, t_ns, fault)

    def counters(self) -> dict[str, int]:
        """Return the number of failed steps over all hands, by the counter's name."""
        found: dict[str, int] = {}
        for _, guarded in self.guarded:
            name = f"{FAULTY_STEPS}.{guarded.name}"
            found[name] = found.get(name, 0) + guarded.n_faults
        return found
