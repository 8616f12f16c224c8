"""Traffic of others in the queue of a link: the instants of its messages."""

from bisect import bisect_left
from collections.abc import Iterator
from fractions import Fraction
from functools import partial
from typing import Final

import numpy as np

from tis.common.scenario.network.capacity import Cross, OnOffCross, PoissonCross
from tis.common.streams import Address
from tis.common.units import NS_PER_S
from tis.netem.draws.grid import CELL_NS, CELLS_PER_S, RenewalPath, alternating, geometric_cells
from tis.netem.link.queue.transmission import NS_PER_BYTE_AT_1_KBIT_S

_STAGE: Final = "cross"


class CrossTraffic:
    """The messages of others, one after the other; ``next_ns`` is the instant of the next one.

    An instant depends on its second of run time and on the address alone, not on where the traffic is followed from
    (oracle: one walk from the begin, and the laws of the processes, tests/netem/link/queue/test_cross_traffic).
    """

    def __init__(self, part: Cross, address: Address, from_ns: int) -> None:
        self.part: Final = part
        self.n_bytes: Final = part.message_bytes
        self._address: Final = address
        self._gap_ns = Fraction(self.n_bytes * NS_PER_BYTE_AT_1_KBIT_S) / Fraction(str(part.kbit_s))
        self._phase_ns = int(address.stream(f"{_STAGE}/phase").uniform(0) * self._gap_ns)
        self._path = _on_off(part, address) if isinstance(part, OnOffCross) else None
        self.skip_to(from_ns)

    def skip_to(self, from_ns: int) -> None:
        """Go on with the first message at or after ``from_ns``."""
        self._second = max(from_ns, 0) // NS_PER_S
        self._instants = self._of_second(self._second)
        self._index = bisect_left(self._instants, from_ns)
        self._settle()

    def pass_one(self) -> None:
        """Go on to the next message."""
        self._index += 1
        self._settle()

    def _settle(self) -> None:
        while self._index >= len(self._instants):
            self._second += 1
            self._instants, self._index = self._of_second(self._second), 0
        self.next_ns = self._instants[self._index]

    def _of_second(self, second: int) -> list[int]:
        if isinstance(self.part, PoissonCross):
            return self._poisson(second)
        begin_ns = second * NS_PER_S
        if self._path is not None:
            off = self._path.at(begin_ns // CELL_NS)
            if not off.value and off.end * CELL_NS >= begin_ns + NS_PER_S:
                return []
        gap, unit = self._gap_ns.as_integer_ratio()
        first, last = (-((self._phase_ns - ns) * unit // gap) for ns in (begin_ns, begin_ns + NS_PER_S))
        instants = [self._phase_ns + i * gap // unit for i in range(max(first, 0), last)]
        return instants if self._path is None else list(_while_on(self._path, instants))

    def _poisson(self, second: int) -> list[int]:
        """Return the instants of a second: the process has no memory, so each second begins anew."""
        stream, gap_ns = self._address.stream(f"{_STAGE}/{second}"), float(self._gap_ns)
        at_ns, known = 0.0, []
        for number in range(1 << 20):
            instants = at_ns - np.cumsum(np.log(stream.block(number))) * gap_ns
            known.append(instants[instants < NS_PER_S])
            at_ns = float(instants[-1])
            if at_ns >= NS_PER_S:
                break
        found: list[int] = (second * NS_PER_S + np.concatenate(known).astype(np.int64)).tolist()
        return found


def _while_on(path: RenewalPath, instants: list[int]) -> Iterator[int]:
    for at_ns in instants:
        if path.at(at_ns // CELL_NS).value:
            yield at_ns


def _on_off(part: OnOffCross, address: Address) -> RenewalPath:
    """Return the path of a source that begins off."""
    off, on = (partial(geometric_cells, mean=mean_s * CELLS_PER_S) for mean_s in (part.mean_off_s, part.mean_on_s))
    return alternating(address.stream(f"{_STAGE}/on_off"), off, on)
