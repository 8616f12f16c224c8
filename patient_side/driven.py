"""Set points of a hand: what drives its arm at a tick, the message for the arm's controller, and the record."""

from collections.abc import Sequence
from math import inf
from typing import Final, NamedTuple

from pydantic import ValidationError

from common.header import Header
from common.messages import Quaternion, SafetyMode, SetPoint, Vector3, position_m
from common.node import Emission, Record
from common.safety_records import SAFETY, SafetyNote
from patient_side.hand import PatientHand
from patient_side.safety.safety_state import Seen
from patient_side.safety.set_point import Place

LEVEL: Final = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)


def drive(
    hand: PatientHand, where_m: Vector3 | None, std_m: Vector3 | None, is_certain: bool, t_ns: int
) -> Place | None:
    """Advance a hand's safety state; return the set point, None while there is none.

    Without a safety state the active estimate drives the arm as it is. ``is_certain``: the stated deviation is valid,
    or the estimator states none.
    """
    estimate_m = None if where_m is None else (where_m.x, where_m.y, where_m.z)
    if hand.safety is None:
        return estimate_m
    newest = hand.freshest
    largest_m = (None if is_certain else inf) if std_m is None else max(std_m.x, std_m.y, std_m.z)
    seen = Seen(None if newest is None else newest.sample_ns, estimate_m, largest_m)
    hand.safety_state = hand.safety.step(hand.safety_state, t_ns, seen)
    return hand.safety_state.place


def set_point(session: str, hand: PatientHand, place: Place, tick: int, t_ns: int) -> Emission:
    """Return the message for the arm's own controller.

    Orientation and gripper are those of the newest sample; while the set point follows no estimate they stay.
    """
    if hand.safety_state.mode in ("tracking", "resuming"):
        hand.driven_pose = hand.pose
    channel, pose = hand.channels.driven, hand.driven_pose
    key = channel.key(session)
    x_m, y_m, z_m = place
    message = SetPoint(
        sample_ns=t_ns,
        position_m=Vector3(x=x_m, y=y_m, z=z_m),
        orientation=LEVEL if pose is None else pose.orientation,
        gripper_rad=0.0 if pose is None else pose.gripper_rad,
        hand=hand.channels.hand,
        tick=tick,
        mode=hand.safety_state.mode,
        age_ns=_age_ns(hand, t_ns),
    )
    payload = message.model_dump_json().encode()

    def on_sent(sent_ns: int) -> Sequence[Record]:
        return (Record(key, sent_ns, payload, channel.payload, sent_ns, tick),)

    return Emission("east", key, payload, Header(tick), on_sent)


class LeftPlace(NamedTuple):
    """Where a process that is gone has left the arm, and in which safety state."""

    place: Place
    mode: SafetyMode


def left_place(payload: bytes | None) -> LeftPlace | None:
    """Return the place in the payload of a set point; None without one, or where it cannot be read."""
    if payload is None:
        return None
    try:
        last = SetPoint.model_validate_json(payload)
    except ValidationError:
        return None
    return LeftPlace(position_m(last), last.mode)


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
