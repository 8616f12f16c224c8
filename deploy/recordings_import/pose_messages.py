"""Poses and joint states in messages: JSON of `tis`, JSON of others, and decoded messages of ROS. Pure."""

from collections.abc import Mapping
from typing import Any, Final

from tis.common.units import NS_PER_S
from tis.deploy.recordings_import.found import Kind

Pose = tuple[float, float, float, float, float, float, float, float]
"""x y z in m, quaternion x y z w, gripper in rad; NaN for an orientation or a gripper that the message lacks."""

POSE_TYPES: Final = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped")
JOINT_TYPES: Final = ("sensor_msgs/msg/JointState",)

_NAN: Final = float("nan")
_NO_TURN: Final = (_NAN, _NAN, _NAN, _NAN)


def kind_of_type(name: str) -> Kind | None:
    """Return what messages of a ROS type are imported as; ROS 1 names lack the ``/msg``."""
    full = name if "/msg/" in name else name.replace("/", "/msg/", 1)
    if full in POSE_TYPES:
        return "pose"
    return "joints" if full in JOINT_TYPES else None


def kind_of_json(value: object) -> Kind | None:
    """Return what a JSON message is imported as, by its fields."""
    if not isinstance(value, Mapping):
        return None
    try:
        pose_in_json(value, 0)
    except (LookupError, TypeError, ValueError):
        position = value.get("position")
        return "joints" if isinstance(position, list) and position else None
    return "pose"


def pose_in_json(value: Mapping[str, Any], log_ns: int) -> tuple[int, Pose, bool]:
    """Return instant, pose, and whether the message states its instant; else it is ``log_ns``.

    Read are `tis` poses (``sample_ns``, ``position_m``) and the JSON of PoseStamped, TransformStamped and Foxglove's
    PoseInFrame. Raises `LookupError`, `TypeError` or `ValueError` for anything else.
    """
    inner = value.get("pose", value.get("transform", value))
    place = inner.get("position_m", inner.get("position", inner.get("translation")))
    turn = inner.get("orientation", inner.get("rotation"))
    gripper = inner.get("gripper_rad")
    turned = _NO_TURN if turn is None else tuple(_number(turn[axis]) for axis in "xyzw")
    x, y, z = (_number(place[axis]) for axis in "xyz")
    qx, qy, qz, qw = turned
    t_ns, is_stamped = _stamp(value, log_ns)
    return t_ns, (x, y, z, qx, qy, qz, qw, _NAN if gripper is None else _number(gripper)), is_stamped


def jaw_in_json(value: Mapping[str, Any], log_ns: int) -> tuple[int, float, bool]:
    """Return instant, angle of the first joint, and whether the message states its instant; raises likewise."""
    t_ns, is_stamped = _stamp(value, log_ns)
    return t_ns, _number(value["position"][0]), is_stamped


def pose_in_ros(message: Any, log_ns: int) -> tuple[int, Pose, bool]:
    """Return what `pose_in_json` returns, of a decoded PoseStamped or TransformStamped."""
    if hasattr(message, "transform"):
        place, turn = message.transform.translation, message.transform.rotation
    else:
        place, turn = message.pose.position, message.pose.orientation
    t_ns, is_stamped = _ros_stamp(message, log_ns)
    return t_ns, (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w, _NAN), is_stamped


def jaw_in_ros(message: Any, log_ns: int) -> tuple[int, float, bool]:
    """Return what `jaw_in_json` returns, of a decoded JointState."""
    t_ns, is_stamped = _ros_stamp(message, log_ns)
    return t_ns, float(message.position[0]), is_stamped


def _ros_stamp(message: Any, log_ns: int) -> tuple[int, bool]:
    stamp = message.header.stamp
    t_ns = int(stamp.sec) * NS_PER_S + int(stamp.nanosec)
    return (t_ns, True) if t_ns else (log_ns, False)  # a stamp of 0 was not set


def _stamp(value: Mapping[str, Any], log_ns: int) -> tuple[int, bool]:
    if "sample_ns" in value:
        return _whole(value["sample_ns"]), True
    header = value.get("header")
    stamp = header.get("stamp") if isinstance(header, Mapping) else value.get("timestamp")
    if not isinstance(stamp, Mapping):
        return log_ns, False
    t_ns = _whole(stamp["sec"]) * NS_PER_S + _whole(stamp.get("nanosec", stamp.get("nsec", 0)))
    return (t_ns, True) if t_ns else (log_ns, False)


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError("no number")
    return float(value)


def _whole(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError("no integer")
    return value
