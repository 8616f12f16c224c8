"""Deliberate reordering: some packets skip their delay, or part of it, and overtake earlier ones."""

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.network.pipeline import Reorder
from tis.common.streams import Address
from tis.common.units import ms_to_ns
from tis.netem.draws.blocks import SelectionBlocks


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
