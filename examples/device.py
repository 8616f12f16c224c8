"""A device: it draws circles of 20 mm on the surgeon's network, as a haptic hand controller would move.

python examples/device.py tcp/127.0.0.1:7447 [SECONDS [KEY]]
"""

import json
import math
import sys
import time

import zenoh

where, seconds, key = [*sys.argv[1:], *["tcp/127.0.0.1:7447", "60", "device/MTML/measured_cp"][len(sys.argv) - 1 :]]
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([where]))
config.insert_json5("connect/timeout_ms", "-1")  # wait until there is a run
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("scouting/gossip/enabled", "false")

n_sent, begun_ns = 0, time.monotonic_ns()
with zenoh.open(config) as session:
    publisher = session.declare_publisher(key)
    while (stamp_ns := time.monotonic_ns()) < begun_ns + float(seconds) * 1e9:
        angle = 2 * math.pi * 0.4 * (stamp_ns - begun_ns) / 1e9
        position = {"x": 0.02 * math.cos(angle), "y": 0.02 * math.sin(angle), "z": 0.0}
        try:
            publisher.put(json.dumps({"stamp_ns": stamp_ns, "position_m": position, "gripper_rad": 0.3}))
        except zenoh.ZError:  # the run is over, and netem with it
            break
        n_sent += 1
        time.sleep(0.01)
print(f"{n_sent} poses sent on {key}")
