"""The emergency stops in force, each until a release that names it: whoever else has stopped stays heard."""

import hmac
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from tis.common.safety_records import StopsInForceNote
from tis.common.stop_messages import LATCH, MAX_IN_FORCE, ReleaseRule, StopRefusal, lock_of

_N_ENDED: Final = 1000
_FIRST_GIVEN: Final = 1 << 52
"""First number that the patient gives to a stop; each is given once, also after a new start."""
_N_NOTED: Final = 8
"""Stops of which a note holds number and lock: with them it fits into a slot of the arm's memory."""
NOBODYS: Final = "0" * 64
"""Lock of stops that are in force as one: no secret of theirs opens it."""
TOO_MANY: Final = f"more than {MAX_IN_FORCE} stops at once"
BEFORE: Final = "from before the patient's new start"


class Stop(NamedTuple):
    """A stop in force: the number that its request had, its lock and its reason."""

    asked: int
    lock: str
    reason: str

    def is_same(self, other: "Stop | None") -> bool:
        """Tell whether both are one request, sent more than once."""
        return other is not None and (self.asked, self.lock) == (other.asked, other.lock)


class Added(NamedTuple):
    """The number under which a stop is in force; 0: it ended before. ``is_new``: it was not in force before."""

    under: int
    is_new: bool


@dataclass
class StopsInForce:
    """At most `MAX_IN_FORCE` stops by number, the oldest first, and one more for all beyond.

    Oracle: test_stops_in_force, a set of numbers.
    """

    by_number: dict[int, Stop] = field(default_factory=dict)
    _ended: dict[int, Stop] = field(default_factory=dict)
    _joint: int = 0
    _n_given: int = 0

    def add(self, stop: Stop) -> Added:
        """Put a stop in force, if it is not yet; one that has ended stays ended, as its repeats come late.

        It keeps its number where that is one and free, and is given one otherwise.
        """
        if stop.asked:
            if stop.is_same(self._ended.get(stop.asked)):
                return Added(0, is_new=False)
            if stop.is_same(self.by_number.get(stop.asked)):
                return Added(stop.asked, is_new=False)
        for number, one in self.by_number.items():
            if stop.is_same(one):
                return Added(number, is_new=False)
        if len(self.by_number) - (self._joint > 0) < MAX_IN_FORCE:
            number = stop.asked if stop.asked != LATCH and self._is_free(stop.asked) else self._given()
            self.by_number[number] = stop
            return Added(number, is_new=True)
        if self._joint:
            return Added(self._joint, is_new=False)
        return Added(self._join(TOO_MANY), is_new=True)

    def is_by_stopper(self, number: int, secret: str) -> bool | None:
        """Tell whether a secret is that of a stop in force; None where the stop has none."""
        lock = self.by_number[number].lock
        return hmac.compare_digest(lock_of(secret), lock) if lock else None

    def is_joint(self, number: int) -> bool:
        """Tell whether a number is that of all stops beyond `MAX_IN_FORCE`."""
        return number > 0 and number == self._joint

    def refusal(self, number: int, secret: str, rule: ReleaseRule) -> StopRefusal:
        """Return why a release does not end the stop that it names; "" where it does.

        With ``stopper`` it needs the stop's secret; a stop without a lock is ended by whoever names it.
        """
        if number not in self.by_number:
            return "no such stop in force"
        return "wrong secret" if rule == "stopper" and self.is_by_stopper(number, secret) is False else ""

    def end(self, number: int) -> None:
        """End the stop of this number; the last `_N_ENDED` are known as ended."""
        self._ended[number] = self.by_number.pop(number)
        if number == self._joint:
            self._joint = 0
        if len(self._ended) > _N_ENDED:
            del self._ended[next(iter(self._ended))]

    def note(self, at_ns: int) -> StopsInForceNote:
        """Return what a patient that is started anew needs; inverse: `resume`."""
        own = [(number, stop.lock) for number, stop in self.by_number.items() if number != self._joint]
        newest = own[-_N_NOTED:]
        stops = " ".join(f"{number}:{lock}" for number, lock in newest)
        others = len(self.by_number) - len(newest)
        return StopsInForceNote(at_ns=at_ns, stops=stops, others=others, given=self._n_given)

    def resume(self, note: StopsInForceNote) -> None:
        """Put the stops of a note in force, and those that it does not name as one. Raises `ValueError`."""
        self._n_given = note.given
        for text in note.stops.split():
            number, lock = text.split(":")
            self.by_number[int(number)] = Stop(int(number), lock, BEFORE)
        if note.others:
            self._join(BEFORE)

    def _join(self, reason: str) -> int:
        self._joint = number = self._given()
        self.by_number[number] = Stop(0, NOBODYS, reason)
        return number

    def _is_free(self, number: int) -> bool:
        return number > 0 and number not in self.by_number and number not in self._ended

    def _given(self) -> int:
        self._n_given += 1
        return _FIRST_GIVEN + self._n_given
