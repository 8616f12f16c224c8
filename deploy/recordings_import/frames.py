"""Transforms between frames: each pair of a topic of TF is a topic of poses of its own, like /tf:odom:base_link.

Pairs are those that were sent; a chain like map, odom, base_link is not multiplied out.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, Final

from tis.deploy.logs.payloads import UNREADABLE
from tis.deploy.recordings_import.found import Rows, Topic
from tis.deploy.recordings_import.messages import in_ros, pairs_in

_MAX_PAIRS: Final = 1000

Decode = Callable[[], Any]
"""Returns a decoded message; raises one of `UNREADABLE`."""


def pair_topics(topic: str, type_name: str, messages: Iterable[Decode]) -> list[Topic]:
    """Return the pairs of frames in a topic's messages, in order; those that cannot be read name none."""
    counts: Counter[str] = Counter()
    for decode in messages:
        try:
            found = pairs_in(topic, decode())
        except (*UNREADABLE, AssertionError):
            continue
        for pair, transforms in found.items():
            if pair in counts or len(counts) < _MAX_PAIRS:
                counts[pair] += len(transforms)
    return [Topic(pair, type_name, n, "pose") for pair, n in counts.items()]


def take_pairs(topic: str, decode: Decode, log_ns: int, rows: Mapping[str, Rows]) -> None:
    """Add the transforms of a message to the rows of their pairs; one that cannot be read counts for each pair."""
    try:
        found = pairs_in(topic, decode())
    except (*UNREADABLE, AssertionError):
        for name, into in rows.items():
            into.n_undecodable += name.startswith(f"{topic}:")
        return
    for pair, transforms in found.items():
        for one in transforms if pair in rows else ():
            rows[pair].take(partial(in_ros, one, log_ns, True))
