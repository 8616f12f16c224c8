"""Records of devices and arms that join a run by keys: what they did that the figures do not show."""

from typing import Annotated, Final, Literal

from msgspec import Meta

from tis.common.channels import Hand
from tis.common.device import TargetRun
from tis.common.messages import Message
from tis.common.topic import Topic

FOREIGN_SURGEON: Final = "foreign_surgeon"
"""Counter in the log of a surgeon that another program was: 1."""

DeviceEvent = Literal["first", "silent", "back", "refused"]


class DeviceNote(Message, frozen=True):
    """A change in what a device sends: its first pose, a silence, its return, or a first refusal of each kind."""

    at_ns: Annotated[int, Meta(description="Run time of the tick that noticed it, in ns.")]
    hand: Annotated[Hand, Meta(description="Hand whose device is concerned.")]
    event: Annotated[
        DeviceEvent,
        Meta(
            description="first: its first pose; silent: no pose for longer than silent_after_ms, the last one holds; "
            "back: poses again; refused: a message was not used, for the first time for this reason."
        ),
    ]
    for_ns: Annotated[int, Meta(description="How long there was no pose, in ns; 0 for first and refused.")]
    reason: Annotated[str, Meta(max_length=200, description="Reason for a refusal; empty otherwise.")] = ""


DEVICES: Final = Topic("/tis/devices", DeviceNote, stamps=("at_ns",))


class TargetRunNote(TargetRun, frozen=True, kw_only=True):
    """A run at the targets of the live page that was played to the end, as the device's program tells it."""

    at_ns: Annotated[int, Meta(description="Run time at which the surgeon's side heard of it, in ns.")]
    hand: Annotated[Hand, Meta(description="Hand that played.")]


TARGET_RUNS: Final = Topic("/tis/target_runs", TargetRunNote, stamps=("at_ns",))
