"""Blocks of draws: the live path picks single numbers from the same arrays that the vectorised path returns."""

from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from tis.common.streams import Address

BLOCK: Final = 4096

Counts = Literal["packet", "cell"]
"""The unit of an index into the blocks: a packet of a key, or a cell of 1 ms of run time."""

Floats = NDArray[np.float64]


class DelayBlocks(Protocol):
    """The delays of one key's packets, or of the cells of run time."""

    @property
    def counts(self) -> Counts:
        """Return the unit of an index."""
        ...

    def block(self, number: int) -> NDArray[np.int64]:
        """Return delays in ns, (BLOCK,), none negative; they do not depend on earlier calls."""
        ...


class LossBlocks(Protocol):
    """The loss probability of each packet of one key, given the path of the model's state."""

    @property
    def counts(self) -> Counts:
        """Return the unit of an index."""
        ...

    def block(self, number: int) -> Floats:
        """Return probabilities, (BLOCK,), 0 and 1 included; they do not depend on earlier calls."""
        ...


class SelectionBlocks:
    """Packets selected independently: ``seq`` is one if element ``seq`` of the stage's stream is below ``p``.

    The packets that a smaller probability selects are among those of a greater one.
    """

    def __init__(self, address: Address, stage: str, p: float) -> None:
        self._p = p
        self._stream = address.stream(stage)

    def block(self, number: int) -> NDArray[np.bool_]:
        """Return the packets of block ``number`` >= 0 that are selected, (BLOCK,).

        Oracle: the binomial distribution of their number, tests/netem/stages/test_duplication.
        """
        if self._p == 0.0:
            return np.zeros(BLOCK, dtype=np.bool_)
        return np.asarray(self._stream.uniforms(number * BLOCK, BLOCK) < self._p)
