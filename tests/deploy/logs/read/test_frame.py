"""Records kept as columns, against the same records as plain dicts, and columns of integers against lists."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import to_builtins

from tis.common.messages import MAX_SIZE, Quaternion, Vector3, encode
from tis.common.records import (
    ESTIMATES,
    FRESH,
    ORIENTATIONS,
    TICKS,
    EstimateNote,
    FreshNote,
    OrientationNote,
)
from tis.common.safety_records import STOPS, StopNote
from tis.deploy.logs.read.columns import IntColumn
from tis.deploy.logs.read.frame import Frame

INTS = st.integers(-(2**62), 2**62)
FLOATS = st.floats(-MAX_SIZE, MAX_SIZE)
POINTS = st.none() | st.builds(Vector3, x=FLOATS, y=FLOATS, z=FLOATS)
HANDS = st.sampled_from(["left", "right"])
ESTIMATE = st.builds(EstimateNote, tick=INTS, t_ns=INTS, hand=HANDS, estimator=st.text(max_size=5),
                     position_m=POINTS, std_m=POINTS, step_ns=INTS)  # fmt: skip
FRESH_NOTE = st.builds(FreshNote, tick=INTS, hand=HANDS, key=st.sampled_from("ab"), seq=INTS, sample_ns=INTS,
                       answer=st.none() | INTS)  # fmt: skip
TURNS = st.none() | st.builds(Quaternion, x=FLOATS, y=FLOATS, z=FLOATS, w=FLOATS)
ORIENTATION = st.builds(OrientationNote, tick=INTS, t_ns=INTS, hand=HANDS, method=st.text(max_size=5),
                        orientation=TURNS, std_rad=POINTS, gripper_rad=st.none() | FLOATS,
                        gripper_std_rad=st.none() | FLOATS, step_ns=INTS)  # fmt: skip


@settings(max_examples=40)
@given(
    st.lists(ESTIMATE, max_size=8) | st.lists(FRESH_NOTE, max_size=8) | st.lists(ORIENTATION, max_size=8),
    st.integers(1, 3),
)
def test_rows_come_back_as_they_went_in(
    notes: list[EstimateNote] | list[FreshNote] | list[OrientationNote], at_once: int
) -> None:
    topic = next((one for one in (FRESH, ORIENTATIONS) if notes and one.model is type(notes[0])), ESTIMATES)
    expected = [json.loads(encode(note).decode()) for note in notes]
    rows = Frame.of(topic)
    for first in range(0, len(expected), at_once):
        rows.extend(expected[first : first + at_once])
    assert list(rows) == expected
    assert rows == expected
    assert [rows[i] for i in range(-len(expected), 0)] == expected
    assert rows[1:3] == expected[1:3]
    assert len(rows) == len(expected)
    for name in ("tick", "hand"):
        assert rows.column(name).tolist() == [row[name] for row in expected]
    assert rows.where("hand", "left").tolist() == [row["hand"] == "left" for row in expected]


def test_points_and_flags_are_arrays() -> None:
    rows = Frame.of(ESTIMATES)
    where = {"x": 1.0, "y": 2.0, "z": 3.0}
    row = {"tick": 0, "t_ns": 0, "hand": "left", "estimator": "hold", "std_m": None, "step_ns": 0}
    rows.extend([{**row, "position_m": where}, {**row, "position_m": None}])
    assert rows.column("position_m").tolist()[0] == [1.0, 2.0, 3.0]
    assert np.isnan(rows.column("position_m")[1]).all()
    ticks = Frame.of(TICKS)
    ticks.extend([{"tick": 0, "due_ns": 1, "begin_ns": 2, "missed": True}])
    assert ticks.column("missed").tolist() == [True]
    moved = ticks.with_columns(due_ns=np.array([7]))
    assert moved[0] == {"tick": 0, "due_ns": 7, "begin_ns": 2, "missed": True}
    assert ticks[0]["due_ns"] == 1


def test_quaternions_and_numbers_are_arrays() -> None:
    rows = Frame.of(ORIENTATIONS)
    row = {"tick": 0, "t_ns": 0, "hand": "left", "method": "hold", "std_rad": None, "gripper_std_rad": None}
    turn = {"x": 0.5, "y": -0.5, "z": 0.5, "w": 0.5}
    rows.extend(
        [{**row, "orientation": turn, "gripper_rad": 0.25}, {**row, "orientation": None, "gripper_rad": None}]
    )
    assert rows.column("orientation").tolist()[0] == [0.5, -0.5, 0.5, 0.5]
    assert np.isnan(rows.column("orientation")[1]).all()
    assert rows.column("gripper_rad")[0] == 0.25
    assert np.isnan(rows.column("gripper_rad")[1])
    assert np.isnan(rows.column("gripper_std_rad")).tolist() == [True, True]


def test_fields_that_an_older_log_lacks_have_their_defaults() -> None:
    rows = Frame.of(FRESH)
    rows.extend([{"tick": 3, "hand": "left", "key": "k", "seq": 4, "sample_ns": 5}])
    assert rows[0]["answer"] is None


def test_records_of_another_version_are_refused_and_none_is_half_taken() -> None:
    rows = Frame.of(TICKS)
    with pytest.raises(LookupError):
        rows.extend([{"tick": 0, "due": 1}])
    assert len(rows) == 0
    with pytest.raises(IndexError):
        rows[0]


def test_records_of_no_known_topic_keep_their_fields() -> None:
    rows = Frame.of(None)
    rows.extend([{"a": 1}])
    rows.extend([{"a": "x", "b": None}, {}])
    assert rows == [{"a": 1, "b": None}, {"a": "x", "b": None}, {"a": None, "b": None}]
    assert rows.names == ("a", "b")


def test_texts_of_frequent_records_are_short_and_few() -> None:
    note = {"tick": 0, "hand": "left", "seq": 0, "sample_ns": 0, "answer": None}
    for keys in (["k" * 257], [str(k) for k in range(1 << 15)]):
        with pytest.raises(ValueError, match="must have at most"):
            Frame.of(FRESH).extend([{**note, "key": key} for key in keys])


def test_optional_flags_and_long_texts_of_rare_records() -> None:
    rows = Frame.of(STOPS)
    stop = StopNote(at_ns=1, stop=True, reason="r" * 200)
    release = StopNote(at_ns=2, stop=False, reason="", by_stopper=False, stopped=True)
    rows.extend([to_builtins(stop), to_builtins(release)])
    assert rows == [to_builtins(stop), to_builtins(release)]
    assert rows[0]["by_stopper"] is None
    assert rows[1]["by_stopper"] is False


def test_a_selection_has_the_same_columns() -> None:
    ticks = Frame.of(TICKS)
    ticks.extend([{"tick": k, "due_ns": 10 * k, "begin_ns": 10 * k + 1, "missed": k == 2} for k in range(4)])
    begun = ticks.at(~ticks.missed)
    assert begun.tick.tolist() == [0, 1, 3]
    assert begun == [row for row in ticks if not row["missed"]]
    assert ticks.at(ticks.tick >= 0) is ticks
    with pytest.raises(AttributeError, match="tack"):
        ticks.tack  # noqa: B018


STEPS = st.sampled_from([0, 1, 300, 70_000, 2**33, 2**50])
ANY_INTS = st.integers(-(2**63), 2**63 - 1)


@settings(max_examples=25)
@given(st.lists(st.tuples(ANY_INTS, STEPS, st.integers(0, 5000)), max_size=5))
def test_integers_that_go_in_come_out(runs: list[tuple[int, int, int]]) -> None:
    column, expected = IntColumn(), []
    for first, step, n in runs:
        values = [max(min(first + i * step, 2**63 - 1), -(2**63)) for i in range(n)]
        column.extend(np.array(values, dtype=np.int64))
        column.extend(np.array([first]))
        expected += [*values, first]
    assert column.array().tolist() == expected
    assert column.array().dtype == np.int64
    assert len(column) == len(expected)
    for i in range(0, len(expected), 997):
        assert column.plain(i, i + 1) == expected[i : i + 1]
    assert column.plain(3, len(expected)) == expected[3:]


def test_what_is_read_is_a_copy() -> None:
    column = IntColumn()
    column.extend(range(10_000))
    column.array()[:] = -1
    assert column.array().tolist() == list(range(10_000))


@pytest.mark.parametrize("value", ["1", None, 2**62 + 1, 2**63])
def test_what_is_no_integer_of_a_log_is_refused(value: object) -> None:
    with pytest.raises((TypeError, ValueError, OverflowError)):
        IntColumn().extend([value])
