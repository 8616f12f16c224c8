"""Selection of the records that are drawn, and of their form."""

from base64 import b64decode
from collections.abc import Iterator, Mapping
from typing import Final

from tis.common.channels import Side
from tis.common.clocks import SHARED
from tis.common.records import CONTROL, ESTIMATES, ESTIMATOR_FAULTS, FRESH, ORIENTATIONS, REJECTED, TICKS, TRUTH
from tis.common.sight_records import PICTURES
from tis.deploy.logs.payloads import UNREADABLE, json_row, other_version
from tis.deploy.logs.read.clocks import Clocks
from tis.deploy.logs.viewer import foxglove
from tis.deploy.logs.viewer.draw_forces import ForceStream, Places
from tis.deploy.logs.viewer.draw_metrics import (
    AgeStream,
    DelayStream,
    Freshest,
    LineStream,
    control_line,
    fault_line,
    rejected_line,
)
from tis.deploy.logs.viewer.draw_poses import (
    EstimateStream,
    OrientationStream,
    PoseStream,
    ScoredStream,
    Truth,
    Turns,
)
from tis.deploy.logs.viewer.drawn import (
    CAMERA_VIDEO,
    MTM,
    NO_RECORDS,
    PLANT_ARM,
    PSM,
    SET_POINT,
    Drawn,
    Records,
    RunTopics,
    Stream,
)


class PictureStream:
    """Draws the frames of a camera."""

    def take(self, records: Records) -> Iterator[Drawn]:
        """Yield each frame as an image or as video."""
        for at_ns, payload in zip(records.log_ns.tolist(), records.payloads, strict=True):
            row = json_row(payload)
            kind = "image" if row["format"] == "jpeg" else "video"
            yield Drawn(
                CAMERA_VIDEO, kind, at_ns, foxglove.picture(kind, at_ns, row["format"], b64decode(row["data"]))
            )


_FIRST: Final = (TRUTH, FRESH)
_MAX_REJECTED: Final = 20


class Scene:
    """The streams of a run, created at their first records."""

    def __init__(self, topics: RunTopics, clocks: Clocks) -> None:
        self._topics, self._clocks = topics, clocks
        self._truth, self._turns = Truth(topics), Turns()
        self._places = {row.hand: Places() for row in topics.channels}
        self._freshest = Freshest(topics, clocks.get("surgeon", SHARED))
        self._streams: dict[tuple[Side, str], Stream | None] = {}

    def take(self, records: Mapping[tuple[Side, str], Records]) -> Iterator[Drawn]:
        """Take the next records by side and topic, and yield messages for them."""
        # errors need truth, ages samples, estimates' poses orientations, and forces places, so those come first
        for name in sorted(records, key=lambda name: _order(name[1])):
            if name not in self._streams:
                self._streams[name] = self._stream(*name)
            stream = self._streams[name]
            if stream is not None:
                yield from _drawn(stream, name[1], records[name])
        for name, stream in self._streams.items():
            if isinstance(stream, ScoredStream) and name not in records:
                yield from stream.take(NO_RECORDS)  # truth for pending errors may have arrived

    def draws(self, side: Side, topic: str) -> bool:
        """Tell whether records of a side and topic are drawn."""
        name = (side, topic)
        if name not in self._streams:
            self._streams[name] = self._stream(side, topic)
        return self._streams[name] is not None

    def _stream(self, side: Side, topic: str) -> Stream | None:
        topics, prefix = self._topics, f"{ESTIMATES}/"
        if topic == REJECTED:
            return LineStream(side, rejected_line, _MAX_REJECTED)
        if (side, topic) == ("netem", CONTROL):
            return LineStream(side, control_line)
        if (side, topic) == ("patient", ESTIMATOR_FAULTS):
            return LineStream(side, fault_line)
        if (side, topic) == ("surgeon", TRUTH):
            return self._truth
        if side == "patient" and topic.startswith(prefix):
            return EstimateStream(topic.removeprefix(prefix), topics, self._truth, self._turns)
        if side == "patient" and _is_orientation(topic):
            method = topic.removeprefix(f"{ORIENTATIONS}/")
            turns = self._turns if method == topics.active_orientation else None
            return OrientationStream(method, topics, self._truth, turns)
        if (side, topic) == ("patient", PICTURES):
            return PictureStream()
        if (side, topic) == ("patient", FRESH):
            return self._freshest
        if (side, topic) == ("patient", TICKS):
            return AgeStream(topics, self._clocks.get("patient", SHARED), self._freshest)
        return self._of_key(side, topic)

    def _of_key(self, side: Side, key: str) -> Stream | None:
        topics = self._topics
        # received messages are drawn as delays, sent ones as poses
        for row in topics.channels:
            if (side, key) == ("patient", row.force.key(topics.session)):
                return ForceStream("tool", row.hand, topics, self._places[row.hand])
            if key == row.shown.key(topics.session):
                return ForceStream("hand", row.hand, topics)
            drawn_as = (
                (row.command, MTM), (row.arm, PSM), (row.estimated, ""), (row.measured, PLANT_ARM),
                (row.driven, SET_POINT), (row.force, ""), (row.motion, ""),
            )  # fmt: skip
            for channel, drawn in drawn_as:
                if channel.key(topics.session) != key:
                    continue
                sender = "surgeon" if channel.direction == "forward" else "patient"
                if side != sender and channel.direction is not None:
                    return DelayStream(key, channel.direction, topics.rate_hz)
                places = self._places[row.hand] if drawn == PLANT_ARM else None
                return PoseStream(topics.of_hand(drawn, row.hand), topics.rate_hz, places) if drawn else None
        return None


def _order(topic: str) -> tuple[bool, ...]:
    return topic not in _FIRST, not _is_orientation(topic), topic.endswith("_cf")


def _is_orientation(topic: str) -> bool:
    return topic.startswith(f"{ORIENTATIONS}/")


def _drawn(stream: Stream, topic: str, records: Records) -> Iterator[Drawn]:
    """Yield what a stream draws of records; raises `DataError` for records of another version."""
    try:
        yield from stream.take(records)
    except UNREADABLE:
        raise other_version(topic) from None
