"""Random numbers addressed by (seed, label, index): no draw shifts another's.

A stream is an endless array of uniforms in (0, 1). `Stream.uniforms` returns any stretch of it, `Stream.uniform`
one element of the same blocks, so the live path and the vectorised path are one implementation. The generator is
Philox, whose counter is set to the block's number (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3").
"""

import hashlib
from dataclasses import dataclass, field
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction

BLOCK: Final = 4096
"""The uniforms that one setting of the generator's counter yields."""


@dataclass
class Stream:
    """An endless array of uniforms; ``key`` holds 128 bits derived from seed and label."""

    key: tuple[int, int]
    _number: int = field(default=-1, repr=False)
    _block: NDArray[np.float64] = field(default_factory=lambda: np.empty(0), repr=False)

    @classmethod
    def named(cls, seed: int, label: str) -> Self:
        """Return the stream of ``label``, for instance ``"forward/tis/MTML/measured_cp/loss"``."""
        # The NUL separates seed and label unambiguously.
        digest = hashlib.blake2b(f"{seed}\0{label}".encode(), digest_size=16).digest()
        return cls((int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:], "little")))

    def uniform(self, index: int) -> float:
        """Return element ``index`` (>= 0), a float in the open interval (0, 1)."""
        number, offset = divmod(index, BLOCK)
        return float(self._block_of(number)[offset])

    def uniforms(self, start: int, count: int) -> NDArray[np.float64]:
        """Return elements ``start`` .. ``start + count - 1``, shape (count,)."""
        first, last = start // BLOCK, (start + count - 1) // BLOCK
        blocks = np.concatenate([self._block_of(number) for number in range(first, max(first, last) + 1)])
        return blocks[start - first * BLOCK :][:count]

    def block(self, number: int, n: int = BLOCK) -> NDArray[np.float64]:
        """Return the first ``n`` elements of block ``number``, shape (n,), which the stream does not keep."""
        philox = np.random.Philox(key=np.array(self.key, dtype=np.uint64), counter=[0, number, 0, 0])
        draws = np.random.Generator(philox).random(n)
        # random() is in [0, 1); quantile functions need the open interval.
        return np.maximum(draws, 2.0**-54)

    def _block_of(self, number: int) -> NDArray[np.float64]:
        # The last block is cached: packets and draws come in the order of their numbers, nearly always.
        if number != self._number:
            self._block = self.block(number)
            self._number = number
        return self._block


class Address(NamedTuple):
    """A key in one direction of a run: with the name of a stage it determines a stream."""

    seed: int
    direction: Direction
    key: str

    def stream(self, stage: str, across_keys: bool = False) -> Stream:
        """Return the stream of one stage; ``across_keys``: the one that all keys of the direction share."""
        return Stream.named(self.seed, f"{self.direction}/{'*' if across_keys else self.key}/{stage}")
