"""Messages of a run as an observer sees them."""

from collections import deque
from collections.abc import Iterator
from typing import Any

from tis.common.channels import Channel, Network, hand_channels
from tis.common.messages import FeedbackPose, Header, Pose, Quaternion, Vector3, encode
from tis.common.units import NS_PER_MS, sample_instant_ns
from tis.deploy.watch.book import LiveBook, Sighting

LEFT = hand_channels("left", "PSM2")
STARTED_NS = 50_000 * NS_PER_MS
"""The observer's clock at the run's epoch."""
_LEVEL = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)


def sighting(network: Network, channel: Channel[Any], seq: int, sent_ns: int, at_ns: int, payload: bytes) -> Sighting:
    return Sighting(network, channel.key("tis"), STARTED_NS + at_ns, Header(seq, sent_ns).pack(), payload)


def pose(sample_ns: int, x_m: float) -> bytes:
    place = Vector3(x=x_m, y=0.0, z=0.0)
    return encode(Pose(sample_ns=sample_ns, position_m=place, orientation=_LEVEL, gripper_rad=0.0))


def answer(k: int, t_ns: int, x_m: float, fresh_ns: int | None) -> bytes:
    message = FeedbackPose(
        sample_ns=t_ns, position_m=Vector3(x=x_m, y=0.0, z=0.0), orientation=_LEVEL, gripper_rad=0.0, tick=k,
        command_sample_ns=fresh_ns,
    )  # fmt: skip
    return encode(message)


def a_run(n: int, rate_hz: int = 100, delay_ms: int = 20, lost: frozenset[int] = frozenset()) -> Iterator[Sighting]:
    """Yield ``n`` samples that move at 0.1 m/s along x; estimates hold, 2 ms after each sample instant.

    Of the samples in ``lost`` neither the master's nor the arm's arrives.
    """
    seen: list[Sighting] = []
    under_way: deque[int] = deque()
    fresh_ns: int | None = None
    for i in range(n):
        s_ns = sample_instant_ns(i, rate_hz)
        for channel, gain in ((LEFT.command, 2.0), (LEFT.arm, 1.0)):
            payload = pose(s_ns, gain * 0.1 * s_ns * 1e-9)
            seen.append(sighting("west", channel, i, s_ns, s_ns, payload))
            if i not in lost:
                seen.append(sighting("east", channel, i, s_ns, s_ns + delay_ms * NS_PER_MS, payload))
        t_ns = s_ns + 2 * NS_PER_MS
        if i not in lost:
            under_way.append(s_ns)
        while under_way and under_way[0] + delay_ms * NS_PER_MS <= t_ns:
            fresh_ns = under_way.popleft()
        if fresh_ns is not None:
            payload = answer(i, t_ns, 0.1 * fresh_ns * 1e-9, fresh_ns)
            seen.append(sighting("east", LEFT.estimated, i, t_ns, t_ns, payload))
            seen.append(sighting("west", LEFT.estimated, i, t_ns, t_ns + delay_ms * NS_PER_MS, payload))
    yield from sorted(seen, key=lambda one: one.at_ns)


def a_book(n: int = 300, **run: int) -> LiveBook:
    book = LiveBook("tis")
    for seen in a_run(n, **run):  # type: ignore[arg-type]
        book.take(seen)
        book.settle(seen.at_ns)
    book.settle(STARTED_NS + 100_000 * NS_PER_MS)
    return book
