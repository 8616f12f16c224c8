"""The surgeon's displays, one for each arm: from poses sent and received to messages with the predicted pose."""

from collections.abc import Sequence
from typing import Final

from common.channels import Channel, HandChannels
from common.header import Header
from common.messages import FeedbackPose, Pose
from common.node import Emission, Record
from surgeon_side.commanded_arm import CommandedArm, Servo
from surgeon_side.predictive_display import PredictiveDisplay
from surgeon_side.samples import SampleMessage

MAX_RATE_HZ: Final = 120
"""Pictures a second of a display: no screen shows more, and each costs a tick of 1 kHz a part of its time."""


class Displays:
    """Displays of all arms of a session. What they show is published on the surgeon's network only, and logged.

    They show every tick, or at fast rates every n-th, at most `MAX_RATE_HZ` a second.
    """

    def __init__(self, session: str, hands: Sequence[HandChannels], rate_hz: int, servo: Servo | None) -> None:
        self._by_command: dict[str, tuple[PredictiveDisplay, Channel, str]] = {}
        self._by_feedback: dict[str, PredictiveDisplay] = {}
        self._every = -(-rate_hz // MAX_RATE_HZ)
        for channels in hands:
            display = PredictiveDisplay(channels.hand, CommandedArm(rate_hz, servo))
            predicted = channels.predicted
            self._by_command[channels.arm.key(session)] = (display, predicted, predicted.key(session))
            self._by_feedback[channels.measured.key(session)] = display

    @property
    def keys(self) -> Sequence[str]:
        """Keys of the predicted poses."""
        return [key for _, _, key in self._by_command.values()]

    def feedback(self, key: str, pose: Pose, recv_ns: int) -> None:
        """Take an answer of the patient; only the arm's measured pose is displayed."""
        display = self._by_feedback.get(key)
        if display is not None and isinstance(pose, FeedbackPose):
            display.feedback(pose, recv_ns)

    def sampled(self, tick: int, messages: Sequence[SampleMessage]) -> Sequence[Emission]:
        """Take the commands of a tick; return the displays at that instant."""
        shown = []
        for message in messages:
            if message.key in self._by_command:
                display, channel, key = self._by_command[message.key]
                display.command(tick, message.message)
                predicted = display.show(tick, message.message) if tick % self._every == 0 else None
                if predicted is not None:
                    shown.append(_emission(channel, key, tick, predicted.model_dump_json().encode()))
        return shown


def _emission(channel: Channel, key: str, tick: int, payload: bytes) -> Emission:
    def on_sent(sent_ns: int) -> Sequence[Record]:
        return (Record(key, sent_ns, payload, channel.payload, sent_ns, tick),)

    return Emission("west", key, payload, Header(tick), on_sent)
