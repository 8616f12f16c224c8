"""The schemas of messages and records."""

import json
from collections.abc import Iterator
from typing import Any

import pytest

from tests.every_message import every_message
from tis.common import messages, records
from tis.common.runtime.mcap_log import flat_schema, prepare_schemas


def test_no_schema_is_left_to_be_worked_out_in_a_run() -> None:
    for module in (messages, records):
        prepare_schemas(module)
    before = flat_schema.cache_info().misses
    for model in (messages.Pose, messages.FeedbackPose, records.TickNote, records.EstimateNote, records.FateBatch):
        flat_schema(model)
    assert flat_schema.cache_info().misses == before


def _schemas(node: Any) -> Iterator[dict[str, Any]]:
    """Yield the schemas of the fields of an object, and those within them."""
    for schema in node.get("properties", {}).values():
        yield schema
        yield from _schemas(schema)
    if isinstance(node.get("items"), dict):
        yield node["items"]
        yield from _schemas(node["items"])


@pytest.mark.parametrize("model", every_message())
def test_a_viewer_finds_the_type_of_every_field(model: type[messages.Message]) -> None:
    """Foxglove refuses a schema with a field that states none."""
    schema = json.loads(flat_schema(model))
    assert schema["title"] == model.__name__
    assert schema["type"] == "object"
    assert all(isinstance(field["type"], str) for field in _schemas(schema))


def test_a_field_and_a_model_are_described_as_in_the_code() -> None:
    schema = json.loads(flat_schema(messages.SampledPose))
    assert schema["description"].endswith("\n\nWithout a history the payload holds the fields of `Pose` only.")
    assert schema["properties"]["position_m"]["description"] == "Position of the tool tip, in m."
    assert schema["properties"]["position_m"]["properties"]["x"]["description"] == "Component along x."
    assert json.loads(flat_schema(records.TruthRow))["properties"]["hand"] == {
        "description": "Hand whose arm is concerned.", "enum": ["left", "right"], "type": "string",
    }  # fmt: skip
