"""One side of a ROS 2 system, with zenoh-ros2-sdk in place of ROS 2: `python -m tests.system.ros2_side west PORT`.

``east`` subscribes and serves until its standard input ends, then prints what came; ``west`` publishes and calls;
``device`` publishes poses until its standard input ends. The definitions of the messages are those of ROS 2 Jazzy,
written out so that nothing is downloaded.
"""

import json
import os
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

DEFINITIONS = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
    "geometry_msgs/msg/Pose": "Point position\nQuaternion orientation\n",
    "geometry_msgs/msg/Twist": "Vector3 linear\nVector3 angular\n",
    "geometry_msgs/msg/PoseStamped": "std_msgs/Header header\nPose pose\n",
    "geometry_msgs/msg/TwistStamped": "std_msgs/Header header\nTwist twist\n",
    "sensor_msgs/msg/JointState": "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
    "float64[] effort\n",
    "example_interfaces/srv/AddTwoInts": "int64 a\nint64 b\n---\nint64 sum\n",
}
TOPICS = {
    "/arm/setpoint": "geometry_msgs/msg/PoseStamped",
    "/arm/twist": "geometry_msgs/msg/TwistStamped",
    "/arm/joints": "sensor_msgs/msg/JointState",
}
N_EACH = 40


def prepared(port: str) -> Any:
    """Return the SDK, with the definitions in a folder and sessions that are clients of a router on ``port``."""
    folder = Path(tempfile.mkdtemp())
    for name, text in DEFINITIONS.items():
        file = folder / f"{name}.{name.split('/')[1]}"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    os.environ["ZENOH_CONFIG_OVERRIDE"] = f'mode="client";connect/endpoints=["tcp/127.0.0.1:{port}"]'
    import zenoh_ros2_sdk as sdk

    sdk.get_registry(str(folder))
    for name in DEFINITIONS:
        if "/msg/" in name:
            assert sdk.load_message_type(name)
    return sdk


def say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def header(sdk: Any, sec: int = 1) -> Any:
    stamp = sdk.get_message_class("builtin_interfaces/msg/Time")(sec=sec, nanosec=0)
    return sdk.get_message_class("std_msgs/msg/Header")(stamp=stamp, frame_id="base")


def pose(sdk: Any, x: float) -> Any:
    made = {name: sdk.get_message_class(f"geometry_msgs/msg/{name}") for name in ("Pose", "Point", "Quaternion")}
    return made["Pose"](position=made["Point"](x=x, y=0.0, z=0.0), orientation=made["Quaternion"](0.0, 0.0, 0.0, 1.0))


def fields_of(sdk: Any, topic: str, i: int) -> dict[str, Any]:
    import numpy as np

    if topic == "/arm/setpoint":
        return {"header": header(sdk), "pose": pose(sdk, 0.001 * i)}
    if topic == "/arm/twist":
        vector = sdk.get_message_class("geometry_msgs/msg/Vector3")
        twist = sdk.get_message_class("geometry_msgs/msg/Twist")
        return {
            "header": header(sdk),
            "twist": twist(linear=vector(0.5 * i, 0.0, 0.0), angular=vector(0.0, 0.0, 1.0)),
        }
    none = np.empty(0)
    joints = {"name": ["yaw", "pitch"], "position": np.array([0.25 * i, -1.0]), "velocity": none, "effort": none}
    return {"header": header(sdk), **joints}


def number_in(topic: str, message: Any) -> float:
    """Return what the message says of its own number."""
    if topic == "/arm/setpoint":
        return float(message.pose.position.x) / 0.001
    if topic == "/arm/twist":
        return float(message.twist.linear.x) / 0.5
    return float(message.position[0]) / 0.25


def east(sdk: Any) -> None:
    got: dict[str, list[float]] = {topic: [] for topic in TOPICS}
    n_served = [0]

    def keep(topic: str) -> Any:
        return lambda message: got[topic].append(round(number_in(topic, message), 6))

    held = [sdk.ROS2Subscriber(topic, kind, keep(topic)) for topic, kind in TOPICS.items()]

    def add(request: Any) -> Any:
        n_served[0] += 1
        return sdk.get_message_class("example_interfaces/srv/AddTwoInts_Response")(sum=request.a + request.b)

    held.append(sdk.ROS2ServiceServer("/arm/add", "example_interfaces/srv/AddTwoInts", add))
    say("ready")
    sys.stdin.read()
    say(json.dumps({"got": got, "served": n_served[0]}))


def west(sdk: Any) -> None:
    publishers = {topic: sdk.ROS2Publisher(topic, kind) for topic, kind in TOPICS.items()}
    client = sdk.ROS2ServiceClient("/arm/add", "example_interfaces/srv/AddTwoInts")
    time.sleep(1.0)  # as long as discovery takes
    for i in range(N_EACH):
        for topic, publisher in publishers.items():
            publisher.publish(**fields_of(sdk, topic, i))
        time.sleep(0.01)
    sums = [client.call(a=20, b=22), client.call(a=-(2**40), b=1)]
    say(json.dumps([None if answer is None else int(answer.sum) for answer in sums]))


def device(sdk: Any) -> None:
    publisher, over = sdk.ROS2Publisher("/device/left", "geometry_msgs/msg/PoseStamped"), threading.Event()

    def wait_for_the_end() -> None:
        sys.stdin.read()
        over.set()

    threading.Thread(target=wait_for_the_end, daemon=True).start()
    for i in range(1_000_000):
        if over.wait(0.01):
            break
        publisher.publish(header=header(sdk, 1 + i), pose=pose(sdk, 0.02 * (i % 50) / 50))


if __name__ == "__main__":
    {"east": east, "west": west, "device": device}[sys.argv[1]](prepared(sys.argv[2]))
    os._exit(0)  # closing the SDK's session takes seconds
