import pytest

from tis.common.channels import (
    CONTROL,
    DESTINATION,
    FOLLOWER,
    MASTER,
    ORIGIN,
    SAME_NAME,
    Arm,
    Hand,
    hand_channels,
)
from tis.common.messages import FeedbackPose, SampledPose


@pytest.mark.parametrize(
    ("hand", "arm", "keys"),
    [
        (
            "left",
            "PSM2",
            ["s/MTML/measured_cp", "s/PSM2/setpoint_cp", "s/PSM2/estimated_cp", "s/PSM2/measured_cp"],
        ),
        (
            "right",
            "PSM1",
            ["s/MTMR/measured_cp", "s/PSM1/setpoint_cp", "s/PSM1/estimated_cp", "s/PSM1/measured_cp"],
        ),
    ],
)
def test_keys_are_crtk_names(hand: Hand, arm: Arm, keys: list[str]) -> None:
    assert FOLLOWER[hand] == arm
    channels = hand_channels(hand, arm)
    four = [channels.command, channels.arm, channels.estimated, channels.measured]
    assert [channel.key("s") for channel in four] == keys


def test_commands_go_forward_and_answers_come_back() -> None:
    channels = hand_channels("left", "PSM2")
    assert {channels.command.direction, channels.arm.direction} == {"forward"}
    assert {channels.estimated.direction, channels.measured.direction} == {"feedback"}
    assert {channels.command.payload, channels.arm.payload} == {SampledPose}
    assert {channels.estimated.payload, channels.measured.payload} == {FeedbackPose}


def test_no_two_channels_share_a_key() -> None:
    keys = [
        channel.key("s")
        for hand in MASTER
        for channels in [hand_channels(hand, FOLLOWER[hand])]
        for channel in (channels.command, channels.arm, channels.estimated, channels.measured)
    ]
    assert len(set(keys)) == len(keys) == 8


def test_the_like_named_pairing_is_the_other_one() -> None:
    assert {hand: SAME_NAME[hand] for hand in MASTER} == {"left": "PSM1", "right": "PSM2"}
    assert all(SAME_NAME[hand] != FOLLOWER[hand] for hand in MASTER)


def test_each_direction_leads_from_one_network_to_the_other() -> None:
    assert DESTINATION == {"forward": "east", "feedback": "west"}
    assert all({ORIGIN[way], DESTINATION[way]} == {"west", "east"} for way in DESTINATION)


def test_control_keys_are_out_of_reach_of_wildcards() -> None:
    assert CONTROL.startswith("@")
