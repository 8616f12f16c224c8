"""Tables of a run's network: packets, delays and losses, by direction and by key, on the page and in a terminal."""

from collections.abc import Iterator, Mapping
from html import escape
from typing import Any, Final

from tis.common.channels import Direction
from tis.deploy.present.numbers import counted, heads, interval, number
from tis.deploy.present.page import folded, nonbreaking_units, note
from tis.deploy.present.table import Column, Table
from tis.deploy.report.subjects.network.link_figures import KeyOfLink, Link

Links = Mapping[Direction, Link]
_COLUMNS: Final = ("mean", "std", "p50", "p90", "p95", "p99", "p99.9", "max")
_MAX_KEYS: Final = 12
_FAITHFUL: Final = {
    True: ("faithful", "good", "the network was the one that {}."),
    False: ("not faithful", "bad", "the network was not the one that {}."),
    None: ("not decidable", "open", "too little was sent to tell whether the network was the one that {}."),
}
_COUNTS: Final = {
    "sent": "sent",
    "offered": "reached netem",
    "copied": "copies made by netem",
    "dropped": "dropped by netem",
    "recovered": "sent again by the recovery",
    "released": "released",
    "received": "received",
    "not_used": "of these refused by its gate",
    "unplanned_loss": "unplanned loss",
    "held_at_end": "in flight at the end",
    "reordered": "reordered",
    "duplicated": "duplicated",
    "duplicated_by_netem": "of these by netem",
    "corrupted": "corrupted by netem",
    "corrupted_rejected": "of these rejected on arrival",
    "foreign": "foreign",
}


_ALWAYS: Final = ("sent", "offered", "dropped", "released", "received", "unplanned_loss")
"""The counts that are told where they are 0, too."""


def packet_table(links: Links) -> Table:
    """Return what became of the packets of both links."""
    each = links.values()
    rows: list[tuple[Any, ...]] = [
        (title, *(link[name] for link in each))
        for name, title in _COUNTS.items()
        if name in _ALWAYS or any(link[name] for link in each)
    ]
    rows.append(("share lost in netem, %", *(link.loss_pct for link in each)))
    rows.append(("its 95 % interval, %", *(interval(link.loss_pct_interval_95) for link in each)))
    reasons = dict.fromkeys(reason for link in each for reason in link.dropped_by)
    rows += [(f"dropped because of {why}", *(link.dropped_by.get(why, 0) for link in each)) for why in reasons]
    note = (
        "Dropped: by netem, as requested. Unplanned loss: lost on either side of netem. Foreign: messages of other "
        "programs on keys of the testbed"
    )
    if n_unlogged := sum(link.untold for link in each):
        note += f". Left out, as they fall into gaps of damaged logs: {n_unlogged}"
    return Table("Packets, by direction", ("what became of them", *links), rows, note)


def fidelity_list(links: Links, request: str = "the scenario requests") -> str:
    """Return the verdict on each direction in a sentence, with violations, warnings and undecidable criteria.

    ``request`` completes the sentence "the network was the one that ...".
    """
    items = []
    for direction, link in links.items():
        verdict = link.verdict
        word, look, sentence = _FAITHFUL[verdict.faithful]
        sentence = sentence.format(request)
        if verdict.faithful and (left_open := verdict.undecided_text):
            word += "" if verdict.undecided_keys else " in what could be judged"
            sentence = f"{sentence.removesuffix('.')}, as far as this run can show ({left_open})."
        if verdict.faithful and (judged := verdict.judged_text):
            sentence = f"{sentence.removesuffix('.')}, {judged}."
        items.append((look, word, f"{direction}: {sentence}"))
        items += [("bad", "violated", text) for text in verdict.violations]
        items += [("open", "warning", text) for text in verdict.warnings]
        if verdict.not_decidable:
            items.append(("", "", "; ".join(verdict.not_decidable)))
    lines = [
        f'<strong class="{look}">{word}</strong> {escape(text)}'
        if look
        else f'<span class="note">{escape(text)}</span>'
        for look, word, text in ((look, word, nonbreaking_units(text)) for look, word, text in items)
    ]
    return f'<ul class="problems">{"".join(f"<li>{line}</li>" for line in lines)}</ul>'


def key_tables(links: Links) -> str:
    """Return a folded section with a table for each key of each direction."""
    listed = [(d, title, key) for d, link in links.items() for title, key in link.keys.items()]
    tables = [key_table(f"{title}, {direction}", key).html() for direction, title, key in listed[:_MAX_KEYS]]
    n_more = len(listed) - _MAX_KEYS + sum(link.keys_not_listed for link in links.values())
    more = note(f"In summary.json: {counted(n_more, 'more key')}.") if n_more > 0 else ""
    return folded(f"{counted(min(len(listed), _MAX_KEYS), 'key')} in numbers", "".join(tables) + more)


def key_table(caption: str, key: KeyOfLink) -> Table:
    """Return one key's distributions, and a line with its counts."""
    named = {
        "delay, requested, ms": key.delay_ms.requested,
        "delay, decided, ms": key.delay_ms.decided,
        "delay, realised, ms": key.delay_ms.realised,
        "above the smallest (PDV), ms": key.pdv_ms,
        "from one message to the next (IPDV, absolute), ms": key.ipdv_ms,
        "RFC 3550 jitter, ms": key.rfc3550_jitter_ms,
        "release error, \u00b5s": key.release_error_us,
    }
    if key.queued_ms["max"]:
        named["of it in a queue, ms"] = key.queued_ms
    if key.recovered_ms["max"]:
        named["of it by a recovery, where any, ms"] = key.recovered_ms
    base = " (without changes)" if key.requested.varies else ""
    line = (
        f"Lost: {number(key.loss_pct)} % of {number(key.offered)} (95 % interval "
        f"{interval(key.loss_pct_interval_95)}), requested{base}: {number(key.requested.loss_pct)} %; "
        f"{counted(key.loss_runs.count, 'run')}, mean length {number(key.loss_runs.mean)}, the longest "
        f"{key.loss_runs.longest}. "
        f"Copied: {number(key.copied)}, corrupted: {number(key.corrupted)}. Reordered: "
        f"{number(key.reordered_in_netem)} in netem, {number(key.reordered)} on arrival. "
        f"Unplanned loss: {number(key.unplanned_loss)}."
        + f" Sent again by a recovery: {number(key.recovered)}."
        * bool(key.recovered)
    )
    rows = [(title, *(found.get(name) for name in _COLUMNS)) for title, found in named.items()]
    return Table(caption, ("what", *heads(_COLUMNS)), rows, line)


_STATISTICS: Final = ("mean", "std", "p50", "p95", "p99", "max")
_LOSSES: Final = ("lost, %", "its 95 % interval, %", "in a row")
_NOTHING: Final = [None] * len(_LOSSES)
_MAX_NAMED: Final = 4
_MAX_KEY_CHARS: Final = 26
_SEEN_MS: Final = 0.1
_ROUNDING_MS: Final = 1e-3
_US_PER_MS: Final = 1000
_SHARES_ABOVE: Final = (0.45, 0.04, 0.01, 0.0)  # from the 50th, 95th and 99th percentile and the maximum upwards
_SHARES_BELOW: Final = (0.5, 0.45, 0.04, 0.01)
_LATE: Final = "left later than decided, by the release error"
_WAITING: Final = "waited for earlier ones, in their order (fifo) or in a queue"
_WITHOUT_CHANGES: Final = (
    "*: without outages, steps and the changes by states, timeline or while running, which the others have"
)


def delay_table(links: Links, requested: str = "by the scenario") -> Table:
    """Return delay in netem and loss of both directions: requested, drawn by the models, and measured.

    ``requested`` names the source of the request. The keys of a direction have rows of their own when their pipelines
    differ, as no request applies to them all. The busiest key of each request comes first; keys that do not fit are
    counted. Oracle: literal summaries, test_delay_table.
    """
    rows: list[tuple[Any, ...]] = []
    notes: list[str] = []
    varies = False
    for direction, link in links.items():
        varies |= link.requested.varies and _is_known(link)
        keys = _differing_keys(link)
        if not keys:
            rows += _rows(f"{direction} ", link)
            continue
        shown = _first_of_each(keys)[:_MAX_NAMED]
        for name in shown:
            varies |= keys[name].requested.varies and _is_known(keys[name])
            # keys differ at their ends
            end = name if len(name) <= _MAX_KEY_CHARS else f"...{name[3 - _MAX_KEY_CHARS :]}"
            rows += [(f"{direction}, {end}", *[None] * len(_STATISTICS), *_NOTHING), *_rows("  ", keys[name])]
        if n_more := len(keys) - len(shown) + link.keys_not_listed:
            notes.append(f"{counted(n_more, 'more key')} {direction}: see summary.json")
    words = (
        f"requested: {requested}; decided: drawn by its models, both without waits in a queue; realised: measured in "
        "netem, with them, but not what waited before netem; release error: left later than decided by; in a row: "
        "mean number of messages lost without one between them"
    )
    columns = [
        Column(head, on_page_only=name in ("std", "p95"))
        for name, head in zip(_STATISTICS, heads(_STATISTICS), strict=True)
    ]
    columns += [Column(head, on_page_only="interval" in head) for head in _LOSSES]
    causes = dict.fromkeys(cause for link in links.values() for cause in _excess(link))
    waited = [f"realised exceeds decided: messages {', and '.join(sorted(causes))}"] if causes else []
    note = "; ".join([words, *waited, *([_WITHOUT_CHANGES] if varies else []), *notes])
    title = "The network requested, decided and realised: delay one way, and loss"
    return Table(title, ("direction", *columns), rows, note)


def _excess(link: Link) -> Iterator[str]:
    """Yield the causes for which realised delays exceed the decided ones, as far as they show in the means.

    The summary has percentiles of the release error, which bound its mean from below and above. A wait is named only
    where the upper bound leaves room for one, or where the queue's own mean shows.
    """
    decided_ms, realised_ms = (found["mean"] for found in (link.delay_ms.decided, link.delay_ms.realised))
    if decided_ms is None or realised_ms is None or realised_ms - decided_ms <= _SEEN_MS:
        return
    ends_ms = [(link.release_error_us.get(name) or 0.0) / _US_PER_MS for name in ("p50", "p95", "p99", "max")]
    least_ms = sum(share * ms for share, ms in zip(_SHARES_ABOVE, ends_ms, strict=True))
    most_ms = sum(share * ms for share, ms in zip(_SHARES_BELOW, ends_ms, strict=True))
    waited_ms = max(realised_ms - decided_ms - most_ms, link.queued_ms.get("mean") or 0.0)
    is_late = least_ms > _SEEN_MS
    has_waited = waited_ms > (_SEEN_MS if is_late else _ROUNDING_MS)
    if is_late or not has_waited:
        yield _LATE
    if has_waited:
        yield _WAITING


def _differing_keys(link: Link) -> dict[str, KeyOfLink]:
    """Return the testbed's keys of the link if their requests differ, else none."""
    keys = {name: key for name, key in link.keys.items() if not key.foreign}
    several = not _is_known(link) and any(_is_known(key) for key in keys.values())
    return keys if several and len(keys) > 1 else {}


def _is_known(part: Link | KeyOfLink) -> bool:
    return part.delay_ms.requested["mean"] is not None


def _first_of_each(keys: Mapping[str, KeyOfLink]) -> list[str]:
    """Return the names, the first key of each distinct request in front."""
    firsts: dict[Any, str] = {}
    for name, key in keys.items():
        firsts.setdefault(tuple(key.delay_ms.requested.values()), name)
    return [*firsts.values(), *(name for name in keys if name not in firsts.values())]


def _rows(before: str, part: Link | KeyOfLink) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of a link or of a key; an unknown request has none."""
    asked = part.requested
    losses = {
        "requested": (asked.loss_pct, None, asked.mean_burst),
        "realised": (part.loss_pct, interval(part.loss_pct_interval_95), part.loss_runs.mean),
    }
    for kind, delay in part.delay_ms:
        if kind == "requested" and delay["mean"] is None:
            continue
        mark = "*" if kind == "requested" and asked.varies else ""
        yield (f"{before}{kind}{mark}, ms", *(delay[name] for name in _STATISTICS), *losses.get(kind, _NOTHING))
    if part.release_error_us.get("max"):  # in virtual time none is late
        late_us = (part.release_error_us.get(name) for name in _STATISTICS)
        yield (f"{before}release error, \u00b5s", *late_us, *_NOTHING)
