"""Foreign recordings that the tests write: LeRobot data sets, bags and MCAP files of one movement."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

Columns = Mapping[str, Any]

STORE: Final = get_typestore(Stores.ROS2_HUMBLE)
_PARTS: Final = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "gripper_rad")
_ACTION: Final = ("MTML", "MTMR")
_STATE: Final = ("PSM2", "PSM1")
_START_NS: Final = 1_763_990_000_000_000_000


def lerobot_set(folder: Path, columns: Columns, version: int, single: bool = False, episode: int = 1) -> Path:
    """Write a set of two episodes, the first of which is another movement; positions in m, angles in rad."""
    number = pa.float32() if single else pa.float64()
    tables = []
    for index in (0, episode):
        n = len(columns["time_s"])
        shift = 0.0 if index == episode else 1.0
        features: dict[str, Any] = {}
        for vector, devices in (("observation.state", _STATE), ("action", _ACTION)):
            there = [device for device in devices if f"{device}_x_m" in columns]
            rows = np.stack([columns[f"{device}_{part}"] + shift for device in there for part in _PARTS], axis=1)
            kind = pa.list_(number, rows.shape[1]) if version == 3 else pa.list_(number)
            features[vector] = pa.array(rows.tolist(), kind)
        frames = np.arange(n)
        about = {"frame_index": frames, "timestamp": pa.array(frames / 30, pa.float32())}
        tables.append(pa.table({**features, **about, "episode_index": np.full(n, index)}))
    chunk = folder / "data" / "chunk-000"
    chunk.mkdir(parents=True)
    if version == 2:
        for index, table in zip((0, episode), tables, strict=True):
            pq.write_table(table, chunk / f"episode_{index:06d}.parquet")
    else:
        pq.write_table(pa.concat_tables(tables), chunk / "file-000.parquet")
    sides = {"PSM2": "left", "PSM1": "right", "MTML": "left", "MTMR": "right"}
    named = {}
    for vector, devices in (("observation.state", _STATE), ("action", _ACTION)):
        there = [device for device in devices if f"{device}_x_m" in columns]
        parts = ("x", "y", "z", "qx", "qy", "qz", "qw", "gripper")
        named[vector] = [f"{sides[device]}_{part}" for device in there for part in parts]
    features = {
        vector: {"dtype": "float32", "shape": [len(names)], "names": {"axes": names} if version == 3 else names}
        for vector, names in named.items()
    }
    (folder / "meta").mkdir()
    info = {"codebase_version": "v3.0" if version == 3 else "v2.1", "fps": 30, "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    return folder


def open_h_set(folder: Path, n_rows: int = 60) -> Path:
    """Write an episode in the form of Open-H-Embodiment's dVRK sets: nested names, set points, forces with units."""
    t_s = np.arange(n_rows) / 30
    pose = [0.05 * np.sin(t_s), 0.04 * np.cos(t_s), 0.03 * np.sin(2 * t_s), *np.zeros((3, n_rows)), np.ones(n_rows)]
    measured = np.stack([*pose, np.full(n_rows, 0.4)] * 2, axis=1)
    planned = measured + np.array([0.001, 0, 0, 0, 0, 0, 0, 0] * 2)
    force = np.stack([np.full(n_rows, k + 1.0) for k in range(6)], axis=1)
    parts = [*(f"position.{axis}" for axis in "xyz"), *(f"orientation.{axis}" for axis in "xyzw")]
    arms = ("psm1", "psm2")
    named = {
        "observation.state": [name for arm in arms for name in (*(f"{arm}_pose.{p}" for p in parts), f"{arm}_jaw")],
        "action": [name for arm in arms for name in (*(f"{arm}_sp.{p}" for p in parts), f"{arm}_jaw_sp")],
        "observation.meta.force_torque": ["fx", "fy", "fz", "tx", "ty", "tz"],
        "observation.meta.probe": ["depth"],
    }
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [len(names)], "names": [names]} for name, names in named.items()
    }
    features["observation.meta.force_torque"]["info"] = {"sensor": "wrist_ft", "units": "N + N m"}
    features["observation.meta.tool"] = {"dtype": "string", "shape": [1], "names": ["value"]}
    vectors = (measured, planned, force, np.zeros((n_rows, 1)))
    columns: dict[str, Any] = {
        name: pa.array(values.tolist(), pa.list_(pa.float32())) for name, values in zip(named, vectors, strict=True)
    }
    columns |= {"frame_index": np.arange(n_rows), "timestamp": pa.array(t_s, pa.float32())}
    columns |= {"episode_index": np.zeros(n_rows, dtype=int)}
    (folder / "data" / "chunk-000").mkdir(parents=True)
    pq.write_table(pa.table(columns), folder / "data" / "chunk-000" / "episode_000000.parquet")
    (folder / "meta").mkdir()
    info = {"codebase_version": "v2.1", "robot_type": "dvrk", "fps": 30, "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    return folder


def ros_messages(columns: Columns, transforms: Sequence[str] = ()) -> list[tuple[str, str, int, Any]]:
    """Return topic, type, log time and message of a recording with CRTK topics, in order of time."""
    types = STORE.types
    stamped, pose = types["geometry_msgs/msg/PoseStamped"], types["geometry_msgs/msg/Pose"]
    point, turn = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Quaternion"]
    moved, transform = types["geometry_msgs/msg/TransformStamped"], types["geometry_msgs/msg/Transform"]
    vector, joints = types["geometry_msgs/msg/Vector3"], types["sensor_msgs/msg/JointState"]
    header, time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    names = {"MTML": "measured_cp", "MTMR": "measured_cp", "PSM1": "setpoint_cp", "PSM2": "setpoint_cp"}
    grips = {"MTML": "gripper", "MTMR": "gripper", "PSM1": "jaw", "PSM2": "jaw"}
    found = []
    for i, t_s in enumerate(columns["time_s"]):
        t_ns = _START_NS + round(t_s * 1e9)
        head = header(stamp=time(sec=t_ns // 10**9, nanosec=t_ns % 10**9), frame_id="")
        for device, name in names.items():
            if f"{device}_x_m" not in columns:
                continue
            x, y, z, qx, qy, qz, qw, grip = (float(columns[f"{device}_{part}"][i]) for part in _PARTS)
            turned = turn(x=qx, y=qy, z=qz, w=qw)
            message: Any
            if device in transforms:
                kind = "geometry_msgs/msg/TransformStamped"
                inner = transform(translation=vector(x=x, y=y, z=z), rotation=turned)
                message = moved(header=head, child_frame_id="", transform=inner)
            else:
                kind = "geometry_msgs/msg/PoseStamped"
                message = stamped(header=head, pose=pose(position=point(x=x, y=y, z=z), orientation=turned))
            found.append((f"/{device}/{name}", kind, t_ns, message))
            empty = np.array([])
            jaw = joints(header=head, name=["jaw"], position=np.array([grip]), velocity=empty, effort=empty)
            found.append((f"/{device}/{grips[device]}/measured_js", "sensor_msgs/msg/JointState", t_ns, jaw))
    return found


def odometry(columns: Columns, kind: str = "nav_msgs/msg/Odometry") -> list[tuple[str, str, int, Any]]:
    """Return topic, type, log time and message of the master's poses, with a covariance."""
    types, found = STORE.types, []
    for _, _, t_ns, posed in ros_messages({name: columns[name] for name in columns if "PSM" not in name}):
        if not hasattr(posed, "pose"):
            continue
        with_covariance = types["geometry_msgs/msg/PoseWithCovariance"](pose=posed.pose, covariance=np.zeros(36))
        more: dict[str, Any] = {}
        if kind == "nav_msgs/msg/Odometry":
            zero = types["geometry_msgs/msg/Vector3"](x=9.0, y=9.0, z=9.0)
            twist = types["geometry_msgs/msg/Twist"](linear=zero, angular=zero)
            twisted = types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=np.zeros(36))
            more = {"child_frame_id": "base_link", "twist": twisted}
        found.append(("/odom", kind, t_ns, types[kind](header=posed.header, pose=with_covariance, **more)))
    return found


def frames(columns: Columns) -> list[tuple[str, str, int, Any]]:
    """Return messages of TF: odom to base_link is the master's pose, base_link to tool the arm's, camera is fixed."""
    types, found = STORE.types, []
    kinds = {"MTML": ("odom", "base_link"), "PSM2": ("base_link", "tool")}
    for topic, kind, t_ns, one in ros_messages(columns, tuple(kinds)):
        if kind != "geometry_msgs/msg/TransformStamped":
            continue
        parent, child = kinds[topic.split("/")[1]]
        header = types["std_msgs/msg/Header"](stamp=one.header.stamp, frame_id=parent)
        moved: Any = types[kind](header=header, child_frame_id=child, transform=one.transform)
        found.append(("/tf", "tf2_msgs/msg/TFMessage", t_ns, types["tf2_msgs/msg/TFMessage"](transforms=[moved])))
    fixed = types["geometry_msgs/msg/TransformStamped"](
        header=header, child_frame_id="camera", transform=moved.transform
    )
    found.append(("/tf_static", "tf2_msgs/msg/TFMessage", t_ns, types["tf2_msgs/msg/TFMessage"](transforms=[fixed])))
    return found


def wrenches(topic: str, t_s: Sequence[float]) -> list[tuple[str, str, int, Any]]:
    """Return messages of a force of k, 0, 0 N and a torque of 0, 0, 1 N m, as `ros_messages` does those of poses."""
    kinds = [f"geometry_msgs/msg/{name}" for name in ("WrenchStamped", "Wrench", "Vector3")]
    stamped, wrench, vector = (STORE.types[kind] for kind in kinds)
    header, time = STORE.types["std_msgs/msg/Header"], STORE.types["builtin_interfaces/msg/Time"]
    found = []
    for k, at_s in enumerate(t_s):
        t_ns = _START_NS + round(at_s * 1e9)
        head = header(stamp=time(sec=t_ns // 10**9, nanosec=t_ns % 10**9), frame_id="")
        felt = wrench(force=vector(x=float(k), y=0.0, z=0.0), torque=vector(x=0.0, y=0.0, z=1.0))
        found.append((topic, kinds[0], t_ns, stamped(header=head, wrench=felt)))
    return found


def rosbag(folder: Path, columns: Columns, storage: str = "sqlite3", transforms: Sequence[str] = ()) -> Path:
    """Write a rosbag2 of CRTK topics."""
    return rosbag_of(folder, ros_messages(columns, transforms), storage)


def rosbag_of(folder: Path, messages: Sequence[tuple[str, str, int, Any]], storage: str = "sqlite3") -> Path:
    """Write a rosbag2."""
    plugin = StoragePlugin.SQLITE3 if storage == "sqlite3" else StoragePlugin.MCAP
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        connections: dict[str, Any] = {}
        for topic, kind, t_ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], t_ns + 1000, STORE.serialize_cdr(message, kind))
    return folder


def ros_mcap(file: Path, columns: Columns) -> Path:
    """Write an MCAP file of CRTK topics in CDR, as a recorder of ROS 2 does."""
    return ros_mcap_of(file, ros_messages(columns))


def ros_mcap_of(file: Path, messages: Sequence[tuple[str, str, int, Any]]) -> Path:
    """Write an MCAP file in CDR."""
    with file.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start(profile="ros2")
        channels: dict[str, int] = {}
        for topic, kind, t_ns, message in messages:
            if topic not in channels:
                schema = writer.register_schema(kind, "ros2msg", b"")
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(STORE.serialize_cdr(message, kind))
            writer.add_message(channels[topic], t_ns, data, t_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return file


def json_mcap(file: Path, topics: Mapping[str, Sequence[tuple[int, object]]]) -> Path:
    """Write an MCAP file of JSON messages: log time and content by topic."""
    with file.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start()
        for topic, messages in topics.items():
            channel = writer.register_channel(topic, "json", 0)
            for log_ns, content in messages:
                data = content if isinstance(content, bytes) else json.dumps(content).encode()
                writer.add_message(channel, log_ns, data, log_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return file
