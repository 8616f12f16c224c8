"""Fidelity of one key: its realised network against the decided one, and that against the request."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.errors import problem
from tis.common.metrics.delay_variation import first_arrivals, is_reordered
from tis.common.metrics.fidelity import batch_inflation, half_life_inflation, is_decidable, mean_margin, share_bounds
from tis.common.metrics.percentiles import summarise
from tis.common.units import NS_PER_MS, NS_PER_S, NS_PER_US
from tis.deploy.logs.read.columns import Ints
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.packets import DELIVER, in_order_of_leaving, place_in
from tis.deploy.logs.read.side_log import DEPARTURES, OUTCOMES
from tis.deploy.present.numbers import counted
from tis.deploy.report.subjects.network.key_figures import KeyBooks, KeyFigures
from tis.deploy.report.subjects.network.link_figures import LinkVerdict
from tis.deploy.report.subjects.network.requested import Expected, Requested, Stretch
from tis.deploy.report.subjects.processors import ProcessorFigures, contention_clause
from tis.netem.conditions.conditions import FOREVER_NS
from tis.netem.link.ledger import DROPPED_NEW, DROPPED_OLDEST, full_buffer, when_late

_MIN_DRAWS: Final = 30
_ERROR_NS: Final = NS_PER_MS
_ERROR_SHARE: Final = 0.05
_LATE_SHARE: Final = 0.01
_ROUNDING_NS: Final = 1.0
_MAX_STRETCHES: Final = 3
_ALL_COUNT: Final = "netem's own part, such as its release error, counts all"
_OUTAGE, _REFUSED, _LOSS, _OVERFLOW = (OUTCOMES.index(name) for name in ("outage", "refused", "loss", DROPPED_NEW))
_EVICTED: Final = DEPARTURES.index(DROPPED_OLDEST)


@dataclass
class Verdict:
    """The findings on one key, as sentences; ``n_decided`` counts the criteria that could be decided.

    ``undecided`` maps each criterion in ``not_decidable`` to the number of messages there were to judge it by; None
    when that number is not the reason.
    """

    violations: list[str] = field(default_factory=list)
    not_decidable: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    n_decided: int = 0
    undecided: dict[str, int | None] = field(default_factory=dict)
    judged: int = 0
    set_aside: int = 0
    keys: int = 0
    undecided_keys: dict[str, str] = field(default_factory=dict)
    """The keys that are undecided, where others are not."""

    def add_undecided(self, what: str, n: int, of: str = "") -> None:
        """Note that ``n`` messages are too few to judge the criterion ``what``."""
        self.undecided[what] = n
        self.not_decidable.append(f"{what}{of}: not decidable with {counted(n, 'message')}")

    def as_summary(self) -> LinkVerdict:
        """Return the summary's ``verdict``; ``faithful`` is None when no criterion could be decided."""
        found = asdict(self)
        if not self.undecided_keys:
            del found["keys"], found["undecided_keys"]
        return LinkVerdict(faithful=not self.violations if found.pop("n_decided") else None, **found)


def key_verdict(
    request: Requested,
    books: KeyBooks,
    figures: KeyFigures,
    whole: bool,
    overhead_ns: int | None,
    max_held: int | None,
) -> Verdict:
    """Return the verdict on one key.

    Decided against requested: the mean delay, the shares of delays below its 10, 50 and 90 % quantiles, and the
    shares lost, copied and corrupted lie within 4 standard errors (`tis.common.metrics.fidelity`). Realised against
    decided: the 99th percentile of the release error is at most 1 ms, or 5 % of the median delay if that is more; of
    fewer than `MIN_RELEASES` packets so many are beyond that as no share of 1 % explains.
    Where the ordering forbids overtaking, no packet left netem behind a later one. Drops by a full buffer violate the
    request. What is decided for messages offered under a control change is exempt; release error, order and buffer
    are netem's own part, and count all messages.

    ``whole``: all three logs exist. ``overhead_ns`` is netem's delay without any impairment, ``max_held`` the most
    messages that the link held at a time. Oracle: hand-made runs, test_fidelity.
    """
    verdict, key, fates = Verdict(), books.key, books.fates
    unchanged = request.unchanged(fates.offered_ns)
    verdict.judged = int(np.count_nonzero(unchanged))
    if n_changed := len(unchanged) - verdict.judged:
        verdict.set_aside = n_changed
        fates = fates.at(unchanged)
        met = _spans_text(_met(request.changed, books.fates.offered_ns))
        verdict.warnings.append(
            f"changed while running {met}: {n_changed} of {len(unchanged)} messages are not "
            f"held against the network asked for; {_ALL_COUNT}"
        )
    _check_decisions(verdict, request, key, fates)
    _check_releases(verdict, figures)
    _check_order(verdict, request, books)
    _check_buffer(verdict, request, books, max_held)
    unplanned = figures.account.counts["unplanned_loss"]
    if whole and not books.foreign and unplanned:
        verdict.n_decided += 1
        sent, before = (figures.account.counts[name] for name in ("sent", "lost_before_netem"))
        where = f"{before} on the way to it, {unplanned - before} behind it"
        verdict.violations.append(f"unplanned loss: {unplanned} of {sent} messages vanished outside netem: {where}")
    base = request.base(key)
    if base is not None and overhead_ns is not None and 0.0 < base.mean_ns < overhead_ns:
        verdict.warnings.append(
            f"a delay of {_ms(base.mean_ns)} is asked for, but netem itself takes {_ms(overhead_ns)} "
            "(median of a third of a second before the start)"
        )
    return verdict


def _check_decisions(verdict: Verdict, request: Requested, key: str, fates: Frame) -> None:
    n = len(fates.seq)
    if n == 0:
        verdict.undecided["what was decided"] = 0
        verdict.not_decidable.append("what was decided: no messages")
        return
    if request.pipeline(key) is None:
        n_passed = int(np.count_nonzero(fates.outcome != _REFUSED))
        verdict.n_decided += 1
        if n_passed:
            verdict.violations.append(f"no rule lets this key pass, but {n_passed} of {n} messages were not refused")
        return
    expected = request.of_packets(key, fates)
    if expected is None:
        verdict.undecided["what was decided"] = None
        verdict.not_decidable.append("what was decided: a trace that is named cannot be read")
        return
    verdict.n_decided += 1
    recovered = fates.recovered > 0  # what a model lost, or an outage, and a transport repeated
    out, refused = (fates.outcome == _OUTAGE) | (recovered & expected.outage), fates.outcome == _REFUSED
    if n_refused := int(np.count_nonzero(refused)):
        verdict.violations.append(f"{n_refused} of {n} messages were refused, though a rule lets this key pass")
    for wrong, what in (
        (out & ~expected.outage, "dropped as in an outage where there was none"),
        (~out & ~refused & expected.outage, "not dropped in an outage"),
    ):
        if n_wrong := int(np.count_nonzero(wrong)):
            verdict.violations.append(f"outages: {n_wrong} of {n} messages were {what}")
    _check_shares(verdict, fates, expected, ~out & ~refused & ~expected.outage)
    _check_delay(verdict, fates, expected)


def _check_shares(verdict: Verdict, fates: Frame, expected: Expected, modelled: NDArray[np.bool_]) -> None:
    lost, p = ((fates.outcome == _LOSS) | (fates.recovered > 0))[modelled], expected.p_loss[modelled]
    _check_share(verdict, "loss", "lost", lost, p, expected.loss_inflation)
    through = fates.outcome == DELIVER
    _check_share(verdict, "corruption", "corrupted", (fates.flipped > 0)[through], expected.p_corrupt[through], 1.0)
    if not expected.has_rate and not (fates.outcome == _OVERFLOW).any():  # a copy may find the queue full
        _check_share(
            verdict, "duplication", "copied", (fates.copies > 0)[through], expected.p_duplicate[through], 1.0
        )


def _check_share(
    verdict: Verdict, what: str, done: str, hits: NDArray[np.bool_], p: NDArray[np.float64], inflation: float
) -> None:
    n, n_hits = len(hits), int(np.count_nonzero(hits))
    requested = float(p.mean()) if n else 0.0
    if n == 0 or (requested == 0.0 and n_hits == 0):
        return
    # bursts leave fewer independent draws than messages
    effective = n / inflation
    low, high = share_bounds(n_hits / inflation, effective) if effective > 0.0 else (0.0, 1.0)
    certain = bool(np.isin(p, (0.0, 1.0)).all())  # a trace decides each message
    if certain:
        low = high = n_hits / n
    if not low <= requested <= high:
        verdict.violations.append(
            f"decided {what}: {_pct(n_hits / n)} of {n} messages were {done}, asked for are {_pct(requested)}; so "
            f"many are explained by {_pct(low)} to {_pct(high)}"
        )
    elif not certain and not is_decidable(requested, effective):
        verdict.add_undecided(what, n, f" of {_pct(requested)}")


def _check_delay(verdict: Verdict, fates: Frame, expected: Expected) -> None:
    through = fates.outcome == DELIVER
    n = int(np.count_nonzero(through))
    if n == 0:
        return
    requested_ns, std_ns = expected.delay_ns[through], expected.std_ns[through]
    difference_ns = fates.delay_ns[through] - requested_ns
    variance = float((std_ns**2).mean())
    # correlated delays leave fewer independent draws: by the data for a trace, by the half-life for a model
    inflation = batch_inflation(difference_ns, variance) if expected.is_recorded else 1.0
    if expected.half_life_s is not None:
        # mean spacing of messages against the half-life of the correlation
        step_s = float(np.ptp(fates.offered_ns[through])) / NS_PER_S / max(n - 1, 1)
        inflation = max(inflation, half_life_inflation(max(step_s, 1e-9), expected.half_life_s))
    effective = n / inflation
    # the normal approximation of the mean needs that many independent draws
    if variance > 0.0 and effective < _MIN_DRAWS:
        verdict.add_undecided("mean delay", n)
        return
    margin_ns = mean_margin(sqrt(variance), expected.skewness, effective) + _ROUNDING_NS
    off_ns = float(difference_ns.mean())
    if abs(off_ns) > margin_ns:
        verdict.violations.append(
            f"decided delay: mean {_ms(float(fates.delay_ns[through].mean()))} of {n} messages, asked for are "
            f"{_ms(float(requested_ns.mean()))}: {_ms(abs(off_ns))} too {'long' if off_ns > 0 else 'short'}, "
            f"chance explains {_ms(margin_ns)}"
        )
    else:
        _check_distribution(verdict, fates.delay_ns[through], expected, through, inflation)


def _check_distribution(
    verdict: Verdict, delay_ns: Ints, expected: Expected, through: NDArray[np.bool_], inflation: float
) -> None:
    """Check the shares of delays below points of the requested distribution; report the first violation."""
    for step_ns, share in zip(expected.steps_ns[:, through], expected.shares[:, through], strict=True):
        known = np.isfinite(step_ns)
        n = int(known.sum())
        if n == 0:
            continue
        requested, below = float(share[known].mean()), float((delay_ns[known] <= step_ns[known]).mean())
        low, high = share_bounds(below * n / inflation, n / inflation)
        if not low <= requested <= high:
            at = f"{_ms(float(step_ns[known][0]))}" if np.ptp(step_ns[known]) == 0.0 else "their quantile"
            verdict.violations.append(
                f"decided delay: {_pct(below)} of {n} messages got at most {at}, asked for are {_pct(requested)}; "
                f"so many are explained by {_pct(low)} to {_pct(high)}"
            )
            return


def _check_releases(verdict: Verdict, figures: KeyFigures) -> None:
    n = len(figures.error_ns)
    p50_ns = summarise(figures.decided_ns, (50,), ())["p50"] or 0.0
    allowed_ns = max(_ERROR_NS, _ERROR_SHARE * p50_ns)
    if n < MIN_RELEASES:
        n_late = int(np.count_nonzero(figures.error_ns > allowed_ns))
        if n_late and share_bounds(n_late, n)[0] > _LATE_SHARE:
            verdict.n_decided += 1
            verdict.violations.append(
                f"release error: {n_late} of {n} messages left more than {_ms(allowed_ns)} after their instant, "
                f"up to {_ms(float(figures.error_ns.max()))}; allowed is {_pct(_LATE_SHARE)}; "
                f"{_when(figures.error_ns, figures.left_ns, allowed_ns)}"
            )
        else:
            verdict.add_undecided("release error", n)
        return
    verdict.n_decided += 1
    p99_ns = summarise(figures.error_ns, (99,), ())["p99"] or 0.0
    if p99_ns > allowed_ns:
        verdict.violations.append(
            f"release error: 99 % of {n} messages left within {_ms(p99_ns)} of their instant, "
            f"allowed are {_ms(allowed_ns)}: {_ms(p99_ns - allowed_ns)} too much; "
            f"{_when(figures.error_ns, figures.left_ns, allowed_ns)}"
        )


def _when(error_ns: Ints, left_ns: Ints, allowed_ns: float) -> str:
    """Return when the messages left that are later than allowed, of which there is one at least."""
    late_ns = left_ns[error_ns > allowed_ns]
    return when_late(int(late_ns.min()), int(late_ns.max()), int(left_ns[error_ns.argmax()]), int(left_ns.max()))


def _check_buffer(verdict: Verdict, request: Requested, books: KeyBooks, max_held: int | None) -> None:
    """Check for drops by netem's full buffer; drops by the full queue of a rate are part of the request."""
    n_full = int(np.count_nonzero(books.fates.outcome == _OVERFLOW))
    n_full += int(np.count_nonzero(books.releases.departure == _EVICTED))
    if n_full:
        verdict.n_decided += 1
        verdict.violations.append(
            f"{full_buffer(request.buffer, max_held)}: {n_full} messages dropped of {len(books.fates.seq)} offered, "
            "which is no part of the network asked for"
        )


def _check_order(verdict: Verdict, request: Requested, books: KeyBooks) -> None:
    """Check for packets that left behind later ones of their key although the ordering forbids it all the time.

    Foreign messages are exempt: they may come from several senders.
    """
    pipeline = request.pipeline(books.key)
    if books.foreign or pipeline is None or not request.forbids_overtaking(pipeline):
        return
    # packets are in order when they leave in the order of their offering
    by_number = np.argsort(books.fates.seq, kind="stable")
    left = first_arrivals(in_order_of_leaving(books.releases).seq)
    place, offered = place_in(books.fates.seq[by_number], left)
    n_behind = int(np.count_nonzero(is_reordered(by_number[place[offered]])))
    if n_behind:
        verdict.violations.append(
            f"order: {n_behind} of {len(left)} messages left netem behind later ones, though asked for is "
            f"{pipeline.ordering}"
        )


def _met(stretches: Sequence[Stretch], offered_ns: Ints) -> list[Stretch]:
    """Return the stretches within which messages were offered."""
    return [one for one in stretches if np.any((offered_ns >= one.begin_ns) & (offered_ns < one.end_ns))]


def _spans_text(stretches: Sequence[Stretch]) -> str:
    """Return the first spans in words, and the number of the others."""
    parts = []
    for one in stretches[:_MAX_STRETCHES]:
        end = "on" if one.end_ns >= FOREVER_NS else f"to {one.end_ns / NS_PER_S:.3f} s"
        parts.append(f"from {one.begin_ns / NS_PER_S:.3f} s {end}")
    n_more = len(stretches) - len(parts)
    if n_more:
        parts.append(f"and in {n_more} more {'stretch' if n_more == 1 else 'stretches'}")
    return ", ".join(parts)


def _ms(ns: float) -> str:
    return f"{ns / NS_PER_MS:.4g} ms" if abs(ns) >= NS_PER_MS else f"{ns / NS_PER_US:.4g} us"


def _pct(share: float) -> str:
    return f"{100 * share:.3g} %"


MIN_RELEASES: Final = 100
"""Fewest packets for a 99th percentile."""

_STARVED_P99_NS: Final = 5 * NS_PER_MS
_LATE_NS: Final = NS_PER_MS
_MAX_LATE: Final = 0.05


def starvation(error_ns: Ints, left_ns: Ints, shares: ProcessorFigures | None) -> str | None:
    """Return the problem of a starved netem from a direction's release errors (N,); None: it kept up.

    Starved: the 99th percentile of the release error exceeds 5 ms, or more than 5 % of packets left over 1 ms late.
    ``shares`` of netem's processors name the cause.
    """
    n = len(error_ns)
    if n < MIN_RELEASES:
        return None
    p99_ns = summarise(error_ns, (99,), ())["p99"] or 0.0
    n_late = int(np.count_nonzero(error_ns > _LATE_NS))
    if p99_ns > _STARVED_P99_NS:
        late = f"1 % of {n} packets left netem more than {p99_ns / NS_PER_MS:.4g} ms late, allowed are 5 ms"
    elif n_late > _MAX_LATE * n:
        late = f"{n_late} of {n} packets left more than 1 ms late, allowed are {_MAX_LATE:.0%}"
    else:
        return None
    return problem(
        f"starved: {late}; {_when(error_ns, left_ns, _LATE_NS)}{contention_clause(shares, 'netem')}",
        "free a core, or give netem real-time privileges",
    )
