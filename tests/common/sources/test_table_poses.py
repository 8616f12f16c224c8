from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.scenario.table_source import PoseColumns, PoseUnits
from tis.common.sources.table_clock import played, row_clock
from tis.common.sources.table_columns import DeviceLayout
from tis.common.sources.table_poses import finite_faults, following, pose_track, resampled, unit_doubts
from tis.common.sources.trajectory import PoseTrack

TURN = 2.0 * np.pi / 3.0  # about (1 1 1) / sqrt(3): x becomes y, y becomes z, z becomes x
CYCLE = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]


def device(units: dict[str, str] | None = None, **columns: Any) -> DeviceLayout:
    pose = PoseColumns.model_validate({"position": ("x", "y", "z"), **columns})
    return DeviceLayout("MTML", pose, PoseUnits.model_validate(units or {}))


def table(n_rows: int = 2, /, **columns: Any) -> dict[str, np.ndarray[Any, Any]]:
    there = {"x": 1.0, "y": 2.0, "z": 3.0, **columns}
    return {name: np.broadcast_to(np.asarray(value, dtype=float), n_rows).copy() for name, value in there.items()}


def track(layout: DeviceLayout, **columns: Any) -> PoseTrack:
    found, faults = pose_track(table(**columns), layout, "t.csv")
    assert faults == []
    return found


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001)])
def test_positions_have_a_unit(unit: str, factor: float) -> None:
    found = track(device({"position": unit})).position_m
    assert np.array_equal(found, np.tile(np.multiply([1.0, 2.0, 3.0], factor), (2, 1)))


def test_one_rotation_in_every_form() -> None:
    cells = {f"m{i}": CYCLE[i // 3][i % 3] for i in range(9)}
    half = [0.5, 0.5, 0.5, 0.5]  # axis sin(60 degrees) / sqrt(3), and cos(60 degrees)
    names = [f"m{i}" for i in range(9)]
    quaternion = {"a": 0.5, "b": 0.5, "c": 0.5, "d": 0.5}
    # z by 90 degrees and then x by 90 degrees, about fixed axes, is the same cycle
    forms = [
        track(device(matrix=names), **cells),
        track(device(quaternion=list("abcd")), **quaternion),
        track(device(quaternion=list("abcd")), **{name: -value for name, value in quaternion.items()}),
        track(device({"angle": "deg"}, euler=["p", "q"], euler_axes="zx"), p=90.0, q=90.0),
        track(device(euler=["p", "q"], euler_axes="XZ"), p=np.pi / 2, q=np.pi / 2),
    ]
    for found in forms[:3]:
        assert found.orientation == pytest.approx(np.tile(half, (2, 1)), abs=1e-15)
    for found in forms[3:]:
        x, y, z, w = found.orientation[0]
        matrix = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        turn_x = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
        turn_z = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
        assert np.asarray(matrix) == pytest.approx(turn_x @ turn_z, abs=1e-12)


def test_the_scalar_of_a_quaternion_may_come_first() -> None:
    found = track(device(quaternion=list("wabc"), quaternion_order="wxyz"), w=0.8, a=0.6, b=0.0, c=0.0)
    assert found.orientation[0] == pytest.approx([0.6, 0.0, 0.0, 0.8])


def test_a_device_without_orientation_and_gripper_stays_as_it_is() -> None:
    found = track(device())
    assert found.orientation.tolist() == [[0.0, 0.0, 0.0, 1.0]] * 2
    assert found.gripper_rad.tolist() == [0.0, 0.0]


def test_a_gripper_in_degrees() -> None:
    assert track(device({"gripper": "deg"}, gripper="g"), g=180.0).gripper_rad == pytest.approx(np.pi)


@given(st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4).filter(lambda q: sum(v * v for v in q) > 0.01))
def test_quaternions_are_of_norm_one_whatever_their_rounding(values: list[float]) -> None:
    rounded = np.asarray(values) / np.linalg.norm(values) * 1.004
    found = track(device(quaternion=list("abcd")), a=rounded[0], b=rounded[1], c=rounded[2], d=rounded[3])
    assert np.linalg.norm(found.orientation, axis=1) == pytest.approx(1.0, abs=1e-12)
    assert found.orientation[0, 3] >= 0


def test_quaternions_of_norm_zero_are_refused_five_of_them_shown() -> None:
    columns = table(9, a=0.0, b=0.0, c=0.0, d=0.0)
    columns["d"][1] = 1.0
    _, faults = pose_track(columns, device(quaternion=list("abcd")), "t.csv")
    rule = "must be a quaternion of norm 1 (columns a b c d)"
    expected = [f"t.csv: row {i}: {rule} (got 'norm 0')" for i in (0, 2, 3, 4, 5)]
    assert [str(fault) for fault in faults] == [*expected, f"t.csv: and 3 more rows: {rule}"]


def test_a_matrix_that_is_no_rotation_is_refused() -> None:
    mirror = {f"m{i}": -1.0 if i % 4 == 0 else 0.0 for i in range(9)}
    _, faults = pose_track(table(**mirror), device(matrix=[f"m{i}" for i in range(9)]), "t.csv")
    assert str(faults[0]).startswith("t.csv: row 0: must be a rotation matrix (columns m0 ... m8) (got [-1.0,")
    assert len(faults) == 2


def test_numbers_that_are_not_finite_are_named_by_row_and_column() -> None:
    columns = table(3)
    columns["y"][1] = np.nan
    columns["z"][2] = np.inf
    assert [str(fault) for fault in finite_faults(columns, "t.csv")] == [
        "t.csv: row 1, column y: must be finite (got nan)",
        "t.csv: row 2, column z: must be finite (got inf)",
    ]


def test_likely_wrong_units_are_told() -> None:
    columns = table(3, g=40.0, r=90.0)
    columns["x"] += [0.0, 0.1, 0.2]
    layout = device({"position": "mm"}, gripper="g", euler=["r"], euler_axes="z")
    assert unit_doubts(columns, layout) == [
        "MTML moves within 0.2 mm, taken for mm: are these other units?",
        "MTML has angles up to 90 rad in column r: are these degrees?",
        "MTML has angles up to 40 rad in column g: are these degrees?",
    ]
    assert unit_doubts(table(3, g=3.0), device(gripper="g")) == []


@pytest.mark.parametrize(
    ("names", "order", "told"),
    [
        (["q_RS_w []", "q_RS_x []", "q_RS_y []", "q_RS_z []"], "xyzw", "wxyz"),
        (["qx", "qy", "qz", "qw"], "wxyz", "xyzw"),
        (["q_RS_w []", "q_RS_x []", "q_RS_y []", "q_RS_z []"], "wxyz", ""),
        (["orientation_x", "orientation_y", "orientation_z", "orientation_w"], "xyzw", ""),
        (["a", "b", "c", "d"], "xyzw", ""),
    ],
)
def test_names_that_tell_another_order_of_a_quaternion_are_told(names: list[str], order: str, told: str) -> None:
    columns = table(3) | {name: np.full(3, 0.5) for name in names}
    found = unit_doubts(columns, device(quaternion=names, quaternion_order=order))
    assert [f"named {told}: quaternion_order?" in text for text in found] == ([True] if told else [])


def test_a_device_that_follows_repeats_positions_by_its_gain() -> None:
    found = following(track(device()), 0.5)
    assert found.position_m.tolist() == [[0.5, 1.0, 1.5]] * 2


def test_resampling_keeps_lines_straight_and_rotations_even() -> None:
    t_s = np.array([0.0, 0.02, 0.05, 0.06, 0.1])
    half = 1.5 * t_s / 2  # a turn about z at 1.5 rad/s
    turns = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)
    track = PoseTrack(np.outer(t_s, [1.0, -2.0, 0.5]), turns, 3.0 * t_s)
    at_s = np.array([0.0, 0.01, 0.055, 0.1])
    found = resampled(track, t_s, at_s)
    assert found.position_m == pytest.approx(np.outer(at_s, [1.0, -2.0, 0.5]))
    assert found.gripper_rad == pytest.approx(3.0 * at_s)
    assert found.orientation[:, 2] == pytest.approx(np.sin(0.75 * at_s))


@given(st.integers(20, 2000), st.integers(10, 500))
def test_resampled_rows_lie_within_the_recording(table_hz: int, rate_hz: int) -> None:
    clock, _ = row_clock(np.arange(3 * table_hz) / table_hz, "t.csv", "time_s")
    assert clock is not None
    play, faults = played(clock, rate_hz, resample=25, gaps="refuse", where="t.csv")
    assert faults == []
    if play.at_s is not None:
        assert play.at_s[-1] <= clock.t_s[-1] < play.at_s[-1] + 1.001 / rate_hz
