from pathlib import Path
from typing import Any

from tests.deploy.report.hand_made import MS, a_scenario, counter, write_run
from tis.common.device_records import DEVICES, DeviceNote
from tis.common.node import Record
from tis.deploy.report.subjects.devices import (
    camera_summary,
    camera_texts,
    device_texts,
    devices_summary,
    is_foreign,
    silent_camera,
)
from tis.deploy.report.subjects.identification import source_label

LIVE: dict[str, Any] = {
    "source": {"kind": "live", "hands": ["left", "right"]},
    "patient": {"plant": {"kind": "external"}},
    "identification": {"train": "synthetic"},
}


def test_what_devices_and_arms_sent_and_what_was_not_used_of_it(tmp_path: Path) -> None:
    first = DeviceNote(at_ns=400 * MS, hand="left", event="first", for_ns=0)
    surgeon = [
        Record(DEVICES, 400 * MS, first),
        *[counter(f"device_{name}.left", n) for name, n in (("poses", 90), ("silences", 2), ("silent_ticks", 45))],
        counter("device_not_finite.left", 3),
        counter("device_jump.left", 1),
        counter("device_poses.right", 0),
        counter("device_silences.right", 1),
        counter("device_not_finite.right", 5),
    ]
    patient = [counter("arm_poses.left", 7), counter("arm_poses.right", 8), counter("arm_flooded.right", 1000)]
    scenario = a_scenario(**LIVE)
    found = devices_summary(write_run(tmp_path, surgeon=surgeon, patient=patient), scenario)
    left = found["devices"]["left"]
    assert (left["poses"], left["first_s"], left["silences"], left["silent_s"]) == (90, 0.4, 2, 1.5)
    assert {reason: n for reason, n in left["refused"].items() if n} == {"not_finite": 3, "jump": 1}
    assert found["external_arms"]["left"]["poses"] == 7
    assert device_texts(found["devices"], found["external_arms"]) == [
        "no pose of the left hand came from a device or page in 2 stretches, 1.5 s in all: it was taken to stand "
        "still there; rest with poses is not counted",
        "not used of the messages of the device of the left hand: 3 with numbers that are not finite, 1 that jumped, "
        "which were not followed",
        "not used of the messages of the device of the right hand: 5 with numbers that are not finite",
        "not used of the messages of the external arm of the right hand: 1000 that came too fast, between two ticks",
    ]


def test_a_scenario_without_either_has_no_such_figures(tmp_path: Path) -> None:
    logs = write_run(tmp_path, surgeon=[], patient=[])
    assert devices_summary(logs, a_scenario()) == {}
    assert device_texts({}, {}) == []


def test_a_foreign_surgeon_has_its_device_to_itself(tmp_path: Path) -> None:
    logs = write_run(tmp_path, surgeon=[counter("foreign_surgeon", 1)])
    assert is_foreign(logs)
    assert devices_summary(logs, a_scenario(**LIVE))["devices"] == {}
    assert source_label(a_scenario(**LIVE), is_foreign(logs)) == "foreign surgeon, left and right hand"
    assert not is_foreign(write_run(tmp_path, surgeon=[]))


def test_what_an_external_camera_sent_and_what_was_not_used_of_it(tmp_path: Path) -> None:
    counted = {"video_frames": 90, "camera_undated": 4, "camera_undecodable": 2, "camera_flooded": 7, "unread": 1}
    patient = [counter(name, n) for name, n in counted.items()]
    scenario = a_scenario(sight={"camera": "external"})
    found = camera_summary(write_run(tmp_path, surgeon=[], patient=patient), scenario, 3)["external_camera"]
    assert (found.frames, found.undated, found.unreadable) == (90, 4, 3)
    assert found.refused == {"undecodable": 2, "other_format": 0, "flooded": 7, "unread": 1}
    refused, unreadable, undated = camera_texts(found)
    assert "2 that were no frame, 7 that came faster" in refused
    assert unreadable.startswith("3 frames of the external camera came whole")
    assert undated.startswith("4 frames of the external camera had no usable timestamp")
    assert silent_camera(found) == silent_camera(None) == camera_texts(None) == []
    (problem,) = silent_camera(found.model_copy(update={"frames": 0}))
    assert problem.startswith("external_camera: no frame came that could be used")
    assert camera_summary(write_run(tmp_path, surgeon=[], patient=patient), a_scenario(sight={}), 0) == {}
