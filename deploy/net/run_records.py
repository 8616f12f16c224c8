"""Records to fit from netem's log of a run: the decided delay and loss of each message, by direction."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple, get_args

import numpy as np
from msgspec import convert
from numpy.typing import NDArray
from pydantic import ValidationError

from tis.common.channels import Direction
from tis.common.errors import DataError, Fault, InputError
from tis.common.metrics.percentiles import median, summarise
from tis.common.records import CONTROL, ControlNote
from tis.common.scenario.faults import faults
from tis.common.scenario.network import NetworkPart
from tis.common.trace import LOST, Trace
from tis.common.units import NS_PER_MS
from tis.common.yaml_text import load_yaml
from tis.deploy.logs.log_paths import log_file, log_files
from tis.deploy.logs.read.columns import Flags, Ints
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.load import RunLogs, load_parts
from tis.deploy.logs.read.packets import DELIVER, by_key, late_ns, link_fates, link_releases
from tis.deploy.logs.read.side_log import DEPARTURES, OUTCOMES
from tis.deploy.shell import run_dir as folder
from tis.deploy.standalone.standalone_run import NETWORK_FILE
from tis.netem.conditions.conditions import Span
from tis.netem.control.replay import changed_conditions
from tis.netem.fit.record import NOTHING_ADDED, DirectionRecord, Flips

# Frame and departures of one direction in netem's log, joined packet by packet.

NOWHERE: Final = -1


class Packets(NamedTuple):
    """N packets of one key in the order of offering: fates, and departures of the originals, arrays (N,).

    ``left`` is an index into `DEPARTURES`, `NOWHERE` where it is unknown; ``leaves_ns`` the decided instant, 0
    without one.
    """

    key: str
    fates: Frame
    left: Ints
    queued_ns: Ints
    leaves_ns: Ints
    late_ns: Ints
    """Release errors of originals and copies, (M,)."""


def packets_by_key(fates: Frame, releases: Frame, with_foreign: bool) -> list[Packets]:
    """Return the packets of each key; foreign messages count as separate keys (oracle: test_run_records)."""
    found = []
    for foreign in (False, True) if with_foreign else (False,):
        offered, out = fates.at(fates.foreign == foreign), releases.at(releases.foreign == foreign)
        out_of = dict(zip(out.keys, by_key(out.key, len(out.keys)), strict=True))
        for key, which in zip(offered.keys, by_key(offered.key, len(offered.keys)), strict=True):
            if len(which):
                found.append(_packets(key, offered.at(which), out.at(out_of.get(key, which[:0]))))
    return found


def _packets(key: str, fates: Frame, releases: Frame) -> Packets:
    fates = fates.at(np.argsort(fates.offered_ns, kind="stable"))
    originals = releases.at(releases.copy_index == 0)
    place = _places(fates, originals)
    known = place >= 0

    def of(column: Ints, otherwise: int) -> Ints:
        found = np.full(len(place), otherwise, dtype=np.int64)
        found[known] = column[place[known]]
        return found

    left = of(originals.departure, NOWHERE)
    leaves_ns = np.where(known, of(originals.release_ns, 0), fates.release_ns)
    return Packets(key, fates, left, of(originals.queued_ns, 0), leaves_ns, late_ns(releases))


def _places(fates: Frame, left: Frame) -> NDArray[np.int64]:
    """Return the index of each packet in ``left``, (N,), `NOWHERE` without one. A restarted sender reuses numbers."""
    # one name per pair of number and instant, equal in both tables
    both = np.concatenate([_named(left.seq, left.offered_ns), _named(fates.seq, fates.offered_ns)])
    _, name = np.unique(both, axis=0, return_inverse=True)
    name = name.reshape(-1)
    place = np.full(len(both), NOWHERE, dtype=np.int64)
    place[name[: len(left.seq)]] = np.arange(len(left.seq))
    return np.asarray(place[name[len(left.seq) :]])


def _named(seq: Ints, offered_ns: Ints) -> NDArray[np.int64]:
    return np.stack([seq, offered_ns], axis=1)


RUN_HEADER_FIELDS: Final = ("delay", "release_error", "states")
"""Header fields that define the delays of a run's record."""

_LOG: Final = "netem.mcap"
_MAX_NAMED: Final = 5
_OUTAGE, _REFUSED, _OVERFLOW = (OUTCOMES.index(name) for name in ("outage", "refused", "overflow"))
_LATE, _EVICTED = (DEPARTURES.index(name) for name in ("late", "evicted"))
_BY_QUEUE: Final = tuple(DEPARTURES.index(name) for name in ("codel", "queue_full"))


def run_records(run_dir: Path, key: str | None = None) -> dict[Direction, DirectionRecord]:
    """Return the record of one key of each direction that has messages, by default the busiest; raises `DataError`.

    Keys may have rules of their own, and long messages are lost more often, so they are not fitted together: a
    record names its key, and counts the others' messages as left out.

    The delay is the decided one of the original, not of copies: the models' draw plus the queue of a rate, before
    ordering and without the emulator's release error. Excluded, with counts, are packets dropped by outages, offered
    while an entry of the timeline or a change by `tis net` was in force, or refused by netem's own buffer. In a run
    of the testbed only its own messages count; for a standalone netem all do.
    """
    path, paths = log_file(run_dir, "netem"), log_files(run_dir).get("netem", ())
    if not paths:
        raise DataError(Fault(str(run_dir), "", f"is no run folder with a log of netem ({_LOG})"))
    log = load_parts(paths, "netem")
    logs = RunLogs(run_dir, {"netem": log})
    with_foreign = folder.SCENARIO_FILE not in log.attachments
    network, seed = _recorded_network(run_dir, path, log.attachments, log.metadata)
    notes = [convert(row, ControlNote) for row in logs.of("netem", CONTROL)]
    about = {} if log.coverage.problem is None else {"lack": log.coverage.problem}
    if network.states is not None:
        names = ", ".join(state.name for state in network.states.states)
        about["states"] = f"the states {names} are fitted as one network"
    found: dict[Direction, DirectionRecord] = {}
    sizes: dict[str, int] = {}
    for direction in get_args(Direction):
        spans: list[Span] = []
        if network.timeline or any(note.accepted for note in notes):
            spans = changed_conditions(network, direction, seed, notes).spans(log.last_ns + 1)
        by_key = packets_by_key(link_fates(logs, direction), link_releases(logs, direction), with_foreign)
        sizes |= {one.key: len(one.fates.outcome) for one in by_key}
        made = [
            (record, one.key)
            for one in by_key
            if key in (None, one.key)
            and (record := _record(f"{path}: {one.key}", one, _changed(spans, one.fates.offered_ns), about))
        ]
        if made:
            record, taken = max(made, key=lambda each: len(each[0].trace.sent_ns))
            others = {one.key: len(one.fates.outcome) for one in by_key if one.key != taken}
            found[direction] = replace(record, key=taken, left_out=(*record.left_out, *_others(others, taken)))
    if not found and key is not None and key not in sizes:
        rule = f"is no key of the log; {_in_words(sizes) or 'it has none'}"
        raise InputError(Fault("tis net fit", "--key", rule, key))
    if not found:
        whose = "messages" if with_foreign else "messages of the testbed"
        rule = f"must have {whose} that netem delivered while the network was unchanged"
        raise DataError(Fault(str(path), "", rule))
    return found


def _others(n_of: Mapping[str, int], taken: str) -> list[str]:
    """Return how many messages other keys had, by name; nothing without any."""
    n = sum(n_of.values())
    return [f"{n} of other keys than {taken}: {_in_words(n_of)}; --key fits one of them"] if n else []


def _in_words(n_of: Mapping[str, int]) -> str:
    """Return the busiest keys with their numbers of messages."""
    names = sorted(n_of, key=lambda name: -n_of[name])
    more = f" and {len(names) - _MAX_NAMED} more" if len(names) > _MAX_NAMED else ""
    return ", ".join(f"{name} ({n_of[name]})" for name in names[:_MAX_NAMED]) + more


def _recorded_network(
    run_dir: Path, path: Path, attachments: dict[str, bytes], metadata: dict[str, str]
) -> tuple[NetworkPart, int]:
    """Return the network and the seed attached to the log; raises `DataError` without a readable one."""
    recorded = attachments.get(folder.SCENARIO_FILE)
    if recorded is not None:
        scenario = folder.read_scenario(run_dir, recorded.decode())
        return scenario.network, scenario.seed
    content = attachments.get(NETWORK_FILE)
    if content is None:
        rule = f"must hold {NETWORK_FILE} or {folder.SCENARIO_FILE}: without its beginning the network is unknown"
        raise DataError(Fault(str(path), "", rule))
    try:
        network = NetworkPart.model_validate(load_yaml(content.decode(), str(path)))
    except ValidationError as error:
        raise DataError(faults(error, NetworkPart, str(path))) from None
    return network, int(metadata.get("seed", 0))


def _changed(spans: list[Span], at_ns: Ints) -> Flags:
    """Return for instants (N,) whether a timeline entry or a later change was in force; never without spans."""
    if not spans:
        return np.zeros(len(at_ns), dtype=np.bool_)
    begins_ns = np.array([span.begin_ns for span in spans[1:]], dtype=np.int64)
    held = np.array([span.changed for span in spans], dtype=np.bool_)
    return np.asarray(held[np.searchsorted(begins_ns, at_ns, side="right")])


def _record(label: str, packets: Packets, changed: Flags, about: dict[str, str]) -> DirectionRecord | None:
    """Return the record of a key's packets; None when none of those that count was delivered."""
    fates, left = packets.fates, packets.left
    out, refused, overflow = (fates.outcome == code for code in (_OUTAGE, _REFUSED, _OVERFLOW))
    held = (
        (fates.outcome == DELIVER) & (left == NOWHERE) & (packets.leaves_ns == 0)
    )  # still queued: the release instant is undecided
    without = {
        "dropped by outages, which the loss stage does not cover": out,
        "offered while the timeline or `tis net` changed the network": changed,
        "that netem's own buffer had no room for": overflow | (left == _EVICTED),
        "of a key that was refused": refused,
        "still in a queue when the log ended": held,
    }
    # each packet is excluded for the first reason that applies, so that the counts add up
    kept = np.ones(len(left), dtype=np.bool_)
    left_out = []
    for why, which in without.items():
        n = int(np.count_nonzero(which & kept))
        kept &= ~which
        left_out += [f"{n} {why}"] if n else []
    # delays of delivered packets; dropped ones are losses of the record
    through = kept & (fates.outcome == DELIVER) & ~np.isin(left, _BY_QUEUE)
    if not through.any():
        return None
    delay_ns = np.where(through, fates.delay_ns + packets.queued_ns, LOST)[kept]
    sent_ns = fates.offered_ns[kept]
    # overtaking is judged among the packets that left
    released = through & (left != _LATE)
    leaves_ns = packets.leaves_ns[released]
    flips = fates.flipped[through & (fates.flipped > 0)]
    trace = Trace(label, sent_ns - sent_ns[0], delay_ns, {**_delays_are(packets), **about})
    return DirectionRecord(
        trace,
        NOTHING_ADDED,
        overtaken=float(np.mean(leaves_ns < np.maximum.accumulate(leaves_ns))) if len(leaves_ns) else 0.0,
        n_dropped_late=int(np.count_nonzero(through & (left == _LATE))),
        n_copied=int(fates.copies[through].sum()),
        flips=Flips(len(flips), int(median(flips)) if len(flips) else 0),
        left_out=tuple(left_out),
        drawn=True,
    )


def _delays_are(packets: Packets) -> dict[str, str]:
    """Return the header fields that define the record's delays."""
    queue = ", and the queue of a rate added" if np.any(packets.queued_ns) else ""
    about = {"delay": f"delays as netem's models decided them{queue}"}
    if len(packets.late_ns):
        p99_ms = summarise(packets.late_ns / NS_PER_MS, (99,), ())["p99"]
        about["release_error"] = f"netem let messages go {p99_ms:.2g} ms later at p99, which is not in the delays"
    return about
