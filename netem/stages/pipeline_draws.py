"""The draws of one pipeline for one key: loss, delay, copies and bit flips, packet by packet.

A draw is addressed by (seed, direction, key, stage, sequence number), or by the 1 ms cell of run time for processes
in time. So no packet, stage or key shifts another one's draws, and scenarios that differ only in parameters have the
same uniforms. The live path picks single numbers from the blocks that the vectorised path returns.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from tis.common.scenario.network.pipeline import Pipeline
from tis.common.streams import Address, Stream
from tis.common.trace import Trace
from tis.netem.draws.blocks import Column, DeferredDraw, LossBlocks
from tis.netem.stages.delay import delay_blocks
from tis.netem.stages.loss import loss_blocks
from tis.netem.stages.single_packets import corrupted, duplicated, n_flipped, reordered, skipped_ns

_MAX_AT_ONCE: Final = 1 << 22  # parts of messages whose probabilities are in memory together


class Draw(Struct, frozen=True):
    """The draws for one packet: its delay, the delay of its copy if it has one, and the number of bits to flip."""

    delay_ns: int
    copy_delay_ns: int | None = None
    n_flips: int = 0
    is_lost: bool = False
    """Whether its first sending is lost; only with a recovery, which repeats it."""


class ManyDraws(NamedTuple):
    """The draws for N packets: arrays (N,), ``copy_delay_ns`` -1 where there is no copy."""

    lost: NDArray[np.bool_]
    delay_ns: NDArray[np.int64]
    copy_delay_ns: NDArray[np.int64]
    n_flips: NDArray[np.int64]


class Draws:
    """The draws of a pipeline for one key; the next blocks are appended to ``deferred``."""

    def __init__(
        self,
        pipeline: Pipeline,
        address: Address,
        traces: Mapping[str, Trace],
        deferred: list[DeferredDraw] | None = None,
    ) -> None:
        self._losses = None
        self._mtu_bytes: int | None = None
        if pipeline.loss is not None:
            self._mtu_bytes = None if pipeline.loss.kind == "trace" else pipeline.loss.mtu_bytes
            has_memory = pipeline.loss.kind != "bernoulli"
            blocks = loss_blocks(pipeline.loss, address, traces)
            self._losses = _Losses(blocks, has_memory, address.stream("loss"), deferred)
        delays = delay_blocks(pipeline, address, traces)
        self._delay_by_cell = delays.counts == "cell"
        self._delays = Column(delays.block, deferred)
        constant = pipeline.delay is None or (pipeline.delay.kind == "constant" and pipeline.jitter is None)
        self._constant = Draw(int(delays.block(0, 1)[0])) if constant else None
        self._rare = None
        if pipeline.duplicate is not None or pipeline.corrupt is not None or pipeline.reorder is not None:
            self._rare = _RareStages(pipeline, address, traces, deferred)
        self._pipeline = pipeline

    def share(self, other: "Draws") -> None:
        """Use the columns of ``other``, the same key's draws under another pipeline, for equal stages.

        They hold the same numbers, so blocks that exist are not drawn again.
        """
        ours, theirs = self._pipeline, other._pipeline
        if ours.loss == theirs.loss:
            self._losses = other._losses
        if _delay_of(ours) != _delay_of(theirs):
            return
        self._delays = other._delays
        if _rare_stages_of(ours) == _rare_stages_of(theirs):
            self._rare = other._rare

    def decide(self, seq: int, cell: int, n_bytes: int) -> Draw | None:
        """Return the draw for packet ``seq`` >= 0 of ``n_bytes`` offered in ``cell``; None if it is lost.

        Oracle: `decide_many`, number by number (tests/netem/stages/test_pipeline_draws).
        """
        losses = self._losses
        if losses is not None and losses.is_lost(seq, cell, self.n_parts(n_bytes)):
            return None
        draw = self._constant
        if draw is None:
            draw = Draw(self._delays[cell if self._delay_by_cell else seq])
        return draw if self._rare is None else self._rare.add(draw, seq, cell, n_bytes)

    def decide_recovered(self, seq: int, cell: int, n_bytes: int) -> Draw:
        """Return the draw for a packet that a reliable transport repeats if it is lost."""
        losses = self._losses
        is_lost = losses is not None and losses.is_lost(seq, cell, self.n_parts(n_bytes))
        return Draw(self._delays[cell if self._delay_by_cell else seq], is_lost=is_lost)

    def p_loss(self, seq: int, cell: int, n_bytes: int) -> float:
        """Return the probability that the law loses a packet at the place of ``seq``, or at the time of ``cell``."""
        return 0.0 if self._losses is None else self._losses.p_loss(seq, cell, self.n_parts(n_bytes))

    def decide_many(self, seqs: NDArray[np.int64], cells: NDArray[np.int64], n_bytes: int) -> ManyDraws:
        """Return the draws of packets ``seqs`` (N,), each of ``n_bytes``, offered in ``cells`` (N,), in any order."""
        lost = np.zeros(len(seqs), dtype=bool)
        if self._losses is not None:
            lost = self._losses.are_lost(seqs, cells, self.n_parts(n_bytes))
        delay_ns = self._delays.many(cells if self._delay_by_cell else seqs)
        if self._rare is None:
            return ManyDraws(lost, delay_ns, np.full(len(seqs), -1), np.zeros(len(seqs), dtype=np.int64))
        return ManyDraws(lost, *self._rare.add_many(delay_ns, seqs, cells, n_bytes))

    def n_parts(self, n_bytes: int) -> int:
        """Return the number of packets of the loss model's MTU that a message needs, at least 1."""
        mtu_bytes = self._mtu_bytes
        return 1 if mtu_bytes is None or n_bytes <= mtu_bytes else -(-n_bytes // mtu_bytes)


def _delay_of(pipeline: Pipeline) -> tuple[object, ...]:
    return pipeline.delay, pipeline.jitter, pipeline.correlation


def _rare_stages_of(pipeline: Pipeline) -> tuple[object, ...]:
    return pipeline.duplicate, pipeline.corrupt, pipeline.reorder


class _Losses:
    """The losses: a message is lost if its uniform is below 1 - (1 - p_1) .. (1 - p_n), for n parts.

    A model ``has_memory`` if the p_i differ. Message i then has the parts i * n .. i * n + n - 1 of the model's path,
    so a burst of losses runs through the parts of one message into the next, and yet no draw depends on the sizes of
    other messages. This is exact where all messages of a key have the same number of parts.
    """

    def __init__(
        self, blocks: LossBlocks, has_memory: bool, uniforms: Stream, deferred: list[DeferredDraw] | None
    ) -> None:
        self._by_cell = blocks.counts == "cell"
        self._has_memory = has_memory
        self._p = Column(blocks.block, deferred)
        self._u = Column(uniforms.block, deferred)

    def p_loss(self, seq: int, cell: int, n_parts: int) -> float:
        if n_parts > 1 and self._has_memory:
            return 1.0 - float(np.prod(1.0 - self._p.stretch(seq * n_parts, n_parts)))
        p: float = self._p[cell if self._by_cell else seq]
        return p if n_parts == 1 else 1.0 - (1.0 - p) ** n_parts

    def is_lost(self, seq: int, cell: int, n_parts: int) -> bool:
        p = self.p_loss(seq, cell, n_parts)
        if 0.0 < p < 1.0:  # else no uniform is needed, and none is drawn
            return bool(self._u[seq] < p)
        return p > 0.0

    def are_lost(self, seqs: NDArray[np.int64], cells: NDArray[np.int64], n_parts: int) -> NDArray[np.bool_]:
        if n_parts > 1 and self._has_memory:
            step = max(1, _MAX_AT_ONCE // n_parts)
            parts = [self._of_parts(seqs[i : i + step], n_parts) for i in range(0, len(seqs), step)]
            p = np.concatenate(parts) if parts else np.empty(0)
        else:
            p = self._p.many(cells if self._by_cell else seqs)
            p = p if n_parts == 1 else 1.0 - (1.0 - p) ** n_parts
        lost: NDArray[np.bool_] = self._u.many(seqs) < p
        return lost

    def _of_parts(self, seqs: NDArray[np.int64], n_parts: int) -> NDArray[np.float64]:
        """Return the probability of each message, (N,), that it loses a part."""
        indices = seqs[:, None] * n_parts + np.arange(n_parts)
        p: NDArray[np.float64] = 1.0 - np.prod(1.0 - self._p.many(indices.ravel()).reshape(indices.shape), axis=1)
        return p


class _RareStages:
    """The stages that select single packets: duplication, corruption, deliberate reordering."""

    def __init__(
        self, pipeline: Pipeline, address: Address, traces: Mapping[str, Trace], deferred: list[DeferredDraw] | None
    ) -> None:
        self._corrupt, self._reorder = pipeline.corrupt, pipeline.reorder
        self._duplicated = Column(duplicated(pipeline.duplicate, address).block, deferred)
        self._corrupted = Column(corrupted(pipeline.corrupt, address).block, deferred)
        self._reordered = Column(reordered(pipeline.reorder, address).block, deferred)
        copies = delay_blocks(pipeline, address._replace(key=f"{address.key}#copy"), traces)  # no key contains a '#'
        self._copy_by_cell = copies.counts == "cell"
        self._copy_delays = Column(copies.block, deferred)

    def add(self, draw: Draw, seq: int, cell: int, n_bytes: int) -> Draw:
        delay_ns, copy_ns, n_flips = draw.delay_ns, None, 0
        if self._reordered[seq]:
            early = np.array([delay_ns])
            delay_ns -= int(skipped_ns(self._reorder, early, np.array([True]))[0])
        if self._duplicated[seq]:
            copy_ns = self._copy_delays[cell if self._copy_by_cell else seq]
        if self._corrupted[seq]:
            n_flips = n_flipped(self._corrupt, n_bytes)
        return Draw(delay_ns, copy_ns, n_flips)

    def add_many(
        self, delay_ns: NDArray[np.int64], seqs: NDArray[np.int64], cells: NDArray[np.int64], n_bytes: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        delays = delay_ns - skipped_ns(self._reorder, delay_ns, self._reordered.many(seqs))
        copies = np.where(
            self._duplicated.many(seqs), self._copy_delays.many(cells if self._copy_by_cell else seqs), -1
        )
        return delays, copies, np.where(self._corrupted.many(seqs), n_flipped(self._corrupt, n_bytes), 0)
