"""The summary's ``links``: the figures of each direction, from the books of its keys."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from tis.common.channels import Direction
from tis.common.errors import problem
from tis.common.metrics.percentiles import queue_depth
from tis.common.records import CONTROL, QUEUES
from tis.common.units import NS_PER_S
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.section import DELAYS
from tis.deploy.report.subjects.logs import count_of
from tis.deploy.report.subjects.network.fidelity import Verdict, key_verdict, starvation
from tis.deploy.report.subjects.network.key_figures import KeyBooks, KeyFigures, statistics
from tis.deploy.report.subjects.network.link_books import (
    OF_TIS,
    LinkBooks,
    against_counters,
    link_books,
    unsent,
    unsent_problem,
)
from tis.deploy.report.subjects.network.link_ends import ENDS
from tis.deploy.report.subjects.network.link_figures import (
    ConditionFigures,
    Delays,
    KeyOfLink,
    Link,
    LinkVerdict,
    Queue,
    RequestedShares,
)
from tis.deploy.report.subjects.network.requested import NetworkRequest, Requested
from tis.deploy.report.subjects.network.requested_pipeline import RequestedPipeline
from tis.deploy.report.subjects.processors import shares_of
from tis.netem.stages.loss import ExpectedLoss


def queue_summary(logs: RunLogs, direction: Direction) -> Queue:
    """Return the depth of the rate queues over time; None where nothing queued."""
    notes = sorted(
        (row["at_ns"], row["n_packets"], row["n_bytes"])
        for row in logs.of("netem", QUEUES)
        if row["direction"] == direction
    )
    at_ns, n_packets, n_bytes = np.array(notes, dtype=np.int64).reshape(-1, 3).T
    until_ns = max(int(at_ns[-1]), logs.sides["netem"].last_ns) if len(at_ns) else 0
    return Queue(packets=queue_depth(at_ns, n_packets, until_ns), bytes=queue_depth(at_ns, n_bytes, until_ns))


def condition_summary(logs: RunLogs, request: Requested) -> ConditionFigures:
    """Return the changes, outages, stalls and control requests during the run, and the time in each state."""
    log = logs.sides.get("netem")
    spans = request.spans(log.last_ns) if log is not None else []
    control = logs.of("netem", CONTROL)
    states: dict[str, float] = {}
    for span in spans:
        if span.state is not None:
            states[span.state] = states.get(span.state, 0.0) + (span.end_ns - span.begin_ns) / NS_PER_S
    return ConditionFigures(
        changes=max(0, len(spans) - 1),
        outages=sum(span.outage and (i == 0 or not spans[i - 1].outage) for i, span in enumerate(spans)),
        outage_s=sum(span.end_ns - span.begin_ns for span in spans if span.outage) / NS_PER_S,
        stall_s=sum(span.end_ns - span.begin_ns for span in spans if span.stall) / NS_PER_S,
        states_s=states,
        control_accepted=sum(note["accepted"] for note in control),
        control_refused=sum(not note["accepted"] for note in control),
    )


MAX_KEYS: Final = 64
"""Keys that are listed, the busiest ones; the link's figures cover all."""

_MAX_NAMED: Final = 3
_KEPT_BY_SENDER: Final = ("sent", "lost_before_netem")
_KEPT_BY_RECEIVER: Final = (
    "received", "duplicated", "duplicated_by_netem", "corrupted_rejected", "reordered",
)  # fmt: skip
_KEPT_BY_ALL: Final = ("not_used", "unplanned_loss", "lost_before_netem", "lost_after_netem")


@dataclass(frozen=True)
class _MeasuredKey:
    """One key of a link, under the name that it has in the summary."""

    title: str
    books: KeyBooks
    figures: KeyFigures
    verdict: Verdict


def link_summary(logs: RunLogs, direction: Direction, scenario: NetworkRequest) -> tuple[Link, list[str]]:
    """Return one link's figures, and the problems that make it invalid; names and meanings as in the definitions.

    A figure that needs a missing log is None, and the packet counts are then not checked. Messages in the gaps of
    damaged logs (``untold``) are in no figure. ``keys`` holds the same figures for each key, those of applications
    too; the link's own are of the testbed's keys, or of all keys without a testbed.
    """
    alone = not scenario.session  # without a testbed, no message is a stranger
    request = Requested.of(scenario, direction, logs)
    books = link_books(logs, direction, scenario.session)
    measured = _measured_keys(logs, direction, request, books, alone)
    ours = [one for one in measured if alone or not one.books.foreign]
    n_ours = sum(len(one.books.fates.seq) for one in ours) + books.n_unlogged_offered
    forged = unsent(logs, direction, scenario.session)
    link = Link(
        **_figures(request, ours, logs, direction, False),
        foreign=books.counts["offered"] - n_ours if logs.coverage("netem") is not None else None,
        untold=books.n_unlogged,
        queue=queue_summary(logs, direction),
        conditions=condition_summary(logs, request),
        verdict=_pooled_verdict([one for one in ours if _counts(one)] or measured),
        keys={
            one.title: KeyOfLink(
                foreign=one.books.foreign,
                **_figures(request, [one], logs, direction, one.books.foreign),
                verdict=one.verdict.as_summary(),
            )
            for one in measured[:MAX_KEYS]
        },
        keys_not_listed=max(0, len(books.keys) - MAX_KEYS),
        not_sent=None if forged is None else forged.n,
    )
    problems: list[str] = []
    if logs.all_covered:
        problems += [problem(text, OF_TIS) for one in ours for text in one.figures.account.violations]
        problems += against_counters(logs, direction, books.counts)
    if starved := starvation(books.error_ns, books.left_ns, shares_of(logs, "netem")):
        problems.append(starved)
    return link, [*(f"links.{direction}: {text}" for text in problems), *unsent_problem(forged, direction)]


def _measured_keys(
    logs: RunLogs, direction: Direction, request: Requested, books: LinkBooks, alone: bool
) -> list[_MeasuredKey]:
    """Return the testbed's keys, busiest first, then the busiest foreign ones."""
    overhead_ns, max_held = (count_of(logs, "netem", name) for name in ("base_overhead_ns", f"{direction}.most_held"))
    busiest = sorted(books.keys, key=lambda one: (one.foreign, -len(one.fates.seq)))
    found = []
    for i, one in enumerate(busiest):
        if alone or not one.foreign or i < MAX_KEYS:
            figures = KeyFigures.of(one)
            verdict = key_verdict(request, one, figures, logs.all_covered, overhead_ns, max_held)
            found.append(_MeasuredKey(_title(one, alone), one, figures, verdict))
    return found


def _title(books: KeyBooks, alone: bool) -> str:
    """Return a key's name; a standalone netem lists messages without a header only beside messages with one."""
    if not books.foreign:
        return books.key
    return f"{books.key} ({'without a header of tis' if alone else 'foreign'})"


def _figures(
    request: Requested, measured: list[_MeasuredKey], logs: RunLogs, direction: Direction, foreign: bool
) -> dict[str, Any]:
    """Return the figures of one key, or of several pooled, beside what was requested of them."""
    figures = _known(statistics([one.figures for one in measured]), logs, direction, foreign)
    parts = [one.books for one in measured]
    pipeline = None
    if parts:
        packets = (np.concatenate([getattr(one.fates, name) for one in parts]) for name in ("seq", "offered_ns"))
        pipeline = request.shared([one.key for one in parts], *packets)
    asked_ms = dict.fromkeys(DELAYS.split()) if pipeline is None else pipeline.delay_ms()
    figures["delay_ms"] = Delays(requested=asked_ms, **figures["delay_ms"])
    return {**figures, "requested": _requested_shares(pipeline, request, measured)}


def _known(figures: dict[str, Any], logs: RunLogs, direction: Direction, foreign: bool) -> dict[str, Any]:
    """Return the figures, None for those that need a missing log or, of a foreign key, a sender or receiver."""
    sender, receiver = ENDS[direction]
    unknown: set[str] = set()
    if foreign or logs.coverage(sender) is None:
        unknown |= {*_KEPT_BY_SENDER}
    if foreign or logs.coverage(receiver) is None:
        unknown |= {*_KEPT_BY_RECEIVER}
    if foreign or not logs.all_covered:
        unknown |= {*_KEPT_BY_ALL}
    if logs.coverage("netem") is None:
        unknown |= {
            name
            for name, value in figures.items()
            if isinstance(value, int) and name not in (*_KEPT_BY_SENDER, *_KEPT_BY_RECEIVER)
        }
    return {name: None if name in unknown else value for name, value in figures.items()}


def _requested_shares(
    pipeline: RequestedPipeline | None, request: Requested, measured: list[_MeasuredKey]
) -> RequestedShares:
    """Return the summary's ``requested``: the pipeline's own probabilities, for messages of the sizes seen."""
    entries: dict[str, Any] = dict.fromkeys(("loss_pct", "mean_burst", "duplicate_pct", "corrupt_pct"))
    if pipeline is not None:
        n_packets = np.concatenate([pipeline.n_packets(one.books.fates.n_bytes) for one in measured])
        sizes, counts = np.unique(n_packets, return_counts=True)
        losses = [pipeline.loss(int(size)) for size in sizes] or [pipeline.loss()]
        if pipeline.pipeline.recovery is not None:  # nothing is lost for good
            losses = [ExpectedLoss(0.0, 0.0) for _ in losses]
        burst = losses[0].mean_burst
        entries = {
            "loss_pct": 100
            * float(np.average([loss.p_loss for loss in losses], weights=counts if len(counts) else [1])),
            "mean_burst": burst if len(losses) == 1 and np.isfinite(burst) else None,
            "duplicate_pct": 100 * pipeline.p_duplicate,
            "corrupt_pct": 100 * pipeline.p_corrupt,
        }
    return RequestedShares(**entries, varies=request.varies)


def _counts(one: _MeasuredKey) -> bool:
    """Tell whether a key counts in the link's verdict: a probe's warm-up does so only with a violation."""
    return not one.books.foreign or bool(one.verdict.violations)


def _by_text(sentences: list[tuple[str, list[str]]]) -> list[str]:
    """Return sentences with the keys that they apply to, equal ones once."""
    titles: dict[str, list[str]] = {}
    for title, texts in sentences:
        for text in texts:
            titles.setdefault(text, []).append(title)
    return [f"{_joined(keys)}: {text}" for text, keys in titles.items()]


def _joined(titles: list[str]) -> str:
    n_more = len(titles) - _MAX_NAMED
    more = f" and {n_more} more" if n_more > 0 else ""
    return ", ".join(titles[:_MAX_NAMED]) + more + (", each" if len(titles) > 1 else "")


def _pooled_verdict(measured: list[_MeasuredKey]) -> LinkVerdict:
    """Return the verdict on the link, pooled over its keys."""
    together = Verdict(n_decided=sum(one.verdict.n_decided for one in measured))
    for name in ("violations", "not_decidable", "warnings"):
        setattr(together, name, _by_text([(one.title, getattr(one.verdict, name)) for one in measured]))
    for one in measured:
        together.judged += one.verdict.judged
        together.set_aside += one.verdict.set_aside
        for what, n in one.verdict.undecided.items():
            known = together.undecided.get(what)
            together.undecided[what] = n if known is None or n is None else max(known, n)
    together.keys = sum(one.verdict.judged > 0 for one in measured)
    for what in together.undecided:
        titles = [one.title for one in measured if what in one.verdict.undecided]
        if len(titles) < together.keys:
            together.undecided_keys[what] = _joined(titles)
    return together.as_summary()
