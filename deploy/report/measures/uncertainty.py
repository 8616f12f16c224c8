"""The summary's ``uncertainty_ms``: how far the clocks leave each one-way figure open."""

from collections.abc import Mapping
from typing import Any, Final, get_args

import numpy as np

from common.channels import Hand
from common.clocks.exchange import Ints
from common.clocks.figures import is_resolvable, uncertainties
from common.metrics.percentiles import Summary
from common.units import NS_PER_MS
from deploy.logs.read.clocks import sender_of
from deploy.logs.read.load import RunLogs
from deploy.report.measures.latency import UsedSamples, ages_of_hand

_AGES: Final = (
    "age_of_information_ms",
    "age_of_information_ms.peak",
    *(f"tick_modes.{mode}.age_when_used_ms" for mode in ("free", "phase_locked", "on_arrival")),
)


def clock_figures(summary: Mapping[str, Any], logs: RunLogs, used: UsedSamples) -> dict[str, Any]:
    """Return what the summary says of the clocks: themselves, what they leave open, and which figures that drowns."""
    bounds = one_way_uncertainty(summary, logs, used)
    return {
        "clocks": logs.clocks.summary(),
        "uncertainty_ms": bounds,
        "not_resolvable": not_resolvable(summary, bounds),
    }


def one_way_uncertainty(summary: Mapping[str, Any], logs: RunLogs, used: UsedSamples) -> dict[str, Summary]:
    """Return, for each figure that spans two clocks, the bound of the error of its statistics, in ms.

    Keys are the figure's place in the summary (``latency_ms.network``). Nothing when all clocks are shared: then no
    figure is uncertain. Statistics of a clock that nobody knows are None. Durations by one clock (round trip, wait
    for the tick, computing) are not here. Oracle: a clock made wrong by a known amount (tests test_uncertainty).
    """
    if logs.clocks.all_shared and logs.clocks.all_known:
        return {}
    ages = [ages_of_hand(logs, hand) for hand in get_args(Hand)]
    at_ns, age_ns = (np.concatenate(parts) for parts in zip(*ages, strict=True))
    worst_ns = worst_age_ns(logs)
    worst_ms = None if worst_ns is None else worst_ns / NS_PER_MS
    return {
        "latency_ms.network": _bounds(logs, used.sent_ns, used.recv_ns),
        "latency_ms.end_to_end": _bounds(logs, used.sample_ns, used.published_ns),
        "age_ms": _bounds(logs, at_ns - age_ns, at_ns),
        **{place: _alike(figures_at(summary, place), worst_ms) for place in _AGES},
    }


def figures_at(summary: Mapping[str, Any], place: str) -> Mapping[str, Any]:
    """Return the part of the summary that a dotted place names."""
    part: Any = summary
    for name in place.split("."):
        part = part[name]
    found: Mapping[str, Any] = part
    return found


def worst_age_ns(logs: RunLogs) -> int | None:
    """Return how far any age can be off, in ns: from a sample, by the surgeon's clock, to now, by the patient's.

    None when nothing bounds it. Means, percentiles and maxima of ages can be off by no more.
    """
    log = logs.sides.get("patient")
    arrived = {} if log is None else log.messages
    ours = [columns for key, columns in arrived.items() if sender_of(key) == "surgeon"]
    open_ns = [logs.clocks.uncertainty_ns("surgeon", one.sample_ns, "patient", one.log_ns) for one in ours]
    if any(ns is None for ns in open_ns):
        return None
    return max((int(ns.max(initial=0)) for ns in open_ns if ns is not None), default=0)


def _alike(figures: Mapping[str, Any], bound_ms: float | None) -> Summary:
    return {
        name: None if value is None else bound_ms for name, value in figures.items() if not isinstance(value, dict)
    }


def _bounds(logs: RunLogs, begin_ns: Ints, end_ns: Ints) -> Summary:
    """Return the bounds of a duration that begins by the surgeon's clock and ends by the patient's."""
    open_ns = logs.clocks.uncertainty_ns("surgeon", begin_ns, "patient", end_ns)
    bounds_ns = uncertainties(end_ns - begin_ns, np.zeros_like(begin_ns) if open_ns is None else open_ns)
    known = open_ns is not None
    return {name: ns / NS_PER_MS if known and ns is not None else None for name, ns in bounds_ns.items()}


def not_resolvable(summary: Mapping[str, Any], uncertainty_ms: Mapping[str, Summary]) -> list[str]:
    """Return the places of the figures that the clocks leave open by more than their own size."""
    found = []
    for place, bounds in uncertainty_ms.items():
        figures = figures_at(summary, place)
        found += [f"{place}.{name}" for name, bound in bounds.items() if not is_resolvable(figures.get(name), bound)]
    return found
