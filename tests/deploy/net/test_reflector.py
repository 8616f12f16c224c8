"""Batches of stamps as they travel."""

import json

import pytest

from tis.deploy.net.reflector import Batch

ABOUT = {"name": "there 1f", "first": 3, "total": 5}


def test_a_batch_comes_back_as_it_was() -> None:
    batch = Batch("there 1f", 3, 9, [(0, 12, 1 << 60), (-1, 0, -5)])
    assert Batch.unpack(*batch.pack()) == batch
    empty = Batch("there 1f", 9, 9, [])
    assert Batch.unpack(*empty.pack()) == empty


def test_a_row_is_three_big_endian_numbers() -> None:
    payload, _ = Batch("x", 0, 1, [(1, 2, 258)]).pack()
    assert payload == bytes(7) + b"\x01" + bytes(7) + b"\x02" + bytes(6) + b"\x01\x02"


@pytest.mark.parametrize(
    ("payload", "about"),
    [
        (bytes(23), ABOUT),
        (bytes(72), ABOUT),  # three rows from number 3 on are more than 5
        (b"", {**ABOUT, "first": -1}),
        (b"", {**ABOUT, "first": True}),
        (b"", {**ABOUT, "total": 5.0}),
        (b"", {**ABOUT, "name": 1}),
        (b"", {"name": "x"}),
        (b"", [1]),
        (b"", "junk"),
    ],
)
def test_what_is_no_batch_is_none(payload: bytes, about: object) -> None:
    assert Batch.unpack(payload, json.dumps(about).encode()) is None
    assert Batch.unpack(payload, b"\xff{") is None
