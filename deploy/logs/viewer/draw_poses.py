"""Poses, frames, paths and errors of the movement, and errors of orientation, for viewers."""

from abc import ABC, abstractmethod
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tis.common.channels import Hand
from tis.common.messages import Message, encode
from tis.common.metrics.tracking import angles_deg, error_vectors, orientation_at
from tis.common.runtime.chunk_writer import Ints
from tis.common.units import MM_PER_M, NS_PER_MS, NS_PER_S
from tis.deploy.logs.payloads import json_row, json_rows
from tis.deploy.logs.viewer import foxglove
from tis.deploy.logs.viewer.draw_forces import Places
from tis.deploy.logs.viewer.drawn import (
    DRAWN_HZ,
    ERROR,
    ESTIMATE,
    FRAMES_HZ,
    PATH,
    TRANSFORMS,
    TRUTH_NAME,
    TURN_ERROR,
    Drawn,
    ErrorSample,
    EveryNth,
    Records,
    RunTopics,
    TurnErrorSample,
    xyz,
)

_PATH_STEP_NS: Final = 100 * NS_PER_MS
_PATH_EVERY_NS: Final = NS_PER_S
_PATH_POINTS: Final = 50
_KEPT_NS: Final = 3 * NS_PER_S
_KEPT: Final = 1000

Numbers = tuple[float, ...]


class PoseStream:
    """A key's messages as poses of a topic, and its frame; ``places`` keep where it was."""

    def __init__(self, topic: str, rate_hz: int, places: Places | None = None) -> None:
        self._topic, self._places = topic, places
        self._pick, self._frames = EveryNth(rate_hz), EveryNth(min(rate_hz, DRAWN_HZ), max_hz=FRAMES_HZ)

    def take(self, records: Records) -> Iterator[Drawn]:
        """Draw the next messages."""
        chosen = self._pick.of(len(records.payloads))
        framed = set(self._frames.of(len(chosen)).tolist())
        for n, i in enumerate(chosen.tolist()):
            pose, at_ns = json_row(records.payloads[i]), int(records.log_ns[i])
            place = (xyz(pose["position_m"]), tuple(pose["orientation"][axis] for axis in "xyzw"))
            if self._places is not None:
                self._places.note(at_ns, place[0])
            yield Drawn(self._topic, "pose", at_ns, foxglove.pose(at_ns, *place))
            if n in framed:
                frame = self._topic.strip("/")
                yield Drawn(TRANSFORMS, "transforms", at_ns, foxglove.transform(at_ns, frame, *place))


class Path:
    """The last 5 s of a movement on a 0.1 s grid, once a second."""

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._points: deque[Sequence[float]] = deque(maxlen=_PATH_POINTS)
        self._step, self._second = -1, 0

    def take(self, at_ns: Ints, position_m: Sequence[Sequence[float]]) -> Iterator[Drawn]:
        """Take the next points, (N,) and (N, 3), in order of time."""
        step = at_ns // _PATH_STEP_NS
        # the first point of each new grid step; points may repeat a step or come late
        highest = np.maximum.accumulate(np.append(self._step, step))
        for i in np.flatnonzero(step > highest[:-1]).tolist():  # a new second begins with a new step
            now_ns = int(at_ns[i])
            self._points.append(position_m[i])
            if now_ns // _PATH_EVERY_NS > self._second:
                self._second = now_ns // _PATH_EVERY_NS
                yield Drawn(self._topic, "path", now_ns, foxglove.path(now_ns, self._points))
        self._step = int(highest[-1])


class Truth:
    """The recent truth of each hand's arm, up to the last record taken."""

    def __init__(self, topics: RunTopics) -> None:
        self._at: dict[Hand, tuple[Ints, NDArray[np.float64]]] = {
            hand: (np.empty(0, dtype=np.int64), np.empty((0, 3))) for hand in topics.hands
        }
        self._turned: dict[Hand, NDArray[np.float64]] = {hand: np.empty((0, 3)) for hand in topics.hands}
        self._paths = {hand: Path(topics.of_hand(f"{PATH}/{TRUTH_NAME}", hand)) for hand in topics.hands}

    def take(self, records: Records) -> Iterator[Drawn]:
        """Take the next truth rows, whose log times are their sample instants."""
        rows: dict[Hand, list[tuple[int, tuple[float, ...], tuple[float, ...]]]] = defaultdict(list)
        joined = [row for rows in json_rows(records.payloads) for row in rows]
        for at_ns, row in zip(records.log_ns.tolist(), joined, strict=True):
            turned_rad = row.get("rotation_rad")
            turn = (np.nan,) * 3 if turned_rad is None else xyz(turned_rad)
            rows[row["hand"]].append((at_ns, xyz(row["position_m"]), turn))
        for hand, its_rows in rows.items():
            at_ns, position_m = self._at[hand]
            new_ns = np.array([at for at, _, _ in its_rows], dtype=np.int64)
            new_m = [where for _, where, _ in its_rows]
            # always keep the last point before the new ones: estimates between them may be pending
            keep = max(min(int(np.searchsorted(at_ns, new_ns[0] - _KEPT_NS)), len(at_ns) - 1), 0)
            self._at[hand] = (
                np.concatenate([at_ns[keep:], new_ns]),
                np.concatenate([position_m[keep:], np.array(new_m)]),
            )
            new_rad = np.array([turn for _, _, turn in its_rows])
            self._turned[hand] = np.concatenate([self._turned[hand][keep:], new_rad])
            yield from self._paths[hand].take(new_ns, new_m)

    def turned_at(self, hand: Hand, at_ns: Ints) -> NDArray[np.float64]:
        """Return the orientation (N, 4) at instants (N,), at constant speed between samples, NaN where unknown."""
        known_ns, turned_rad = self._at[hand][0], self._turned[hand]
        if not np.isfinite(turned_rad).all():
            return np.full((len(at_ns), 4), np.nan)
        return orientation_at(at_ns, known_ns, Rotation.from_rotvec(turned_rad).as_quat())

    def known_until_ns(self, hand: Hand) -> int:
        """Return the last instant with known truth, -1 before any."""
        at_ns, _ = self._at[hand]
        return int(at_ns[-1]) if len(at_ns) else -1

    def at(self, hand: Hand, at_ns: Ints) -> NDArray[np.float64]:
        """Return the interpolated truth (N, 3) in m at instants (N,), NaN where it is no longer kept."""
        known_ns, known_m = self._at[hand]
        columns = [np.interp(at_ns, known_ns, known_m[:, axis], left=np.nan) for axis in range(3)]
        return np.stack(columns, axis=-1)


class Turns:
    """The recent orientations x, y, z, w that the answers carried, by hand and instant."""

    def __init__(self) -> None:
        self._at: dict[Hand, dict[int, Numbers]] = defaultdict(dict)
        self._order: dict[Hand, deque[int]] = defaultdict(deque)

    def note(self, hand: Hand, at_ns: int, turn: Numbers) -> None:
        """Keep an orientation; the oldest one is dropped."""
        if at_ns not in self._at[hand]:
            self._order[hand].append(at_ns)
        self._at[hand][at_ns] = turn
        if len(self._order[hand]) > _KEPT:
            del self._at[hand][self._order[hand].popleft()]

    def at(self, hand: Hand, at_ns: int) -> Numbers:
        """Return the orientation of an answer; level where it is not known."""
        return self._at[hand].get(at_ns, foxglove.LEVEL)


class ScoredStream(ABC):
    """One method's estimates, which wait for truth to be drawn as errors: it is interpolated between samples."""

    _field: str
    _axes: str

    def __init__(self, name: str, topics: RunTopics, truth: Truth) -> None:
        self._name, self._topics, self._truth = name, topics, truth
        self._pick = EveryNth(topics.rate_hz, len(topics.hands))
        self._waiting: dict[Hand, list[tuple[int, Numbers]]] = defaultdict(list)

    def take(self, records: Records) -> Iterator[Drawn]:
        """Draw the next estimates, without missing ones, and the errors that are known by now."""
        new: dict[Hand, list[tuple[int, Numbers]]] = defaultdict(list)
        for i in self._pick.of(len(records.payloads)).tolist():
            row: Mapping[str, Any] = json_row(records.payloads[i])
            if row[self._field] is None:
                continue
            hand, at_ns = row["hand"], int(records.log_ns[i])
            numbers = tuple(row[self._field][axis] for axis in self._axes)
            new[hand].append((at_ns, numbers))
            yield from self._drawn(hand, at_ns, numbers)
        for hand, its in new.items():
            self._waiting[hand] += its
            yield from self._path(hand, its)
        for hand in self._topics.hands:
            known_ns, waiting = self._truth.known_until_ns(hand), self._waiting[hand]
            ready = [entry for entry in waiting if entry[0] <= known_ns]
            self._waiting[hand] = waiting[len(ready) :]
            if ready:
                at_ns_of = np.array([at_ns for at_ns, _ in ready], dtype=np.int64)
                yield from self._errors(hand, at_ns_of, np.array([numbers for _, numbers in ready]))

    @abstractmethod
    def _drawn(self, hand: Hand, at_ns: int, numbers: Numbers) -> Iterable[Drawn]:
        """Draw one estimate."""

    def _path(self, _: Hand, __: Sequence[tuple[int, Numbers]]) -> Iterable[Drawn]:
        """Draw the path of new estimates."""
        return ()

    @abstractmethod
    def _errors(self, hand: Hand, at_ns: Ints, estimates: NDArray[np.float64]) -> Iterable[Drawn]:
        """Draw the errors of estimates (N, axes) whose truth is known."""


class EstimateStream(ScoredStream):
    """One estimator's positions as poses, with the orientation of the answer of that instant, a path, and errors."""

    _field, _axes = "position_m", "xyz"

    def __init__(self, name: str, topics: RunTopics, truth: Truth, turns: Turns) -> None:
        super().__init__(name, topics, truth)
        self._turns = turns
        self._paths = {hand: Path(topics.of_hand(f"{PATH}/{name}", hand)) for hand in topics.hands}

    def _drawn(self, hand: Hand, at_ns: int, numbers: Numbers) -> Iterable[Drawn]:
        topic = self._topics.of_hand(f"{ESTIMATE}/{self._name}", hand)
        yield Drawn(topic, "pose", at_ns, foxglove.pose(at_ns, numbers, self._turns.at(hand, at_ns)))

    def _path(self, hand: Hand, its: Sequence[tuple[int, Numbers]]) -> Iterable[Drawn]:
        at_ns = np.array([at_ns for at_ns, _ in its], dtype=np.int64)
        return self._paths[hand].take(at_ns, [numbers for _, numbers in its])

    def _errors(self, hand: Hand, at_ns: Ints, estimates: NDArray[np.float64]) -> Iterable[Drawn]:
        error_mm = MM_PER_M * np.linalg.norm(estimates - self._truth.at(hand, at_ns), axis=1)
        topic = self._topics.of_hand(f"{ERROR}/{self._name}", hand)
        return _samples(topic, ErrorSample, "error_mm", at_ns, error_mm)


class OrientationStream(ScoredStream):
    """One orientation method's errors; ``turns`` keep the active one's orientations."""

    _field, _axes = "orientation", "xyzw"

    def __init__(self, name: str, topics: RunTopics, truth: Truth, turns: Turns | None) -> None:
        super().__init__(name, topics, truth)
        self._turns = turns

    def _drawn(self, hand: Hand, at_ns: int, numbers: Numbers) -> Iterable[Drawn]:
        if self._turns is not None:
            self._turns.note(hand, at_ns, numbers)
        return ()

    def _errors(self, hand: Hand, at_ns: Ints, estimates: NDArray[np.float64]) -> Iterable[Drawn]:
        error_deg = angles_deg(error_vectors(estimates, self._truth.turned_at(hand, at_ns)))
        topic = self._topics.of_hand(f"{TURN_ERROR}/{self._name}", hand)
        return _samples(topic, TurnErrorSample, "error_deg", at_ns, error_deg)


def _samples(
    topic: str, model: type[Message], field: str, at_ns: Ints, errors: NDArray[np.float64]
) -> Iterator[Drawn]:
    known = np.isfinite(errors)
    for at, error in zip(at_ns[known].tolist(), errors[known].tolist(), strict=True):
        yield Drawn(topic, model, at, encode(model(**{field: round(error, 4)})))
