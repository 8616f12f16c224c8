"""Stages that select single packets: duplication, deliberate reordering, and corruption by bit flips.

A copy has another draw of the same delay model. A reordered packet skips its delay, or part of it, and overtakes
earlier ones.
"""

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.network.pipeline import Corrupt, Duplicate, Reorder
from tis.common.streams import BLOCK, Address
from tis.common.units import ms_to_ns
from tis.netem.draws.blocks import Floats, SelectionBlocks

_BITS_PER_BYTE: Final = 8


def duplicated(part: Duplicate | None, address: Address) -> SelectionBlocks:
    """Return the selection of duplicated packets (oracle: binomial, tests/netem/stages/test_duplication)."""
    return SelectionBlocks(address, "duplicate", 0.0 if part is None else part.p_duplicate)


def reordered(part: Reorder | None, address: Address) -> SelectionBlocks:
    """Return the selection of packets that skip their delay.

    Oracle: the binomial distribution, tests/netem/stages/test_reordering.
    """
    return SelectionBlocks(address, "reorder", 0.0 if part is None else part.p_reorder)


def skipped_ns(part: Reorder | None, delay_ns: NDArray[np.int64], skips: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the part of its delay that each packet skips, in ns, (N,): 0 if it is not selected, at most the delay.

    ``delay_ns`` (N,) are the drawn delays, ``skips`` (N,) the selection of `reordered` (oracle: a table,
    tests/netem/stages/test_reordering).
    """
    if part is None:
        return np.zeros_like(delay_ns)
    skipped = delay_ns if part.early_ms is None else np.minimum(delay_ns, ms_to_ns(part.early_ms))
    return np.where(skips, skipped, 0)


def corrupted(part: Corrupt | None, address: Address) -> SelectionBlocks:
    """Return the selection of packets with flipped bits.

    Oracle: the binomial distribution, tests/netem/stages/test_corruption.
    """
    return SelectionBlocks(address, "corrupt", 0.0 if part is None else part.p_corrupt)


def n_flipped(part: Corrupt | None, n_bytes: int) -> int:
    """Return the number of bits that flip in a corrupted payload of ``n_bytes``: as configured, at most all."""
    return 0 if part is None else min(part.bits, n_bytes * _BITS_PER_BYTE)


def flip_bits(payload: bytes, seq: int, n_bits: int, address: Address) -> bytes:
    """Return ``payload`` with ``n_bits`` different bits flipped, or all bits if it has fewer.

    Every set of positions is equally likely: Floyd's sampling (Bentley, Floyd, "A sample of brilliance", 1987), with
    one uniform per bit. Packet ``seq`` >= 0 has its own stretch of uniforms, so neither the length of a payload nor
    another packet changes its positions (oracle: chi-square over positions and over pairs of them,
    tests/netem/stages/test_corruption).
    """
    n_available = len(payload) * _BITS_PER_BYTE
    if n_bits < 1 or n_available == 0:
        return payload
    n_flips = min(n_bits, n_available)
    uniforms = _uniforms(address, n_bits, seq)
    chosen: set[int] = set()
    for i in range(n_flips):
        last = n_available - n_flips + i
        position = int(uniforms[i] * (last + 1))
        chosen.add(last if position in chosen else position)
    damaged = bytearray(payload)
    for position in chosen:
        damaged[position >> 3] ^= 1 << (position & 7)
    return bytes(damaged)


def _uniforms(address: Address, n_bits: int, seq: int) -> Floats:
    number, row = divmod(seq, _packets_per_block(n_bits))
    stretch: Floats = _block(address, n_bits, number)[row]
    return stretch


def _packets_per_block(n_bits: int) -> int:
    return max(1, BLOCK // n_bits)


@lru_cache(maxsize=32)
def _block(address: Address, n_bits: int, number: int) -> Floats:
    """Return the uniforms of successive packets, (packets, n_bits); the cache only saves drawing them again."""
    n_packets = _packets_per_block(n_bits)
    # one stream for each number of bits, so that stretches of different lengths never share a draw
    stream = address.stream(f"corrupt_bits/{n_bits}")
    uniforms = stream.uniforms(number * n_packets * n_bits, n_packets * n_bits).reshape(n_packets, n_bits)
    uniforms.setflags(write=False)
    return np.asarray(uniforms)
