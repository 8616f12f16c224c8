"""What the scenario asks of each packet of a direction: by its key's rule, and the conditions when it was offered."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from common.channels import Direction
from common.errors import DataError
from common.records import CONTROL, ControlNote
from common.runtime.trace_files import load_traces
from common.scenario.network import Buffer, NetworkPart, Rule
from common.scenario.network.conditions import Change
from common.scenario.network.pipeline import Pipeline
from common.trace import Trace
from deploy.logs.read.batches import Fates
from deploy.logs.read.load import Ints, RunLogs
from deploy.report.measures.network.requested_pipeline import RequestedPipeline, requested_pipeline
from deploy.report.measures.network.trace_playback import delay_moments_ns, p_loss, with_played_rows
from netem.conditions.conditions import FOREVER_NS, Condition, Conditions, Span, merged
from netem.control.changed_conditions import ChangedConditions, changed_conditions
from netem.link.flow import flow_key
from netem.link.rules import RuleTable, compile_rules

Floats = NDArray[np.float64]


class NetworkRequest(Protocol):
    """Who asks for a network: a scenario, or the user of a netem without one."""

    @property
    def name(self) -> str:
        """What errors call it."""
        ...

    @property
    def session(self) -> str:
        """The first chunk of the testbed's own keys; empty without."""
        ...

    @property
    def seed(self) -> int:
        """Decides every random number."""
        ...

    @property
    def network(self) -> NetworkPart:
        """What is asked for."""
        ...

    @property
    def impaired_keys(self) -> tuple[str, ...]:
        """Key expressions of the directions' own pipelines."""
        ...

    def generated_rules(self) -> tuple[Rule, ...]:
        """Return the rules that nobody wrote."""
        ...


class InForce(NamedTuple):
    """Which of ``conditions`` held for each of N packets: ``which`` (N,) are indices into them."""

    conditions: tuple[Condition, ...]
    which: Ints

    def column(self, name: str) -> Any:
        """Return an attribute of the condition of each packet, (N,)."""
        return np.array([getattr(condition, name) for condition in self.conditions])[self.which]


class Expected(NamedTuple):
    """What is asked of N packets: arrays (N,), and what holds for all of them.

    ``delay_ns`` and its ``std_ns`` are those of what is drawn, where it is delivered; ``p_loss`` the probability that
    the models lose it. ``steps_ns`` and ``shares``, (3, N), are points of the distribution of its delay, NaN where
    there are none to test. The largest ``skewness``, ``half_life_s`` and ``loss_inflation`` of any condition.
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
    """From ``begin_ns`` until ``end_ns``, exclusive, in ns of run time; `FOREVER_NS`: for good."""

    begin_ns: int
    end_ns: int


class Requested:
    """The rules and conditions of one direction of a scenario."""

    def __init__(
        self,
        rules: RuleTable,
        conditions: Conditions | ChangedConditions,
        traces: Mapping[str, Trace],
        changed: Sequence[Stretch] = (),
        may_limit_rate: bool = False,
        buffer: Buffer | None = None,
    ) -> None:
        self.rules = rules
        self.conditions = conditions
        self.changed = tuple(changed)
        """When changes made while running held in this direction: then the network asked for was not in force."""
        self.buffer = buffer or Buffer()
        """What netem may hold."""
        self.may_limit_rate = may_limit_rate
        """Whether a state or the timeline sets a rate."""
        self.traces = traces
        self._known: dict[tuple[Pipeline, tuple[Change, ...]], RequestedPipeline | None] = {}
        self._pipelines: dict[str, Pipeline | None] = {}

    @classmethod
    def of(cls, scenario: NetworkRequest, direction: Direction, logs: RunLogs) -> Self:
        """Return what a scenario asks for in one direction; a trace that cannot be read is left out."""
        try:
            traces: Mapping[str, Trace] = load_traces(scenario.network, logs.attachments("netem"))
        except DataError:
            traces = {}
        network = scenario.network
        rules = compile_rules(network, scenario.name, scenario.impaired_keys, scenario.generated_rules())
        notes = [ControlNote.model_validate(row) for row in logs.of("netem", CONTROL)]
        changed = _changed(direction, notes)
        return cls(
            rules[direction],
            changed_conditions(network, direction, scenario.seed, notes if changed else ()),
            traces,
            changed,
            any(change.rate is not None for change in _changes(network, direction)),
            network.buffer,
        )

    @property
    def varies(self) -> bool:
        """Tell whether what is asked for changes while the run lasts."""
        return not self.conditions.is_constant or bool(self.changed)

    def unchanged(self, at_ns: Ints) -> NDArray[np.bool_]:
        """Tell of each instant (N,) whether no change made while running held."""
        edges_ns = np.array([edge_ns for stretch in self.changed for edge_ns in stretch], dtype=np.int64)
        return np.asarray(np.searchsorted(edges_ns, at_ns, side="right") % 2 == 0)

    def pipeline(self, key: str) -> Pipeline | None:
        """Return the pipeline of a key outside all conditions; None: it is refused."""
        if key not in self._pipelines:
            assigned = self.rules.assign(flow_key(key))
            self._pipelines[key] = None if assigned is None else assigned.pipeline
        return self._pipelines[key]

    def base(self, key: str) -> RequestedPipeline | None:
        """Return what the pipeline of a key asks for by itself; None when it is refused, or a trace is missing."""
        return self.asked(key, ())

    def together(self, fates: Fates) -> RequestedPipeline | None:
        """Return what the pipeline that all keys of N packets share asks for by itself, of traces the rows played.

        None when the keys have different ones, or nobody knows.
        """
        keys = [fates.keys[number] for number in np.unique(fates.key)]
        asked = self.base(keys[0]) if len({self.pipeline(key) for key in keys}) == 1 else None
        return None if asked is None else with_played_rows(asked, fates.seq, fates.offered_ns)

    def in_force(self, at_ns: Ints) -> InForce:
        """Return the conditions at instants (N,), in any order (oracle: one by one, test_requested)."""
        order = np.argsort(at_ns, kind="stable")
        ordered = at_ns[order]
        which = np.empty(len(at_ns), dtype=np.int64)
        numbers: dict[Condition, int] = {}
        first, n = 0, len(ordered)
        while first < n:
            condition = self.conditions.at(int(ordered[first]))
            stop = max(first + 1, int(np.searchsorted(ordered, condition.until_ns)))
            alike = condition._replace(until_ns=0, since_ns=0)
            which[order[first:stop]] = numbers.setdefault(alike, len(numbers))
            first = stop
        return InForce(tuple(numbers), which)

    def spans(self, until_ns: int) -> list[Span]:
        """Return what held from 0 until ``until_ns``."""
        return self.conditions.spans(until_ns)

    def of_packets(self, key: str, fates: Fates) -> Expected | None:
        """Return what is asked of N > 0 packets of one key; None when it is refused, or a trace is missing.

        Changes made while running count as asked for. Oracle: `netem.expected.simulate`, test_requested.
        """
        held = self.in_force(fates.offered_ns)
        variants: dict[tuple[Change, ...], int] = {}
        numbers = [variants.setdefault(condition.changes, len(variants)) for condition in held.conditions]
        asked = [self.asked(key, changes) for changes in variants]
        known = [one for one in asked if one is not None]
        if len(known) < len(asked):
            return None
        variant = np.array(numbers)[held.which]

        delay_ns, std_ns, p_own = (np.zeros(len(fates.seq)) for _ in range(3))
        for number, one in enumerate(known):
            which = variant == number
            its = fates.at(which)
            delay_ns[which], std_ns[which] = delay_moments_ns(one, its.seq, its.offered_ns)
            p_own[which] = p_loss(one, its.seq, its.offered_ns, self.n_packets(one, its))

        def column(name: str) -> Floats:
            values = np.array([getattr(one, name) for one in known], dtype=np.float64)
            return np.asarray(values[variant])

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
            p_duplicate=column("p_duplicate"),
            p_corrupt=column("p_corrupt"),
            steps_ns=(steps[:, :, 0].T * np.where(scale > 0.0, scale, np.nan)) + add_ns,
            shares=steps[:, :, 1].T,
            skewness=max(abs(one.skewness) for one in known),
            half_life_s=max(half_lives, default=None),
            loss_inflation=max(one.loss_inflation() for one in known),
            is_recorded=any(one.is_recorded for one in known),
            has_rate=any(one.pipeline.rate is not None for one in known),
        )

    @staticmethod
    def n_packets(asked: RequestedPipeline, fates: Fates) -> Ints:
        """Return into how many packets of the loss model's MTU the payload of each message was cut, (N,)."""
        return asked.n_packets(fates.n_bytes)

    def asked(self, key: str, changes: tuple[Change, ...]) -> RequestedPipeline | None:
        """Return what the pipeline of a key asks for under changes; None as for `base`."""
        base = self.pipeline(key)
        if base is None:
            return None
        place = (base, changes)
        if place not in self._known:
            self._known[place] = requested_pipeline(merged(base, changes), self.traces)
        return self._known[place]


def _changed(direction: Direction, notes: Sequence[ControlNote]) -> list[Stretch]:
    """Return when what was asked for while running held in a direction: the changes alone, on a network of none."""
    stretches: list[Stretch] = []
    for span in changed_conditions(NetworkPart(), direction, 0, notes).spans(FOREVER_NS):
        if not span.changed:
            continue
        begins_ns = stretches.pop().begin_ns if stretches and stretches[-1].end_ns == span.begin_ns else span.begin_ns
        stretches.append(Stretch(begins_ns, span.end_ns))
    return stretches


def _changes(network: NetworkPart, direction: Direction) -> list[Change]:
    states = () if network.states is None else network.states.states
    return [entry.set for entry in network.timeline] + [getattr(state, direction) for state in states]
