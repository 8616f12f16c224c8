"""The schemas of messages and records."""

from tis.common import messages, records
from tis.common.runtime.json_schema import flat_schema, prepare_schemas


def test_no_schema_is_left_to_be_worked_out_in_a_run() -> None:
    for module in (messages, records):
        prepare_schemas(module)
    before = flat_schema.cache_info().misses
    for model in (messages.Pose, messages.FeedbackPose, records.TickNote, records.EstimateNote, records.FateBatch):
        flat_schema(model)
    assert flat_schema.cache_info().misses == before
