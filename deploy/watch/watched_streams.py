"""Which stream of the testbed a key is, for somebody who sees keys only and knows no scenario."""

from typing import Literal, NamedTuple, get_args

from common.channels import Arm, Channel, Direction, Hand, hand_channels

Role = Literal["command", "arm", "estimated"]
StreamName = Literal["master", "arm", "answers"]

STREAM_OF: dict[Role, StreamName] = {
    "command": "master",
    "arm": "arm",
    "estimated": "answers",
}


class Stream(NamedTuple):
    """A row of the channel table, with what it is to its hand."""

    role: Role
    channel: Channel

    @property
    def device(self) -> str:
        """Return whose pose it is: MTML, MTMR, PSM1 or PSM2."""
        return self.channel.device

    @property
    def direction(self) -> Direction:
        """Return which way it goes."""
        return self.channel.direction


def watched_streams(session: str) -> dict[str, Stream]:
    """Return the streams of a session that are watched, by key, whichever arms follow."""
    table = {}
    for hand in get_args(Hand):
        for arm in get_args(Arm):
            row = hand_channels(hand, arm)
            for role in get_args(Role):
                channel: Channel = getattr(row, role)
                table[channel.key(session)] = Stream(role, channel)
    return table
