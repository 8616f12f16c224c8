"""What a run writes, decoded by the models that it states: a number that is not finite would be null there."""

from pathlib import Path

from tests.every_message import every_message
from tests.log_reader import LogReader
from tis.common.messages import decode


def test_every_record_of_a_run_is_one_of_its_model(run_dir: Path) -> None:
    models = {f"tis.{model.__name__}": model for model in every_message()}
    decoded = set()
    for side in ("surgeon", "netem", "patient", "run"):
        log = LogReader(run_dir / f"{side}.mcap")
        for _, message in log.messages():
            schema = log.schemas.get(log.channels[message.channel_id].schema_id)
            if schema is not None and schema.name in models:
                decode(message.data, models[schema.name])
                decoded.add(schema.name)
    assert len(decoded) > 15
