from typing import Any

import pytest

from tis.deploy.recordings_import.element_names import elements_of, names_in, units_in


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["left_x", "left_y", "left_z", "left_gripper"], ("PSM2", (0, 1, 2), None, None, 3)),
        (["x", "y", "z", "roll", "pitch", "yaw", "jaw"], ("PSM2", (0, 1, 2), None, (3, 4, 5), 6)),
        (["psm1_qw", "psm1_qx", "psm1_qy", "psm1_qz", "psm1_x", "psm1_y", "psm1_z"],
         ("PSM1", (4, 5, 6), (1, 2, 3, 0), None, None)),
        (["PSM2.position.x", "PSM2.position.y", "PSM2.position.z", "PSM2.orientation.x", "PSM2.orientation.y",
          "PSM2.orientation.z", "PSM2.orientation.w", "PSM2.jaw"], ("PSM2", (0, 1, 2), (3, 4, 5, 6), None, 7)),
        (["rightArmX", "rightArmY", "rightArmZ"], ("PSM1", (0, 1, 2), None, None, None)),
    ],
)  # fmt: skip
def test_names_of_elements_are_understood(names: list[str], expected: tuple[Any, ...]) -> None:
    [found] = elements_of(names, is_action=False)
    assert (found.device, found.position, found.quaternion, found.euler, found.gripper) == expected


def test_an_action_is_the_masters_and_joints_are_no_poses() -> None:
    names = [f"{side}_{axis}" for side in ("left", "right") for axis in "xyz"]
    assert [each.device for each in elements_of(names, is_action=True)] == ["MTML", "MTMR"]
    assert elements_of(["shoulder_pan.pos", "elbow_flex.pos", "gripper.pos"], is_action=True) == []
    assert elements_of(["delta_x", "delta_y", "delta_z", "gripper"], is_action=True) == []
    assert elements_of(["ee.vel.x", "ee.vel.y", "ee.vel.z"], is_action=True) == []


def test_set_points_of_arms_are_told_from_a_masters_poses() -> None:
    names = [f"psm1_sp.position.{axis}" for axis in "xyz"]
    assert [each.device for each in elements_of(names, is_action=True)] == ["PSM1"]
    assert [each.device for each in elements_of(["mtml_x", "mtml_y", "mtml_z"], is_action=True)] == ["MTML"]


@pytest.mark.parametrize(
    ("feature", "expected"),
    [
        ({"info": {"units": "N + N m"}}, ("N", "N", "N", "N m", "N m", "N m")),
        ({"info": {"units": "N"}}, ("N",) * 6),
        ({"units": ["N", "N", "N", "Nm", "Nm", "Nm"]}, ("N", "N", "N", "N m", "N m", "N m")),
        ({"info": {"unit": "newton per furlong"}}, None),
        ({"info": {"units": "N + N m + N + N"}}, None),
        ({"info": {"units": {"a": 3}}}, None),
        ({"info": 3}, None),
        ({}, None),
    ],
)
def test_units_stand_beside_a_vector(feature: dict[str, Any], expected: tuple[str, ...] | None) -> None:
    assert units_in(feature, 6) == expected


def test_names_stand_in_a_list_or_a_map() -> None:
    assert names_in({"names": [["a", "b"], ["c"]]}) == ("a", "b", "c")
    assert names_in({"names": [["a"], "b"]}) == names_in({"names": [[["a"]]]}) == ()
    assert names_in({"names": ["a", "b"]}) == ("a", "b")
    assert names_in({"names": {"motors": ["a", "b"]}}) == ("a", "b")
    assert names_in({"names": None}) == names_in({"names": [1, 2]}) == names_in({}) == ()
