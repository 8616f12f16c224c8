"""Payloads of JSON: flat objects as rows, decoded many at a time within limits, and sample instants of messages."""

import struct
from collections.abc import Iterable, Iterator
from typing import Any, Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from pydantic_core import from_json

from tis.common.errors import DataError, Fault
from tis.common.runtime.chunk_writer import MESSAGE_HEAD_BYTES
from tis.deploy.logs.blocks import MAX_JSON_BYTES, MAX_NUMBER, Block

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


Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

NO_INSTANT: Final = -1

_OWN: Final = np.frombuffer(b'{"sample_ns":', dtype=np.uint8)
_COMMAND: Final = np.frombuffer(b'"command_sample_ns":', dtype=np.uint8)
_DIGITS: Final = 18
"""Most digits that always fit int64; enough for a run of thirty years."""
_ZERO, _COMMA, _END = (ord(sign) for sign in "0,}")


def payload_instants(block: Block, which: Ints) -> tuple[Ints, Ints]:
    """Return the sample instant and the answered command's instant of N messages, by index; (N,) each, in ns.

    `NO_INSTANT` for none; raises `ValueError` for a payload that is no JSON, or an instant that is no integer. The
    testbed writes the first at the begin of a payload and the second, if any, at its end; payloads of other layouts
    are parsed as JSON one by one. Oracle: each payload parsed as JSON, test_payloads.
    """
    # payloads too short for both fields may be of any layout: left to the slow path
    own_ns, command_ns = (np.full(len(which), NO_INSTANT, dtype=np.int64) for _ in range(2))
    first, end = block.start[which] + MESSAGE_HEAD_BYTES, block.end[which]
    ours = np.flatnonzero(end - first > len(_OWN) + len(_COMMAND) + _DIGITS)
    data = np.frombuffer(block.body, dtype=np.uint8)
    # head: {"sample_ns":DIGITS,
    heads = _windows(data, first[ours], len(_OWN) + _DIGITS + 1)
    own, length = _leading_number(heads[:, len(_OWN) :])
    stated = (heads[:, : len(_OWN)] == _OWN).all(axis=1) & (length > 0)
    after = np.minimum(len(_OWN) + length, heads.shape[1] - 1)
    stated &= heads[np.arange(len(ours)), after] == _COMMA
    ours, own = ours[stated], own[stated]
    own_ns[ours] = own
    # tail, read backwards: DIGITS} after "command_sample_ns":
    tails = _windows(data, end[ours] - len(_COMMAND) - _DIGITS - 1, len(_COMMAND) + _DIGITS + 1)
    command, length = _leading_number(tails[:, -2::-1], reverse=True)
    answers = (tails[:, -1] == _END) & (length > 0)
    begin = np.maximum(tails.shape[1] - 1 - length - len(_COMMAND), 0)
    for i, sign in enumerate(_COMMAND.tolist()):
        answers &= tails[np.arange(len(ours)), begin + i] == sign
    command_ns[ours[answers]] = command[answers]
    left = np.ones(len(which), dtype=np.bool_)
    left[ours] = False
    for i in np.flatnonzero(left).tolist():
        own_ns[i], command_ns[i] = _parsed(block.body[first[i] : end[i]])
    return own_ns, command_ns


def _windows(data: Bytes, at: Ints, width: int) -> Bytes:
    """Return ``width`` bytes from each position ``at`` (N,), (N, width)."""
    if not len(at):
        return np.empty((0, width), dtype=np.uint8)
    return np.asarray(sliding_window_view(data, width)[at])


def _leading_number(signs: Bytes, reverse: bool = False) -> tuple[Ints, Ints]:
    """Return the leading number of each row (N,), and its number of digits (N,), at most `_DIGITS`.

    ``reverse``: the last digit comes first.
    """
    digits = signs[:, :_DIGITS] - np.uint8(_ZERO)  # uint8 wraps: characters below "0" become large
    others = digits > 9
    length = np.where(others.any(axis=1), others.argmax(axis=1), _DIGITS)
    value = np.zeros(len(signs), dtype=np.int64)
    for n in np.unique(length).tolist():  # few lengths occur in one recording
        which = np.flatnonzero(length == n)
        powers = np.array([10**i for i in range(n)], dtype=np.int64)
        value[which] = digits[which, :n] @ (powers if reverse else powers[::-1])
    return value, length


def _parsed(payload: bytes) -> tuple[int, int]:
    row = json_value(payload)
    if not isinstance(row, dict):
        return NO_INSTANT, NO_INSTANT
    return _instant(row, "sample_ns"), _instant(row, "command_sample_ns")


def _instant(row: Row, name: str) -> int:
    value = row.get(name)
    return NO_INSTANT if value is None else checked_number(value)
