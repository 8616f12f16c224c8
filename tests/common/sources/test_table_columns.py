from typing import Any

import pytest

from tis.common.errors import DataError
from tis.common.scenario.table_source import TableSource
from tis.common.sources.table_columns import canonical_names, layout_of

USUAL = ["time_s", *canonical_names("MTML"), *canonical_names("PSM2")]


def source(**fields: Any) -> TableSource:
    return TableSource.model_validate({"kind": "table", "path": "t.csv", **fields})


def test_the_usual_table_needs_no_map() -> None:
    layout = layout_of(source(), USUAL, "t.csv")
    [hand] = layout.hands
    assert (layout.time, layout.time_unit, hand.hand, hand.arm, hand.gain) == ("time_s", "s", "left", "PSM2", 1.0)
    assert list(layout.names) == [
        "time_s", "MTML_x_m", "MTML_y_m", "MTML_z_m", "MTML_qx", "MTML_qy", "MTML_qz", "MTML_qw", "MTML_gripper_rad",
        "PSM2_x_m", "PSM2_y_m", "PSM2_z_m", "PSM2_qx", "PSM2_qy", "PSM2_qz", "PSM2_qw", "PSM2_gripper_rad",
    ]  # fmt: skip


def test_canonical_columns_of_one_device_are_enough() -> None:
    [hand] = layout_of(source(), ["time_s", *canonical_names("PSM2")], "t.csv").hands
    assert hand.master is None
    assert hand.follower is not None
    [hand] = layout_of(source(), ["time_s", "MTML_x_m", "MTML_y_m", "MTML_z_m"], "t.csv").hands
    assert hand.follower is None
    assert hand.master is not None
    assert hand.master.names == ("MTML_x_m", "MTML_y_m", "MTML_z_m")  # orientation and gripper are optional


def test_a_prefix_of_an_arm_names_the_arm_that_is_driven() -> None:
    columns = {"left": {"master": "leader", "arm": "PSM1"}}
    names = ["time_s", "leader_x_m", "leader_y_m", "leader_z_m", *canonical_names("PSM1")]
    [hand] = layout_of(source(columns=columns), names, "t.csv").hands
    assert hand.arm == "PSM1"


def test_columns_of_the_users_own_names() -> None:
    master = {"position": ["x", "y", "z"], "euler": ["r", "p", "w"], "units": {"position": "mm", "angle": "deg"}}
    layout = layout_of(
        source(columns={"time": "t", "left": {"master": master, "gain": 0.5}}, units={"time": "ms"}),
        ["t", "x", "y", "z", "r", "p", "w", "note"],
        "t.csv",
    )
    assert (layout.time, layout.time_unit, layout.hands[0].gain) == ("t", "ms", 0.5)
    assert layout.names == ("t", "x", "y", "z", "r", "p", "w")


@pytest.mark.parametrize(
    ("fields", "names", "expected"),
    [
        (
            {},
            ["time_s", "MTML_x_mm", "MTML_y_m", "MTML_z_m"],
            ["t.csv: has no column MTML_x_m; its columns: time_s, MTML_x_mm, MTML_y_m, MTML_z_m; did you mean "
             "MTML_x_mm for MTML_x_m?; source.columns names those to read"],
        ),
        (
            {},
            ["time_s", "MTML_x_m", "MTML_y_m", "MTML_z_m", "MTML_x_m", "MTML_qw"],
            ["t.csv: column MTML_x_m: must be there once (got 2)",
             "t.csv: has no column MTML_qx, MTML_qy, MTML_qz; its columns: time_s, MTML_x_m, MTML_y_m, MTML_z_m, "
             "MTML_x_m, MTML_qw; did you mean MTML_qw for MTML_qx, MTML_qw for MTML_qy, MTML_qw for MTML_qz?; "
             "source.columns names those to read"],
        ),
        (
            {},
            ["PSM2_x_m", "PSM2_y_m", "PSM2_z_m"],
            ["t.csv: has no column time_s: set source.columns.time to the time's column, or source.rate_hz to its "
             "rows per s; its columns: PSM2_x_m, PSM2_y_m, PSM2_z_m"],
        ),
    ],
)  # fmt: skip
def test_missing_and_repeated_columns_are_told_at_once(
    fields: dict[str, Any], names: list[str], expected: list[str]
) -> None:
    with pytest.raises(DataError) as caught:
        layout_of(source(**fields), names, "t.csv")
    assert [str(fault) for fault in caught.value.faults] == expected
