"""Warnings while a bridge runs, of what the configured network has not: full buffers, too many names, lateness.

And hints at its end, of programs and keys that may not be where their user believes them.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final

from tis.common.channels import DESTINATION, ORIGIN, Direction, Network
from tis.common.scenario.network import Buffer
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.expected.synopsis import direction_label
from tis.netem.link.flows import MAX_CLOSED, MAX_FLOWS
from tis.netem.link.ledger import DROPPED_NEW, DROPPED_OLDEST, full_buffer
from tis.netem.link.link import Link
from tis.netem.link.rules import RuleTable

LATE_NS: Final = 10 * NS_PER_MS
"""A release error above it is told while it happens: it is beyond what a machine with a free core does."""
_LOOKS_BETWEEN: Final = 20  # 10 s
_WORSE: Final = 10


class BufferWatch:
    """A warning for each direction, once, after a full buffer has dropped messages; any thread may call `look`."""

    def __init__(self, links: Mapping[Direction, Link], buffer: Buffer, warn: Callable[[str], None]) -> None:
        self._left: dict[Direction, Link] = dict(links)
        self._buffer = buffer
        self._warn = warn

    def look(self) -> None:
        """Warn of the directions in which the first drop has occurred."""
        for direction, link in list(self._left.items()):
            if link.dropped[DROPPED_NEW] or link.dropped[DROPPED_OLDEST]:
                del self._left[direction]
                full = full_buffer(self._buffer, link.most_held)
                rule = "it drops messages, which is not part of the configured network"
                self._warn(f"{direction_label(direction)}: {full}: {rule}")


class LengthWatch:
    """A warning for each direction, once, of messages that no queue of their rate takes; any thread may `look`."""

    def __init__(self, links: Mapping[Direction, Link], warn: Callable[[str], None]) -> None:
        self._left: dict[Direction, Link] = dict(links)
        self._warn = warn

    def look(self) -> None:
        """Warn of the directions in which such a message has come."""
        for direction, link in list(self._left.items()):
            if link.n_too_long:
                del self._left[direction]
                self._warn(
                    f"{direction_label(direction)}: a message is longer than its queue's max_bytes: such messages "
                    "never pass"
                )


class NamesWatch:
    """A warning for each direction, once, when its names near a bound; any thread may call `look`."""

    def __init__(self, links: Mapping[Direction, Link], warn: Callable[[str], None]) -> None:
        self._left: dict[Direction, Link] = dict(links)
        self._warn = warn

    def look(self) -> None:
        """Warn of the directions in which as many names are in use, or have come and gone, as netem keeps apart."""
        for direction, link in list(self._left.items()):
            if texts := names_near_bounds(link.flows.counters()):
                del self._left[direction]
                self._warn(f"{direction_label(direction)}: {'; '.join(texts)}")


def watches(
    links: Mapping[Direction, Link], buffer: Buffer, warn: Callable[[str], None]
) -> tuple[Callable[[], None], ...]:
    """Return the watches over links, each to be called twice a second."""
    return BufferWatch(links, buffer, warn).look, NamesWatch(links, warn).look, LengthWatch(links, warn).look


def names_near_bounds(counters: Mapping[str, int], head: str = "") -> list[str]:
    """Return a sentence on each bound of a link's names that is near; ``head`` precedes the names of its counters."""
    texts = []
    if n := counters.get(f"{head}most_names"):
        texts.append(f"{n} names at once: above {MAX_FLOWS} it draws anew for each message of a name that returns")
    if n := counters.get(f"{head}gone_names"):
        texts.append(
            f"{n} names have come and gone: above {MAX_CLOSED} all new ones get random numbers of their own, but "
            "no longer those of a run in which fewer came before them"
        )
    return texts


class LateWatch:
    """A warning for each direction while its releases are late: every 10 s, and when they are ten times as late."""

    def __init__(self, warn: Callable[[str], None]) -> None:
        self._warn = warn
        self._most_ns: dict[Direction, int] = {}
        self._left_ns: dict[Direction, int] = {}
        self._silent: dict[Direction, int] = {}
        self._told_ns: dict[Direction, int] = {}

    def count(self, direction: Direction, most_ns: int, left_ns: int) -> None:
        """Note the largest release error of a batch, and when that message left."""
        if most_ns > max(LATE_NS, self._most_ns.get(direction, 0)):
            self._most_ns[direction], self._left_ns[direction] = most_ns, left_ns

    def look(self) -> None:
        """Warn of releases since the last warning; called twice a second."""
        for direction in DESTINATION:
            silent = self._silent[direction] = max(0, self._silent.get(direction, 0) - 1)
            most_ns = self._most_ns.get(direction, 0)
            if most_ns and (not silent or most_ns >= _WORSE * self._told_ns[direction]):
                del self._most_ns[direction]
                self._silent[direction], self._told_ns[direction] = _LOOKS_BETWEEN, most_ns
                worst_s = self._left_ns[direction] / NS_PER_S
                self._warn(
                    f"{direction_label(direction)}: messages leave up to {most_ns / NS_PER_MS:.0f} ms after their "
                    f"instants, the worst at {worst_s:.2f} s: more than this machine released in time, and not "
                    "part of the configured network"
                )


class RulesWatch:
    """The rules that no message has matched so far, of both directions; for the thread that writes the log."""

    def __init__(self, tables: Mapping[Direction, RuleTable]) -> None:
        self._tables = tables
        self._seen: set[tuple[Direction, str]] = set()
        self.unmatched: Final = {str(key) for table in tables.values() for key, _ in table.rules}

    def match(self, direction: Direction, key: str) -> None:
        """Note the rule of a key as matched; each key is looked up once, and none when all rules are matched."""
        if not self.unmatched or (direction, key) in self._seen:
            return
        if len(self._seen) < MAX_FLOWS:
            self._seen.add((direction, key))
        if assigned := self._tables[direction].assign(key):
            self.unmatched.discard(assigned.group)


def silent(
    counters: Mapping[str, int], ends: Mapping[Network, str], keys: Sequence[str], unmatched: Iterable[str] = ()
) -> list[str]:
    """Return a hint for each network from which nothing came, or in which nobody subscribed to what crossed to it.

    ``ends`` are their endpoints. Queries and liveliness need no subscriber: with some, nothing is said of one.
    Where anything came, the rules that matched none of it, ``unmatched``, are named, too.
    """
    matched = "" if "**" in keys else f", and on keys that match {' or '.join(keys)}"
    other = counters.get("queries.asked", 0) + counters.get("tokens.changes", 0)
    hints = [
        f"nothing came from the {origin}: if its programs send, do they connect to {ends[origin]}{matched}?"
        for direction, origin in ORIGIN.items()
        if not counters[f"{direction}.offered"]
    ]
    if any(counters[f"{direction}.offered"] for direction in ORIGIN):
        hints += [f"rule {key}: no message came whose key it matches" for key in sorted(unmatched)]
    return hints + [
        f"nobody in the {DESTINATION[direction]} subscribed to what came from the {origin}: are both programs "
        f"in one network? What receives connects to {ends[DESTINATION[direction]]}"
        for direction, origin in ORIGIN.items()
        if not other and counters[f"{direction}.offered"] and counters.get(f"{direction}.unheard")
    ]
