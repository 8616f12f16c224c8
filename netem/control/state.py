"""What a running emulator says of itself: what holds now, in each direction."""

from collections.abc import Mapping
from typing import Final, NamedTuple

from common.channels import Direction
from common.scenario.control import DirectionState, EmulatorState, RuleState
from common.scenario.network.conditions import TimelineEntry
from common.units import NS_PER_MS, NS_PER_S
from netem.conditions.conditions import FOREVER_NS, Condition, merged
from netem.link.link import Link
from netem.link.rules import RuleTable

_NOTHING: Final = EmulatorState(running=False)


class Seen(NamedTuple):
    """What is read off a link between two packets."""

    rules: RuleTable
    condition: Condition
    added: tuple[TimelineEntry, ...]
    counters: dict[str, int]


def look(links: Mapping[Direction, Link], now_ns: int) -> dict[Direction, Seen]:
    """Read off both links what `describe` needs; quick, so that no packet waits for it."""
    return {
        direction: Seen(link.rules, link.conditions.at(now_ns), link.conditions.added(now_ns), link.counters())
        for direction, link in links.items()
    }


def describe(
    seen: Mapping[Direction, Seen] | None, now_ns: int | None, counters: Mapping[str, int] | None = None
) -> EmulatorState:
    """Return the state as it is told; without a run there is none (oracle: literal states, test_control_state)."""
    if seen is None or now_ns is None:
        return _NOTHING
    return EmulatorState(
        running=True,
        at_s=now_ns / NS_PER_S,
        unmatched=seen["forward"].rules.unmatched,
        forward=_direction("forward", seen["forward"]),
        feedback=_direction("feedback", seen["feedback"]),
        counters=dict(counters or {}),
    )


def _direction(direction: Direction, seen: Seen) -> DirectionState:
    condition = seen.condition
    rules = tuple(
        RuleState(key=str(key), pipeline=pipeline, now=merged(pipeline, condition.changes))
        for key, pipeline in seen.rules.rules
    )
    return DirectionState(
        state=condition.state,
        outage=condition.outage,
        scale_delay=condition.scale_delay,
        add_delay_ms=condition.add_delay_ns / NS_PER_MS,
        add_p_loss=condition.p_extra_loss,
        until_s=None if condition.until_ns >= FOREVER_NS else condition.until_ns / NS_PER_S,
        pipeline=seen.rules.default,
        now=merged(seen.rules.default, condition.changes),
        rules=rules,
        added=seen.added,
        counters={name.removeprefix(f"{direction}."): count for name, count in seen.counters.items()},
    )
