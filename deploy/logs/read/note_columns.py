"""Notes of a side as columns; empty without a log."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Hand, Side
from tis.common.records import FRESH, PROMPT, TICKS
from tis.deploy.logs.read.load import Ints, RunLogs
from tis.deploy.logs.read.rows import Rows, column_model


def notes(logs: RunLogs, side: Side, topic: str) -> Rows:
    """Return a side's notes of a topic whose records are kept as columns (oracle: the tests of the readers)."""
    log = logs.sides.get(side)
    found = None if log is None else log.rows.get(topic)
    if isinstance(found, Rows):
        return found
    model = column_model(topic)
    assert model is not None, "only such topics are requested"
    return Rows(model)


class Ticks(NamedTuple):
    """The patient's ticks that were not missed, ascending: number, nominal instant and begin in ns, (T,)."""

    tick: Ints
    due_ns: Ints
    begin_ns: Ints

    def at(self, tick: Ints) -> tuple[Ints, NDArray[np.bool_]]:
        """Return the index of each ``tick`` (N,), and whether it exists (N,)."""
        return place_in(self.tick, tick)


def ticks(logs: RunLogs) -> Ticks:
    """Return the patient's ticks."""
    rows = notes(logs, "patient", TICKS)
    begun = ~rows.column("missed")
    order = np.argsort(rows.column("tick")[begun], kind="stable")
    return Ticks(*(rows.column(name)[begun][order] for name in Ticks._fields))


class FreshUses(NamedTuple):
    """One hand's packets at the first use of their sample by an estimate, (N,): at ticks first, then on arrival.

    ``key`` and ``seq`` identify the packet, ``begin_ns`` is the begin of the estimate, ``answer`` its number.
    """

    key: NDArray[np.str_]
    seq: Ints
    begin_ns: Ints
    answer: Ints


def first_uses(logs: RunLogs, hand: Hand) -> FreshUses:
    """Return the first uses at ticks and on arrival; a sample that was answered on arrival counts there only."""
    # answer is NaN where no estimate was made
    prompt, fresh = notes(logs, "patient", PROMPT), notes(logs, "patient", FRESH)
    made = prompt.where("hand", hand) & (prompt.column("answer") >= 0)
    at_once = FreshUses(*(prompt.column(name)[made] for name in FreshUses._fields))
    known = ticks(logs)
    place, begun = known.at(fresh.column("tick"))
    first = fresh.where("hand", hand) & begun
    # a sample answered on arrival is noted again at the next tick: not a first use there
    for key in np.unique(at_once.key):
        of_key = fresh.column("key") == key
        first &= ~(of_key & np.isin(fresh.column("seq"), at_once.seq[at_once.key == key]))
    number = fresh.column("answer")
    number = np.where(number >= 0, number, fresh.column("tick"))
    begin_ns = known.begin_ns[place[first]]
    at_ticks = FreshUses(fresh.column("key")[first], fresh.column("seq")[first], begin_ns, number[first])
    return FreshUses(*(np.concatenate(both) for both in zip(at_ticks, at_once, strict=True)))


def place_in(ascending: Ints, values: Ints) -> tuple[Ints, NDArray[np.bool_]]:
    """Return the index of each of ``values`` (N,) in ``ascending`` (M,), 0 if absent, and whether it exists (N,)."""
    place = np.searchsorted(ascending, values)
    found = place < len(ascending)
    found[found] = ascending[place[found]] == values[found]
    return np.where(found, place, 0), found
