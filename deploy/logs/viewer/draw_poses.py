"""Poses, frames, paths and errors of the movement, and errors of orientation, for viewers."""

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tis.common.channels import Hand
from tis.common.metrics.tracking import angles_deg, error_vectors, orientation_at
from tis.common.runtime.chunk_writer import Ints
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.deploy.logs.payloads import json_row, json_rows
from tis.deploy.logs.viewer import foxglove
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
)

_MM_PER_M: Final = 1000.0
_PATH_STEP_NS: Final = 100 * NS_PER_MS
_PATH_EVERY_NS: Final = NS_PER_S
_PATH_POINTS: Final = 50
_KEPT_NS: Final = 3 * NS_PER_S


class PoseStream:
    """A key's messages as poses of a topic, and its frame."""

    def __init__(self, topic: str, rate_hz: int) -> None:
        self._topic = topic
        self._pick, self._frames = EveryNth(rate_hz), EveryNth(min(rate_hz, DRAWN_HZ), max_hz=FRAMES_HZ)

    def take(self, records: Records) -> Iterator[Drawn]:
        """Draw the next messages."""
        chosen = self._pick.of(len(records.payloads))
        framed = set(self._frames.of(len(chosen)).tolist())
        for n, i in enumerate(chosen.tolist()):
            pose, at_ns = json_row(records.payloads[i]), int(records.log_ns[i])
            place = (_xyz(pose["position_m"]), tuple(pose["orientation"][axis] for axis in "xyzw"))
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
            turn = (np.nan,) * 3 if turned_rad is None else _xyz(turned_rad)
            rows[row["hand"]].append((at_ns, _xyz(row["position_m"]), turn))
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


class Orientations(Protocol):
    """The orientations that the answers carried."""

    def at(self, hand: Hand, at_ns: int) -> tuple[float, ...] | None:
        """Return the orientation x, y, z, w of an answer; None where it is not known."""
        ...


class EstimateStream:
    """One estimator's estimates as poses, a path, and errors as soon as truth is known.

    All are drawn with the orientation that the answer of the same instant carried.
    """

    def __init__(self, name: str, topics: RunTopics, truth: Truth, turns: Orientations | None = None) -> None:
        self._name, self._topics, self._truth, self._turns = name, topics, truth, turns
        self._pick = EveryNth(topics.rate_hz, len(topics.hands))
        self._paths = {hand: Path(topics.of_hand(f"{PATH}/{name}", hand)) for hand in topics.hands}
        self._waiting: dict[Hand, list[tuple[int, tuple[float, ...]]]] = defaultdict(list)

    def take(self, records: Records) -> Iterator[Drawn]:
        """Draw the next estimates, without missing ones."""
        new: dict[Hand, list[tuple[int, tuple[float, ...]]]] = defaultdict(list)
        for i in self._pick.of(len(records.payloads)).tolist():
            row: Mapping[str, Any] = json_row(records.payloads[i])
            if row["position_m"] is None:
                continue
            hand, at_ns, where = row["hand"], int(records.log_ns[i]), _xyz(row["position_m"])
            new[hand].append((at_ns, where))
            topic = self._topics.of_hand(f"{ESTIMATE}/{self._name}", hand)
            turn = None if self._turns is None else self._turns.at(hand, at_ns)
            yield Drawn(topic, "pose", at_ns, foxglove.pose(at_ns, where, foxglove.LEVEL if turn is None else turn))
        for hand, its in new.items():
            self._waiting[hand] += its
            at = np.array([at_ns for at_ns, _ in its], dtype=np.int64)
            yield from self._paths[hand].take(at, [where for _, where in its])
        for hand in self._topics.hands:
            yield from self._errors(hand)

    def _errors(self, hand: Hand) -> Iterable[Drawn]:
        known_ns, waiting = self._truth.known_until_ns(hand), self._waiting[hand]
        # truth is interpolated, so an error needs the sample after its instant
        ready = [entry for entry in waiting if entry[0] <= known_ns]
        if not ready:
            return
        self._waiting[hand] = waiting[len(ready) :]
        at_ns = np.array([at for at, _ in ready], dtype=np.int64)
        off_m = np.array([where for _, where in ready]) - self._truth.at(hand, at_ns)
        error_mm = _MM_PER_M * np.linalg.norm(off_m, axis=1)
        topic, known = self._topics.of_hand(f"{ERROR}/{self._name}", hand), np.isfinite(error_mm)
        for at, off_mm in zip(at_ns[known].tolist(), error_mm[known].tolist(), strict=True):
            sample = ErrorSample(error_mm=round(off_mm, 4))
            yield Drawn(topic, ErrorSample, at, sample.model_dump_json().encode())


def _xyz(point: Mapping[str, float]) -> tuple[float, float, float]:
    return point["x"], point["y"], point["z"]


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
