"""Correlation in time that preserves the distribution: a Gaussian-copula Ornstein-Uhlenbeck process.

Gaussian scores follow a stationary Ornstein-Uhlenbeck process of mean 0 and variance 1, sampled at the cells of 1 ms
of run time: the covariance of two cells is 2 ** (-distance / half_life). A score z is mapped to the uniform Phi(z),
and that to a quantile of any distribution. So the marginal distribution is the requested one at every message rate.

The process is a Markov process: given two of its points, the path between them is independent of the rest, a bridge
drawn from the increments of its own cells (Glasserman, "Monte Carlo Methods in Financial Engineering", section 3.1).
Every 4096th cell is drawn first, as a process on a coarser grid, in the same way. So every block costs the same at
any run time, and no state has to be kept.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import expm1, log, sqrt
from typing import Final

import numpy as np
import scipy

from tis.common.scenario.network.delay import Correlation
from tis.common.streams import BLOCK, Address, Stream
from tis.netem.draws.blocks import Floats

_CELL_S: Final = 0.001
# a step on the grid of level 3 is 795 days, beyond any half-life, so its points are independent
_TOP: Final = 3
_STRETCH: Final = 64  # of a coarser grid, kept for 262 s or longer: whole blocks of three grids are 200 kB a key
_MAX_KEPT: Final = 2  # two neighbours of the coarser grid may lie in two stretches


def uniforms(scores: Floats) -> Floats:
    """Return the uniforms of Gaussian scores, in the open interval (0, 1), same shape."""
    return np.clip(scipy.special.ndtr(scores), 2.0**-54, 1.0 - 2.0**-53)


class ScorePath:
    """The Gaussian scores of one stage, for one key, for all keys of a direction, or for both directions.

    With a share p in both directions' process the scores are ``sqrt(p) * both + sqrt(1 - p) * own``. Both processes
    have the same half-life, so the sum is one of it, and p is its correlation with the other direction's.
    """

    def __init__(self, part: Correlation, address: Address, stage: str) -> None:
        labels = [stage if level == 0 else f"{stage}/{level}" for level in range(_TOP + 1)]
        self._parts: list[tuple[float, _Process]] = []
        if part.shared < 1.0:
            own = [address.stream(label, part.across_keys) for label in labels]
            self._parts.append((sqrt(1.0 - part.shared), _Process(part.half_life_s, own)))
        if part.shared > 0.0:
            both = [Stream.named(address.seed, f"both/*/{label}") for label in labels]
            self._parts.append((sqrt(part.shared), _Process(part.half_life_s, both)))

    def block(self, number: int) -> Floats:
        """Return the scores of cells ``number * BLOCK`` .. + BLOCK - 1, (BLOCK,), in any order of calls.

        Oracle: the covariance of the process, and conditioning on two points, tests/netem/draws/test_correlation.
        """
        first, *rest = (weight * process.block(number) for weight, process in self._parts)
        return first if not rest else np.asarray(first + rest[0])


class _Process:
    """One Ornstein-Uhlenbeck process; ``streams`` are those of its grids, the finest first."""

    def __init__(self, half_life_s: float, streams: list[Stream]) -> None:
        self._bridges = [bridge_of(half_life_s, level) for level in range(_TOP)]
        self._streams = streams
        self._coarse: list[dict[int, Floats]] = [{} for _ in range(_TOP + 1)]

    def block(self, number: int) -> Floats:
        return self._draw(0, number)

    def _draw(self, level: int, number: int) -> Floats:
        normals = scipy.special.ndtri(self._streams[level].block(number))
        if level == _TOP:
            return normals
        begin, end = self._point(level + 1, number), self._point(level + 1, number + 1)
        return self._bridges[level].between(normals, begin, end)

    def _point(self, level: int, index: int) -> float:
        number, offset = divmod(index, _STRETCH)
        kept = self._coarse[level]
        stretch = kept.get(number)
        if stretch is None:
            block, begin = divmod(number * _STRETCH, BLOCK)
            stretch = self._draw(level, block)[begin : begin + _STRETCH].copy()  # else it keeps the block
            if len(kept) >= _MAX_KEPT:
                del kept[min(kept)]
            kept[number] = stretch
        return float(stretch[offset])


@dataclass(frozen=True, eq=False)
class Bridge:
    """A bridge of BLOCK steps on one grid, between two known points."""

    decay: Floats
    """(BLOCK + 1,): a ** k."""
    gain: Floats
    """(BLOCK + 1,): covariance of point k with the last point over the variance of the last, given the first."""
    fresh: float
    """Standard deviation of the innovation of one step."""

    def between(self, normals: Floats, begin: float, end: float) -> Floats:
        """Return points 0 .. BLOCK - 1 of the path from ``begin`` to ``end``, which is point BLOCK.

        Oracle: one-shot Gaussian conditioning, tests/netem/draws/test_correlation.
        """
        # a free path from the first point, pulled to the last one in proportion to its covariance with it
        path = np.empty(BLOCK + 1)
        path[0] = begin
        path[1:] = self._free(normals) + self.decay[1:] * begin
        path += self.gain * (end - path[BLOCK])
        return path[:BLOCK]

    def _free(self, normals: Floats) -> Floats:
        """Return x_k = a x_(k-1) + fresh w_k from x_0 = 0, (BLOCK,), in log2(BLOCK) vector operations."""
        x = self.fresh * normals
        shift = 1
        while shift < BLOCK and self.decay[shift] > 0.0:  # x holds sums of ``shift`` terms; twice as many after
            x[shift:] += self.decay[shift] * x[:-shift]
            shift *= 2
        return x


@lru_cache(maxsize=64)
def bridge_of(half_life_s: float, level: int) -> Bridge:
    """Return the bridge on the grid of a level, of BLOCK ** level cells a step; keys share it by half-life."""
    log_a = -log(2.0) * _CELL_S * BLOCK**level / half_life_s
    steps = np.arange(BLOCK + 1)
    gain = np.exp((BLOCK - steps) * log_a) * np.expm1(2.0 * steps * log_a) / expm1(2.0 * BLOCK * log_a)
    return Bridge(np.exp(steps * log_a), gain, sqrt(-expm1(2.0 * log_a)))
