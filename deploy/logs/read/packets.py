"""Packets of a run as frames: netem's fates and releases of a direction, and their first uses by the patient."""

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction, Hand
from tis.common.records import FATES, FRESH, PROMPT, RELEASES, TICKS
from tis.deploy.logs.read.columns import Flags, Ints
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.side_log import DEPARTURES, OUTCOMES, no_packets

DELIVER: Final = OUTCOMES.index("deliver")
RELEASED: Final = DEPARTURES.index("released")


def fates_by_key(logs: RunLogs, direction: Direction) -> dict[str, Frame]:
    """Return the fates of each key in order of first appearance; needs less memory at a time than `link_fates`.

    Columns are those of `FateBatch`; ``outcome`` is an index into `OUTCOMES`.
    """
    return _by_key(logs, FATES, direction)


def releases_by_key(logs: RunLogs, direction: Direction) -> dict[str, Frame]:
    """Return the releases of each key, as `fates_by_key`; ``departure`` is an index into `DEPARTURES`."""
    return _by_key(logs, RELEASES, direction)


def link_fates(logs: RunLogs, direction: Direction) -> Frame:
    """Return the fates of one direction, key by key: ``key`` (N,) is an index into ``keys``.

    Empty without netem's log. Oracle: literals, test_packets.
    """
    return _together(logs, FATES, direction)


def link_releases(logs: RunLogs, direction: Direction) -> Frame:
    """Return the releases of one direction, as `link_fates`."""
    return _together(logs, RELEASES, direction)


def _of(logs: RunLogs, topic: str, direction: Direction) -> dict[str, Frame]:
    log = logs.sides.get("netem")
    known = {} if log is None else log.packets.get(topic, {})
    return {key: frame for (way, key), frame in known.items() if way == direction}


def _by_key(logs: RunLogs, topic: str, direction: Direction) -> dict[str, Frame]:
    return {key: frame.at(slice(None)) for key, frame in _of(logs, topic, direction).items()}


def _together(logs: RunLogs, topic: str, direction: Direction) -> Frame:
    frames = _of(logs, topic, direction)
    key = np.repeat(np.arange(len(frames)), [len(frame) for frame in frames.values()])
    each = (no_packets(topic), *frames.values())
    columns = {name: np.concatenate([frame.column(name) for frame in each]) for name in each[0].names}
    return Frame.of_arrays(tuple(frames), key=key, **columns)


NO_FATES: Final = link_fates(RunLogs(Path()), "forward")
NO_RELEASES: Final = link_releases(RunLogs(Path()), "forward")


def late_ns(releases: Frame) -> Ints:
    """Return the release error (N,) in ns of each released packet or copy."""
    out = releases.departure == RELEASED
    return np.asarray(releases.released_ns[out] - releases.release_ns[out])


def in_order_of_leaving(releases: Frame) -> Frame:
    """Return the released packets and copies by instant of release; ties in order of the log."""
    out = releases.at(releases.departure == RELEASED)
    if np.all(out.released_ns[1:] >= out.released_ns[:-1]):
        return out
    return out.at(np.argsort(out.released_ns, kind="stable"))


def by_key(index: Ints, n_keys: int) -> list[Ints]:
    """Return for each of ``n_keys`` keys its positions in ``index`` (N,), ascending."""
    order = np.argsort(index, kind="stable")
    return np.split(order, np.searchsorted(index[order], np.arange(1, n_keys))) if n_keys else []


def begun_ticks(logs: RunLogs) -> Frame:
    """Return the patient's ticks that were not missed, ascending, as `TickNote`."""
    rows = logs.of("patient", TICKS)
    begun = rows.at(~rows.column("missed"))
    return begun.at(np.argsort(begun.column("tick"), kind="stable"))


def first_uses(logs: RunLogs, hand: Hand) -> Frame:
    """Return one hand's packets at the first use of their sample by an estimate: at ticks first, then on arrival.

    ``key`` and ``seq`` (N,) identify the packet, ``begin_ns`` is the begin of the estimate, ``answer`` its number. A
    sample that was answered on arrival counts there only.
    """
    names = ("key", "seq", "begin_ns", "answer")
    # answer is NaN where no estimate was made
    prompt, fresh = logs.of("patient", PROMPT), logs.of("patient", FRESH)
    at_once = prompt.at(prompt.where("hand", hand) & (prompt.column("answer") >= 0))
    ticks = begun_ticks(logs)
    place, begun = place_in(ticks.column("tick"), fresh.column("tick"))
    first = fresh.where("hand", hand) & begun
    # a sample answered on arrival is noted again at the next tick: not a first use there
    for key in np.unique(at_once.key):
        answered = at_once.seq[at_once.key == key]
        first &= ~(fresh.where("key", key) & np.isin(fresh.column("seq"), answered))
    number = fresh.column("answer")
    number = np.where(number >= 0, number, fresh.column("tick"))[first]
    of_ticks = fresh.at(first).with_columns(begin_ns=ticks.column("begin_ns")[place[first]], answer=number)
    return Frame.of_arrays(**{name: np.concatenate([of_ticks.column(name), at_once.column(name)]) for name in names})


def place_in(ascending: Ints, values: Ints) -> tuple[Ints, Flags]:
    """Return the index of each of ``values`` (N,) in ``ascending`` (M,), 0 if absent, and whether it exists (N,)."""
    place: NDArray[np.int64] = np.searchsorted(ascending, values)
    found = place < len(ascending)
    found[found] = ascending[place[found]] == values[found]
    return np.where(found, place, 0), found
