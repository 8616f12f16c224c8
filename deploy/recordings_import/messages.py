"""Poses and joint states in messages: JSON of `tis`, JSON of others, and messages of ROS, by the package rosbags."""

from collections.abc import Callable, Mapping
from importlib.util import find_spec
from typing import Any, Final, Literal

from tis.common.errors import Fault, InputError
from tis.common.extras import GET_ROSBAG
from tis.common.units import NS_PER_S

Kind = Literal["pose", "joints", "wrench"]
Read = tuple[int, tuple[float, ...], bool]
"""Instant in ns, numbers, and whether the message states its instant; else it is that of the recorder.

The numbers of a pose are x y z in m, a quaternion x y z w and the gripper in rad, NaN for an orientation or a gripper
that the message lacks; of joints the first angle in rad; of a wrench force x y z in N and torque x y z in N m.
"""

POSE_TYPES: Final = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Odometry",
)
"""Messages of one pose. That of Odometry is in the frame of its header; its twist, which is not read, in the child's.

Frames like map, odom and base_link: REP-105, https://www.ros.org/reps/rep-0105.html.
"""
TF_TYPES: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
"""Messages of many transforms: each pair of frames is a topic of its own, like /tf:odom:base_link."""
JOINT_TYPES: Final = ("sensor_msgs/msg/JointState",)
WRENCH_TYPES: Final = ("geometry_msgs/msg/WrenchStamped",)
"""Messages of a force and a torque, as CRTK's measured_cf."""

_NAN: Final = float("nan")
_NO_TURN: Final = (_NAN, _NAN, _NAN, _NAN)


def kind_of_type(name: str) -> Kind | None:
    """Return what messages of a ROS type are imported as; ROS 1 names lack the ``/msg``."""
    full = _full(name)
    if full in POSE_TYPES:
        return "pose"
    if full in WRENCH_TYPES:
        return "wrench"
    return "joints" if full in JOINT_TYPES else None


def holds_frames(name: str) -> bool:
    """Tell whether messages of a ROS type hold transforms of pairs of frames."""
    return _full(name) in TF_TYPES


def _full(name: str) -> str:
    return name if "/msg/" in name else name.replace("/", "/msg/", 1)


def pairs_in(topic: str, message: Any) -> dict[str, list[Any]]:
    """Return the transforms of a decoded message of TF by the topic of their pair: topic, parent and child."""
    found: dict[str, list[Any]] = {}
    for one in message.transforms:
        pair = f"{topic}:{one.header.frame_id.lstrip('/')}:{one.child_frame_id.lstrip('/')}"
        found.setdefault(pair, []).append(one)
    return found


def kind_of_json(value: object) -> Kind | None:
    """Return what a JSON message is imported as, by its fields."""
    if not isinstance(value, Mapping):
        return None
    try:
        in_json(value, 0, is_pose=True)
    except (LookupError, TypeError, ValueError):
        position = value.get("position")
        return "joints" if isinstance(position, list) and position else None
    return "pose"


def in_json(value: Mapping[str, Any], log_ns: int, is_pose: bool) -> Read:
    """Return what a JSON message holds.

    Read are `tis` poses (``sample_ns``, ``position_m``) and the JSON of `POSE_TYPES`, of Foxglove's PoseInFrame, and
    of JointState. Raises one of `tis.deploy.logs.payloads.UNREADABLE` for anything else.
    """
    if not is_pose:
        t_ns, is_stamped = _stamp(value, log_ns)
        return t_ns, (_number(value["position"][0]),), is_stamped
    inner = value.get("pose", value.get("transform", value))
    inner = inner.get("pose", inner)
    place = inner.get("position_m", inner.get("position", inner.get("translation")))
    turn = inner.get("orientation", inner.get("rotation"))
    gripper = inner.get("gripper_rad")
    turned = _NO_TURN if turn is None else tuple(_number(turn[axis]) for axis in "xyzw")
    placed = tuple(_number(place[axis]) for axis in "xyz")
    t_ns, is_stamped = _stamp(value, log_ns)
    return t_ns, (*placed, *turned, _NAN if gripper is None else _number(gripper)), is_stamped


def in_ros(message: Any, log_ns: int, is_pose: bool) -> Read:
    """Return what a decoded message of `POSE_TYPES`, a JointState or a WrenchStamped holds; raises as `in_json`."""
    stamp = message.header.stamp
    t_ns = int(stamp.sec) * NS_PER_S + int(stamp.nanosec)
    at_ns = t_ns or log_ns  # a stamp of 0 was not set
    if not is_pose and hasattr(message, "wrench"):
        force, torque = message.wrench.force, message.wrench.torque
        return at_ns, (force.x, force.y, force.z, torque.x, torque.y, torque.z), bool(t_ns)
    if not is_pose:
        return at_ns, (float(message.position[0]),), bool(t_ns)
    if hasattr(message, "transform"):
        place, turn = message.transform.translation, message.transform.rotation
    else:
        pose = getattr(message.pose, "pose", message.pose)  # beside a covariance
        place, turn = pose.position, pose.orientation
    return at_ns, (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w, _NAN), bool(t_ns)


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


def decoder(type_name: str) -> Callable[[bytes], Any]:
    """Return a function that decodes CDR of a type of ROS 2; it raises `ValueError` for what is none.

    Raises `InputError` without the package rosbags.
    """
    check_rosbags()
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    full = _full(type_name)

    def decode(payload: bytes) -> Any:
        try:
            return store.deserialize_cdr(payload, full)
        except Exception as error:  # rosbags documents no closed set of errors for a damaged message
            raise ValueError("no message of this type") from error

    return decode


def check_rosbags() -> None:
    """Raise `InputError` without the package rosbags."""
    if find_spec("rosbags") is None:
        raise InputError(Fault("tis import", "", f"messages of ROS need the package rosbags: {GET_ROSBAG}"))
