"""What became of the packets of one link, from the sender's log over netem's to the receiver's.

A packet is named by (key, sequence number); the three logs are matched by that name after the drain.
"""

from collections.abc import Iterable, Mapping
from math import sqrt
from statistics import NormalDist
from typing import NamedTuple

Packet = tuple[str, int]


class LinkPackets(NamedTuple):
    """The packets of one link at each station; a packet may come more than once in ``received`` only.

    ``sent`` from the sender's log, ``offered`` ``released`` ``dropped`` ``held_at_end`` from netem's,
    ``received`` from the receiver's.
    """

    sent: Iterable[Packet]
    offered: Iterable[Packet]
    released: Iterable[Packet]
    dropped: Iterable[Packet]
    held_at_end: Iterable[Packet]
    received: Iterable[Packet]


class LinkAccount(NamedTuple):
    """Counts of distinct packets under the summary's names, and sentences on what does not add up."""

    counts: dict[str, int]
    violations: tuple[str, ...]


def account(packets: LinkPackets) -> LinkAccount:
    """Balance one link.

    ``unplanned_loss = (sent - offered) + (released - received)``: what got lost on either side of netem,
    which no scenario asked for. ``duplicated`` counts arrivals beyond the first of each packet (RFC 5560).
    Loss is as in RFC 7680 with the drain as its time-out.

    The books balance when ``offered = released + dropped + held_at_end`` packet by packet, nothing is
    offered that was not sent, and nothing received that was not released. Oracle: hand-made tables in the
    tests.
    """
    received = list(packets.received)
    books = {name: list(entries) for name, entries in packets._replace(received=received)._asdict().items()}
    once = {name: set(entries) for name, entries in books.items()}
    counts = {name: len(entries) for name, entries in once.items()}
    counts["duplicated"] = len(received) - counts["received"]
    counts["unplanned_loss"] = counts["sent"] - counts["offered"] + counts["released"] - counts["received"]
    violations = [
        f"{len(entries) - counts[name]} packets stand more than once in {name}"
        for name, entries in books.items()
        if name != "received" and len(entries) > counts[name]
    ]
    return LinkAccount(counts, (*violations, *_imbalances(once)))


def _imbalances(once: Mapping[str, set[Packet]]) -> list[str]:
    released, dropped, held = once["released"], once["dropped"], once["held_at_end"]
    decided = released | dropped | held
    twice = (released & dropped) | (released & held) | (dropped & held)
    wrong = {
        "offered but never sent": once["offered"] - once["sent"],
        "offered but neither released nor dropped nor held": once["offered"] - decided,
        "released, dropped or held but never offered": decided - once["offered"],
        "more than one of released, dropped and held": twice,
        "received but never released": once["received"] - released,
    }
    return [
        f"{len(found)} packets: {what}; the first is {min(found)[0]} seq {min(found)[1]}"
        for what, found in wrong.items()
        if found
    ]


def wilson_interval(n_lost: int, n: int, confidence: float = 0.95) -> tuple[float, float] | None:
    """Return the Wilson score interval of a loss share, (low, high) in 0..1; None without packets.

    Unlike the normal approximation it stays within 0..1 and has a width at no loss (Wilson 1927). It takes
    losses as independent: bursts make the true interval wider. Oracle: `scipy.stats.binomtest`.
    """
    if n == 0:
        return None
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    share = n_lost / n
    centre = share + z * z / (2 * n)
    half = z * sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    scale = 1 + z * z / n
    # at no loss and at nothing but loss the bound is exactly 0 or 1; rounding would leave -1e-18
    low = (centre - half) / scale if n_lost > 0 else 0.0
    high = (centre + half) / scale if n_lost < n else 1.0
    return (low, high)
