"""Draws come in blocks: the live path picks from the very arrays that the vectorised path returns."""

from typing import Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

BLOCK: Final = 4096

Counts = Literal["packet", "cell"]
"""What an index into the blocks counts: a key's packets, or cells of 1 ms of run time."""

Floats = NDArray[np.float64]


class DelayBlocks(Protocol):
    """The delays of one key's packets, or of the cells of run time."""

    @property
    def counts(self) -> Counts:
        """Return what the blocks count."""
        ...

    def block(self, number: int) -> NDArray[np.int64]:
        """Return delays in ns, (BLOCK,), none negative; the same whatever was asked for before."""
        ...


class LossBlocks(Protocol):
    """How probable the loss of each of a key's packets is, given the path of the model's state."""

    @property
    def counts(self) -> Counts:
        """Return what the blocks count."""
        ...

    def block(self, number: int) -> Floats:
        """Return probabilities, (BLOCK,), 0 and 1 included; the same whatever was asked for before."""
        ...
