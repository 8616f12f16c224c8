"""Set points of a hand: what drives its arm at a tick, the message for the arm's controller, and the record."""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

from pydantic import ValidationError

from common.header import Header
from common.messages import SafetyMode, SetPoint, Vector3, position_m
from common.node import Emission, Record
from common.safety_records import SAFETY, SafetyNote
from patient_side.hand import PatientHand
from patient_side.orientation.turn_limit import turn_towards
from patient_side.orientation.wrist import Wrist, components
from patient_side.rotations import unit
from patient_side.safety.safety_state import Seen
from patient_side.safety.set_point import Place


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


def steer(hand: PatientHand, target: Wrist, t_ns: int) -> Wrist:
    """Advance orientation and gripper of a hand's set point, after `drive`; return them.

    They are those of ``target``, the answer's. While the set point follows no estimate they stay, and after that, and
    after a break, they turn towards it at a bounded rate until the arm tracks again and they have met it. Without a
    safety state they are the target's.
    """
    if hand.safety is None or hand.driven is None:
        hand.driven = target
        return target
    state = hand.safety_state
    is_slow = state.mode != "tracking" or hand.safety.is_cautious(state, t_ns)
    hand.is_turn_bounded = hand.is_turn_bounded or is_slow
    if state.mode in ("tracking", "resuming"):
        hand.driven = (
            turn_towards(hand.driven, target, hand.safety.limits.turn_rad) if hand.is_turn_bounded else target
        )
        hand.is_turn_bounded = is_slow or hand.driven != target
    return hand.driven


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
    payload = message.model_dump_json().encode()

    def on_sent(sent_ns: int) -> Sequence[Record]:
        return (Record(key, sent_ns, payload, channel.payload, sent_ns, tick),)

    return Emission("east", key, payload, Header(tick), on_sent)


class LeftPlace(NamedTuple):
    """Where a process that is gone has left the arm, and in which safety state.

    ``wrist`` is None where its orientation is none.
    """

    place: Place
    mode: SafetyMode
    wrist: Wrist | None


def left_place(payload: bytes | None) -> LeftPlace | None:
    """Return the place in the payload of a set point; None without one, or where it cannot be read."""
    if payload is None:
        return None
    try:
        last = SetPoint.model_validate_json(payload)
    except ValidationError:
        return None
    is_orientation = unit(components(last.orientation)) is not None
    wrist = Wrist(last.orientation, last.gripper_rad) if is_orientation else None
    return LeftPlace(position_m(last), last.mode, wrist)


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
