"""Requested network of each packet: the rule of its key under the conditions at its offering."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

import numpy as np
from msgspec import convert
from numpy.typing import NDArray

from tis.common.channels import Direction
from tis.common.errors import DataError
from tis.common.records import CONTROL, ControlNote
from tis.common.runtime.scenario_files import load_traces
from tis.common.scenario import Scenario
from tis.common.scenario.network import Buffer, NetworkPart, Rule
from tis.common.scenario.network.conditions import Change
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.trace import Trace
from tis.deploy.logs.read.columns import Ints
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.subjects.network.requested_pipeline import (
    RequestedPipeline,
    delay_moments_ns,
    p_loss,
    requested_pipeline,
    with_played_rows,
)
from tis.netem.conditions.conditions import FOREVER_NS, Condition, Conditions, Span, merged
from tis.netem.control.replay import ChangedConditions, changed_conditions
from tis.netem.link.packet import flow_key
from tis.netem.link.rules import RuleTable, compile_rules

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class StandaloneNetwork:
    """The network that the options of a standalone netem request, in place of a scenario.

    ``impaired_keys`` are the key expressions that get its own pipelines where no rule names another.
    """

    network: NetworkPart
    keys: tuple[str, ...]
    impaired_keys: tuple[str, ...]
    seed: int
    name: str = "netem"
    session: str = ""

    def generated_rules(self) -> tuple[Rule, ...]:
        """Return no rules: only the user writes rules here."""
        return ()


NetworkRequest = Scenario | StandaloneNetwork


class InForce(NamedTuple):
    """The conditions in force for each of N packets: ``which`` (N,) are indices into ``conditions``."""

    conditions: tuple[Condition, ...]
    which: Ints

    def column(self, name: str) -> Any:
        """Return an attribute of the condition of each packet, (N,)."""
        return np.array([getattr(condition, name) for condition in self.conditions])[self.which]


class Expected(NamedTuple):
    """The request for N packets: arrays (N,), and scalars for all of them.

    ``delay_ns`` and ``std_ns`` are mean and standard deviation of the drawn delay of a delivered packet, ``p_loss``
    the probability that the models lose it. ``steps_ns`` and ``shares``, (3, N), are points of the distribution of
    its delay, NaN where none can be tested. ``skewness``, ``half_life_s`` and ``loss_inflation`` are the largest of
    any condition.
    """

    delay_ns: Floats
    std_ns: Floats
    p_loss: Floats
    outage: NDArray[np.bool_]
    p_duplicate: Floats
    p_corrupt: Floats
    steps_ns: Floats
    shares: Floats
    skewness: float
    half_life_s: float | None
    loss_inflation: float
    is_recorded: bool
    has_rate: bool


class Stretch(NamedTuple):
    """A span of run time from ``begin_ns`` to ``end_ns``, exclusive; `FOREVER_NS`: without end."""

    begin_ns: int
    end_ns: int


@dataclass
class Requested:
    """The rules and conditions of one direction of a scenario."""

    rules: RuleTable
    conditions: Conditions | ChangedConditions
    traces: Mapping[str, Trace]
    changed: tuple[Stretch, ...] = ()
    """Spans in which control changes held in this direction: the scenario's network was not in force then."""
    may_limit_rate: bool = False
    """Whether a state or the timeline sets a rate, or a stall makes messages wait."""
    buffer: Buffer = field(default_factory=Buffer)
    """Capacity of netem's buffer."""
    changes_ordering: bool = False
    """Whether a state or the timeline sets an ordering other than fifo."""
    _known: dict[tuple[Pipeline, tuple[Change, ...]], RequestedPipeline | None] = field(default_factory=dict)
    _pipelines: dict[str, Pipeline | None] = field(default_factory=dict)

    @classmethod
    def of(cls, scenario: NetworkRequest, direction: Direction, logs: RunLogs) -> Self:
        """Return the request for one direction; a trace that cannot be read is left out."""
        try:
            traces: Mapping[str, Trace] = load_traces(scenario.network, logs.attachments("netem"))
        except DataError:
            traces = {}
        network = scenario.network
        rules = compile_rules(network, scenario.name, scenario.impaired_keys, scenario.generated_rules())
        notes = [convert(row, ControlNote) for row in logs.of("netem", CONTROL)]
        changed = tuple(_changed(direction, notes))
        states = () if network.states is None else network.states.states
        changes = [entry.set for entry in network.timeline] + [getattr(state, direction) for state in states]
        return cls(
            rules[direction],
            changed_conditions(network, direction, scenario.seed, notes if changed else ()),
            traces,
            changed,
            any(change.rate is not None or change.stall for change in changes)
            or any(part.effect == "stall" for part in network.outages),
            network.buffer,
            any(change.ordering not in (None, "fifo") for change in changes),
        )

    @property
    def varies(self) -> bool:
        """Tell whether the request changes during the run."""
        return not self.conditions.is_constant or bool(self.changed)

    def forbids_overtaking(self, pipeline: Pipeline) -> bool:
        """Tell whether the ordering of a pipeline's keys forbids overtaking all the time.

        Under changes that holds for fifo alone: it waits also for what a removed stage still delays.
        """
        if self.varies:
            return pipeline.ordering == "fifo" and not (self.changed or self.changes_ordering)
        return pipeline.ordering != "reorder"

    def unchanged(self, at_ns: Ints) -> NDArray[np.bool_]:
        """Mark the instants (N,) at which no control change was in force."""
        # spans do not overlap: an even number of edges before an instant means that it is outside of all
        edges_ns = np.array([edge_ns for stretch in self.changed for edge_ns in stretch], dtype=np.int64)
        return np.asarray(np.searchsorted(edges_ns, at_ns, side="right") % 2 == 0)

    def pipeline(self, key: str) -> Pipeline | None:
        """Return the pipeline of a key outside all conditions; None when the key is refused."""
        if key not in self._pipelines:
            assigned = self.rules.assign(flow_key(key))
            self._pipelines[key] = None if assigned is None else assigned.pipeline
        return self._pipelines[key]

    def base(self, key: str) -> RequestedPipeline | None:
        """Return the request of a key without changes; None when the key is refused or a trace is missing."""
        return self.under(key, ())

    def shared(self, keys: Sequence[str], seq: Ints, offered_ns: Ints) -> RequestedPipeline | None:
        """Return the request that all ``keys`` share, with the trace rows that their N packets played.

        None when the keys have different pipelines or the request is unknown.
        """
        shared = self.base(keys[0]) if len({self.pipeline(key) for key in keys}) == 1 else None
        return None if shared is None else with_played_rows(shared, seq, offered_ns)

    def shared_by(self, fates: Frame) -> RequestedPipeline | None:
        """Return the request that all keys of packets of a direction share."""
        return self.shared([fates.keys[number] for number in np.unique(fates.key)], fates.seq, fates.offered_ns)

    def in_force(self, at_ns: Ints) -> InForce:
        """Return the conditions at instants (N,) in any order (oracle: one by one, test_requested)."""
        order = np.argsort(at_ns, kind="stable")
        ordered = at_ns[order]
        which = np.empty(len(at_ns), dtype=np.int64)
        numbers: dict[Condition, int] = {}
        first, n = 0, len(ordered)
        while first < n:  # one look-up per span of a condition, not per packet
            condition = self.conditions.at(int(ordered[first]))
            stop = max(first + 1, int(np.searchsorted(ordered, condition.until_ns)))
            alike = condition._replace(until_ns=0, since_ns=0)
            which[order[first:stop]] = numbers.setdefault(alike, len(numbers))
            first = stop
        return InForce(tuple(numbers), which)

    def spans(self, until_ns: int) -> list[Span]:
        """Return the conditions in force from 0 to ``until_ns``."""
        return self.conditions.spans(until_ns)

    def of_packets(self, key: str, fates: Frame) -> Expected | None:
        """Return the request for N > 0 packets of one key; None when the key is refused or a trace is missing.

        Control changes count as requested. Oracle: `tis.netem.expected.simulate`, test_requested.
        """
        held = self.in_force(fates.offered_ns)
        # conditions with the same changes share one request
        variants: dict[tuple[Change, ...], int] = {}
        numbers = [variants.setdefault(condition.changes, len(variants)) for condition in held.conditions]
        requests = [self.under(key, changes) for changes in variants]
        known = [one for one in requests if one is not None]
        if len(known) < len(requests):
            return None
        variant = np.array(numbers)[held.which]

        delay_ns, std_ns, p_own = (np.zeros(len(fates.seq)) for _ in range(3))
        for number, one in enumerate(known):
            which = variant == number
            its = fates.at(which)
            delay_ns[which], std_ns[which] = delay_moments_ns(one, its.seq, its.offered_ns)
            p_own[which] = p_loss(one, its.seq, its.offered_ns, one.n_packets(its.n_bytes))

        scale = held.column("scale_delay")
        half_lives = [one.half_life_s for one in known if one.half_life_s is not None]
        nothing = [(np.nan, np.nan)] * 3
        steps = np.array([one.steps_ns() or nothing for one in known])[variant]
        add_ns = held.column("add_delay_ns")
        return Expected(
            delay_ns=delay_ns * scale + add_ns,
            std_ns=std_ns * scale,
            p_loss=1.0 - (1.0 - p_own) * (1.0 - held.column("p_extra_loss")),
            outage=held.column("outage"),
            p_duplicate=np.array([one.p_duplicate for one in known])[variant],
            p_corrupt=np.array([one.p_corrupt for one in known])[variant],
            # a scale of 0 leaves a constant, whose shares cannot be tested
            steps_ns=(steps[:, :, 0].T * np.where(scale > 0.0, scale, np.nan)) + add_ns,
            shares=steps[:, :, 1].T,
            skewness=max(abs(one.skewness) for one in known),
            half_life_s=max(half_lives, default=None),
            loss_inflation=max(one.loss_inflation() for one in known),
            is_recorded=any(one.is_recorded for one in known),
            has_rate=any(one.pipeline.rate is not None for one in known),
        )

    def under(self, key: str, changes: tuple[Change, ...]) -> RequestedPipeline | None:
        """Return the request of a key's pipeline under changes; None as for `base`."""
        base = self.pipeline(key)
        if base is None:
            return None
        place = (base, changes)
        if place not in self._known:
            self._known[place] = requested_pipeline(merged(base, changes), self.traces)
        return self._known[place]


def _changed(direction: Direction, notes: Sequence[ControlNote]) -> list[Stretch]:
    """Return the spans in which control changes held in a direction, adjacent ones joined."""
    stretches: list[Stretch] = []
    # the notes on an empty network: what deviates from it is due to control alone
    for span in changed_conditions(NetworkPart(), direction, 0, notes).spans(FOREVER_NS):
        if not span.changed:
            continue
        begins_ns = stretches.pop().begin_ns if stretches and stretches[-1].end_ns == span.begin_ns else span.begin_ns
        stretches.append(Stretch(begins_ns, span.end_ns))
    return stretches
