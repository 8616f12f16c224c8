"""Clocks of the sides against netem's, and the uncertainty that they leave in each one-way figure."""

from collections.abc import Mapping
from typing import Any, Final, get_args

import numpy as np

from tis.common.channels import Hand
from tis.common.clocks import Ints
from tis.common.metrics.percentiles import Summary, is_resolvable, uncertainties
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.clocks import sender_of
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.present.numbers import number, with_margin
from tis.deploy.present.table import Column, Table
from tis.deploy.report.section import Section, SideName, Statistics, means
from tis.deploy.report.subjects.age import ages_of_hand
from tis.deploy.report.subjects.latency import UsedSamples


class ClockFigures(Section):
    """The clock of a side."""

    kind: str = means(
        "`reference` (netem's), `shared` (the same host), `exchanged` (compared by time stamps) or `unknown`."
    )
    offset_ms: float | None = means("Offset at run time 0, positive when the reference is ahead.")
    drift_ppm: float | None = means("Drift against the reference.")
    drift_uncertainty_ppm: float | None = means("Bound of the drift's error.")
    uncertainty_us: float | None = means("Largest bound of the offset's error during the run.")
    n_exchanges: int = means("Exchanges of time stamps with netem.")
    min_round_trip_us: float | None = means("Shortest round trip of an exchange.")
    discipline: dict[str, Any] | None = means(
        "State of the kernel's clock (adjtimex): `synchronised`, `estimated_error_us`, "
        "`maximum_error_us`, `frequency_ppm`."
    )

    @property
    def is_netems(self) -> bool:
        """Tell whether the side reads netem's own clock."""
        return self.kind in ("reference", "shared")


Clocks = Mapping[SideName, ClockFigures]
_AGES: Final = ("age_of_information_ms", "tick_modes.")
_KINDS: Final = {
    "reference": "the reference",
    "shared": "the reference's own: same host",
    "exchanged": "compared by exchanges",
    "unknown": "never compared",
}


def clock_figures(logs: RunLogs) -> dict[str, ClockFigures]:
    """Return the clocks by side; none in virtual time."""
    return {side: ClockFigures(**found) for side, found in logs.clocks.summary().items()}


def one_way_uncertainty(figures: Mapping[str, Statistics], logs: RunLogs, used: UsedSamples) -> dict[str, Summary]:
    """Return the error bounds in ms of the statistics of each figure that spans two clocks.

    ``figures`` has them by their place in the summary (``latency_ms.network``), and so has the result. Empty when all
    sides share one clock. Bounds are None when a clock is unknown. Durations on one clock
    (round trip, tick wait, computing) have no bound. Oracle: a clock with a known error, test_uncertainty.
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
        **{place: _constant(figures[place], worst_ms) for place in figures if place.startswith(_AGES)},
    }


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
    return {name: None if value is None else bound_ms for name, value in figures.items()}


def _bounds(logs: RunLogs, begin_ns: Ints, end_ns: Ints) -> Summary:
    """Return the error bounds of a duration from the surgeon's clock to the patient's."""
    open_ns = logs.clocks.uncertainty_ns("surgeon", begin_ns, "patient", end_ns)
    bounds_ns = uncertainties(end_ns - begin_ns, np.zeros_like(begin_ns) if open_ns is None else open_ns)
    known = open_ns is not None
    return {name: ns / NS_PER_MS if known and ns is not None else None for name, ns in bounds_ns.items()}


def not_resolvable(figures: Mapping[str, Statistics], uncertainty_ms: Mapping[str, Summary]) -> list[str]:
    """Return the places of the figures whose clock uncertainty exceeds their own size."""
    found = []
    for place, bounds in uncertainty_ms.items():
        found += [
            f"{place}.{name}" for name, bound in bounds.items() if not is_resolvable(figures[place].get(name), bound)
        ]
    return found


def clock_table(clocks: Clocks) -> Table:
    """Return a row for each side, and a note on one-way figures; where all read one clock there are no rows."""
    apart = not all(clock.is_netems for clock in clocks.values())
    rows = [
        (side, _KINDS.get(clock.kind, clock.kind), *_comparison(clock), _disciplined(clock.discipline))
        for side, clock in clocks.items()
        if apart
    ]
    columns = (
        "side", Column("clock", words=True), "offset, ms", "drift, ppm", "known within, \u00b5s", "exchanges",
        "shortest round trip, \u00b5s", Column("synchronised by its host", words=True),
    )  # fmt: skip
    return Table("Clocks against netem's", columns, rows, _note(clocks))


def _comparison(clock: ClockFigures) -> list[Any]:
    """Return the five figures of a comparison; dashes for the reference clock itself."""
    if clock.is_netems:
        return [None] * 5
    return [
        clock.offset_ms,
        with_margin(clock.drift_ppm, clock.drift_uncertainty_ppm),
        clock.uncertainty_us,
        clock.n_exchanges,
        clock.min_round_trip_us,
    ]


def _note(clocks: Clocks) -> str:
    kinds = {clock.kind for clock in clocks.values()}
    if not clocks:
        return "All sides ran on one clock, that of virtual time: one-way figures are exact."
    if "unknown" in kinds:
        return "A clock was never compared with netem's, so delays between its host and another are not known."
    if "exchanged" not in kinds:
        return (
            "All sides ran on one host and read one clock, netem's: there was nothing to compare, and clocks add no "
            "uncertainty to one-way figures."
        )
    known = [clock.uncertainty_us or 0.0 for clock in clocks.values() if clock.kind == "exchanged"]
    return (
        f"One-way figures between hosts may be wrong by up to {number(sum(known))} \u00b5s: half the shortest round "
        "trips, and what the clocks may have wandered between them. A figure smaller than that cannot be resolved."
    )


def _disciplined(discipline: Mapping[str, Any] | None) -> str:
    if discipline is None:
        return "not known"
    return "yes" if discipline.get("synchronised") else "no"
