"""Records kept as columns, against the same records as plain dicts."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.messages import MAX_SIZE, Quaternion, Vector3
from tis.common.records import (
    ESTIMATES,
    FRESH,
    ORIENTATIONS,
    TICKS,
    EstimateNote,
    FreshNote,
    OrientationNote,
    TickNote,
)
from tis.deploy.logs.read.rows import Rows, column_model

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
    model = type(notes[0]) if notes else EstimateNote
    expected = [json.loads(note.model_dump_json()) for note in notes]
    rows = Rows(model)
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
    rows = Rows(EstimateNote)
    where = {"x": 1.0, "y": 2.0, "z": 3.0}
    row = {"tick": 0, "t_ns": 0, "hand": "left", "estimator": "hold", "std_m": None, "step_ns": 0}
    rows.extend([{**row, "position_m": where}, {**row, "position_m": None}])
    assert rows.column("position_m").tolist()[0] == [1.0, 2.0, 3.0]
    assert np.isnan(rows.column("position_m")[1]).all()
    ticks = Rows(TickNote)
    ticks.append({"tick": 0, "due_ns": 1, "begin_ns": 2, "missed": True})
    assert ticks.column("missed").tolist() == [True]
    moved = ticks.with_columns({"due_ns": np.array([7])})
    assert moved[0] == {"tick": 0, "due_ns": 7, "begin_ns": 2, "missed": True}
    assert ticks[0]["due_ns"] == 1


def test_quaternions_and_numbers_are_arrays() -> None:
    rows = Rows(OrientationNote)
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
    rows = Rows(FreshNote)
    rows.append({"tick": 3, "hand": "left", "key": "k", "seq": 4, "sample_ns": 5})
    assert rows[0]["answer"] is None


def test_records_of_another_version_are_refused_and_none_is_half_taken() -> None:
    rows = Rows(TickNote)
    with pytest.raises(LookupError):
        rows.append({"tick": 0, "due": 1})
    assert len(rows) == 0
    with pytest.raises(IndexError):
        rows[0]


def test_only_flat_models_are_kept_as_columns() -> None:
    assert column_model(TICKS) is TickNote
    assert column_model(f"{ESTIMATES}/hold") is EstimateNote
    assert column_model(f"{ORIENTATIONS}/hold") is OrientationNote
    assert column_model(FRESH) is FreshNote
    assert column_model("/tis/counters") is None
