"""Latency of single samples from the logs, part by part, and round trips."""

from collections.abc import Iterator, Mapping
from html import escape
from typing import Final, NamedTuple

import numpy as np

from tis.common.channels import Arm, Hand, Side, hand_channels
from tis.common.errors import problem
from tis.common.metrics.latency import Instants, LatencyParts, latency_parts, round_trip_ns
from tis.common.metrics.percentiles import is_resolvable
from tis.common.units import NS_PER_MS
from tis.deploy.logs.payloads import NO_INSTANT
from tis.deploy.logs.read.columns import joined
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import first_uses, place_in
from tis.deploy.logs.read.side_log import no_messages
from tis.deploy.present.numbers import NONE, heads, number, rounded_up
from tis.deploy.present.page import css, nonbreaking_units
from tis.deploy.present.palette import PARTS
from tis.deploy.present.table import Table
from tis.deploy.report.section import Section, Statistics, statistics, with_uncertainty


class Latency(Section):
    """The end-to-end latency, its parts, and the delays beside it, in ms."""

    surgeon: Statistics = statistics(
        "From the sample instant to sending. The first four parts add up to end_to_end, sample by sample."
    )
    network: Statistics = statistics("From sending to reception, one way.")
    tick_wait: Statistics = statistics("From reception to the tick that uses the sample.")
    compute: Statistics = statistics("From the beginning of that tick to the publication of the estimate.")
    end_to_end: Statistics = statistics(
        "From the sample instant to the publication of the estimate that uses the sample."
    )
    actuation: Statistics = statistics(
        "How late an arm that executes set points follows the active estimate, without stops and ways back."
    )
    round_trip: Statistics = statistics(
        "From a command's sample instant to the first answer that carries it, on the surgeon's clock."
    )
    network_round_trip: Statistics = statistics("The network's part of a round trip, both ways.")


LATENCY_PARTS: Final = {
    "surgeon": "surgeon (sample taken to sent)",
    "network": "+ network (sent to received)",
    "tick_wait": "+ tick wait (until the next tick)",
    "compute": "+ compute (until published)",
    "end_to_end": "= end to end",
}
"""The parts of the end-to-end latency, in order; they add up to it."""

END_TO_END: Final = (
    "End to end: from the instant of the newest sample behind an estimate, command or arm position, whichever "
    "arrived first, to the estimate's publication. It can be below a link's one-way delay, which counts every "
    "message, the slow and the overtaken ones too"
)
"""Definition of the end-to-end latency, and why it can be smaller than a one-way delay."""

_ROWS: Final = {
    **LATENCY_PARTS,
    "actuation": "then the arm follows",
    "round_trip": "round trip (surgeon's clock)",
    "network_round_trip": "of it in the network",
}
_STATISTICS: Final = ("p50", "p95", "p99", "max")
_MIN_PIECE_PCT: Final = 0.4
_EARLIEST_MS: Final = -1.0
"""A message that arrives more than this before it was sent has a send time that is wrong."""


class UsedSamples(NamedTuple):
    """The samples at their first use by an estimate, all hands together; instants (N,) in ns.

    A sample is taken, sent and received; the estimate that uses it is begun, published, and returned to the surgeon's
    side (`NO_INSTANT` where it never arrived).
    """

    sample_ns: Instants
    sent_ns: Instants
    recv_ns: Instants
    begin_ns: Instants
    published_ns: Instants
    returned_ns: Instants


def used_samples(logs: RunLogs, session: str, arms: Mapping[Hand, Arm]) -> UsedSamples:
    """Return each sample at its first use, at a tick or on arrival; ``arms`` maps a hand to the arm that it drives.

    A sample whose path is not in the logs from end to end is left out. Oracle: paths computed by hand, test_summary.
    """
    arrivals = logs.messages("patient", "forward", session)
    published, returned = (_answers(logs, side, session, arms) for side in ("patient", "surgeon"))
    found = [np.empty((0, len(UsedSamples._fields)), dtype=np.int64)]
    for hand in arms:
        uses = first_uses(logs, hand)
        published_ns = _instants(published.get(hand), uses.answer)
        returned_ns = _instants(returned.get(hand), uses.answer)
        # sequence numbers are per key, so packets are matched key by key; the first arrival counts
        for key in np.unique(uses.key):
            packets = arrivals.get(str(key), no_messages()).first_of_each("seq")
            place, arrived = place_in(packets.seq, uses.seq)
            used = arrived & (uses.key == key) & (published_ns != NO_INSTANT)
            path = packets.at(place[used])
            then_ns = (uses.begin_ns[used], published_ns[used], returned_ns[used])
            found.append(np.column_stack([path.sample_ns, path.sent_ns, path.log_ns, *then_ns]))
    return UsedSamples(*np.concatenate(found).T)


def sample_latency(used: UsedSamples) -> LatencyParts:
    """Return the latency of each used sample by part, from its instant to the estimate that used it."""
    return latency_parts(used.sample_ns, used.sent_ns, used.recv_ns, used.begin_ns, used.published_ns)


def network_round_trips(used: UsedSamples) -> Instants:
    """Return the network's share (N,) of each round trip in ns: forward the sample, back its first estimate.

    The time between arrival and answer is left out, like the reflector's time in TWAMP (RFC 5357); the offset between
    the two clocks cancels with it. Oracle: paths computed by hand, test_summary.
    """
    back = used.returned_ns != NO_INSTANT
    trips_ns = used.recv_ns - used.sent_ns + used.returned_ns - used.published_ns
    return np.asarray(trips_ns[back])


def round_trips(logs: RunLogs, session: str, arms: Mapping[Hand, Arm]) -> Instants:
    """Return the round trip (N,) of each command sample that an estimate answers, in ns on the surgeon's clock."""
    each = _answers(logs, "surgeon", session, arms).values()
    carrying = [answers.at(answers.command_sample_ns != NO_INSTANT) for answers in each]
    return joined(round_trip_ns(one.command_sample_ns, one.log_ns) for one in carrying)


def _answers(logs: RunLogs, side: Side, session: str, arms: Mapping[Hand, Arm]) -> dict[Hand, Frame]:
    """Return the estimates that a side sent or received, by hand."""
    log = logs.sides.get(side)
    known = {} if log is None else log.messages
    keys = {hand: hand_channels(hand, arm).estimated.key(session) for hand, arm in arms.items()}
    return {hand: known[key] for hand, key in keys.items() if key in known}


def _instants(answers: Frame | None, number: Instants) -> Instants:
    """Return the instant of the first copy of each answer ``number`` (N,); `NO_INSTANT` where there is none."""
    if answers is None or not len(answers):
        return np.full(len(number), NO_INSTANT)
    first = answers.first_of_each("seq")
    place, known = place_in(first.seq, number)
    return np.where(known, first.log_ns[place], NO_INSTANT)


def _known(
    latency: Latency, uncertainty_ms: Mapping[str, Statistics]
) -> Iterator[tuple[str, Statistics, Statistics]]:
    """Yield title, figures and clock uncertainty of each row, without an arm that executes nothing."""
    for name, title in _ROWS.items():
        if name != "actuation" or latency.actuation["p50"] is not None:
            yield title, latency[name], uncertainty_ms.get(f"latency_ms.{name}", {})


def latency_page_table(latency: Latency, uncertainty_ms: Mapping[str, Statistics]) -> Table:
    """Return the latency of the freshest sample by part, with clock uncertainty."""
    rows = [
        (title, *(with_uncertainty(figures[p], bounds.get(p)) for p in _STATISTICS))
        for title, figures, bounds in _known(latency, uncertainty_ms)
    ]
    return Table("Latency of the freshest sample, ms", ("part", *heads(_STATISTICS)), rows)


def latency_table(latency: Latency, uncertainty_ms: Mapping[str, Statistics]) -> Table:
    """Return the same for a terminal, with the largest uncertainty of a row in a column."""
    note = f"{END_TO_END}; in topology observer commands cross unimpaired. "
    note += "The parts add up sample by sample; their medians and percentiles do not"
    if uncertainty_ms:
        note += "\n\u00b1: clock uncertainty of a row; ?: not resolvable, the uncertainty exceeds the figure"
    rows = []
    for title, figures, bounds in _known(latency, uncertainty_ms):
        cells = [figures[p] if is_resolvable(figures[p], bounds.get(p)) else "?" for p in _STATISTICS]
        widest = max((ms for ms in bounds.values() if ms is not None), default=None)
        margin = "" if not bounds else NONE if widest is None else rounded_up(widest, 2)
        rows.append((title, *cells, *([margin] if uncertainty_ms else [])))
    columns = ("", *heads(_STATISTICS), *(["\u00b1"] if uncertainty_ms else []))
    return Table("Latency of the freshest sample, ms", columns, rows, note)


def sent_after_arrival(latency: Latency, uncertainty_ms: Mapping[str, Statistics]) -> list[str]:
    """Return a problem where the usual message arrived before it was sent, by its header and the clocks."""
    network_ms = latency.network["p50"]
    bound = uncertainty_ms.get("latency_ms.network", {}).get("p50") or 0.0
    if network_ms is None or network_ms >= _EARLIEST_MS - bound:
        return []
    rule = "by their headers (sent_ns) messages were sent after they had arrived, median"
    cure = "set the clocks of the hosts by chrony, and the stamps of a foreign surgeon by its host's clock"
    return [problem(f"latency_ms.network: {rule} {-network_ms:.1f} ms", cure)]


def budget_ms(parts: LatencyParts) -> dict[str, float]:
    """Return the mean of each part in ms by name; they add up to the mean of the whole. Empty without samples."""
    whole = parts._asdict()
    if not len(whole.pop("end_to_end")):
        return {}
    return {name: float(values_ns.mean()) / NS_PER_MS for name, values_ns in whole.items()}


def budget_bar(means_ms: dict[str, float]) -> str:
    """Return the bar of `budget_ms` with legend and caption; "" without parts."""
    total_ms = sum(means_ms.values())
    if total_ms <= 0:
        return ""
    named = {name: (*PARTS[name], value) for name, value in means_ms.items()}
    longest = max(means_ms, key=lambda name: means_ms[name])
    pieces = "".join(
        f'<span style="width:{100 * value / total_ms:.2f}%;color:{css(tone)}"></span>'
        for _, tone, value in named.values()
        if 100 * value / total_ms >= _MIN_PIECE_PCT
    )
    keys = "".join(
        f'<li><i class="bar" style="color:{css(tone)}"></i>{escape(title)} {_ms(value)}</li>'
        for title, tone, value in named.values()
    )
    title, _, value = named[longest]
    caption = (
        f"From the instant of the newest sample to the estimate made with it, {_ms(total_ms)} pass in the mean: "
        "means add up part by part, medians do not. The longest part is the one to shorten first: here "
        f"{title}, mean {_ms(value)}, {100 * value / total_ms:.0f} % of the whole."
    )
    return (
        '<figure class="budget" aria-labelledby="budget"><figcaption><h3 id="budget">Where the time goes</h3>'
        f'<p>{escape(nonbreaking_units(caption))}</p></figcaption><div class="track" role="img" '
        'aria-label="Bar of the mean parts of the latency; the list below has the same numbers.">'
        f'{pieces}</div><ul class="keys">{keys}</ul></figure>'
    )


def _ms(value: float) -> str:
    return f"{value:.1f} ms" if value >= 10 else number(value, " ms")
