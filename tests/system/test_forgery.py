"""Somebody on the patient's network sends samples in a second version, and set points: every side tells."""

import json
import queue

import pytest
import zenoh

from tests.system.conftest import Start
from tis.common.channels import Side
from tis.common.records import PEERS
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions, visitor
from tis.deploy.logs.read.load import load_run

pytestmark = pytest.mark.live
_ARM, _DRIVEN = "tis/PSM2/setpoint_cp", "tis/PSM2/servo_cp"
_SIDES: tuple[Side, ...] = ("surgeon", "netem", "patient")


def test_a_second_version_of_samples_is_told_by_every_side_and_holds_the_arm(start: Start) -> None:
    west, east = free_endpoints()
    settings = (
        f"hosts={{west: {west}, east: {east}}}", "patient.gate.on_conflict=hold",
        "estimators=[hold]", "active_estimator=hold",
    )  # fmt: skip
    tis = start("run", "default", "--duration-s", "6", *(word for one in settings for word in ("--set", one)))
    tis.await_log("patient", 30_000)
    heard: queue.SimpleQueue[tuple[bytes, bytes]] = queue.SimpleQueue()

    def hear(sample: zenoh.Sample) -> None:
        if sample.attachment is not None:
            heard.put((sample.payload.to_bytes(), sample.attachment.to_bytes()))

    with zenoh.open(visitor(east, ZenohOptions())) as session:
        forged, driven = session.declare_publisher(_ARM), session.declare_publisher(_DRIVEN)
        subscriber = session.declare_subscriber(_ARM, hear)
        for k in range(60):
            payload, attachment = heard.get(timeout=20)
            if k < 20:  # the arm is driven by then
                continue
            pose = json.loads(payload)
            pose["gripper_rad"] += 1e-3
            forged.put(json.dumps(pose), attachment=attachment)  # under the number that has just been used
            driven.put(payload, attachment=attachment)
        subscriber.undeclare()  # type: ignore[no-untyped-call]
        code, _, err = tis.wait()
    assert code in (0, 5), err
    summary, logs = tis.summary(), load_run(tis.run_dir)
    for side in _SIDES:
        events = {row["event"] for row in logs.of(side, PEERS)}
        assert {"conflict", "foreign_set_point"} <= events, (side, events)
    assert summary["safety"]["left"]["time_s"]["hold"] > 0
    assert summary["evidence"]["conflict"]["n"] >= 10
    assert summary["evidence"]["foreign_set_point"]["n"] >= 10
    assert "somebody forges them" in " ".join(err.split())
