"""Devices of others that lie, flood and stop: the run is valid, names it, and the patient's log replays."""

import json
import time

import pytest
import zenoh

from tests.system.conftest import StartHere, is_right_but_for_the_machine
from tis.common.records import COUNTERS
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.deploy.logs.read.load import load_run
from tis.deploy.run.replay import replay

LEFT = "device/MTML/measured_cp"
GOOD = '{"stamp_ns": %d, "position_m": {"x": %f, "y": 0, "z": 0}}'
BAD = (
    b"junk", b"", b"\xff" * 100, b"x" * 3000, b'{"position_m": {"x": NaN, "y": 0, "z": 0}}',
    b'{"position_m": {"x": 0, "y": 0, "z": 0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 0}}',
    b'{"stamp_ns": 1, "position_m": {"x": 0, "y": 0, "z": 0}}',
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.live
def test_a_device_that_lies_floods_and_stops_is_named_and_ends_no_run(
    run_here: StartHere, endpoints: tuple[str, str]
) -> None:
    west, east = endpoints
    hosts = json.dumps({"west": west, "east": east})
    words = ("--set", f"hosts={hosts}", "--set", "estimators=[hold, innovations_kf]", "--duration-s", "6")
    tis = run_here("run", "live", *words, meanwhile=lambda _: _lie_and_flood(west))
    code, _, err = tis.wait()
    summary, logs = tis.summary(), load_run(tis.run_dir)
    assert is_right_but_for_the_machine(code, summary), (err, summary["problems"])
    row = summary["devices"]["left"]
    refused = row["refused"]
    assert refused["undecodable"] == 40
    assert refused["not_finite"] == refused["no_rotation"] == refused["backwards"] == 10
    assert refused["jump"] == 1
    unread = next(note["value"] for note in logs.of("surgeon", COUNTERS) if note["name"] == "flooded")
    assert row["poses"] + refused["flooded"] + unread == 100 + 30_000 + 1
    assert refused["flooded"] + unread > 1000
    assert row["silences"] >= 1
    found = replay(tis.run_dir)
    assert found.identical
    assert found.n_compared > 300


def _lie_and_flood(west: str) -> None:
    with zenoh.open(a_patient_client(west)) as session:
        await_run(session)
        for i in range(100):  # a second of honest movement, and lies between
            put(session, GOOD % (100 + i, 0.001 * (i % 10)))
            time.sleep(0.01)
            for lie in BAD if i % 10 == 0 else ():
                put(session, lie)
        for i in range(30_000):
            put(session, GOOD % (1000 + i, 0.001 * (i % 10)))
        put(session, GOOD % (100_000, 5.0))  # five metres away; then nothing any more


def put(session: zenoh.Session, content: str | bytes) -> None:
    """Publish as a device that waits where the network is busy, so that nothing is lost on the way."""
    session.put(LEFT, content, congestion_control=zenoh.CongestionControl.BLOCK)


def a_patient_client(endpoint: str) -> zenoh.Config:
    """Return the configuration of a client that waits until netem is there."""
    config = configure("client", ZenohOptions(connect=[endpoint]))
    config.insert_json5("connect/timeout_ms", "-1")
    return config


def await_run(session: zenoh.Session) -> None:
    """Wait until the run has begun."""
    for _ in range(1200):
        if any(reply.ok for reply in session.liveliness().get("tis/@tis/run/netem/*")):
            time.sleep(0.5)
            return
        time.sleep(0.1)
    raise AssertionError("no run began")
