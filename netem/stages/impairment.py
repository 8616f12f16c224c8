"""The impairment of one key in one direction: a pipeline under the present condition."""

from collections.abc import Mapping
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.network.capacity import Capacity
from tis.common.scenario.network.conditions import Change
from tis.common.scenario.network.pipeline import Ordering, Pipeline
from tis.common.streams import Address
from tis.common.trace import Trace
from tis.common.units import NS_PER_MS, ms_to_ns
from tis.netem.conditions.conditions import FOREVER_NS, Condition, Conditions, merged
from tis.netem.draws.blocks import Column, DeferredDraw
from tis.netem.stages.delay import latency_of
from tis.netem.stages.loss.recovery import Terms
from tis.netem.stages.pipeline_draws import Draw, Draws, ManyDraws

_NEUTRAL: Final = 1.0
_MAX_VARIANTS: Final = 64
_MAX_AGAIN: Final = 64  # uniforms of a packet for its repeats; after them they come again

Verdict = Literal["deliver", "loss", "outage"]


class Variant(NamedTuple):
    """A pipeline after changes, its draws, and the terms of its recovery."""

    pipeline: Pipeline
    draws: Draws
    terms: Terms | None


class Modulations(NamedTuple):
    """The modulation of N packets under the same replaced stages: arrays (N,)."""

    changes: tuple[Change, ...]
    scale_delay: NDArray[np.float64]
    add_delay_ns: NDArray[np.int64]
    p_extra_loss: NDArray[np.float64]


class Impairment:
    """A pipeline that impairs one key, with its variants under states and timeline.

    ``rate``, ``ordering`` and ``terms``, of a recovery, are those under the conditions of the last decision. All
    variants draw from the same uniforms at the same addresses, so a change of one stage does not shift the draws of
    the others.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        address: Address,
        traces: Mapping[str, Trace] | None = None,
        deferred: list[DeferredDraw] | None = None,
    ) -> None:
        self._pipeline = pipeline
        self._address = address
        self._traces = traces or {}
        self._deferred = deferred
        self._extra = Column(address.stream("extra_loss").block, deferred)
        self._again = Column(address.stream("again").block)
        self._latest = 0
        self._variants: dict[tuple[Change, ...], Variant] = {}
        self._select(())

    @property
    def is_open(self) -> bool:
        """Tell whether the unchanged pipeline has no stage that drops, delays or alters a packet."""
        return self._pipeline.is_open

    def decide(self, seq: int, now_ns: int, n_bytes: int, condition: Condition) -> Draw | Verdict:
        """Return the draw for packet ``seq`` offered at ``now_ns``, or the reason why it is not delivered.

        ``condition`` is the one at ``now_ns``.
        """
        if condition.changes is not self._changes:
            self._select(condition.changes)
        if self.terms is not None:
            return self._recovered(seq, now_ns, n_bytes, condition)
        if condition.outage:
            return "outage"
        draw = self._draws.decide(seq, now_ns // NS_PER_MS, n_bytes)
        if draw is None or (condition.p_extra_loss > 0.0 and self._extra[seq] < condition.p_extra_loss):
            return "loss"
        if condition.scale_delay == _NEUTRAL and condition.add_delay_ns == 0:
            return draw
        return _modulated(draw, condition)

    def leaves_again_ns(self, seq: int, n: int, at_ns: int, conditions: Conditions) -> int | None:
        """Return when repeat ``n`` >= 1 of a packet, sent at ``at_ns``, leaves: after a stall; None if it is lost.

        The law that holds then decides, ``n`` places after the key's latest packet: each sending is a step of it.
        A repeat is one packet, however many the message had.
        """
        condition = conditions.at(at_ns)
        if condition.outage:
            return None
        draws = self.variant(condition.changes).draws
        p = draws.p_loss(self._latest + n, at_ns // NS_PER_MS, 0)
        p = 1.0 - (1.0 - p) * (1.0 - condition.p_extra_loss)
        if p > 0.0 and self._again[seq * _MAX_AGAIN + n % _MAX_AGAIN] < p:
            return None
        while condition.stall and condition.until_ns < FOREVER_NS:
            at_ns = condition.until_ns
            condition = conditions.at(at_ns)
        return at_ns

    def _recovered(self, seq: int, now_ns: int, n_bytes: int, condition: Condition) -> Draw:
        self._latest = seq
        draw = self._draws.decide_recovered(seq, now_ns // NS_PER_MS, n_bytes)
        lost = draw.is_lost or condition.outage
        lost = lost or (condition.p_extra_loss > 0.0 and self._extra[seq] < condition.p_extra_loss)
        return _modulated(draw, condition, lost)

    def decide_many(
        self, seqs: NDArray[np.int64], cells: NDArray[np.int64], n_bytes: int, modulations: Modulations
    ) -> ManyDraws:
        """Return the draws of packets ``seqs`` (N,) offered in ``cells`` (N,), none of them in an outage."""
        draws = self.variant(modulations.changes).draws.decide_many(seqs, cells, n_bytes)
        lost = draws.lost
        if modulations.p_extra_loss.any():
            lost = lost | (self._extra.many(seqs) < modulations.p_extra_loss)
        delay_ns, copy_ns = (
            np.rint(ns * modulations.scale_delay).astype(np.int64) + modulations.add_delay_ns
            for ns in (draws.delay_ns, draws.copy_delay_ns)
        )
        return ManyDraws(lost, delay_ns, np.where(draws.copy_delay_ns < 0, -1, copy_ns), draws.n_flips)

    def variant(self, changes: tuple[Change, ...]) -> Variant:
        """Return the variant of the pipeline under ``changes``."""
        found = self._variants.get(changes)
        if found is None:
            found = self._make(changes)
            if len(self._variants) >= _MAX_VARIANTS:  # live control may request any number of them
                del self._variants[next(iter(self._variants))]
            self._variants[changes] = found
        return found

    def _select(self, changes: tuple[Change, ...]) -> None:
        pipeline, self._draws, self.terms = self.variant(changes)
        self._changes = changes
        self.rate: Capacity | Literal["link"] | None = pipeline.rate
        self.ordering: Ordering = pipeline.ordering

    def _make(self, changes: tuple[Change, ...]) -> Variant:
        pipeline = merged(self._pipeline, changes)
        draws = Draws(pipeline, self._address, self._traces, self._deferred)
        for other in self._variants.values():
            draws.share(other.draws)
        return Variant(pipeline, draws, _terms(pipeline, self._traces))


def _terms(pipeline: Pipeline, traces: Mapping[str, Trace]) -> Terms | None:
    recovery = pipeline.recovery
    if recovery is None:
        return None
    mean_ns = round(latency_of(pipeline, traces).mean_ns)
    rtt_ns = 2 * mean_ns if recovery.rtt_ms is None else ms_to_ns(recovery.rtt_ms)
    rto_ns, max_rto_ns = ms_to_ns(recovery.rto_ms), ms_to_ns(recovery.max_ms)
    return Terms(rtt_ns, max(0, rtt_ns - mean_ns), rto_ns, max_rto_ns, recovery.tail_probe, recovery.congestion)


def _modulated(draw: Draw, condition: Condition, is_lost: bool = False) -> Draw:
    def scaled(delay_ns: int) -> int:
        return round(delay_ns * condition.scale_delay) + condition.add_delay_ns

    copy_ns = draw.copy_delay_ns
    return Draw(scaled(draw.delay_ns), None if copy_ns is None else scaled(copy_ns), draw.n_flips, is_lost)
