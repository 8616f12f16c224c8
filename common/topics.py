"""All topics of the logs, and the topic of a record by its key.

A topic is declared beside its model, in one of the modules of records.
"""

from collections.abc import Mapping
from types import ModuleType
from typing import Final

from tis.common import device_records, host_records, records, safety_records, sight_records
from tis.common.channels import PREDICTED, SERVO, SHOWN
from tis.common.messages import PredictedPose, SetPoint, ShownForce
from tis.common.topic import Topic

RECORD_MODULES: Final[tuple[ModuleType, ...]] = (
    records,
    device_records,
    host_records,
    safety_records,
    sight_records,
)

TOPICS: Final[Mapping[str, Topic]] = {
    value: value for module in RECORD_MODULES for value in vars(module).values() if isinstance(value, Topic)
}
"""Records beside the messages, by key."""

_POSE: Final = ("sample_ns", "position_m", "hand", "tick")
LOCAL: Final[Mapping[str, Topic]] = {
    SERVO: Topic(
        SERVO,
        SetPoint,
        fields=(*_POSE, "mode"),
        stamps=("sample_ns",),
        is_frequent=True,
        is_recomputable=True,
        table="set_points",
    ),
    PREDICTED: Topic(
        PREDICTED,
        PredictedPose,
        fields=(*_POSE, "shown_tick", "shown_m", "command_ns", "round_trip_ns"),
        stamps=("sample_ns", "command_ns"),
        is_frequent=True,
        table="displays",
    ),
    SHOWN: Topic(
        SHOWN, ShownForce, stamps=("sample_ns", "command_ns"), is_frequent=True, is_recomputable=True, table="forces"
    ),
}
"""Messages that cross no network and are read as records, by the end of their keys."""

_GROUPS: Final = tuple(topic for topic in TOPICS.values() if topic.is_group)


def topic_of(key: str) -> Topic | None:
    """Return the declaration of a record's key; None for a message, and for a record of another version."""
    if not key.startswith("/"):
        _, slash, end = key.rpartition("/")
        return LOCAL.get(end) if slash else None
    return next((group for group in _GROUPS if key.startswith(f"{group}/")), TOPICS.get(key))
