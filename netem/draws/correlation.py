"""Correlation in time that leaves the distribution as it is: a Gaussian-copula Ornstein-Uhlenbeck process.

Gaussian scores follow a stationary Ornstein-Uhlenbeck process of mean 0 and variance 1, sampled at the cells of 1 ms
of run time: the covariance of two cells is 2 ** (-distance / half_life). A score z stands for the uniform Phi(z), and
that for the quantile of any distribution. So at every message rate the marginal distribution is the one asked for.

The process is a Markov process, so given two of its points, the way between them is independent of everything else:
a bridge, drawn from the increments of its own cells (Glasserman, "Monte Carlo Methods in Financial Engineering",
section 3.1). Every 4096th cell is drawn first, as a process on a coarser grid, the same way. So any block costs the
same, whether an hour of run time went by before or not, and nothing has to be kept.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import expm1, log, sqrt
from typing import Final

import numpy as np
from scipy.special import ndtr, ndtri

from common.scenario.network.delay import Correlation
from common.streams import Address, Stream
from netem.draws.blocks import BLOCK, Floats

_CELL_S: Final = 0.001
# a step on the grid of level 3 is 795 days: beyond any half-life, so its points are independent
_TOP: Final = 3
_KEPT_BLOCKS: Final = 2  # two neighbours of the coarser grid may lie in two of its blocks


def uniforms(scores: Floats) -> Floats:
    """Return the uniforms that Gaussian scores stand for, in the open interval (0, 1), same shape."""
    return np.clip(ndtr(scores), 2.0**-54, 1.0 - 2.0**-53)


class ScorePath:
    """The Gaussian scores of one stage, for one key or for all keys of a direction."""

    def __init__(self, part: Correlation, address: Address, stage: str) -> None:
        self._bridges = [bridge_of(part.half_life_s, level) for level in range(_TOP)]
        labels = [stage if level == 0 else f"{stage}/{level}" for level in range(_TOP + 1)]
        self._streams: list[Stream] = [address.stream(label, part.across_keys) for label in labels]
        self._coarse: list[dict[int, Floats]] = [{} for _ in range(_TOP + 1)]

    def block(self, number: int) -> Floats:
        """Return the scores of cells ``number * BLOCK`` .. + BLOCK - 1, (BLOCK,), the same in whatever order asked.

        Oracle: the covariance of the process, and conditioning on two points, tests/netem/draws/test_correlation.
        """
        return self._draw(0, number)

    def _draw(self, level: int, number: int) -> Floats:
        normals = ndtri(self._streams[level].uniforms(number * BLOCK, BLOCK))
        if level == _TOP:
            return normals
        begin, end = self._point(level + 1, number), self._point(level + 1, number + 1)
        return self._bridges[level].between(normals, begin, end)

    def _point(self, level: int, index: int) -> float:
        number, offset = divmod(index, BLOCK)
        kept = self._coarse[level]
        block = kept.get(number)
        if block is None:
            block = self._draw(level, number)
            if len(kept) >= _KEPT_BLOCKS:
                del kept[min(kept)]
            kept[number] = block
        return float(block[offset])


@dataclass(frozen=True, eq=False)
class Bridge:
    """The BLOCK steps on one grid between two known points."""

    decay: Floats
    """(BLOCK + 1,): a ** k."""
    gain: Floats
    """(BLOCK + 1,): covariance of point k with the last one over its variance, given the first."""
    fresh: float
    """Standard deviation of what one step adds."""

    def between(self, normals: Floats, begin: float, end: float) -> Floats:
        """Return points 0 .. BLOCK - 1 on the way from ``begin`` to ``end``, which is point BLOCK.

        Oracle: one-shot Gaussian conditioning, tests/netem/draws/test_correlation.
        """
        path = np.empty(BLOCK + 1)
        path[0] = begin
        path[1:] = self._free(normals) + self.decay[1:] * begin
        path += self.gain * (end - path[BLOCK])
        return path[:BLOCK]

    def _free(self, normals: Floats) -> Floats:
        """Return x_k = a x_(k-1) + fresh w_k from 0, (BLOCK,), by doubling the number of terms summed."""
        x = self.fresh * normals
        shift = 1
        while shift < BLOCK and self.decay[shift] > 0.0:
            x[shift:] += self.decay[shift] * x[:-shift]
            shift *= 2
        return x


@lru_cache(maxsize=64)
def bridge_of(half_life_s: float, level: int) -> Bridge:
    """Return the bridge on a level's grid, whose steps are BLOCK ** level cells; many keys share one half-life."""
    log_a = -log(2.0) * _CELL_S * BLOCK**level / half_life_s
    steps = np.arange(BLOCK + 1)
    gain = np.exp((BLOCK - steps) * log_a) * np.expm1(2.0 * steps * log_a) / expm1(2.0 * BLOCK * log_a)
    return Bridge(np.exp(steps * log_a), gain, sqrt(-expm1(2.0 * log_a)))
