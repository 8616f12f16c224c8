"""Derived records of a merged file, for plots: errors, ages and delays."""

from tis.common.channels import Direction
from tis.common.messages import Message


class ErrorSample(Message):
    """How far an estimate is from truth at its tick (truth interpolated between samples), to 0.1 um."""

    error_mm: float


class TurnErrorSample(Message):
    """The angle between an estimated orientation and the true one at its tick."""

    error_deg: float


class AgeSample(Message):
    """The age at a tick: its instant minus that of the freshest sample, clocks aligned."""

    age_ms: float


class DelaySample(Message):
    """One message's way from sending to arrival, clocks aligned."""

    direction: Direction
    key: str
    seq: int
    delay_ms: float
