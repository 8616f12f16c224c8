"""Traffic of the surgeon, and redundancy: cost and gain of copies and history."""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from tis.common.channels import Arm, Hand, hand_channels
from tis.common.messages import HEADER_BYTES
from tis.common.metrics.age_of_information import Arrivals, ages_at_ns
from tis.common.metrics.delivery import Flags, PlannedSamples
from tis.common.metrics.percentiles import summarise
from tis.common.records import SENT_BYTES, SENT_PACKETS, TICKS
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_MS
from tis.deploy.logs.read.columns import Ints, joined
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import begun_ticks, place_in
from tis.deploy.present.numbers import number, significant
from tis.deploy.present.table import Table
from tis.deploy.report.section import MEAN_LATE, Section, Statistics, means, statistics
from tis.deploy.report.subjects.age import near_gap_of_patient
from tis.deploy.report.subjects.logs import LogGaps, counters_of
from tis.deploy.report.subjects.network.link_books import ENDS, both_ends


class KeyTraffic(Section):
    """What the surgeon sent on a key, without the headers of Zenoh, TCP and IP."""

    packets: int = means("Packets that the surgeon sent.")
    bytes: int = means("Bytes of payload and attachment.")
    packets_per_s: float = means("Packets a second.")
    bytes_per_s: float = means("Bytes a second.")


class Price(Section):
    """The rates of all keys together."""

    packets_per_s: float | None = means("Packets a second of all keys.")
    bytes_per_s: float | None = means("Bytes a second of all keys.")
    packets_per_s_once: float | None = means("Packets a second without redundancy.")
    bytes_per_s_once: float | None = means("Bytes a second without redundancy.")


class LostSamples(Section):
    """Packets and samples that had not arrived by the end of the drain (RFC 7680)."""

    packets: int | None = means("Packets sent.")
    packets_pct: float | None = means("Share of them that did not arrive.")
    samples: int | None = means("Samples sent.")
    samples_pct: float | None = means("Share of them that arrived in no packet.")
    samples_once_pct: float | None = means("Share of them that the first packets alone would have lost.")


class Redundancy(Section):
    """Cost and gain of copies and history; figures with ``once`` are of the first packet of each sample alone."""

    copies: int = means("Packets for each sample (`surgeon.copies`).")
    copy_spacing_ms: float = means("Time between copies.")
    history: int = means("Earlier samples in each packet (`surgeon.history`).")
    price: Price = means("Packets and bytes a second.")
    lost: LostSamples = means("Packets and samples that never arrived.")
    age_ms: Statistics = statistics("Age of the freshest sample at the ticks.", MEAN_LATE)
    age_once_ms: Statistics = statistics("The same by the first packets alone.", MEAN_LATE)

    @property
    def is_used(self) -> bool:
        """Tell whether anything was sent more than once."""
        return self.copies > 1 or self.history > 0

    def __str__(self) -> str:
        """Return the repetition in words: ``each sample 4 times, 8 ms apart, with the 2 samples before it``."""
        words = ["each sample once"]
        if self.copies > 1:
            spacing = f"{self.copy_spacing_ms:g} ms apart" if self.copy_spacing_ms else "all at once"
            words = [f"each sample {self.copies} times", spacing]
        if self.history:
            before = f"the {self.history} samples" if self.history > 1 else "the sample"
            words.append(f"with {before} before it")
        return ", ".join(words)

    @property
    def loss_text(self) -> str | None:
        """Return the share of samples that arrived in no packet; None without redundancy or when it is unknown."""
        pct = self.lost.samples_pct
        if not self.is_used or pct is None:
            return None
        return f"{significant(pct)} % of the samples never arrived" if pct else "every sample arrived"

    @property
    def rate_text(self) -> str | None:
        """Return packets and bytes per second that the surgeon sends; None when unknown."""
        if self.price.packets_per_s is None:
            return None
        return f"{number(self.price.packets_per_s)} packets/s, {number(kilo(self.price.bytes_per_s))} kB/s"


_NOTE: Final = (
    "First packets alone: each sample once and without history, on this run's fates. Where packets wait for each "
    "other, in a queue or for their order, first packets alone would be faster. Bytes: payload and attachment"
)


def surgeon_traffic(logs: RunLogs, duration_s: float) -> dict[str, KeyTraffic]:
    """Return packets and bytes (payload and attachment) of each key, in total and per second of ``duration_s``.

    Taken from the surgeon's counters, which are written at the end of the run; empty without them. The headers of
    Zenoh, TCP and IP are not included.
    """
    counts = counters_of(logs, "surgeon")
    keys = [name.removeprefix(f"{SENT_PACKETS}.") for name in counts if name.startswith(f"{SENT_PACKETS}.")]
    traffic = {}
    for key in keys:
        n_packets, n_bytes = counts[f"{SENT_PACKETS}.{key}"], counts[f"{SENT_BYTES}.{key}"]
        rates = {"packets_per_s": n_packets / duration_s, "bytes_per_s": n_bytes / duration_s}
        traffic[key] = KeyTraffic(packets=n_packets, bytes=n_bytes, **rates)
    return traffic


_FIELD_BYTES: Final = len(',"history":[') + len("]") - 1
"""The JSON field around a history; each of its poses but the first adds a comma."""


class _Key(NamedTuple):
    """One stream: lost flags of packets (N,) and of samples (S,), by any packet and by the first packet alone.

    ``recv_ns`` and ``sample_ns`` (A,) are of the arrivals, ``by_first`` (A,) marks those of first packets.
    """

    packet_lost: Flags
    sample_lost: Flags
    sample_lost_once: Flags
    recv_ns: Ints
    sample_ns: Ints
    by_first: Flags


def redundancy(
    logs: RunLogs, scenario: Scenario, arms: Mapping[Hand, Arm], traffic: Mapping[str, KeyTraffic]
) -> Redundancy:
    """Return cost and gain of copies and history, over the samples of all hands and streams.

    ``traffic`` is the summary's ``surgeon_traffic``. Figures with ``once`` are of one packet per sample without
    history, on this run's fates: the first copies alone. Where copies wait for each other, in a queue or under
    `fifo`, first packets alone would have been faster. ``lost`` counts packets and samples that had not arrived by
    the end of the drain (RFC 7680). ``age_ms`` is of the freshest sample of a hand, at the ticks at which both
    variants have one. Values are None where a log is missing. Oracles: a few packets computed by hand, and a run that
    sends everything once, test_redundancy.
    """
    part = scenario.surgeon
    keys = _keys(logs, scenario, arms)
    packets, samples, samples_once = (
        joined((getattr(one, name) for of_hand in keys for one in of_hand), np.bool_)
        for name in ("packet_lost", "sample_lost", "sample_lost_once")
    )
    age_ns, once_ns = _ages_ns(logs, keys)
    return Redundancy(
        copies=part.copies,
        copy_spacing_ms=part.copy_spacing_ms,
        history=part.history,
        price=_price(logs, part.history, traffic),
        lost=LostSamples(
            packets=len(packets) if keys else None,
            packets_pct=_share_pct(packets),
            samples=len(samples) if keys else None,
            samples_pct=_share_pct(samples),
            samples_once_pct=_share_pct(samples_once),
        ),
        age_ms=summarise(age_ns / NS_PER_MS, also=("mean", "max")),
        age_once_ms=summarise(once_ns / NS_PER_MS, also=("mean", "max")),
    )


def _keys(logs: RunLogs, scenario: Scenario, arms: Mapping[Hand, Arm]) -> Sequence[Sequence[_Key]]:
    """Return the streams of each hand; none where a log is missing."""
    sender, receiver = ENDS["forward"]
    if logs.coverage(sender) is None or logs.coverage(receiver) is None:
        return ()
    gaps = LogGaps.of(logs, "forward", scenario.session, (sender, receiver))
    ends, history = both_ends(logs, "forward", scenario.session), scenario.surgeon.history
    found = []
    for hand, arm in arms.items():
        channels = hand_channels(hand, arm)
        keys = [channel.key(scenario.session) for channel in (channels.command, channels.arm)]
        found.append([_key(*ends[key], gaps, history) for key in keys if key in ends and len(ends[key][0])])
    return found


def _key(out: Frame, received: Frame, gaps: LogGaps, history: int) -> _Key:
    sent = out.first_of_each("seq")
    planned = PlannedSamples.of(sent.seq, sent.sample_ns)
    logged = ~gaps.affect(sent.sent_ns)
    arrived = np.isin(sent.seq, received.seq)
    # a packet in a gap may have brought its sample and the history before it: neither counts
    known = ~planned.carried(~logged, history)
    # a sample arrives in its own packet, a copy, or the history of a later one
    any_way, once = planned.carried(arrived, history), planned.carried(arrived & planned.is_first, 0)
    place, ours = place_in(sent.seq, received.seq)
    return _Key(
        packet_lost=~arrived[logged],
        sample_lost=~any_way[known],
        sample_lost_once=~once[known],
        recv_ns=received.log_ns[ours],
        sample_ns=received.sample_ns[ours],
        by_first=planned.is_first[place[ours]],
    )


def _ages_ns(logs: RunLogs, keys: Sequence[Sequence[_Key]]) -> tuple[Ints, Ints]:
    """Return the ages (T,) of the freshest sample, hand by hand: by all packets, and by first packets alone."""
    due_ns = begun_ticks(logs).due_ns
    due_ns = due_ns[~near_gap_of_patient(logs, due_ns)]
    all_ns, once_ns = [], []
    for of_hand in keys:
        recv_ns, sample_ns = (joined(getattr(one, name) for one in of_hand) for name in ("recv_ns", "sample_ns"))
        alone = joined((one.by_first for one in of_hand), np.bool_)
        # both variants over the same ticks, else a late first packet would drop out of one mean only
        either = ages_at_ns(*Arrivals.of(recv_ns, sample_ns), due_ns)
        once = ages_at_ns(*Arrivals.of(recv_ns[alone], sample_ns[alone]), due_ns)
        both = (either >= 0) & (once >= 0)
        all_ns.append(either[both])
        once_ns.append(once[both])
    return joined(all_ns), joined(once_ns)


def _price(logs: RunLogs, history: int, traffic: Mapping[str, KeyTraffic]) -> Price:
    """Return packets and bytes per second, as sent and with one packet per sample without history."""
    n_samples = int(np.count_nonzero(~logs.of("surgeon", TICKS).column("missed")))
    sent = [one for one in traffic.values() if one.packets]
    if not n_samples or not sent:
        return Price(**dict.fromkeys(Price.model_fields))
    once = [one.packets_per_s / one.packets * n_samples for one in sent]
    alone = [alone_bytes(one.bytes / one.packets, n_samples, history) for one in sent]
    return Price(
        packets_per_s=sum(one.packets_per_s for one in sent),
        bytes_per_s=sum(one.bytes_per_s for one in sent),
        packets_per_s_once=sum(once),
        bytes_per_s_once=sum(rate * size for rate, size in zip(once, alone, strict=True)),
    )


def alone_bytes(packet_bytes: float, n_samples: int, history: int) -> float:
    """Return the size of a packet without its history, from the mean size ``packet_bytes`` with it.

    Of ``n_samples``, sample k carries the h = min(k, ``history``) samples before it: h poses of about its own size,
    the commas between them and, for h > 0, the field around them. Oracle: payloads of a run, test_redundancy.
    """
    n_history = np.minimum(np.arange(n_samples), history)
    added = float(np.mean(np.where(n_history > 0, _FIELD_BYTES + n_history, 0)))
    return float(HEADER_BYTES + (packet_bytes - HEADER_BYTES - added) / (1.0 + n_history.mean()))


def _share_pct(lost: Flags) -> float | None:
    return 100 * float(lost.mean()) if len(lost) else None


def redundancy_table(found: Redundancy) -> Table:
    """Return cost and gain, without rows where nothing was sent twice."""
    price, lost = found.price, found.lost
    rows = [
        ("packets/s", price.packets_per_s, price.packets_per_s_once),
        ("kB/s", kilo(price.bytes_per_s), kilo(price.bytes_per_s_once)),
        ("packets that never arrived, %", lost.packets_pct, lost.samples_once_pct),
        ("samples that never arrived, %", lost.samples_pct, lost.samples_once_pct),
        *((f"age at the ticks, {name}, ms", found.age_ms[name], found.age_once_ms[name]) for name in ("mean", "p95")),
    ]
    columns = ("figure", "as sent", "first packets alone")
    return Table(f"What redundancy cost and gained: {found}", columns, rows if found.is_used else (), _NOTE)


def kilo(value: float | None) -> float | None:
    """Return thousands."""
    return None if value is None else value / 1000
