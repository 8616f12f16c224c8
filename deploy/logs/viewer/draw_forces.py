"""Forces of touch for viewers: an arrow at the tool and at the hand, and their sizes for plots."""

from bisect import bisect_right
from collections import deque
from collections.abc import Iterator
from math import sqrt
from typing import Final

from tis.common.channels import Hand
from tis.common.messages import Vector3, encode
from tis.common.units import NS_PER_S
from tis.deploy.logs.payloads import json_row
from tis.deploy.logs.viewer import foxglove
from tis.deploy.logs.viewer.drawn import FORCE, FORCE_SIZE, Drawn, EveryNth, ForceSample, Records, RunTopics, xyz

_KEPT: Final = 4000
_OLD_NS: Final = NS_PER_S
"""Age of an arm's place beyond which no force is drawn at it."""


class Places:
    """The newest places of one arm, by the instants of their records."""

    def __init__(self) -> None:
        self._at_ns: deque[int] = deque(maxlen=_KEPT)
        self._places: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)

    def note(self, at_ns: int, place_m: tuple[float, float, float]) -> None:
        """Keep a place; instants do not go back."""
        self._at_ns.append(at_ns)
        self._places.append(place_m)

    def at(self, at_ns: int) -> tuple[float, float, float] | None:
        """Return the last place up to an instant; None without one within `_OLD_NS`."""
        k = bisect_right(self._at_ns, at_ns) - 1
        return self._places[k] if k >= 0 and at_ns - self._at_ns[k] <= _OLD_NS else None


class ForceStream:
    """The forces on one tool (``where``: tool), at its arm's ``places``, or on one hand, which tells its place."""

    def __init__(self, where: str, hand: Hand, topics: RunTopics, places: Places | None = None) -> None:
        self._id = f"{where}/{hand}"
        self._arrows, self._sizes = (topics.of_hand(f"{topic}/{where}", hand) for topic in (FORCE, FORCE_SIZE))
        self._pick, self._places, self._color = EveryNth(topics.rate_hz), places, foxglove.COLORS[where]

    def take(self, records: Records) -> Iterator[Drawn]:
        """Draw the next forces."""
        for i in self._pick.of(len(records.payloads)).tolist():
            row, at_ns = json_row(records.payloads[i]), int(records.log_ns[i])
            x, y, z = force_n = xyz(row["force_n"])
            size = sqrt(x * x + y * y + z * z)
            sample = ForceSample(size_n=size, force_n=Vector3(x=x, y=y, z=z))
            yield Drawn(self._sizes, ForceSample, at_ns, encode(sample))
            place = xyz(row["position_m"]) if self._places is None else self._places.at(at_ns)
            if place is not None:
                yield Drawn(
                    self._arrows, "scene", at_ns, foxglove.arrow(at_ns, self._id, place, force_n, self._color)
                )
