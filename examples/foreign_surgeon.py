"""A surgeon that is no part of the testbed: it follows docs/reference/protocol.md, with Zenoh alone.

python examples/foreign_surgeon.py tcp/127.0.0.1:7447
"""

import json
import math
import struct
import sys
import time

import zenoh


def pose(sample_ns: int, size_m: float, centre_m: tuple[float, float, float]) -> str:
    """Return a pose on a circle as JSON."""
    angle = 2 * math.pi * 0.4 * sample_ns / 1e9
    x, y, z = centre_m[0] + size_m * math.cos(angle), centre_m[1] + size_m * math.sin(angle), centre_m[2]
    turn = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    position = {"x": x, "y": y, "z": z}
    return json.dumps({"sample_ns": sample_ns, "position_m": position, "orientation": turn, "gripper_rad": 0.3})


config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
config.insert_json5("connect/timeout_ms", "-1")  # wait for netem
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("scouting/gossip/enabled", "false")
with zenoh.open(config) as session:
    live = session.liveliness()
    # 1. netem's token tells the digest of the scenario; a query tells its fields.
    while not (tokens := [str(r.ok.key_expr) for r in live.get("tis/@tis/side/netem/*") if r.ok]):
        time.sleep(0.1)
    digest = tokens[0].split("/")[-1]
    (reply,) = [r.ok for r in session.get("tis/@tis/scenario/netem") if r.ok]
    field = {name: json.loads(text) for name, text in json.loads(reply.payload.to_bytes()).items() if text[0] != "#"}
    # 2. The offset of netem's clock over this one: the exchange with the shortest round trip.
    exchanges = []
    for _ in range(20):
        t1 = time.monotonic_ns()
        (reply,) = [r.ok for r in session.get("tis/@tis/clock") if r.ok]
        t4, clock = time.monotonic_ns(), json.loads(reply.payload.to_bytes())
        t2, t3 = clock["received_ns"], clock["replied_ns"]
        exchanges.append(((t4 - t1) - (t3 - t2), (t2 - t1 + t3 - t4) // 2))
    offset_ns = min(exchanges)[1]
    # 3. The barrier: say that the surgeon is here, and wait for the token that begins the run.
    here = live.declare_token(f"tis/@tis/side/surgeon/{digest}")
    while not (tokens := [str(r.ok.key_expr) for r in live.get("tis/@tis/run/netem/*") if r.ok]):
        time.sleep(0.05)
    run = tokens[0].split("/")[-1]
    run_id, epoch_ns = (int(part) for part in run.split("-")[:2])
    running = live.declare_token(f"tis/@tis/run/surgeon/{run}")
    rate_hz, duration_s, end_s = field["rate_hz"], field["duration_s"], field["duration_s"] + field["drain_s"]
    # 4. One sample a period, each on two keys, and a beat every 200 ms, until the end of the drain.
    places = {"MTML/measured_cp": (0.02, (0.1, -0.05, 0.35)), "PSM2/setpoint_cp": (0.01, (0.05, 0.025, 0.025))}
    drop = zenoh.CongestionControl.DROP
    publishers = {key: session.declare_publisher(f"tis/{key}", congestion_control=drop) for key in places}
    beat, n_samples, k, beat_due_ns = "tis/@tis/beat/surgeon", int(duration_s * rate_hz + 1e-9), 0, 0
    while (now_ns := time.monotonic_ns() + offset_ns - epoch_ns) < end_s * 1e9:
        sample_ns = k * 10**9 // rate_hz
        if k < n_samples and now_ns >= sample_ns:
            for key, (size_m, centre_m) in places.items():
                payload = pose(sample_ns, size_m, centre_m)
                sent_ns = time.monotonic_ns() + offset_ns - epoch_ns
                publishers[key].put(payload, attachment=struct.pack("<4sIqI", b"tis\x02", k, sent_ns, run_id))
            k += 1
        if now_ns >= beat_due_ns:
            session.put(beat, json.dumps({"side": "surgeon", "at_ns": now_ns, "loop_ns": now_ns, "run_id": run_id}))
            beat_due_ns = now_ns + 200_000_000
        time.sleep(0.001)
print(f"{k} samples sent in run {run_id}")
