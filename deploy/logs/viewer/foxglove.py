"""Foxglove's protobuf messages, which viewers draw without configuration.

Coordinates are rounded to single precision (some 10 nm), which halves their size; the logs' own records are exact.
"""

import struct
from collections.abc import Mapping, Sequence
from math import sqrt
from typing import Any, Final, Literal

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap_protobuf.schema import build_file_descriptor_set

from tis.common.units import NS_PER_S

WORLD: Final = "world"
Level = Literal["INFO", "WARNING", "ERROR"]
Point = Sequence[float]

SCHEMAS: Final[Mapping[str, Any]] = {
    "pose": PoseInFrame,
    "path": PosesInFrame,
    "transforms": FrameTransforms,
    "scene": SceneUpdate,
    "log": Log,
    "image": CompressedImage,
    "video": CompressedVideo,
}
LEVEL: Final = (0.0, 0.0, 0.0, 1.0)
COLORS: Final = {"tool": (0.84, 0.37, 0.0), "hand": (0.48, 0.32, 0.58)}
"""Colours of the forces: red, green and blue, 0 to 1."""
_M_PER_N: Final = 0.005
_OPPOSITE: Final = 1e-9
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


def arrow(at_ns: int, name: str, position_m: Point, force_n: Point, color: Point) -> bytes:
    """Return a force as an arrow that begins at a place of the world, 5 mm for each N; none for no force."""
    update = SceneUpdate()
    entity = update.entities.add(frame_id=WORLD, id=name)
    _stamp(entity.timestamp, at_ns)
    x, y, z = force_n
    length = sqrt(x * x + y * y + z * z)
    if length > 0.0:
        one = entity.arrows.add()
        # from the x axis, along which an arrow points, by the shortest way; half a turn about z where it is opposite
        w = 1.0 + x / length
        turn = (0.0, -z / length, y / length, w) if w > _OPPOSITE else (0.0, 0.0, 1.0, 0.0)
        norm = sqrt(sum(value * value for value in turn))
        _place(one.pose, position_m, [value / norm for value in turn])
        one.shaft_length, one.head_length = 0.75 * _M_PER_N * length, 0.25 * _M_PER_N * length
        one.shaft_diameter, one.head_diameter = 0.001, 0.0025
        one.color.r, one.color.g, one.color.b = color
        one.color.a = 1.0
    return update.SerializeToString()


def picture(kind: str, at_ns: int, encoding: str, data: bytes) -> bytes:
    """Return a frame; ``kind`` is ``image`` or ``video``, ``encoding`` as Foxglove names it."""
    message = SCHEMAS[kind](frame_id="camera", format=encoding, data=data)
    _stamp(message.timestamp, at_ns)
    return bytes(message.SerializeToString())


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
