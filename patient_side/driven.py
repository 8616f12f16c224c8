"""Set points of a hand: what drives its arm at a tick, the message for the arm's controller, and the record."""

from collections.abc import Sequence
from math import inf

from msgspec import DecodeError

from tis.common.messages import Header, SafetyMode, SetPoint, Vector3, components, decode, encode, position_m
from tis.common.node import Arrival, Emission, Record
from tis.common.records import REJECTED, Rejected
from tis.common.safety_records import QUARANTINE, SAFETY, QuarantineNote, SafetyNote
from tis.patient_side.hand import Driven, PatientHand
from tis.patient_side.orientation.wrist import Wrist, quaternion
from tis.patient_side.rotations import is_orientation
from tis.patient_side.safety import set_point as point
from tis.patient_side.safety.safety_state import Left, Seen
from tis.patient_side.safety.set_point import Place


def drive(
    hand: PatientHand, where_m: Vector3 | None, std_m: Vector3 | None, is_certain: bool, wrist: Wrist, t_ns: int
) -> Driven:
    """Advance a hand's safety state; return the set point, without a place while there is none.

    Without a safety state the active estimate drives the arm as it is. ``is_certain``: the stated deviation is valid,
    or the estimator states none. ``wrist`` is the answer's.
    """
    estimate_m = None if where_m is None else (where_m.x, where_m.y, where_m.z)
    touch = hand.touch
    if touch is not None:
        estimate_m = touch.goal(estimate_m, None if hand.safety is None else hand.safety_state.mode)
    if hand.safety is None:
        if touch is not None:
            touch.took(estimate_m)
        return Driven(estimate_m, wrist)
    newest = hand.freshest
    largest_m = (None if is_certain else inf) if std_m is None else max(std_m.x, std_m.y, std_m.z)
    target = point.WristPose(components(wrist.orientation), wrist.gripper_rad)
    sample_ns = None if newest is None else newest.sample_ns
    is_pressed = touch is not None and touch.is_pressed(estimate_m, hand.safety_state.place)
    seen = Seen(sample_ns, estimate_m, largest_m, target, hand.is_in_conflict(t_ns), is_pressed)
    hand.safety_state = state = hand.safety.step(hand.safety_state, t_ns, seen)
    if touch is not None:
        touch.took(state.place)
    if state.place is None or state.wrist is None:
        return Driven(None, wrist)
    at = state.wrist.at
    # the answer's own message where it is met: a second one of the same numbers costs time
    orientation = wrist.orientation if at.orientation == target.orientation else quaternion(at.orientation)
    return Driven(state.place, Wrist(orientation, at.gripper_rad))


def set_point(session: str, hand: PatientHand, place: Place, wrist: Wrist, tick: int, t_ns: int) -> Emission:
    """Return the message for the arm's own controller."""
    channel = hand.channels.driven
    key = channel.key(session)
    x_m, y_m, z_m = place
    message = SetPoint(
        sample_ns=t_ns,
        position_m=Vector3(x=x_m, y=y_m, z=z_m),
        orientation=wrist.orientation,
        gripper_rad=wrist.gripper_rad,
        hand=hand.channels.hand,
        tick=tick,
        mode=hand.safety_state.mode,
        age_ns=_age_ns(hand, t_ns),
    )
    payload = encode(message)

    def on_sent(sent_ns: int) -> Sequence[Record]:
        return (Record(key, sent_ns, payload, channel.payload, sent_ns, tick),)

    return Emission("east", key, payload, Header(tick), on_sent)


def left_place(payload: bytes | None) -> Left | None:
    """Return where a process that is gone has left the arm, by its last set point; None where it cannot be read."""
    if payload is None:
        return None
    try:
        last = decode(payload, SetPoint)
    except DecodeError:
        return None
    turn = components(last.orientation)
    wrist = point.WristPose(turn, last.gripper_rad) if is_orientation(turn) else None
    return Left(position_m(last), last.mode, wrist)


def foreign_set_point(hand: PatientHand, arrival: Arrival) -> Sequence[Record]:
    """Count a set point that the patient did not send, which an arm on its network may follow; return its record."""
    hand.foreign.note(arrival.recv_ns)
    if not hand.foreign.is_to_be_logged(arrival.recv_ns):
        return ()
    header = Header.unpack(arrival.attachment)
    try:
        sent = decode(arrival.payload, SetPoint)
    except DecodeError:
        head = arrival.payload[:32].hex()
        note = Rejected(key=arrival.key, recv_ns=arrival.recv_ns, reason="a foreign set point", head_hex=head)
        return (Record(REJECTED, arrival.recv_ns, note),)
    x_m, y_m, z_m = position_m(sent)
    return (
        Record(
            QUARANTINE,
            arrival.recv_ns,
            QuarantineNote(
                key=arrival.key, seq=0 if header is None else header.seq, recv_ns=arrival.recv_ns,
                sample_ns=sent.sample_ns, x_m=x_m, y_m=y_m, z_m=z_m, kind="foreign_set_point",
            ),
        ),
    )  # fmt: skip


def safety_change(hand: PatientHand, before: SafetyMode, t_ns: int) -> Record | None:
    """Return the record of a change of the safety state at this tick, None without one."""
    mode, cause = hand.safety_state.mode, hand.safety_state.cause
    if mode == before:
        return None
    age_ns = _age_ns(hand, t_ns)
    note = SafetyNote(t_ns=t_ns, hand=hand.channels.hand, before=before, mode=mode, cause=cause, age_ns=age_ns)
    return Record(SAFETY, t_ns, note)


def _age_ns(hand: PatientHand, t_ns: int) -> int | None:
    return None if hand.freshest is None else t_ns - hand.freshest.sample_ns
