import pytest

from tis.common.errors import DataError, InputError
from tis.deploy.recordings_import.choice import chosen, listing
from tis.deploy.recordings_import.found import Topic, Wanted

POSE, JOINTS = "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/JointState"
TOPICS = [
    Topic("/MTML/measured_cp", POSE, 9, "pose"),
    Topic("/MTML/setpoint_cp", POSE, 9, "pose"),
    Topic("/MTML/gripper/measured_js", JOINTS, 9, "joints"),
    Topic("/PSM2/measured_cp", POSE, 9, "pose"),
    Topic("/PSM2/setpoint_cp", POSE, 9, "pose"),
    Topic("/PSM2/jaw/measured_js", JOINTS, 9, "joints"),
    Topic("/PSM1/setpoint_cp", POSE, 0, "pose"),
    Topic("/diagnostics", "x/msg/Y", 3, None),
]


def test_masters_are_measured_and_arms_commanded() -> None:
    poses, jaws = chosen(TOPICS, Wanted(), "f")
    assert poses == {"MTML": "/MTML/measured_cp", "PSM2": "/PSM2/setpoint_cp"}  # nothing was said on PSM1
    assert jaws == {"MTML": "/MTML/gripper/measured_js", "PSM2": "/PSM2/jaw/measured_js"}
    assert listing(TOPICS, poses, jaws)[0] == f"/MTML/gripper/measured_js: 9 of {JOINTS} -> gripper of MTML"
    assert listing(TOPICS, poses, jaws)[-1] == "/diagnostics: 3 of x/msg/Y"


def test_any_namespace_goes_before_the_device() -> None:
    topics = [Topic("lab/dvrk/PSM1/measured_cp", POSE, 2, "pose"), Topic("tis/MTMR/measured_cp", "json", 2, "pose")]
    assert chosen(topics, Wanted(), "f")[0] == {"MTMR": "tis/MTMR/measured_cp", "PSM1": "lab/dvrk/PSM1/measured_cp"}


def test_named_topics_replace_the_usual_ones() -> None:
    wanted = Wanted(topics={"PSM2": "/PSM2/measured_cp"})
    assert chosen(TOPICS, wanted, "f")[0] == {"PSM2": "/PSM2/measured_cp"}


def test_wrong_names_are_told_at_once() -> None:
    wanted = Wanted(topics={"ECM": "/PSM2/measured_cp", "PSM2": "/diagnostics"}, jaws={"PSM2": "/jaw"})
    with pytest.raises(InputError) as caught:
        chosen(TOPICS, wanted, "f")
    assert [str(fault) for fault in caught.value.faults] == [
        "tis import: --topic: must begin with one of MTML, PSM2, MTMR, PSM1 (got 'ECM')",
        "tis import: --topic: must be a topic of poses: /MTML/measured_cp, /MTML/setpoint_cp, /PSM2/measured_cp, "
        "/PSM2/setpoint_cp, /PSM1/setpoint_cp (got 'x/msg/Y')",
        "tis import: --jaw: must be a topic of the file; of joint states: /MTML/gripper/measured_js, "
        "/PSM2/jaw/measured_js (got '/jaw')",
    ]


def test_a_recording_without_poses_lists_its_topics() -> None:
    with pytest.raises(DataError, match=r"--topic DEVICE=TOPIC names one; its topics: /diagnostics \(x/msg/Y\)"):
        chosen(TOPICS[-1:], Wanted(), "f")
