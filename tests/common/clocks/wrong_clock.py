"""A clock that is wrong by a known amount, and exchanges with the reference over ways of known length."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tis.common.clocks import Exchanges, Stamps

MS = 1_000_000
S = 1_000_000_000
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class WrongClock:
    """Shows ``(t - offset) / (1 + drift)`` when the reference shows t, which so gains ``drift`` a ns on it."""

    offset_ns: int = 3 * S
    drift_ppm: float = 50.0

    def shows(self, reference_ns: Sequence[int] | Ints) -> Ints:
        ns = (np.asarray(reference_ns, dtype=np.float64) - self.offset_ns) / (1 + self.drift_ppm * 1e-6)
        return np.rint(ns).astype(np.int64)


def exchange(
    shows: Callable[[Sequence[int]], Ints], asked_ns: int, there_ns: int, made_ns: int, back_ns: int
) -> Stamps:
    """An exchange begun when the reference shows ``asked_ns``: its ways there and back, and the time between."""
    received_ns = asked_ns + there_ns
    replied_ns = received_ns + made_ns
    own = shows([asked_ns, replied_ns + back_ns])
    return int(own[0]), received_ns, replied_ns, int(own[1])


def exchanges(
    shows: Callable[[Sequence[int]], Ints],
    n: int,
    every_ns: int,
    shortest_ns: int,
    seed: int,
    asymmetry: float = 0.5,
    begin_ns: int = 3 * S,
) -> Exchanges:
    """N exchanges whose ways are ``shortest_ns`` together and, by chance, longer; there takes ``asymmetry`` of it."""
    chance = np.random.default_rng(seed)
    stamps = []
    for i in range(n):
        there, back = (shortest_ns * share for share in (asymmetry, 1 - asymmetry))
        more_there, more_back = chance.exponential(shortest_ns, 2)
        ways = round(there + more_there), 20_000, round(back + more_back)
        stamps.append(exchange(shows, begin_ns + i * every_ns, *ways))
    return Exchanges.of(stamps)
