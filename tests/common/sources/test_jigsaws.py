import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.common.sources.trials import FIRST, rows_of, text_of
from tis.common.errors import DataError
from tis.common.sources.jigsaws import COLUMNS, parse_trial, pose_track, position_m

REAL = {
    "Knot_Tying_C002": 1068,
    "Knot_Tying_D004": 1049,
    "Needle_Passing_D003": 3234,
    "Needle_Passing_E001": 3256,
    "Suturing_C004": 2479,
    "Suturing_D002": 2214,
    "Suturing_E003": 2605,
    "Suturing_F003": 2265,
}

numbers = st.floats(-1e6, 1e6, allow_nan=False, width=64)


def faults_of(text: str) -> list[str]:
    with pytest.raises(DataError) as caught:
        parse_trial(text, "T.txt")
    return str(caught.value).splitlines()


def counting_text(n_rows: int) -> list[list[str]]:
    """Return tokens in which line i (0-based), column c (0-based) reads 100 i + c."""
    return [[str(100 * i + c) for c in range(76)] for i in range(n_rows)]


def joined(tokens: list[list[str]]) -> str:
    return "\n".join(" ".join(line) for line in tokens) + "\n"


def test_the_columns_are_those_of_the_description() -> None:
    rows = parse_trial(joined(counting_text(2)), "T.txt")
    assert rows.shape == (2, 76)
    # 1-based: positions 1-3, 20-22, 39-41, 58-60; rotations from 4, 23, 42, 61; grippers 19, 38, 57, 76
    read = {
        device: (
            [int(v) + 1 for v in rows[0, columns.position]],
            [int(rows[0, columns.rotation][0]) + 1, int(rows[0, columns.rotation][-1]) + 1],
            int(rows[0, columns.gripper]) + 1,
        )
        for device, columns in COLUMNS.items()
    }
    assert read == {
        "MTML": ([1, 2, 3], [4, 12], 19),
        "MTMR": ([20, 21, 22], [23, 31], 38),
        "PSM1": ([39, 40, 41], [42, 50], 57),
        "PSM2": ([58, 59, 60], [61, 69], 76),
    }
    assert position_m(rows, "PSM1")[1].tolist() == [138.0, 139.0, 140.0]


@settings(max_examples=25, deadline=None)
@given(arrays(np.float64, st.tuples(st.integers(2, 4), st.just(76)), elements=numbers))
def test_what_is_written_in_full_is_read_back_exactly(
    rows: np.ndarray[tuple[int, int], np.dtype[np.float64]],
) -> None:
    text = "\n".join("\t".join(repr(float(value)) for value in row) for row in rows)
    assert np.array_equal(parse_trial(text, "T.txt"), rows)


def test_the_files_own_format_is_read_to_its_eight_decimals() -> None:
    rows = rows_of(50)
    text = text_of(rows)
    assert np.abs(parse_trial(text, "T.txt") - rows).max() <= 0.5e-8
    assert np.array_equal(parse_trial(text, "T.txt"), np.loadtxt(text.splitlines()))
    assert np.array_equal(parse_trial(text.replace("\n", "\r\n") + "\n \n", "T.txt"), parse_trial(text, "T.txt"))


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (lambda t: t[2].pop(), ["T.txt: line 3: must have 76 columns (got 75)"]),
        (lambda t: t[0].append("1"), ["T.txt: line 1: must have 76 columns (got 77)"]),
        (lambda t: t[1].clear(), ["T.txt: line 2: must have 76 columns (got 0)"]),
        (lambda t: t[3].__setitem__(7, "abc"), ["T.txt: line 4, column 8: must be a number (got 'abc')"]),
        (lambda t: t[3].__setitem__(0, "1_0"), ["T.txt: line 4, column 1: must be a number (got '1_0')"]),
        (lambda t: t[3].__setitem__(75, "NaN"), ["T.txt: line 4, column 76: must be finite (got 'NaN')"]),
        (lambda t: t[1].__setitem__(4, "-inf"), ["T.txt: line 2, column 5: must be finite (got '-inf')"]),
        (lambda t: t[1].__setitem__(4, "1e999"), ["T.txt: line 2, column 5: must be finite (got '1e999')"]),
        (
            lambda t: t[1].__setitem__(slice(4, 7), ["nan"] * 3),
            ["T.txt: line 2, column 5 and 2 more: must be finite (got 'nan')"],
        ),
        (lambda t: t.__delitem__(slice(1, None)), ["T.txt: must have at least 2 rows (got 1)"]),
        (lambda t: t.clear(), ["T.txt: is empty, must have lines of 76 numbers"]),
    ],
)
def test_one_fault_is_one_line_that_says_where(
    spoil: Callable[[list[list[str]]], object], expected: list[str]
) -> None:
    tokens = counting_text(5)
    spoil(tokens)
    assert faults_of(joined(tokens)) == expected


def test_all_kinds_of_faults_come_at_once() -> None:
    tokens = counting_text(6)
    tokens[0].pop()
    tokens[0][3] = "x"
    tokens[4][9] = "nan"
    assert faults_of(joined(tokens)) == [
        "T.txt: line 1: must have 76 columns (got 75)",
        "T.txt: line 1, column 4: must be a number (got 'x')",
        "T.txt: line 5, column 10: must be finite (got 'nan')",
    ]
    assert faults_of("1 2 x") == [
        "T.txt: line 1: must have 76 columns (got 3)",
        "T.txt: line 1, column 3: must be a number (got 'x')",
        "T.txt: must have at least 2 rows (got 1)",
    ]


@settings(max_examples=20, deadline=None)
@given(n_bad=st.integers(1, 12))
def test_five_lines_of_a_kind_are_shown_and_the_rest_counted(n_bad: int) -> None:
    tokens = counting_text(13)
    for line in tokens[:n_bad]:
        line.pop()
    found = faults_of(joined(tokens))
    shown = [text for text in found if re.match(r"T\.txt: line \d+: must have 76 columns \(got 75\)$", text)]
    rest = [text for text in found if text not in shown]
    assert len(shown) == min(n_bad, 5)
    assert rest == ([f"T.txt: and {n_bad - 5} more lines: must have 76 columns"] if n_bad > 5 else [])


def test_a_file_of_another_layout_is_one_fault() -> None:
    tokens = counting_text(12)
    for line in tokens:
        line.pop()
    assert faults_of(joined(tokens)) == ["T.txt: all 12 lines: must have 76 columns (got 75)"]


@settings(max_examples=30, deadline=None)
@given(
    line=st.integers(0, 4), column=st.integers(0, 75), token=st.text("0123456789.eE+-_naifx", min_size=1, max_size=6)
)
def test_any_token_is_either_read_as_a_finite_number_or_refused_in_place(line: int, column: int, token: str) -> None:
    tokens = counting_text(5)
    tokens[line][column] = token
    if re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", token) and np.isfinite(float(token)):
        assert parse_trial(joined(tokens), "T.txt")[line, column] == float(token)
    else:
        [fault] = faults_of(joined(tokens))
        assert fault.startswith(f"T.txt: line {line + 1}, column {column + 1}: must be ")


def turned(axis: list[float], angle_rad: float) -> tuple[list[float], list[float]]:
    """Return Rodrigues' matrix (9, row major) and the half-angle quaternion x y z w of one rotation."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross
    s = np.sin(angle_rad / 2)
    return matrix.ravel().tolist(), [s * x, s * y, s * z, float(np.cos(angle_rad / 2))]


@settings(max_examples=30, deadline=None)
@given(
    axis=st.lists(st.floats(-1, 1), min_size=3, max_size=3).filter(lambda a: float(np.linalg.norm(a)) > 0.1),
    device=st.sampled_from(sorted(FIRST)),
)
def test_a_full_turn_gives_the_half_angle_quaternion_without_a_change_of_sign(axis: list[float], device: str) -> None:
    angles_rad = np.linspace(0.0, 2 * np.pi, 40)
    rows, expected = rows_of(40), np.empty((40, 4))
    first = FIRST[device]
    for i, angle_rad in enumerate(angles_rad):
        matrix, expected[i] = turned(axis, angle_rad)
        rows[i, first + 3 : first + 12] = np.round(matrix, 6)
    track = pose_track(rows, device, "T.txt")
    # the half-angle quaternion goes on to -1 at the full turn: only the continuous choice follows it
    assert np.abs(track.orientation - expected).max() < 5e-6
    assert np.array_equal(track.position_m, rows[:, first : first + 3])
    assert np.array_equal(track.gripper_rad, rows[:, first + 18])


def test_the_first_quaternion_has_a_positive_w() -> None:
    rows = rows_of(2)
    for i, angle_rad in enumerate((1.5 * np.pi, 1.6 * np.pi)):
        rows[i, 3:12] = turned([0, 0, 1], angle_rad)[0]
    track = pose_track(rows, "MTML", "T.txt")
    assert track.orientation[0] == pytest.approx([0, 0, -np.sin(0.75 * np.pi), -np.cos(0.75 * np.pi)])


def test_velocities_leave_no_trace() -> None:
    rows = rows_of(5)
    spoilt = rows.copy()
    for first in FIRST.values():
        spoilt[:, first + 12 : first + 18] = -7.0
    for device in FIRST:
        one, other = pose_track(rows, device, "T.txt"), pose_track(spoilt, device, "T.txt")
        assert np.array_equal(one.position_m, other.position_m)
        assert np.array_equal(one.orientation, other.orientation)
        assert np.array_equal(one.gripper_rad, other.gripper_rad)


def test_matrices_that_are_no_rotations_are_faults_of_their_device_only() -> None:
    rows = rows_of(10)
    rows[1, 41:50] = 0.0
    rows[2, 41:50] = np.diag([1, 1, -1]).ravel()
    rows[3, 41:50] = 1.02 * np.eye(3).ravel()
    with pytest.raises(DataError) as caught:
        pose_track(rows, "PSM1", "T.txt")
    lines = str(caught.value).splitlines()
    assert lines[0].startswith("T.txt: line 2, columns 42-50 (PSM1): must be a rotation matrix (got [0.0, 0.0, 0.0")
    assert [line.split(",")[0] for line in lines] == [f"T.txt: line {n}" for n in (2, 3, 4)]
    pose_track(rows, "PSM2", "T.txt")
    rows[:, 41:50] = 0.0
    with pytest.raises(DataError) as caught:
        pose_track(rows, "PSM1", "T.txt")
    assert str(caught.value).splitlines()[5:] == ["T.txt: and 5 more lines: must be a rotation matrix"]


@pytest.mark.parametrize("name", sorted(REAL))
def test_real_trials(jigsaws_dir: Path, name: str) -> None:
    file = jigsaws_dir / name[:-5] / "kinematics" / "AllGestures" / f"{name}.txt"
    if not file.is_file():
        pytest.skip(f"no {name} in {jigsaws_dir}")
    rows = parse_trial(file.read_text(), name)
    assert rows.shape == (REAL[name], 76)
    for device in COLUMNS:
        track = pose_track(rows, device, name)
        assert np.abs(np.linalg.norm(track.orientation, axis=1) - 1).max() < 1e-12
        assert np.sum(track.orientation[1:] * track.orientation[:-1], axis=1).min() > 0.9
        # back to matrices by the textbook formula, within what rounding and the masters' skew leave
        x, y, z, w = track.orientation.T
        corner = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)])
        assert np.abs(corner - rows[:, COLUMNS[device].rotation][:, :3]).max() < 2e-3


@pytest.mark.parametrize(("mark", "name"), [(",", "commas"), (";", "semicolons")])
def test_other_marks_than_blanks_between_numbers_are_named(mark: str, name: str) -> None:
    tokens = [["0.5"] * 76 for _ in range(12)]
    rule = f"must have 76 columns, separated by spaces and not by {name} (got 1)"
    assert faults_of("\n".join(mark.join(line) for line in tokens)) == [f"T.txt: all 12 lines: {rule}"]
    assert f"T.txt: line 1: {rule}" in faults_of(mark.join(tokens[0]))


@pytest.mark.parametrize(
    ("text", "rule"),
    [("\n" * 200_000 + "1", "at most 120000 lines"), ("1 " * 9000, "line 1: must have at most 10000")],
)
def test_more_or_longer_lines_than_any_trial_has_are_refused(text: str, rule: str) -> None:
    with pytest.raises(DataError, match=rule):
        parse_trial(text, "a.txt")
