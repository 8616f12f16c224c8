"""Records of devices and arms that join a run by keys: what they did that the figures do not show."""

from typing import Final, Literal

from pydantic import Field

from tis.common.channels import Hand
from tis.common.messages import Message
from tis.common.topic import Topic

FOREIGN_SURGEON: Final = "foreign_surgeon"
"""Counter in the log of a surgeon that another program was: 1."""

Refusal = Literal["undecodable", "not_finite", "no_rotation", "backwards", "flooded", "jump"]
"""Reason why a message of a device is not used."""

DeviceEvent = Literal["first", "silent", "back", "refused"]


class DeviceNote(Message):
    """A change in what a device sends: its first pose, a silence, its return, or a first refusal of each kind."""

    at_ns: int = Field(description="Run time of the tick that noticed it, in ns.")
    hand: Hand = Field(description="Hand whose device is concerned.")
    event: DeviceEvent = Field(
        description="first: its first pose; silent: no pose for longer than silent_after_ms, the last one holds; "
        "back: poses again; refused: a message was not used, for the first time for this reason."
    )
    for_ns: int = Field(description="How long there was no pose, in ns; 0 for first and refused.")
    reason: str = Field("", max_length=200, description="Reason for a refusal; empty otherwise.")


DEVICES: Final = Topic("/tis/devices", DeviceNote, stamps=("at_ns",))
