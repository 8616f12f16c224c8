"""A chance that befalls each packet alike, by itself: which packets it befalls, addressed by sequence number."""

import numpy as np
from numpy.typing import NDArray

from common.streams import Address
from netem.draws.blocks import BLOCK


class Chance:
    """Packet ``seq`` is befallen where element ``seq`` of the stage's stream lies below ``p``.

    So the packets of a smaller probability are among those of a greater one, and none depends on others.
    """

    def __init__(self, address: Address, stage: str, p: float) -> None:
        self._p = p
        self._stream = address.stream(stage)

    def block(self, number: int) -> NDArray[np.bool_]:
        """Return which packets of block ``number`` >= 0 it befalls, (BLOCK,).

        Oracle: the binomial distribution of their number, tests/netem/stages/test_duplication.
        """
        if self._p == 0.0:
            return np.zeros(BLOCK, dtype=np.bool_)
        return np.asarray(self._stream.uniforms(number * BLOCK, BLOCK) < self._p)
