"""A network in a few words, one line a direction: what is told before the first message passes."""

from collections.abc import Mapping
from math import isnan
from typing import Final, get_args

from common.channels import DESTINATION, ORIGIN, Direction
from common.scenario.network import NetworkPart
from common.scenario.network.conditions import CycleStates
from common.trace import Trace
from netem.figures import direction_figures

_BY_NAME: Final = ("duplicate", "corrupt", "rate", "reorder")


def way(direction: Direction) -> str:
    """Return a direction with the networks that it joins, as ``forward (west to east)``."""
    return f"{direction} ({ORIGIN[direction]} to {DESTINATION[direction]})"


def synopsis(network: NetworkPart, traces: Mapping[str, Trace]) -> list[str]:
    """Return a line a direction: its figures in the long run, as in the profile library, and what changes them.

    Oracle: the library's own figures and literal lines, tests/netem/test_synopsis.
    """
    return [f"{way(direction)}: {_words(network, direction, traces)}" for direction in get_args(Direction)]


def _words(network: NetworkPart, direction: Direction, traces: Mapping[str, Trace]) -> str:
    of = direction_figures(network, direction, traces)
    changes = () if network.states is None else [getattr(state, direction) for state in network.states.states]
    pipeline = getattr(network, direction)
    words = []
    if isnan(of.mean_ms):
        words.append("nothing arrives")
    elif pipeline.delay is not None or of.mean_ms > 0:
        words.append(f"delay {of.mean_ms:.4g} ms, sd {of.std_ms:.3g}")
    if of.loss_pct > 0:
        words.append(f"loss {of.loss_pct:.3g} %")
    if of.outage_pct > 0:
        words.append(f"outages {of.outage_pct:.3g} % of the time")
    words += [name for name in _BY_NAME if any(getattr(part, name) is not None for part in (pipeline, *changes))]
    words += [*_states(network), *_timeline(network, direction), *_rules(network, direction)]
    return ", ".join(words) or "nothing injected"


def _states(network: NetworkPart) -> list[str]:
    states = network.states
    if states is None:
        return []
    names = "/".join(dict.fromkeys(state.name for state in states.states))
    if isinstance(states, CycleStates):
        return [f"states {names} in a cycle of {sum(state.for_s for state in states.states):g} s"]
    return [f"states {names}"]


def _timeline(network: NetworkPart, direction: Direction) -> list[str]:
    n = sum(entry.direction in (direction, "both") for entry in network.timeline)
    return [f"timeline of {n}"] if n else []


def _rules(network: NetworkPart, direction: Direction) -> list[str]:
    n = sum(rule.direction in (direction, "both") for rule in network.rules)
    return [f"{n} rule{'s' if n > 1 else ''}"] if n else []
