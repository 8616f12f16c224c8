"""Fates and departures of one direction in netem's log, joined packet by packet."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deploy.logs.read.batches import Fates, Releases, by_key, late_ns
from deploy.logs.read.load import Ints

NOWHERE: Final = -1


class Packets(NamedTuple):
    """N packets of one key in the order of offering: fates, and departures of the originals, arrays (N,).

    ``left`` is an index into `DEPARTURES`, `NOWHERE` where it is unknown; ``leaves_ns`` the decided instant, 0
    without one.
    """

    key: str
    fates: Fates
    left: Ints
    queued_ns: Ints
    leaves_ns: Ints
    late_ns: Ints
    """Release errors of originals and copies, (M,)."""


def packets_by_key(fates: Fates, releases: Releases, with_foreign: bool) -> list[Packets]:
    """Return the packets of each key; foreign messages count as separate keys (oracle: test_run_records)."""
    found = []
    for foreign in (False, True) if with_foreign else (False,):
        offered, out = fates.at(fates.foreign == foreign), releases.at(releases.foreign == foreign)
        out_of = dict(zip(out.keys, by_key(out.key, len(out.keys)), strict=True))
        for key, which in zip(offered.keys, by_key(offered.key, len(offered.keys)), strict=True):
            if len(which):
                found.append(_packets(key, offered.at(which), out.at(out_of.get(key, which[:0]))))
    return found


def _packets(key: str, fates: Fates, releases: Releases) -> Packets:
    fates = fates.at(np.argsort(fates.offered_ns, kind="stable"))
    originals = releases.at(releases.copy_index == 0)
    place = _places(fates, originals)
    known = place >= 0

    def of(column: Ints, otherwise: int) -> Ints:
        found = np.full(len(place), otherwise, dtype=np.int64)
        found[known] = column[place[known]]
        return found

    left = of(originals.departure, NOWHERE)
    leaves_ns = np.where(known, of(originals.release_ns, 0), fates.release_ns)
    return Packets(key, fates, left, of(originals.queued_ns, 0), leaves_ns, late_ns(releases))


def _places(fates: Fates, left: Releases) -> NDArray[np.int64]:
    """Return the index of each packet in ``left``, (N,), `NOWHERE` without one. A restarted sender reuses numbers."""
    # one name per pair of number and instant, equal in both tables
    both = np.concatenate([_named(left.seq, left.offered_ns), _named(fates.seq, fates.offered_ns)])
    _, name = np.unique(both, axis=0, return_inverse=True)
    name = name.reshape(-1)
    place = np.full(len(both), NOWHERE, dtype=np.int64)
    place[name[: len(left.seq)]] = np.arange(len(left.seq))
    return np.asarray(place[name[len(left.seq) :]])


def _named(seq: Ints, offered_ns: Ints) -> NDArray[np.int64]:
    return np.stack([seq, offered_ns], axis=1)
