"""Checks of rare records, which are kept as rows."""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, Final

from pydantic import TypeAdapter

from tis.common.devices.records import DEVICES, DeviceNote
from tis.common.host_records import (
    CLOCK,
    DISCIPLINE,
    EXCHANGES,
    PROCESSORS,
    ClockNote,
    DisciplineNote,
    ExchangeNote,
    ProcessorNote,
)
from tis.common.messages import Message
from tis.common.metrics.processor_shares import numbers_of
from tis.common.records import (
    CONTROL,
    COUNTERS,
    ESTIMATOR_FAULTS,
    PEERS,
    PHASES,
    QUEUES,
    REJECTED,
    ControlNote,
    CounterNote,
    EstimatorFault,
    PeerNote,
    PhaseNote,
    QueueNote,
    Rejected,
)
from tis.common.safety_records import (
    QUARANTINE,
    SAFETY,
    STOPS,
    STOPS_IN_FORCE,
    QuarantineNote,
    SafetyNote,
    StopNote,
    StopsInForceNote,
)
from tis.deploy.logs.json_rows import Row, checked_number

_MODELS: Final[Mapping[str, type[Message]]] = {
    CLOCK: ClockNote,
    CONTROL: ControlNote,
    DEVICES: DeviceNote,
    COUNTERS: CounterNote,
    DISCIPLINE: DisciplineNote,
    ESTIMATOR_FAULTS: EstimatorFault,
    EXCHANGES: ExchangeNote,
    PEERS: PeerNote,
    PHASES: PhaseNote,
    PROCESSORS: ProcessorNote,
    QUEUES: QueueNote,
    QUARANTINE: QuarantineNote,
    REJECTED: Rejected,
    SAFETY: SafetyNote,
    STOPS: StopNote,
    STOPS_IN_FORCE: StopsInForceNote,
}


def check_rows(topic: str, rows: Sequence[Row]) -> None:
    """Raise `ValueError` for rows that are not of their topic's model, or of an unknown topic and not flat."""
    if topic in _MODELS:
        _validator(_MODELS[topic]).validate_python(rows, strict=True)
    if topic == PROCESSORS:
        for row in rows:
            numbers_of(row["processors"])
    for row in rows:
        for value in row.values():
            if isinstance(value, dict | list):
                raise ValueError("a record is not flat")
            if type(value) is int:
                checked_number(value)


@cache
def _validator(model: type[Message]) -> TypeAdapter[Any]:
    return TypeAdapter(list[model])  # type: ignore[valid-type]
