"""A side's notes of one topic as columns, none where there is no log of them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.channels import Hand, Side
from common.records import FRESH, PROMPT, TICKS
from deploy.logs.read.load import Ints, RunLogs
from deploy.logs.read.rows import Rows, column_model


def notes(logs: RunLogs, side: Side, topic: str) -> Rows:
    """Return a side's notes of a topic whose records are kept as columns (oracle: the readers' own tests)."""
    log = logs.sides.get(side)
    found = None if log is None else log.rows.get(topic)
    if isinstance(found, Rows):
        return found
    model = column_model(topic)
    assert model is not None, "only such topics are asked for"
    return Rows(model)


class Ticks(NamedTuple):
    """The patient's ticks that were not missed, ascending: number, nominal instant and beginning, (T,)."""

    tick: Ints
    due_ns: Ints
    begin_ns: Ints

    def at(self, tick: Ints) -> tuple[Ints, NDArray[np.bool_]]:
        """Return the place of each of ``tick`` (N,), and whether it is among them."""
        return place_in(self.tick, tick)


def ticks(logs: RunLogs) -> Ticks:
    """Return the patient's ticks."""
    rows = notes(logs, "patient", TICKS)
    begun = ~rows.column("missed")
    order = np.argsort(rows.column("tick")[begun], kind="stable")
    return Ticks(*(rows.column(name)[begun][order] for name in Ticks._fields))


class FreshUses(NamedTuple):
    """One hand's packets whose sample an estimate was the first to use: (N,), ticks first, in their order.

    ``key`` and ``seq`` name the packet, ``begin_ns`` is when that estimate was begun and ``answer`` its number.
    """

    key: NDArray[np.str_]
    seq: Ints
    begin_ns: Ints
    answer: Ints


def first_uses(logs: RunLogs, hand: Hand) -> FreshUses:
    """Return what ticks used first, and what was answered at its arrival already, each once."""
    prompt, fresh = notes(logs, "patient", PROMPT), notes(logs, "patient", FRESH)
    made = prompt.where("hand", hand) & (prompt.column("answer") >= 0)
    at_once = FreshUses(*(prompt.column(name)[made] for name in FreshUses._fields))
    known = ticks(logs)
    place, begun = known.at(fresh.column("tick"))
    first = fresh.where("hand", hand) & begun
    for key in np.unique(at_once.key):
        of_key = fresh.column("key") == key
        first &= ~(of_key & np.isin(fresh.column("seq"), at_once.seq[at_once.key == key]))
    number = fresh.column("answer")
    number = np.where(number >= 0, number, fresh.column("tick"))
    begin_ns = known.begin_ns[place[first]]
    at_ticks = FreshUses(fresh.column("key")[first], fresh.column("seq")[first], begin_ns, number[first])
    return FreshUses(*(np.concatenate(both) for both in zip(at_ticks, at_once, strict=True)))


def place_in(ascending: Ints, values: Ints) -> tuple[Ints, NDArray[np.bool_]]:
    """Return where each of ``values`` (N,) stands in ``ascending`` (M,), place 0 where it does not, and whether."""
    place = np.searchsorted(ascending, values)
    found = place < len(ascending)
    found[found] = ascending[place[found]] == values[found]
    return np.where(found, place, 0), found
