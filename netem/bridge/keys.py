"""The keys that cross the bridge: those of the user and those that Zenoh's own layers derive from them."""

from collections.abc import Sequence
from itertools import combinations
from typing import Final, NamedTuple

import zenoh

from tis.common.channels import CONTROL
from tis.common.errors import Fault, InputError
from tis.common.zenoh_syntax import key_expression_fault

PROBES: Final = f"{CONTROL}/netem"
"""The prefix of the bridge's own probes; ``**`` never matches a chunk that begins with ``@``."""

_LIVE_CONTROL: Final = "netem/control"
_ADVANCED_CHUNK: Final = "@adv"
_ADVANCED: Final = f"{_ADVANCED_CHUNK}/**"
_ROS_GRAPH: Final = "@ros2_lv"


class CrossingKeys(NamedTuple):
    """The key expressions that cross: of messages and queries, and of liveliness tokens, which have more."""

    messages: tuple[str, ...]
    tokens: tuple[str, ...]

    @property
    def all(self) -> tuple[str, ...]:
        """Return every expression once."""
        return tuple(dict.fromkeys((*self.messages, *self.tokens)))


def crossing_keys(keys: Sequence[str]) -> CrossingKeys:
    """Return all key expressions that must cross for applications on ``keys``; raises `InputError`.

    Each key expression also has the keys of its advanced publishers and subscribers (caches, heartbeats, detection:
    ``KEY/@adv/**``). A ROS 2 domain, the first chunk of rmw_zenoh's keys, also has its graph (liveliness below
    ``@ros2_lv/<domain>``). An expression within another one is left out; two that overlap otherwise are an error,
    since a key that matches both would cross twice.
    """
    parsed: list[zenoh.KeyExpr] = []
    faults: list[Fault] = []
    for key in keys:
        if key_expression_fault(key) is not None:
            faults.append(Fault("netem", "KEYEXPR", "must be a Zenoh key expression, like demo/**", key))
            continue
        expr = zenoh.KeyExpr.autocanonize(key)
        chunks = str(expr).split("/")
        if CONTROL in chunks or chunks[0] == "@" or is_private(str(expr)):
            faults.append(Fault("netem", "KEYEXPR", "must not name control keys: they never cross", key))
        parsed.append(expr)
    for one, two in combinations(parsed, 2):
        if one.intersects(two) and not (one.includes(two) or two.includes(one)):
            faults.append(
                Fault("netem", "KEYEXPR", f"must not share keys with {one}: they would cross twice", str(two))
            )
    if faults:
        raise InputError(faults)
    unique = list(dict.fromkeys(str(expr) for expr in parsed))
    widest = [key for key in unique if not any(_is_within(key, other) for other in unique)]
    messages = [expression for key in widest for expression in (key, f"{key}/{_ADVANCED}")]
    graphs = [_ros_graph(key.partition("/")[0]) for key in widest]
    tokens = dict.fromkeys([*messages, *filter(None, graphs)])
    return CrossingKeys(tuple(dict.fromkeys(messages)), tuple(tokens))


def is_private(key: str) -> bool:
    """Tell whether a key is a live control key, which belongs to one network.

    Its first chunk is the session or the configured prefix.
    """
    if _LIVE_CONTROL not in key:
        return False
    _, _, below = key.partition("/")
    return below == _LIVE_CONTROL or below.startswith(f"{_LIVE_CONTROL}/")


def is_advanced(key: str) -> bool:
    """Tell whether a key is a derived one of an advanced publisher or subscriber."""
    return _ADVANCED_CHUNK in key.split("/")


def _is_within(key: str, other: str) -> bool:
    return key != other and zenoh.KeyExpr(other).includes(key)


def _ros_graph(chunk: str) -> str:
    if chunk == "**":
        return f"{_ROS_GRAPH}/**"
    return f"{_ROS_GRAPH}/{chunk}/**" if chunk == "*" or chunk.isdecimal() else ""
