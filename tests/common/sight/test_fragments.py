"""Frames cut into messages and put together again, whatever happens to the messages."""

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.sight import fragments
from tis.common.sight.fragments import FRAGMENT_HEAD_BYTES, Part, Reassembly, cut, numbers_in, parse, received

DATA = bytes(range(256)) * 10


def _parts(frame: int, data: bytes = DATA, size: int = 1000) -> list[Part]:
    found = [parse(payload) for payload, _ in cut(frame, 5, data, size)]
    assert None not in found
    return [part for part in found if part is not None]


@given(st.binary(min_size=1, max_size=3000), st.integers(1, 65_000), st.randoms(use_true_random=False))
@settings(max_examples=50)
def test_a_frame_in_any_order_is_the_frame(data: bytes, size: int, rng: Random) -> None:
    parts = _parts(0, data, size)
    assert len(parts) == -(-len(data) // size)
    rng.shuffle(parts)
    frames = Reassembly()
    for part in parts:
        assert not frames.ready()
        assert frames.take(part, 9) == "new"
    assert frames.ready()
    frame, found = frames.pop()
    assert found is not None
    assert (frame, found.is_as_sent, found.stretches(), found.missing()) == (0, True, [(0, data)], "")
    assert frames._n_bytes == 0


@pytest.mark.parametrize(("n_bytes", "size"), [(65_000, 65_000), (65_001, 65_000), (3, 1), (2400, 1200), (1, 1)])
def test_the_sizes_of_a_frame_and_its_fragments_are_exact(n_bytes: int, size: int) -> None:
    payloads = [payload for payload, _ in cut(3, 5, bytes(n_bytes), size)]
    assert sum(map(len, payloads)) == n_bytes + len(payloads) * FRAGMENT_HEAD_BYTES
    assert len(payloads) == -(-n_bytes // size)
    for size in (0, 65_001):
        with pytest.raises(ValueError, match="a fragment"):
            next(cut(0, 0, b"x", size))


@given(st.integers(0, 8 * 1000 + 8 * FRAGMENT_HEAD_BYTES - 1))
def test_a_flipped_bit_is_found(bit: int) -> None:
    payload = bytearray(next(cut(1, 5, DATA, 1000))[0])
    payload[bit // 8] ^= 1 << bit % 8
    assert parse(bytes(payload)) is None


@given(st.binary(max_size=80))
def test_anything_else_is_no_fragment(payload: bytes) -> None:
    assert parse(payload) is None


def test_a_fragment_again_a_late_one_and_one_that_contradicts_are_counted() -> None:
    frames, parts = Reassembly(), _parts(0)
    assert [frames.take(part, t) for t, part in enumerate((parts[2], parts[0], parts[0], parts[1]))] == [
        "new", "new", "duplicated", "new",
    ]  # fmt: skip
    assert frames.n_reordered == 2
    assert frames.take(parts[0]._replace(content=b"y" * 1000), 9) == "forged"
    assert frames.take(_parts(0, DATA + b"z")[0], 9) == "forged"
    _, found = frames.pop()
    assert found is not None
    assert (found.first_ns, found.last_ns) == (0, 3)
    assert frames.take(parts[0], 9) == "late"
    assert frames.counts == {"new": 3, "duplicated": 1, "forged": 2, "late": 1}


def test_a_frame_is_given_up_for_a_complete_one_or_two_later_ones() -> None:
    frames = Reassembly()
    frames.take(_parts(0)[0], 1)
    frames.take(_parts(1)[1], 2)
    assert not frames.ready()
    frames.take(_parts(2)[0], 3)
    assert frames.ready()
    frame, found = frames.pop()
    assert found is not None
    assert (frame, found.missing(), found.is_complete) == (0, "1-2", False)
    assert not frames.ready()
    for part in _parts(4):
        frames.take(part, 4)
    assert [frames.pop()[0] for _ in range(4) if frames.ready()] == [1, 2, 3, 4]
    assert not frames.ready()


def test_what_waits_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fragments, "MAX_WAITING_BYTES", 2500)
    frames = Reassembly()
    assert [frames.take(part, 0) for part in _parts(9)] == ["new", "new", "forged"]
    assert frames.take(_parts(10)[0], 0) == "forged"
    assert list(frames.waiting) == [9]


@given(st.sets(st.integers(0, 2)))
def test_a_log_tells_what_arrived(absent: set[int]) -> None:
    frames = Reassembly()
    for part in _parts(0):
        if part.number not in absent:
            frames.take(part, 0)
    _, found = frames.pop()
    if found is None:
        assert len(absent) == 3
        return
    assert numbers_in(found.missing(), 1 << 16) == sorted(absent)
    assert received(DATA, found.missing(), 3, 1000) == found.stretches()


def test_a_frame_that_claims_millions_of_fragments_costs_no_time() -> None:
    (claimed,) = [parse(payload) for payload, _ in cut(0, 0, b"x", 1)]
    assert claimed is not None
    frames = Reassembly()
    frames.take(claimed._replace(frame_bytes=fragments.MAX_FRAME_BYTES, number=7), 0)
    _, found = frames.pop()
    assert found is not None
    assert found.missing() == f"0-6,8-{fragments.MAX_FRAME_BYTES - 1}"


def test_a_log_that_names_very_many_fragments_costs_no_memory() -> None:
    assert numbers_in("0-2,5-99999999999", 7) == [0, 1, 2, 5, 6]
