"""The summary's ``uncertainty_ms``: clock uncertainty of each one-way figure."""

from collections.abc import Mapping
from typing import Any, Final, get_args

import numpy as np

from tis.common.channels import Hand
from tis.common.clocks import Ints
from tis.common.metrics.percentiles import Summary, is_resolvable, uncertainties
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.clocks import sender_of
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.measures.latency import UsedSamples, ages_of_hand

_AGES: Final = (
    "age_of_information_ms",
    "age_of_information_ms.peak",
    *(f"tick_modes.{mode}.age_when_used_ms" for mode in ("free", "phase_locked", "on_arrival")),
)


def clock_figures(summary: Mapping[str, Any], logs: RunLogs, used: UsedSamples) -> dict[str, Any]:
    """Return the summary's ``clocks``, ``uncertainty_ms`` and ``not_resolvable``."""
    bounds = one_way_uncertainty(summary, logs, used)
    return {
        "clocks": logs.clocks.summary(),
        "uncertainty_ms": bounds,
        "not_resolvable": not_resolvable(summary, bounds),
    }


def one_way_uncertainty(summary: Mapping[str, Any], logs: RunLogs, used: UsedSamples) -> dict[str, Summary]:
    """Return the error bounds in ms of the statistics of each figure that spans two clocks.

    Keys are places in the summary (``latency_ms.network``). Empty when all sides share one clock. Bounds are None
    when a clock is unknown. Durations on one clock (round trip, tick wait, computing) have no bound. Oracle: a clock
    with a known error, test_uncertainty.
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
        **{place: _constant(figures_at(summary, place), worst_ms) for place in _AGES},
    }


def figures_at(summary: Mapping[str, Any], place: str) -> Mapping[str, Any]:
    """Return the part of the summary that a dotted place names."""
    part: Any = summary
    for name in place.split("."):
        part = part[name]
    found: Mapping[str, Any] = part
    return found


def worst_age_ns(logs: RunLogs) -> int | None:
    """Return the largest error of any age in ns: samples are on the surgeon's clock, ticks on the patient's.

    It also bounds the error of means, percentiles and maxima of ages. None when a clock is unknown.
    """
    log = logs.sides.get("patient")
    arrived = {} if log is None else log.messages
    ours = [columns for key, columns in arrived.items() if sender_of(key) == "surgeon"]
    open_ns = [logs.clocks.uncertainty_ns("surgeon", one.sample_ns, "patient", one.log_ns) for one in ours]
    if any(ns is None for ns in open_ns):
        return None
    return max((int(ns.max(initial=0)) for ns in open_ns if ns is not None), default=0)


def _constant(figures: Mapping[str, Any], bound_ms: float | None) -> Summary:
    return {
        name: None if value is None else bound_ms for name, value in figures.items() if not isinstance(value, dict)
    }


def _bounds(logs: RunLogs, begin_ns: Ints, end_ns: Ints) -> Summary:
    """Return the error bounds of a duration from the surgeon's clock to the patient's."""
    open_ns = logs.clocks.uncertainty_ns("surgeon", begin_ns, "patient", end_ns)
    bounds_ns = uncertainties(end_ns - begin_ns, np.zeros_like(begin_ns) if open_ns is None else open_ns)
    known = open_ns is not None
    return {name: ns / NS_PER_MS if known and ns is not None else None for name, ns in bounds_ns.items()}


def not_resolvable(summary: Mapping[str, Any], uncertainty_ms: Mapping[str, Summary]) -> list[str]:
    """Return the places of the figures whose clock uncertainty exceeds their own size."""
    found = []
    for place, bounds in uncertainty_ms.items():
        figures = figures_at(summary, place)
        found += [f"{place}.{name}" for name, bound in bounds.items() if not is_resolvable(figures.get(name), bound)]
    return found
