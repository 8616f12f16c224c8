"""Parsing of untrusted requests: JSON with bounded size and depth, unique keys and no NaN."""

import json
from typing import Any, Final, NoReturn

from tis.common.errors import Fault, InputError

MAX_BYTES: Final = 64 * 1024
_MAX_DEPTH: Final = 20
_WHERE: Final = "control"


def parse_request(payload: bytes) -> Any:
    """Return the value of a request's JSON; raises `InputError` with the reason, and no other error."""
    if len(payload) > MAX_BYTES:
        raise too_large(len(payload))
    try:
        value = json.loads(payload.decode("utf-8"), object_pairs_hook=_mapping, parse_constant=_refuse_constant)
    except UnicodeDecodeError as error:
        raise InputError(Fault(_WHERE, "", f"must be UTF-8; byte {error.start} is not")) from None
    except json.JSONDecodeError as error:
        raise InputError(Fault(_WHERE, "", f"must be JSON: {error.msg} at character {error.pos}")) from None
    except RecursionError:
        raise _too_deep() from None
    except ValueError as error:  # an integer of thousands of digits, or a duplicate key
        reason, _, _ = str(error).partition(";")
        raise InputError(Fault(_WHERE, "", f"must be JSON: {reason}")) from None
    _check_depth(value)
    return value


def too_large(n_bytes: int) -> InputError:
    """Return the error for a request of ``n_bytes``, which need not be read."""
    return InputError(Fault(_WHERE, "", f"must have at most {MAX_BYTES} bytes", n_bytes))


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
        if depth > _MAX_DEPTH:
            raise _too_deep()
        below = (item.values() if isinstance(item, dict) else item for item in level if isinstance(item, dict | list))
        level = [item for items in below for item in items]


def _too_deep() -> InputError:
    return InputError(Fault(_WHERE, "", f"must be nested at most {_MAX_DEPTH} levels deep"))
