"""A robot that is no part of the testbed: it follows the set points at 100 Hz, and tells where it is.

python examples/foreign_arm.py tcp/127.0.0.1:7448
"""

import json
import sys
import threading
import time

import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
config.insert_json5("connect/timeout_ms", "-1")  # wait for netem
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("scouting/gossip/enabled", "false")

over, newest = threading.Event(), []


def follow(sample: zenoh.Sample) -> None:
    """Keep the newest set point; in hold and safe it stands still, so following it is always right."""
    newest[:] = [json.loads(sample.payload.to_bytes())]


with zenoh.open(config) as session:
    session.declare_subscriber("tis/PSM2/servo_cp", follow)
    session.liveliness().declare_subscriber(
        "tis/@tis/run/netem/*", lambda s: over.set() if s.kind == zenoh.SampleKind.DELETE else None, history=True
    )
    publisher, place, n_told = session.declare_publisher("tis/PSM2/arm/measured_cp"), None, 0
    while not over.wait(0.01):
        if newest:
            wanted = newest[0]["position_m"]
            place = wanted if place is None else {a: place[a] + 0.4 * (wanted[a] - place[a]) for a in "xyz"}
            turn, gripper_rad = newest[0]["orientation"], newest[0]["gripper_rad"]
            told = {"stamp_ns": time.monotonic_ns(), "position_m": place, "orientation": turn}
            publisher.put(json.dumps(told | {"gripper_rad": gripper_rad}))
            n_told += 1
print(f"{n_told} poses told")
