"""Requests as they come from anybody: JSON that is bounded in size and depth, every key once, no NaN."""

import json
from typing import Any, Final, NoReturn

from common.errors import Fault, InputError

MOST_BYTES: Final = 64 * 1024
_DEEPEST: Final = 20
_WHERE: Final = "control"


def parse_request(payload: bytes) -> Any:
    """Return the value of a request's JSON; raises `InputError` with the reason, whatever the bytes are."""
    if len(payload) > MOST_BYTES:
        raise too_large(len(payload))
    try:
        value = json.loads(payload.decode("utf-8"), object_pairs_hook=_mapping, parse_constant=_refuse_constant)
    except UnicodeDecodeError as error:
        raise InputError(Fault(_WHERE, "", f"must be UTF-8; byte {error.start} is not")) from None
    except json.JSONDecodeError as error:
        raise InputError(Fault(_WHERE, "", f"must be JSON: {error.msg} at character {error.pos}")) from None
    except RecursionError:
        raise _too_deep() from None
    except ValueError as error:  # an integer of thousands of digits, a key that stands twice
        reason, _, _ = str(error).partition(";")
        raise InputError(Fault(_WHERE, "", f"must be JSON: {reason}")) from None
    _check_depth(value)
    return value


def too_large(n_bytes: int) -> InputError:
    """Return what is wrong with a request of so many bytes, which nobody has to read for that."""
    return InputError(Fault(_WHERE, "", f"must have at most {MOST_BYTES} bytes", n_bytes))


def _mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise ValueError(f"key {key[:80]!r} stands twice")
        found[key] = value
    return found


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def _check_depth(value: Any) -> None:
    level, depth = [value], 0
    while level:
        depth += 1
        if depth > _DEEPEST:
            raise _too_deep()
        below = (item.values() if isinstance(item, dict) else item for item in level if isinstance(item, dict | list))
        level = [item for items in below for item in items]


def _too_deep() -> InputError:
    return InputError(Fault(_WHERE, "", f"must be nested at most {_DEEPEST} levels deep"))
