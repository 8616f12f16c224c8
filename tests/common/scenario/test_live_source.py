from typing import Any

import pytest

from tis.common.errors import InputError
from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario

LIVE: dict[str, Any] = {
    "version": 1,
    "name": "a",
    "source": {"kind": "live"},
    "patient": {"plant": {"kind": "servo"}},
    "identification": {"train": "synthetic"},
}


def build(**changes: Any) -> Scenario:
    return build_scenario(LIVE | changes, "s.yaml")


def rules(**changes: Any) -> list[str]:
    with pytest.raises(InputError) as refused:
        build(**changes)
    return [str(fault) for fault in refused.value.faults]


def test_a_live_source_needs_a_plant_and_a_training_without_a_recording() -> None:
    found = rules(patient={}, identification={})
    assert len(found) == 2
    assert "patient.plant.kind must not be replay with a live source" in found[0]
    assert "identification.train must be synthetic or a model file with a live source" in found[1]


@pytest.mark.parametrize("train", ["own_head", "others"])
def test_a_live_source_has_no_rows_to_train_on(train: str) -> None:
    assert "must be synthetic or a model file" in rules(identification={"train": train})[0]


def test_a_model_file_serves_a_live_source() -> None:
    assert build(identification={"train": "m.json"}).identification.train == "m.json"


def test_synthetic_training_belongs_to_a_live_source() -> None:
    found = rules(source={"kind": "synthetic"}, patient={})
    assert len(found) == 1
    assert found[0].startswith("s.yaml: identification.train can be synthetic with a live source only")


def test_an_external_plant_needs_set_points() -> None:
    external = {"plant": {"kind": "external"}}
    assert build(patient=external).patient.plant.kind == "external"
    assert "must be true with an external plant" in rules(patient=external | {"safety": {"enabled": False}})[0]


@pytest.mark.parametrize(
    ("source", "rule"),
    [
        ({"keys": {"left": "tis/MTML/measured_cp"}}, "must not begin with tis/"),
        ({"keys": {"left": "**"}}, "must be one Zenoh key"),
        ({"keys": {"left": "a//b"}}, "no empty chunk"),
        ({"keys": {"left": "a/@tis/b"}}, "@tis"),
        ({"keys": {"left": "same", "right": "same"}}, "keys must differ"),
        ({"hands": ["left", "left"]}, "at most once"),
        ({"hands": []}, "at least 1 item"),
        ({"scale": 0}, "at least 0.01"),
        ({"max_speed_mm_s": 0}, "greater than 0"),
        ({"silent_after_ms": 0}, "greater than 0"),
        ({"encoding": "protobuf"}, "must be 'json' or 'ros2'"),
        ({"rotation_deg": [0, 0]}, "rotation_deg"),
        ({"encoding": "ros2", "keys": {"left": "**"}}, "must not begin with tis/"),
    ],
)
def test_what_a_live_source_refuses(source: dict[str, Any], rule: str) -> None:
    assert any(rule in fault for fault in rules(source=LIVE["source"] | source))


def test_a_ros_topic_may_leave_its_type_open() -> None:
    key = "0/device/left/*/*"
    assert build(source={"kind": "live", "encoding": "ros2", "keys": {"left": key}}).source.kind == "live"


def test_places_are_in_metres_for_the_nodes() -> None:
    source = build().source
    assert source.kind == "live"
    assert source.master_at_mm.of_m("left") == (0.1, -0.05, 0.35)
    assert source.arm_at_mm.of_m("right") == (0.0, 0.025, -0.025)
