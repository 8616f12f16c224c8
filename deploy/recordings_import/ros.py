"""Messages and bags of ROS, by the package rosbags."""

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from tis.common.errors import GET_ROSBAG, DataError, Fault, InputError
from tis.deploy.logs.payloads import UNREADABLE
from tis.deploy.recordings_import.choice import chosen, listing
from tis.deploy.recordings_import.found import Found, Rows, Topic, Wanted
from tis.deploy.recordings_import.gathered import streams_of
from tis.deploy.recordings_import.pose_messages import jaw_in_ros, kind_of_type, pose_in_ros

_POSE_WIDTH: Final = 8


def decoder(type_name: str) -> Callable[[bytes], Any]:
    """Return a function that decodes CDR of a type of ROS 2; it raises `ValueError` for what is none.

    Raises `InputError` without the package rosbags.
    """
    _check_rosbags()
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    full = type_name if "/msg/" in type_name else type_name.replace("/", "/msg/", 1)

    def decode(payload: bytes) -> Any:
        try:
            return store.deserialize_cdr(payload, full)
        except Exception as error:  # rosbags documents no closed set of errors for a damaged message
            raise ValueError("no message of this type") from error

    return decode


def read_bag(path: Path, wanted: Wanted) -> Found:
    """Return the poses of a rosbag2 (a folder with metadata.yaml; storage sqlite3 or mcap) or of a ROS 1 bag.

    Raises `InputError` without the package rosbags, `DataError` for a damaged bag, and as `chosen` does. Oracle: bags
    that the tests write.
    """
    _check_rosbags()
    try:
        return _read(path, wanted)
    except (DataError, InputError):
        raise
    except Exception as error:  # rosbags documents no closed set of errors for a damaged bag
        text = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise DataError(Fault(str(path), "", f"cannot be read as a bag: {text}")) from None


def _read(path: Path, wanted: Wanted) -> Found:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        counts: dict[str, int] = {}
        types = {}
        for connection in reader.connections:
            counts[connection.topic] = counts.get(connection.topic, 0) + connection.msgcount
            types[connection.topic] = connection.msgtype
        topics = [Topic(name, types[name], n, kind_of_type(types[name])) for name, n in counts.items()]
        poses, jaws = chosen(topics, wanted, str(path))
        rows = {name: Rows(_POSE_WIDTH) for name in poses.values()} | {name: Rows(1) for name in jaws.values()}
        read = [connection for connection in reader.connections if connection.topic in rows]
        for connection, log_ns, data in reader.messages(read):
            into = rows[connection.topic]
            try:
                message = reader.deserialize(data, connection.msgtype)
                if into.width == 1:
                    t_ns, angle, is_stamped = jaw_in_ros(message, log_ns)
                    into.append(t_ns, (angle,))
                else:
                    t_ns, pose, is_stamped = pose_in_ros(message, log_ns)
                    into.append(t_ns, pose)
            except (*UNREADABLE, AssertionError):
                into.n_undecodable += 1
            else:
                into.n_unstamped += not is_stamped
    streams, angles, notes = streams_of(poses, jaws, rows, str(path), wanted.skips_unreadable)
    return Found(streams, angles, (*listing(topics, poses, jaws), *notes), {"kind": "rosbag"})


def _check_rosbags() -> None:
    if find_spec("rosbags") is None:
        raise InputError(Fault("tis import", "", f"messages of ROS need the package rosbags: {GET_ROSBAG}"))
