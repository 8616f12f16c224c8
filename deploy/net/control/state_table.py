"""Terminal output of ``tis net show``."""

from collections.abc import Iterable, Mapping
from typing import Any, Final

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tis.common.channels import Direction
from tis.common.runtime.emulator_client import EmulatorAddress
from tis.common.scenario.control import DirectionState, EmulatorState, RuleState
from tis.common.scenario.network.conditions import TimelineEntry
from tis.common.scenario.network.pipeline import Pipeline
from tis.netem.expected.figures import direction_label

_NONE: Final = "-"
_CHANGED: Final = " *"


def print_state(state: EmulatorState, address: EmulatorAddress, out: Console) -> None:
    """Print both directions side by side, the changes made while running, and the rules."""
    both: tuple[tuple[Direction, DirectionState | None], ...]
    both = (("forward", state.forward), ("feedback", state.feedback))
    ways = {name: of for name, of in both if of is not None}
    out.print(f"{address.endpoint}, {address.prefix}: run time {state.at_s or 0.0:.3f} s")
    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in ("", *(direction_label(name) for name in ways)):
        table.add_column(heading, overflow="fold")
    for name in _names(ways.values()):
        table.add_row(name, *(escape(_stage(of.pipeline, of.now, name)) for of in ways.values()))
    for name, cells in _rows(list(ways.values())):
        table.add_row(name, *map(escape, cells))
    out.print(table)
    if any(of.pipeline != of.now for of in ways.values()):
        out.print("* differs from the scenario")
    for name, of in ways.items():
        for entry in of.added:
            out.print(escape(f"changed, {name}: {_entry(entry)}"), soft_wrap=True)
    for name, of in ways.items():
        for rule in of.rules:
            out.print(escape(f"rule, {name}: {rule.key}: {_rule(rule)}"), soft_wrap=True)


def _names(ways: Iterable[DirectionState]) -> list[str]:
    pipelines = [pipeline for way in ways for pipeline in (way.pipeline, way.now)]
    return [name for name in Pipeline.model_fields if any(getattr(one, name) is not None for one in pipelines)]


def _rows(ways: list[DirectionState]) -> list[tuple[str, list[str]]]:
    rows = [("outage", ["yes" if way.outage else "no" for way in ways])]
    if any(way.stall for way in ways):
        rows.append(("stall", ["yes" if way.stall else "no" for way in ways]))
    if any(way.state for way in ways):
        rows.append(("state", [way.state or _NONE for way in ways]))
    if any(way.scale_rate != 1.0 for way in ways):
        rows.append(("bit rate", [f"x {way.scale_rate:g}" for way in ways]))
    if any((way.scale_delay, way.add_delay_ms) != (1.0, 0.0) for way in ways):
        rows.append(("each delay", [f"x {way.scale_delay:g} + {way.add_delay_ms:g} ms" for way in ways]))
    if any(way.add_p_loss for way in ways):
        rows.append(("further loss", [f"{way.add_p_loss:g}" for way in ways]))
    if any(way.until_s is not None for way in ways):
        rows.append(("next change", [_NONE if way.until_s is None else f"{way.until_s:.3f} s" for way in ways]))
    counts = {"offered": "offered", "released": "released", "held": "held_at_end"}
    counted = [(name, [str(way.counters.get(count, 0)) for way in ways]) for name, count in counts.items()]
    return [*rows, *counted, ("dropped", [_dropped(way.counters) for way in ways])]


def _dropped(counters: Mapping[str, int]) -> str:
    found = [
        f"{name.removeprefix('dropped.')} {n}" for name, n in counters.items() if name.startswith("dropped.") and n
    ]
    return ", ".join(found) or "0"


def _stage(scenario: Pipeline, now: Pipeline, name: str) -> str:
    before, after = getattr(scenario, name), getattr(now, name)
    return _words(_plain(now).get(name)) + ("" if before == after else _CHANGED)


def _rule(rule: RuleState) -> str:
    stages = [f"{name} {_words(value)}" for name, value in _plain(rule.now).items() if name != "ordering"]
    return (", ".join(stages) or "passes without delay") + ("" if rule.now == rule.pipeline else _CHANGED)


def _entry(entry: TimelineEntry) -> str:
    length = "" if entry.for_s is None else f" for {entry.for_s:g} s"
    ramp = f", ramped for {entry.ramp_s:g} s" if entry.ramp_s else ""
    given = entry.set.model_dump(mode="json", exclude_unset=True)
    return f"from {entry.at_s:.3f} s{length}{ramp}: " + ", ".join(f"{name} {_words(v)}" for name, v in given.items())


def _plain(pipeline: Pipeline) -> dict[str, Any]:
    return pipeline.model_dump(mode="json", exclude_defaults=True) | {"ordering": pipeline.ordering}


def _words(value: Any) -> str:
    """Return a stage on one line: its kind, then names and values, a list by its length."""
    if isinstance(value, Mapping):
        kind = [str(value["kind"])] if "kind" in value else []
        return " ".join([*kind, *(f"{name} {_words(below)}" for name, below in value.items() if name != "kind")])
    if isinstance(value, list):
        return f"({len(value)} points)"
    if value is None:
        return _NONE
    return f"{value:g}" if isinstance(value, float) else str(value).lower() if isinstance(value, bool) else str(value)
