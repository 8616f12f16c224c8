"""Messages of a page that drives: how far the pointer has moved the hand, checked like anything from outside."""

from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError

MAX_MESSAGE_CHARS: Final = 400
"""Longest message of a page; the page's own have 120."""

MAX_MOVE_MM: Final = 500.0
_MAX_GRIPPER_RAD: Final = 1.5

Move = Annotated[float, Field(allow_inf_nan=False, ge=-MAX_MOVE_MM, le=MAX_MOVE_MM)]


class HandMove(BaseModel):
    """The hand of a page that drives, ``moved_mm`` from where it was when the page took it, in the arm's axes."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    moved_mm: Annotated[list[Move], Field(min_length=3, max_length=3)]
    gripper_rad: Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=_MAX_GRIPPER_RAD)] = 0.0
    clutch: bool = False
    release: bool = False


def read_move(text: str | bytes) -> HandMove | str:
    """Return a page's message, or in words why it is refused.

    Oracle: messages that break one rule each, tests/deploy/view/drive/test_hand_move.
    """
    if len(text) > MAX_MESSAGE_CHARS:
        return f"message: must have at most {MAX_MESSAGE_CHARS} characters (got {len(text)})"
    try:
        return HandMove.model_validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        field = ".".join(map(str, first["loc"])) or "message"
        got = repr(first["input"])[:60]
        return f"{field}: {first['msg'][:1].lower()}{first['msg'][1:]} (got {got})"
