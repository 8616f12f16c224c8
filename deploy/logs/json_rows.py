"""Payloads of JSON as rows: flat objects, decoded many at a time and never more than a limit at once."""

import struct
from collections.abc import Iterable, Iterator
from typing import Any, Final

from pydantic_core import from_json

from tis.common.errors import DataError, Fault
from tis.deploy.logs.limits import MAX_JSON_BYTES, MAX_NUMBER

Row = dict[str, Any]

UNREADABLE: Final = (LookupError, TypeError, ValueError, OverflowError, AttributeError, struct.error)
"""Errors of code that meets a record of another version."""


def json_value(payload: bytes) -> Any:
    """Return the value of a payload; raises `ValueError` for no JSON, NaN, or more than `MAX_JSON_BYTES`."""
    if len(payload) > MAX_JSON_BYTES:
        raise ValueError(f"a record has more than {MAX_JSON_BYTES} bytes")
    return from_json(payload, allow_inf_nan=False)


def json_row(payload: bytes) -> Row:
    """Return the object of a payload; raises `ValueError` for anything else."""
    row = json_value(payload)
    if not isinstance(row, dict):
        raise ValueError("a record is no object")
    return row


def json_rows(payloads: Iterable[bytes]) -> Iterator[list[Row]]:
    """Yield the objects of the payloads in their order, in portions; raises `ValueError` as `json_row` does."""
    portion: list[bytes] = []
    n_bytes = 0
    for payload in payloads:
        if portion and n_bytes + len(payload) > MAX_JSON_BYTES:
            yield _decoded(portion)
            portion, n_bytes = [], 0
        portion.append(payload)
        n_bytes += len(payload)
    if portion:
        yield _decoded(portion)


def _decoded(portion: list[bytes]) -> list[Row]:
    if len(portion) == 1:
        return [json_row(portion[0])]
    # one parse of a JSON array is far faster than one per record
    rows: list[Any] = from_json(b"[" + b",".join(portion) + b"]", allow_inf_nan=False)
    # a payload like "{},{}" is no JSON, but would be two elements here
    if len(rows) != len(portion) or not all(isinstance(row, dict) for row in rows):
        raise ValueError("a record is no object")
    return rows


def checked_number(value: int) -> int:
    """Return an integer; raises `ValueError` when it is none, or beyond `MAX_NUMBER`."""
    if type(value) is not int or not -MAX_NUMBER <= value <= MAX_NUMBER:
        raise ValueError(f"a number is no integer of at most {MAX_NUMBER}")
    return value


def other_version(topic: str) -> DataError:
    """Return the error for a record that this version does not know."""
    return DataError(Fault(topic, "", "holds records that this version does not know"))
