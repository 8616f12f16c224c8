"""The reported state of a running emulator, in each direction."""

from collections.abc import Mapping
from typing import Final, NamedTuple

from tis.common.channels import Direction
from tis.common.scenario.control import DirectionState, EmulatorState, RuleState
from tis.common.scenario.network.conditions import TimelineEntry
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.conditions.conditions import FOREVER_NS, Condition, merged
from tis.netem.link.link import Link
from tis.netem.link.rules import RuleTable

_NOTHING: Final = EmulatorState(running=False)


class Snapshot(NamedTuple):
    """The state of a link between two packets."""

    rules: RuleTable
    condition: Condition
    added: tuple[TimelineEntry, ...]
    counters: dict[str, int]


def snapshot(links: Mapping[Direction, Link], now_ns: int) -> dict[Direction, Snapshot]:
    """Copy what `describe` needs from both links; it is quick, since packets wait meanwhile."""
    return {
        direction: Snapshot(link.rules, link.conditions.at(now_ns), link.conditions.added(now_ns), link.counters())
        for direction, link in links.items()
    }


def describe(
    links: Mapping[Direction, Snapshot] | None, now_ns: int | None, counters: Mapping[str, int] | None = None
) -> EmulatorState:
    """Return the reported state, or the one of an idle emulator without a run (oracle: literals, test_state)."""
    if links is None or now_ns is None:
        return _NOTHING
    return EmulatorState(
        running=True,
        at_s=now_ns / NS_PER_S,
        unmatched=links["forward"].rules.unmatched,
        forward=_direction("forward", links["forward"]),
        feedback=_direction("feedback", links["feedback"]),
        counters=dict(counters or {}),
    )


def _direction(direction: Direction, link: Snapshot) -> DirectionState:
    condition = link.condition
    rules = tuple(
        RuleState(key=str(key), pipeline=pipeline, now=merged(pipeline, condition.changes))
        for key, pipeline in link.rules.rules
    )
    return DirectionState(
        state=condition.state,
        outage=condition.outage,
        stall=condition.stall,
        scale_rate=condition.scale_rate,
        scale_delay=condition.scale_delay,
        add_delay_ms=condition.add_delay_ns / NS_PER_MS,
        add_p_loss=condition.p_extra_loss,
        until_s=None if condition.until_ns >= FOREVER_NS else condition.until_ns / NS_PER_S,
        pipeline=link.rules.default,
        now=merged(link.rules.default, condition.changes),
        rules=rules,
        added=link.added,
        counters={name.removeprefix(f"{direction}."): count for name, count in link.counters.items()},
    )
