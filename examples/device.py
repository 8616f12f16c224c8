"""A device: it draws circles of 20 mm on the surgeon's network until the run ends, as a hand controller would move.

python examples/device.py tcp/127.0.0.1:7447
"""

import json
import math
import sys
import threading
import time

import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
config.insert_json5("connect/timeout_ms", "-1")  # wait until there is a run
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("scouting/gossip/enabled", "false")

over, n_sent = threading.Event(), 0
with zenoh.open(config) as session:
    session.liveliness().declare_subscriber(
        "tis/@tis/run/netem/*", lambda s: over.set() if s.kind == zenoh.SampleKind.DELETE else None, history=True
    )
    publisher = session.declare_publisher("device/MTML/measured_cp")
    while not over.wait(0.01):
        stamp_ns = time.monotonic_ns()
        angle = 2 * math.pi * 0.4 * stamp_ns / 1e9
        position = {"x": 0.02 * math.cos(angle), "y": 0.02 * math.sin(angle), "z": 0.0}
        publisher.put(json.dumps({"stamp_ns": stamp_ns, "position_m": position, "gripper_rad": 0.3}))
        n_sent += 1
print(f"{n_sent} poses sent")
