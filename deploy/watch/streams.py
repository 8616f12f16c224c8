"""Streams of the testbed by key, for an observer that knows keys but no scenario, and how their packets cross.

A packet's delay and loss are those between its appearance on the network of origin and of destination. The observer
stamps both instants, so no clocks need to be synchronised.
"""

from collections import OrderedDict
from typing import Final, Literal, NamedTuple, TypeVar, get_args

from tis.common.channels import Arm, Channel, Direction, Hand, hand_channels
from tis.common.messages import Pose
from tis.common.units import NS_PER_S

Role = Literal["command", "arm", "estimated"]
StreamName = Literal["master", "arm", "answers"]

STREAM_OF: dict[Role, StreamName] = {"command": "master", "arm": "arm", "estimated": "answers"}


class Stream(NamedTuple):
    """Row of the channel table with its role for the hand."""

    role: Role
    channel: Channel[Pose]

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
                channel: Channel[Pose] = getattr(row, role)
                table[channel.key(session)] = Stream(role, channel)
    return table


T = TypeVar("T")

_MIN_TIMEOUT_NS: Final = NS_PER_S // 2
_MAX_TIMEOUT_NS: Final = 5 * NS_PER_S
_MARGIN_NS: Final = 3 * NS_PER_S // 10
_PASSED_BY_NONE_NS: Final = 2 * NS_PER_S
"""Patience with a packet after which no other one has arrived."""
_DECAY: Final = 0.998
_MAX_PENDING: Final = 50_000


class Crossing(NamedTuple):
    """Delay of a packet sent at ``sent_ns`` of run time, None when it counts as lost."""

    sent_ns: int
    delay_ns: int | None


class Crossings:
    """Pairs the packets of one stream by sequence number. Bounded: with too many pending, the oldest are dropped.

    A packet counts as lost after 0.3 s plus twice the longest recent delay, at least 0.5 s and at most 5 s, if a
    later one has arrived: what a busy emulator holds up comes in order, and is not lost. Where none has, it counts
    after 2 s at the earliest. One that arrives after all is reported again, with its delay.
    """

    def __init__(self) -> None:
        self._offered: OrderedDict[int, tuple[int, int]] = OrderedDict()
        self._early: OrderedDict[int, int] = OrderedDict()
        self._expired: OrderedDict[int, tuple[int, int]] = OrderedDict()
        self._longest_ns = 0.0
        self._newest = -1

    @property
    def loss_timeout_ns(self) -> int:
        """Return the time after which a packet counts as lost."""
        adaptive_ns = int(2 * self._longest_ns) + _MARGIN_NS
        return min(max(adaptive_ns, _MIN_TIMEOUT_NS), _MAX_TIMEOUT_NS)

    @property
    def undecided_ns(self) -> int | None:
        """Return when the oldest packet was sent that may still arrive; None without one."""
        return next(iter(self._offered.values()), (None, 0))[0]

    def offered(self, seq: int, sent_ns: int, at_ns: int) -> Crossing | None:
        """Add a packet seen on its network of origin; it may have been seen on the other one before."""
        arrived_ns = self._early.pop(seq, None)
        if arrived_ns is not None:
            return self._crossed(sent_ns, max(0, arrived_ns - at_ns))
        _put(self._offered, seq, (sent_ns, at_ns))
        return None

    def arrived(self, seq: int, at_ns: int) -> Crossing | None:
        """Add a packet seen at its destination; None for a copy and for one sent before the observation."""
        self._newest = max(self._newest, seq)
        found = self._offered.pop(seq, None)
        if found is None:
            found = self._expired.pop(seq, None)
        if found is None:
            _put(self._early, seq, at_ns)
            return None
        sent_ns, offered_ns = found
        return self._crossed(sent_ns, max(0, at_ns - offered_ns))

    def expire(self, now_ns: int, heard_ns: int = 0) -> list[Crossing]:
        """Return the packets that now count as lost, in the order of sending.

        Of those offered before ``heard_ns``, when the destination was first listened to, nothing is told.
        """
        patience_ns, lost = self.loss_timeout_ns, []
        while self._offered:  # offered in order of time, so the oldest is first
            seq, found = next(iter(self._offered.items()))
            if seq > self._newest:
                patience_ns = max(patience_ns, _PASSED_BY_NONE_NS)
            if found[1] > now_ns - patience_ns:
                break
            del self._offered[seq]
            _put(self._expired, seq, found)
            if found[1] >= heard_ns:
                lost.append(Crossing(found[0], None))
        while self._early and next(iter(self._early.values())) < now_ns - _MAX_TIMEOUT_NS:
            self._early.popitem(last=False)
        return lost

    def keep_multiples(self, n: int) -> None:
        """Drop the pending packets whose number is not a multiple of ``n``: their arrivals will be ignored."""
        for table in (self._offered, self._early, self._expired):
            for seq in [seq for seq in table if seq % n]:
                table.pop(seq)

    def _crossed(self, sent_ns: int, delay_ns: int) -> Crossing:
        self._longest_ns = max(self._longest_ns * _DECAY, delay_ns)
        return Crossing(sent_ns, delay_ns)


def _put(table: OrderedDict[int, T], seq: int, value: T) -> None:
    table[seq] = value
    if len(table) > _MAX_PENDING:
        table.popitem(last=False)
