"""Orientation errors for viewers, and the orientations with which estimates are drawn."""

from collections import defaultdict, deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from tis.common.channels import Hand
from tis.common.metrics.tracking import angles_deg, error_vectors
from tis.deploy.logs.json_rows import json_row
from tis.deploy.logs.topics import TURN_ERROR, RunTopics
from tis.deploy.logs.viewer.derived_records import TurnErrorSample
from tis.deploy.logs.viewer.draw_poses import Truth
from tis.deploy.logs.viewer.drawn import Drawn, EveryNth, Records

Turn = tuple[float, ...]
"""A quaternion x, y, z, w."""

_KEPT: Final = 1000


class Turns:
    """The recent orientations that the answers carried, by hand and instant."""

    def __init__(self) -> None:
        self._at: dict[Hand, dict[int, Turn]] = defaultdict(dict)
        self._order: dict[Hand, deque[int]] = defaultdict(deque)

    def note(self, hand: Hand, at_ns: int, turn: Turn) -> None:
        """Keep an orientation; the oldest one is dropped."""
        if at_ns not in self._at[hand]:
            self._order[hand].append(at_ns)
        self._at[hand][at_ns] = turn
        if len(self._order[hand]) > _KEPT:
            del self._at[hand][self._order[hand].popleft()]

    def at(self, hand: Hand, at_ns: int) -> Turn | None:
        """Return the orientation of an answer; None where it is not known."""
        return self._at[hand].get(at_ns)


class OrientationStream:
    """One orientation method's errors as soon as truth is known; ``turns`` keep the active one's orientations."""

    def __init__(self, name: str, topics: RunTopics, truth: Truth, turns: Turns | None) -> None:
        self._name, self._topics, self._truth, self._turns = name, topics, truth, turns
        self._pick = EveryNth(topics.rate_hz, len(topics.hands))
        self._waiting: dict[Hand, list[tuple[int, Turn]]] = defaultdict(list)

    def take(self, records: Records) -> Iterator[Drawn]:
        """Take the next estimates, without missing ones, and draw the errors that are known by now."""
        for i in self._pick.of(len(records.payloads)).tolist():
            row = json_row(records.payloads[i])
            if row["orientation"] is None:
                continue
            hand, at_ns, turn = row["hand"], int(records.log_ns[i]), _xyzw(row["orientation"])
            self._waiting[hand].append((at_ns, turn))
            if self._turns is not None:
                self._turns.note(hand, at_ns, turn)
        for hand in self._topics.hands:
            yield from self._errors(hand)

    def _errors(self, hand: Hand) -> Iterator[Drawn]:
        known_ns, waiting = self._truth.known_until_ns(hand), self._waiting[hand]
        ready = [entry for entry in waiting if entry[0] <= known_ns]
        if not ready:
            return
        self._waiting[hand] = waiting[len(ready) :]
        at_ns = np.array([at for at, _ in ready], dtype=np.int64)
        truth = self._truth.turned_at(hand, at_ns)
        error_deg = angles_deg(error_vectors(np.array([turn for _, turn in ready]), truth))
        topic = self._topics.of_hand(f"{TURN_ERROR}/{self._name}", hand)
        for at, off_deg in zip(at_ns.tolist(), error_deg.tolist(), strict=True):
            if off_deg == off_deg:
                sample = TurnErrorSample(error_deg=round(off_deg, 4))
                yield Drawn(topic, TurnErrorSample, at, sample.model_dump_json().encode())


def _xyzw(turn: dict[str, float]) -> Turn:
    return turn["x"], turn["y"], turn["z"], turn["w"]
