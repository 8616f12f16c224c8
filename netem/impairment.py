"""The impairments of one key in one direction: which packets are lost and how late the others are.

A fate is addressed by (seed, direction, key, stage, sequence number). So no packet, stage or key shifts
another's, and scenarios that differ in their parameters see the same uniforms. Draws are made in blocks over
the sequence numbers; the live path picks from the blocks that the vectorised path returns.
"""

from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.channels import Direction
from common.scenario.network import Pipeline
from common.streams import Stream
from netem.delay import LatencyModel, build_latency
from netem.loss import build_loss
from netem.outage import Outages

BLOCK: Final = 4096
_KEPT_BLOCKS: Final = 4  # packets that straddle an edge of blocks, or are duplicates, do not redraw


class Draws(NamedTuple):
    """What the models drew: which packets are lost, bool, and how late each is, int64 ns; equal shapes."""

    lost: NDArray[np.bool_]
    delay_ns: NDArray[np.int64]


class Impairment:
    """A pipeline at work on one key."""

    def __init__(
        self, pipeline: Pipeline, seed: int, direction: Direction, key: str, outages: Outages | None = None
    ) -> None:
        self.latency: LatencyModel = build_latency(pipeline)
        self._loss = build_loss(pipeline.loss)
        self._outages = outages if outages is not None and outages.edges_ns else None
        self._streams = {
            stage: Stream.named(seed, f"{direction}/{key}/{stage}") for stage in ("loss", "delay", "jitter")
        }
        # bytes and lists give up an element several times faster than arrays do
        self._blocks: dict[int, tuple[bytes, list[int]]] = {}
        self._number = -1
        self._lost = b""
        self._delay_ns: list[int] = []

    def decide(self, seq: int, now_ns: int) -> tuple[Literal["deliver", "loss", "outage"], int]:
        """Return what becomes of packet ``seq`` >= 0 that is offered at ``now_ns``, and its delay in ns.

        The delay is 0 for a packet that is not delivered (oracle: `decide_many`, bit for bit).
        """
        if self._outages is not None and self._outages.holds(now_ns):
            return "outage", 0
        number, offset = divmod(seq, BLOCK)
        if number != self._number:
            self._turn_to(number)
        if self._lost[offset]:
            return "loss", 0
        return "deliver", self._delay_ns[offset]

    def decide_many(self, seqs: NDArray[np.int64]) -> Draws:
        """Return the draws of packets ``seqs`` (N,), each >= 0, in any order; outages are not among them."""
        numbers, which = np.unique(seqs // BLOCK, return_inverse=True)
        if not len(numbers):
            return Draws(np.empty(0, dtype=bool), np.empty(0, dtype=np.int64))
        blocks = [self._draw(int(number)) for number in numbers]
        offsets = seqs % BLOCK
        return Draws(
            np.stack([block.lost for block in blocks])[which, offsets],
            np.stack([block.delay_ns for block in blocks])[which, offsets],
        )

    def _turn_to(self, number: int) -> None:
        block = self._blocks.get(number)
        if block is None:
            draws = self._draw(number)
            block = draws.lost.tobytes(), draws.delay_ns.tolist()
            if len(self._blocks) == _KEPT_BLOCKS:
                del self._blocks[next(iter(self._blocks))]
            self._blocks[number] = block
        self._number = number
        self._lost, self._delay_ns = block

    def _draw(self, number: int) -> Draws:
        u = {stage: stream.uniforms(number * BLOCK, BLOCK) for stage, stream in self._streams.items()}
        return Draws(self._loss.lost(u["loss"]), self.latency.sample(u["delay"], u["jitter"]))
