"""Emergency stops on the wire: the request to stop or to release, and the arms' state, which answers it."""

import hashlib
from typing import Annotated, Final, Literal

from pydantic import Field

from tis.common.messages import Message

N_NUMBERS: Final = 1 << 53
"""Numbers of requests are below this: a float of 64 bits, as JSON's readers use it, holds them exactly."""

LATCH: Final = N_NUMBERS - 1
"""Names no stop, but the latch of an arm that is safe (`patient.safety.latch`), in a release."""

MAX_IN_FORCE: Final = 64
"""Stops that are in force each for itself. Those beyond are in force as one more, under one number."""

MAX_REASONS: Final = 8
MAX_REASON_CHARS: Final = 40
"""Reasons of stops in an answer, and characters of each: a flood of stops must not make long answers."""

ReleaseRule = Literal["anyone", "stopper", "named"]
"""Right to end a stop: of everybody who names it, of the owner of its secret, or of those whom the scenario names."""

StopRefusal = Literal[
    "", "wrong secret", "no such stop in force", "too many releases", "ended before", "not on this key"
]
"""Reason for which a request is not carried out; "": it is, or it asks for nothing."""

_Number = Annotated[int, Field(ge=0, lt=N_NUMBERS)]


class EmergencyStop(Message):
    """A request to stop the arms now, or to end one stop; one that ends none asks for the state."""

    stop: bool = Field(strict=True, description="true: stop; false: release.")
    reason: str = Field("", max_length=200, description="Text for the log.")
    number: _Number = Field(0, description="Number of the request, by which its answer is known.")
    lock: str = Field(
        "",
        pattern=r"^([0-9a-f]{64})?$",
        description="In a stop: SHA-256 of a secret that only the stopper knows, in hex; empty: none.",
    )
    ends: _Number = Field(0, description="In a release: number of the stop that it ends; 0: it ends none, and asks.")
    secret: str = Field("", max_length=64, description="In a release: the secret of that stop.")


class StopState(Message):
    """The state of the arms when a request was read; it answers the request, whether carried out or not."""

    number: _Number = Field(description="Number of the request.")
    stop: bool = Field(strict=True, description="true: the arms are stopped; false: they are not.")
    led_by: _Number = Field(description="Number of the request that last stopped or released them; 0: none did.")
    under: _Number = Field(description="Number under which the requested stop is in force; 0: it is not.")
    in_force: Annotated[tuple[_Number, ...], Field(max_length=MAX_IN_FORCE + 1)] = Field(
        description="Numbers of the stops in force, the oldest first."
    )
    reasons: Annotated[
        tuple[Annotated[str, Field(max_length=MAX_REASON_CHARS)], ...], Field(max_length=MAX_REASONS)
    ] = Field(description="Beginnings of the reasons of the first of them.")
    latched: bool = Field(strict=True, description="true: an arm stands until a release ends its latch.")
    shared: bool = Field(
        False, strict=True, description="true: ``under`` is in force for all stops beyond 64, and has no secret."
    )
    release: ReleaseRule = Field(description="Who may release: anyone, stopper or named.")
    refused: StopRefusal = Field(description="Why the request was not carried out; empty: it was, or it asked only.")


def lock_of(secret: str) -> str:
    """Return the lock of a stop whose secret this is: SHA-256 of its UTF-8, in hex."""
    return hashlib.sha256(secret.encode()).hexdigest()
