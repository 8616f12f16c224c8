"""The arm's movement at a tick: the plant takes the set point, and its sensors answer."""

from collections.abc import Iterator

import numpy as np

from tis.common.messages import MAX_SIZE, components
from tis.common.node import Emission, Record
from tis.common.records import PLANT, PlantNote
from tis.patient_side.answers import answer
from tis.patient_side.external_arm import ExternalArm
from tis.patient_side.hand import Driven, PatientHand, finite, vector
from tis.patient_side.orientation.wrist import Wrist, stated_turn
from tis.patient_side.plant.protocol import PlantOutput, Reference
from tis.patient_side.rotations import unit
from tis.patient_side.touch import ArmTouch


def feel(hand: PatientHand, touch: ArmTouch, tick: int, t_ns: int) -> None:
    """Move an arm that touches until ``t_ns``, by the set point before; what it feels decides on the next one."""
    if hand.plant is not None:
        hand.plant_state, moved = hand.plant.step(hand.plant_state, None, tick, t_ns)
        touch.felt(moved)


def move(session: str, hand: PatientHand, driven: Driven, tick: int, t_ns: int) -> Iterator[Emission]:
    """Move a hand's arm until ``t_ns``, give it the new set point, and yield what its sensors measure."""
    if hand.plant is None:
        return
    hand.plant_state, hand.moved = hand.plant.step(hand.plant_state, _reference(hand, driven), tick, t_ns)
    if hand.moved is None:
        return
    at, where = finite(hand.moved.measured_m), finite(hand.moved.position_m)
    if at is None or where is None:  # a simulation that has left the numbers measures nothing
        hand.moved, hand.n_not_stated = None, hand.n_not_stated + 1
        return
    wrist = _moved_wrist(hand.moved, driven.wrist)
    yield answer(session, hand, hand.channels.measured, at, wrist, tick, t_ns, tick)
    if hand.touch is not None:
        mode = None if hand.safety is None else hand.safety_state.mode
        command_ns = None if hand.freshest is None else hand.freshest.sample_ns
        wrench = hand.touch.answer(session, tick, t_ns, mode, command_ns)
        if wrench is not None:
            yield wrench


def moved_notes(hand: PatientHand, tick: int, t_ns: int) -> list[Record]:
    """Return the record of a hand's arm at a tick, and what an arm of another program did or sent."""
    external, notes = hand.plant if isinstance(hand.plant, ExternalArm) else None, []
    if hand.moved is not None:
        note = PlantNote(
            tick=tick,
            t_ns=t_ns,
            hand=hand.channels.hand,
            position_m=vector(hand.moved.position_m),
            age_ns=None if external is None else external.age_ns(t_ns),
            clamped=hand.moved.is_clamped,
        )
        notes.append(Record(PLANT, t_ns, note))
    if hand.touch is not None and hand.touch.note is not None:
        notes.append(hand.touch.note)
        hand.touch.note = None
    if external is not None:
        notes += external.notes()
    return notes


def _reference(hand: PatientHand, driven: Driven) -> Reference | None:
    """Return the set point for the plant; its orientation is unknown before a sample has told it."""
    if driven.place is None:
        return None
    is_known = hand.pose is not None
    orientation = unit(components(driven.wrist.orientation)) if is_known else None
    turn = None if orientation is None else np.array(orientation)
    return Reference(np.array(driven.place), turn, driven.wrist.gripper_rad)


def _moved_wrist(moved: PlantOutput, driven: Wrist) -> Wrist:
    """Return orientation and gripper of the plant's arm: its own, or those that drive it."""
    gripper_rad = moved.gripper_rad
    return Wrist(
        stated_turn(moved.orientation) or driven.orientation,
        driven.gripper_rad if gripper_rad is None or not abs(gripper_rad) <= MAX_SIZE else gripper_rad,
    )
