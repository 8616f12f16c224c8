from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, chisquare

from tis.common.scenario.network.pipeline import Corrupt
from tis.common.streams import Address
from tis.netem.stages.single_packets import corrupted, flip_bits, n_flipped

ADDRESS = Address(7, "forward", "tis/MTML/measured_cp")
SEQS = st.integers(0, 2**32)


def _flipped(payload: bytes, seq: int, n_bits: int, address: Address = ADDRESS) -> list[int]:
    """Return the positions that differ, read off the two payloads as numbers."""
    after = flip_bits(payload, seq, n_bits, address)
    assert len(after) == len(payload)
    differ = int.from_bytes(payload, "little") ^ int.from_bytes(after, "little")
    return [i for i in range(differ.bit_length()) if differ >> i & 1]


def test_as_many_are_corrupted_as_were_asked_for() -> None:
    chance = corrupted(Corrupt(p_corrupt=0.02), ADDRESS)
    hit = np.concatenate([chance.block(number) for number in range(25)])
    assert binomtest(int(hit.sum()), len(hit), 0.02).pvalue > 0.001
    assert (hit[:4096] == (ADDRESS.stream("corrupt").uniforms(0, 4096) < 0.02)).all()
    assert not corrupted(None, ADDRESS).block(0).any()


@given(st.binary(max_size=200), SEQS, st.integers(1, 1000))
def test_exactly_so_many_bits_flip_and_flip_back(payload: bytes, seq: int, n_bits: int) -> None:
    n_expected = n_flipped(Corrupt(p_corrupt=1, bits=n_bits), len(payload))
    assert n_expected == min(n_bits, 8 * len(payload))
    assert len(_flipped(payload, seq, n_bits)) == n_expected
    assert flip_bits(flip_bits(payload, seq, n_bits, ADDRESS), seq, n_bits, ADDRESS) == payload


def test_an_empty_payload_and_no_bits_change_nothing() -> None:
    assert flip_bits(b"", 3, 5, ADDRESS) == b""
    assert flip_bits(b"abc", 3, 0, ADDRESS) == b"abc"
    assert n_flipped(None, 100) == 0


def test_where_there_are_too_few_bits_all_flip() -> None:
    assert flip_bits(b"\x00\xff\x0f", 9, 24, ADDRESS) == b"\xff\x00\xf0"
    assert flip_bits(b"\x00\xff\x0f", 9, 1000, ADDRESS) == b"\xff\x00\xf0"


@pytest.mark.parametrize(("n_bytes", "n_bits"), [(1, 1), (5, 1), (32, 1), (5, 3), (32, 100)])
def test_every_position_is_equally_likely(n_bytes: int, n_bits: int) -> None:
    n_packets = 20_000 // n_bits + 1_000
    counts = np.zeros(8 * n_bytes)
    for seq in range(n_packets):
        counts[_flipped(bytes(n_bytes), seq, n_bits)] += 1
    assert counts.sum() == n_packets * n_bits
    # drawn without replacement the counts vary less, by (n - k) / (n - 1), than those that chi-square is about
    n = 8 * n_bytes
    spread = counts.mean() + (counts - counts.mean()) * np.sqrt((n - 1) / (n - n_bits))
    assert 0.001 < chisquare(spread).pvalue < 0.999


@pytest.mark.parametrize("n_bits", [2, 6])
def test_every_set_of_positions_is_equally_likely(n_bits: int) -> None:
    sets = dict.fromkeys(combinations(range(8), n_bits), 0)
    for seq in range(14_000):
        sets[tuple(_flipped(b"\x5a", seq, n_bits))] += 1
    assert 0.001 < chisquare(list(sets.values())).pvalue < 0.999


def test_positions_belong_to_the_packet_its_key_its_direction_and_the_seed() -> None:
    payload = bytes(1000)
    others = [
        _flipped(payload, 70, 4),
        _flipped(payload, 71, 4),
        _flipped(payload, 70, 4, ADDRESS._replace(seed=8)),
        _flipped(payload, 70, 4, ADDRESS._replace(direction="feedback")),
        _flipped(payload, 70, 4, ADDRESS._replace(key="other")),
    ]
    assert len({tuple(positions) for positions in others}) == len(others)
    assert _flipped(payload, 70, 4) == others[0]
    assert _flipped(bytes(range(250)) * 4, 70, 4) == others[0]  # whatever is in it


@given(st.lists(SEQS, min_size=1, max_size=8), st.sampled_from([1, 3, 1000]))
def test_positions_do_not_depend_on_what_was_asked_for_before(seqs: list[int], n_bits: int) -> None:
    payload = bytes(300)
    once = [flip_bits(payload, seq, n_bits, ADDRESS) for seq in seqs]
    again = [flip_bits(payload, seq, n_bits, ADDRESS) for seq in reversed(seqs)]
    assert once == again[::-1]


@pytest.mark.parametrize("n_bits", [1, 3, 1000])
def test_no_two_packets_share_a_draw(n_bits: int) -> None:
    """The stretches follow each other: those of some packets, in a row, are the stream itself."""
    uniforms = ADDRESS.stream(f"corrupt_bits/{n_bits}").uniforms(0, 6_000)
    n_available = 8 * 10**6  # so many that the first one is the uniform itself, nearly
    payload = bytes(n_available // 8)
    for seq in (0, 1, 2, 5):
        first = int(uniforms[seq * n_bits] * (n_available - n_bits + 1))
        after = np.frombuffer(flip_bits(payload, seq, n_bits, ADDRESS), dtype=np.uint8)
        assert after[first >> 3] >> (first & 7) & 1
