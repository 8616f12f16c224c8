"""Emergency stops on the wire: the request to stop or to release, and the arms' state, which answers it."""

import hashlib
from typing import Annotated, Final, Literal

from msgspec import Meta

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
    "", "wrong secret", "no such stop in force", "too many releases", "ended before", "not on this key", "not signed"
]
"""Reason for which a request is not carried out; "": it is, or it asks for nothing."""

_Number = Annotated[int, Meta(ge=0, lt=N_NUMBERS)]


class EmergencyStop(Message, frozen=True):
    """A request to stop the arms now, or to end one stop; one that ends none asks for the state."""

    stop: Annotated[bool, Meta(description="true: stop; false: release.")]
    reason: Annotated[str, Meta(max_length=200, description="Text for the log.")] = ""
    number: Annotated[_Number, Meta(description="Number of the request, by which its answer is known.")] = 0
    lock: Annotated[
        str,
        Meta(
            pattern=r"^([0-9a-f]{64})?$(?!\n)",
            description="In a stop: SHA-256 of a secret that only the stopper knows, in hex; empty: none.",
        ),
    ] = ""
    ends: Annotated[
        _Number, Meta(description="In a release: number of the stop that it ends; 0: it ends none, and asks.")
    ] = 0
    secret: Annotated[str, Meta(max_length=64, description="In a release: the secret of that stop.")] = ""


class StopState(Message, frozen=True, kw_only=True):
    """The state of the arms when a request was read; it answers the request, whether carried out or not."""

    number: Annotated[_Number, Meta(description="Number of the request.")]
    stop: Annotated[bool, Meta(description="true: the arms are stopped; false: they are not.")]
    led_by: Annotated[
        _Number, Meta(description="Number of the request that last stopped or released them; 0: none did.")
    ]
    under: Annotated[_Number, Meta(description="Number under which the requested stop is in force; 0: it is not.")]
    in_force: Annotated[
        tuple[_Number, ...],
        Meta(max_length=MAX_IN_FORCE + 1, description="Numbers of the stops in force, the oldest first."),
    ]
    reasons: Annotated[
        tuple[Annotated[str, Meta(max_length=MAX_REASON_CHARS)], ...],
        Meta(max_length=MAX_REASONS, description="Beginnings of the reasons of the first of them."),
    ]
    latched: Annotated[bool, Meta(description="true: an arm stands until a release ends its latch.")]
    shared: Annotated[
        bool, Meta(description="true: ``under`` is in force for all stops beyond 64, and has no secret.")
    ] = False
    release: Annotated[ReleaseRule, Meta(description="Who may release: anyone, stopper or named.")]
    challenge: Annotated[
        str,
        Meta(max_length=64, description="What the proof of a release covers; empty: messages are not signed."),
    ] = ""
    refused: Annotated[
        StopRefusal, Meta(description="Why the request was not carried out; empty: it was, or it asked only.")
    ]


def lock_of(secret: str) -> str:
    """Return the lock of a stop whose secret this is: SHA-256 of its UTF-8, in hex."""
    return hashlib.sha256(secret.encode()).hexdigest()
