"""netem's fates and releases of one direction as columns."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, Self, get_args

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction
from tis.common.records import FATES, RELEASES, Departure, Outcome
from tis.deploy.logs.json_rows import Row
from tis.deploy.logs.read.load import Ints, RunLogs

Flags = NDArray[np.bool_]

OUTCOMES: Final[tuple[Outcome, ...]] = get_args(Outcome)
DEPARTURES: Final[tuple[Departure, ...]] = get_args(Departure)
_SMALL: Final = ("outcome", "departure", "copies", "copy_index", "flipped")
"""Columns kept as int8, as millions of packets are in memory at a time."""

DELIVER: Final = OUTCOMES.index("deliver")
RELEASED: Final = DEPARTURES.index("released")


class Fates(NamedTuple):
    """N offered packets: ``keys``, and arrays (N,) as in `FateBatch`, key by key in order of time.

    ``key`` is an index into ``keys``, ``outcome`` one into `OUTCOMES`.
    """

    keys: tuple[str, ...]
    key: Ints
    foreign: Flags
    seq: Ints
    offered_ns: Ints
    outcome: Ints
    delay_ns: Ints
    release_ns: Ints
    n_bytes: Ints
    copies: Ints
    flipped: Ints

    def at(self, which: Flags | Ints | slice) -> Self:
        """Return a selection; selecting all copies nothing."""
        if isinstance(which, np.ndarray) and which.dtype == np.bool_ and which.all():
            return self
        return self._replace(**{name: getattr(self, name)[which] for name in self._fields[1:]})


class Releases(NamedTuple):
    """N packets and copies that left: ``keys``, and arrays (N,) as in `ReleaseBatch`, by key in order of leaving.

    ``key`` is an index into ``keys``, ``departure`` one into `DEPARTURES`.
    """

    keys: tuple[str, ...]
    key: Ints
    foreign: Flags
    seq: Ints
    copy_index: Ints
    offered_ns: Ints
    release_ns: Ints
    released_ns: Ints
    departure: Ints
    queued_ns: Ints

    def at(self, which: Flags | Ints | slice) -> Self:
        """Return a selection; selecting all copies nothing."""
        if isinstance(which, np.ndarray) and which.dtype == np.bool_ and which.all():
            return self
        return self._replace(**{name: getattr(self, name)[which] for name in self._fields[1:]})


def fates_by_key(logs: RunLogs, direction: Direction) -> dict[str, Fates]:
    """Return the fates of each key in order of first appearance; needs less memory at a time than `link_fates`."""
    keys = _keys(logs, FATES, direction)
    return {key: Fates(*_columns(logs, FATES, direction, Fates._fields[3:], key)) for key in keys}


def releases_by_key(logs: RunLogs, direction: Direction) -> dict[str, Releases]:
    """Return the releases of each key, as `fates_by_key`."""
    keys = _keys(logs, RELEASES, direction)
    return {key: Releases(*_columns(logs, RELEASES, direction, Releases._fields[3:], key)) for key in keys}


def link_fates(logs: RunLogs, direction: Direction) -> Fates:
    """Return the fates of one direction; empty without netem's log (oracle: literals, test_batches)."""
    return Fates(*_columns(logs, FATES, direction, Fates._fields[3:]))


def link_releases(logs: RunLogs, direction: Direction) -> Releases:
    """Return the releases of one direction; empty without netem's log."""
    return Releases(*_columns(logs, RELEASES, direction, Releases._fields[3:]))


def late_ns(releases: Releases) -> Ints:
    """Return the release error (N,) in ns of each released packet or copy."""
    out = releases.departure == RELEASED
    return np.asarray(releases.released_ns[out] - releases.release_ns[out])


def in_order_of_leaving(releases: Releases) -> Releases:
    """Return the released packets and copies by instant of release; ties in order of the log."""
    out = releases.at(releases.departure == RELEASED)
    if np.all(out.released_ns[1:] >= out.released_ns[:-1]):
        return out
    return out.at(np.argsort(out.released_ns, kind="stable"))


def by_key(index: Ints, n_keys: int) -> list[Ints]:
    """Return for each of ``n_keys`` keys its positions in ``index`` (N,), ascending."""
    order = np.argsort(index, kind="stable")
    return np.split(order, np.searchsorted(index[order], np.arange(1, n_keys))) if n_keys else []


def _batches(logs: RunLogs, topic: str, direction: Direction) -> list[Row]:
    log = logs.sides.get("netem")
    return [batch for batch in (log.batches.get(topic, ()) if log else ()) if batch["direction"] == direction]


def _keys(logs: RunLogs, topic: str, direction: Direction) -> dict[str, None]:
    return dict.fromkeys(batch["key"] for batch in _batches(logs, topic, direction))


def _columns(
    logs: RunLogs, topic: str, direction: Direction, names: Sequence[str], key: str | None = None
) -> Iterator[Any]:
    batches = [batch for batch in _batches(logs, topic, direction) if key in (None, batch["key"])]
    # batches are one per key and direction already, so rows follow key by key
    numbers = {key: i for i, key in enumerate(dict.fromkeys(batch["key"] for batch in batches))}
    lengths = [len(batch["seq"]) for batch in batches]
    yield tuple(numbers)
    yield np.repeat(np.array([numbers[batch["key"]] for batch in batches], dtype=np.int64), lengths)
    for name in ("foreign", *names):
        kind = np.bool_ if name == "foreign" else np.int8 if name in _SMALL else np.int64
        parts = (batch[name].values() for batch in batches)
        yield np.concatenate([np.empty(0, dtype=kind), *(part.astype(kind, copy=False) for part in parts)])


NO_FATES: Final = link_fates(RunLogs(Path()), "forward")
NO_RELEASES: Final = link_releases(RunLogs(Path()), "forward")
