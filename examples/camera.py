"""A camera that is no part of the testbed: it publishes a moving pattern as JPEG, 30 frames a second.

python examples/camera.py tcp/127.0.0.1:7448            # without stamps
python examples/camera.py tcp/127.0.0.1:7448 stamped    # with them: hand to eye is measured, too
"""

import base64
import io
import json
import sys
import threading
import time

import numpy as np
import zenoh
from PIL import Image

SIZE, FPS, RATE_HZ = (800, 600), 30, 30  # any size; RATE_HZ is the scenario's rate_hz
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
config.insert_json5("connect/timeout_ms", "-1")  # wait for netem
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("scouting/gossip/enabled", "false")
is_stamped, over, command = "stamped" in sys.argv, threading.Event(), [-1]


def follow(sample: zenoh.Sample) -> None:
    """Keep the number of the newest command that the arm has followed."""
    sample_ns = json.loads(sample.payload.to_bytes()).get("command_sample_ns")
    if sample_ns is not None:
        command[:] = [round(sample_ns * RATE_HZ / 1e9)]


with zenoh.open(config) as session:
    session.declare_subscriber("tis/PSM2/measured_cp", follow)
    session.liveliness().declare_subscriber(
        "tis/@tis/run/netem/*", lambda s: over.set() if s.kind == zenoh.SampleKind.DELETE else None, history=True
    )
    publisher, n = session.declare_publisher("tis/ECM/camera"), 0
    while not over.wait(1 / FPS):
        captured_ns = time.time_ns()
        picture = np.roll(np.indices(SIZE[::-1]).sum(axis=0) // 4 % 256, 8 * n, axis=1).astype(np.uint8)
        picture = np.repeat(picture[:, :, None], 3, axis=2)
        if is_stamped:
            from tis.common.sight.stamp import Stamp, draw_stamps  # or by the layout on the protocol page

            draw_stamps(picture, Stamp(n, command[0]))
        out = io.BytesIO()
        Image.fromarray(picture).save(out, "JPEG", quality=70, restart_marker_rows=1)
        stamp = {"sec": captured_ns // 10**9, "nsec": captured_ns % 10**9}
        frame = {"timestamp": stamp, "format": "jpeg", "data": base64.b64encode(out.getvalue()).decode()}
        publisher.put(json.dumps(frame))
        n += 1
print(f"{n} frames published")
