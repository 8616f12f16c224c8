"""Streams of the testbed by key, for an observer that knows keys but no scenario."""

from typing import Literal, NamedTuple, get_args

from tis.common.channels import Arm, Channel, Direction, Hand, hand_channels

Role = Literal["command", "arm", "estimated"]
StreamName = Literal["master", "arm", "answers"]

STREAM_OF: dict[Role, StreamName] = {"command": "master", "arm": "arm", "estimated": "answers"}


class Stream(NamedTuple):
    """Row of the channel table with its role for the hand."""

    role: Role
    channel: Channel

    @property
    def device(self) -> str:
        """Return the device: MTML, MTMR, PSM1 or PSM2."""
        return self.channel.device

    @property
    def direction(self) -> Direction:
        """Return the direction."""
        assert self.channel.direction is not None, "all watched streams cross the network"
        return self.channel.direction


def watched_streams(session: str) -> dict[str, Stream]:
    """Return the watched streams of a session by key, for every pairing of hands and arms."""
    table = {}
    for hand in get_args(Hand):
        for arm in get_args(Arm):
            row = hand_channels(hand, arm)
            for role in get_args(Role):
                channel: Channel = getattr(row, role)
                table[channel.key(session)] = Stream(role, channel)
    return table
