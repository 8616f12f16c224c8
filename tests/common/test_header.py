import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.messages import Header

i64 = st.integers(-(2**63), 2**63 - 1)
u32 = st.integers(0, 2**32 - 1)
headers = st.builds(Header, u32, i64, u32)


@given(headers)
def test_round_trip(header: Header) -> None:
    assert Header.unpack(header.pack()) == header


def test_the_layout_is_part_of_the_protocol() -> None:
    packed = Header(1, 3, 5).pack()
    assert packed.hex(" ", 4) == "74697302 01000000 03000000 00000000 05000000"


@settings(deadline=None)
@given(st.binary(max_size=64))
def test_foreign_bytes_are_not_ours(data: bytes) -> None:
    assert Header.unpack(data) is None


@settings(deadline=None, max_examples=50)
@given(headers, st.integers(0, 19))
def test_truncated_or_longer_is_not_ours(header: Header, length: int) -> None:
    assert Header.unpack(header.pack()[:length]) is None
    assert Header.unpack(header.pack() + b"\0") is None


@pytest.mark.parametrize("place", range(4))
def test_a_damaged_frame_is_not_ours(place: int) -> None:
    packed = bytearray(Header(7, 9).pack())
    packed[place] ^= 1
    assert Header.unpack(bytes(packed)) is None


@pytest.mark.parametrize(
    "header", [Header(-1, 0), Header(2**32, 0), Header(0, 2**63), Header(0, -(2**63) - 1), Header(0, 0, 2**32)]
)
def test_numbers_that_do_not_fit_are_refused(header: Header) -> None:
    with pytest.raises(struct.error):
        header.pack()
