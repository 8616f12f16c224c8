"""Foxglove's protobuf messages, which viewers draw without configuration.

Coordinates are rounded to single precision (some 10 nm), which halves their size; the logs' own records are exact.
"""

import struct
from collections.abc import Mapping, Sequence
from typing import Any, Final, Literal

from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from mcap_protobuf.schema import build_file_descriptor_set

from tis.common.units import NS_PER_S

WORLD: Final = "world"
Level = Literal["INFO", "WARNING", "ERROR"]
Point = Sequence[float]

SCHEMAS: Final[Mapping[str, Any]] = {
    "pose": PoseInFrame,
    "path": PosesInFrame,
    "transforms": FrameTransforms,
    "log": Log,
}
LEVEL: Final = (0.0, 0.0, 0.0, 1.0)
_SINGLE: Final = struct.Struct("<7f")


def schema(kind: str) -> tuple[str, bytes]:
    """Return the name of a message type in `SCHEMAS` and its descriptors, as MCAP stores protobuf schemas."""
    message = SCHEMAS[kind]
    return message.DESCRIPTOR.full_name, build_file_descriptor_set(message).SerializeToString()


def pose(at_ns: int, position_m: Point, orientation: Point = LEVEL) -> bytes:
    """Return a pose in the world; ``orientation`` is x, y, z, w."""
    message = PoseInFrame(frame_id=WORLD)
    _stamp(message.timestamp, at_ns)
    _place(message.pose, position_m, orientation)
    return message.SerializeToString()


def path(at_ns: int, positions_m: Sequence[Point]) -> bytes:
    """Return a path in the world, the oldest point first."""
    message = PosesInFrame(frame_id=WORLD)
    _stamp(message.timestamp, at_ns)
    for position_m in positions_m:
        _place(message.poses.add(), position_m, LEVEL)
    return message.SerializeToString()


def transform(at_ns: int, frame: str, position_m: Point, orientation: Point = LEVEL) -> bytes:
    """Return the transform of a frame in the world."""
    message = FrameTransforms()
    one = message.transforms.add(parent_frame_id=WORLD, child_frame_id=frame)
    _stamp(one.timestamp, at_ns)
    where, turn = one.translation, one.rotation
    where.x, where.y, where.z, turn.x, turn.y, turn.z, turn.w = _single(position_m, orientation)
    return message.SerializeToString()


def log_line(at_ns: int, level: Level, name: str, text: str) -> bytes:
    """Return a log line; ``name`` is its source."""
    message = Log(level=Log.Level.Value(level), name=name, message=text)
    _stamp(message.timestamp, at_ns)
    return message.SerializeToString()


def _stamp(timestamp: Any, at_ns: int) -> None:
    timestamp.seconds, timestamp.nanos = divmod(at_ns, NS_PER_S)


def _place(pose: Any, position_m: Point, orientation: Point) -> None:
    where, turn = pose.position, pose.orientation
    where.x, where.y, where.z, turn.x, turn.y, turn.z, turn.w = _single(position_m, orientation)


def _single(position_m: Point, orientation: Point) -> tuple[float, ...]:
    return _SINGLE.unpack(_SINGLE.pack(*position_m, *orientation))
