"""Safety states of the arms, as an observer hears them on the patient's network."""

from collections import deque
from itertools import pairwise
from typing import Final, NamedTuple

from msgspec import DecodeError

from tis.common.messages import SetPoint, decode
from tis.common.units import NS_PER_S

_MAX_CHANGES: Final = 100
_MAX_ARMS: Final = 8
_MAX_AHEAD_NS: Final = 10 * NS_PER_S


class Stretch(NamedTuple):
    """A stretch of one state; ``until_s`` is now for the last one."""

    mode: str
    from_s: float
    until_s: float


class SafetyStates:
    """The states of each arm over the last stretches, from its set points."""

    def __init__(self) -> None:
        self._changes: dict[str, deque[tuple[int, str]]] = {}
        self._now_ns: dict[str, int] = {}

    def take(self, arm: str, payload: bytes, now_ns: int) -> None:
        """Note a set point; what is none, a late one, and one far ahead of the run's time is ignored."""
        try:
            point = decode(payload, SetPoint)
        except DecodeError:
            return
        if arm not in self._changes and len(self._changes) >= _MAX_ARMS:
            return
        changes = self._changes.setdefault(arm, deque(maxlen=_MAX_CHANGES))
        if not self._now_ns.get(arm, -1) < point.sample_ns <= now_ns + _MAX_AHEAD_NS:
            return
        self._now_ns[arm] = point.sample_ns
        if not changes or changes[-1][1] != point.mode:
            changes.append((point.sample_ns, point.mode))

    def modes(self) -> dict[str, str]:
        """Return the newest state of each arm that had a set point."""
        return {arm: changes[-1][1] for arm, changes in self._changes.items() if changes}

    def mode(self, arm: str) -> str | None:
        """Return the newest state of an arm; None before its first set point."""
        return self.modes().get(arm)

    def stretches(self, window_s: float) -> dict[str, list[Stretch]]:
        """Return by arm the stretches of the last ``window_s``, the last one up to its newest set point."""
        found = {}
        for arm, changes in sorted(self._changes.items()):
            now_ns = self._now_ns[arm]
            begin_s = now_ns / NS_PER_S - window_s
            ends = [*changes, (now_ns, "")]
            each = (
                Stretch(mode, max(at_ns / NS_PER_S, begin_s), until_ns / NS_PER_S)
                for (at_ns, mode), (until_ns, _) in pairwise(ends)
            )
            kept = [one for one in each if one.until_s > begin_s]
            found[arm] = kept or [Stretch(changes[-1][1], now_ns / NS_PER_S, now_ns / NS_PER_S)]
        return found
