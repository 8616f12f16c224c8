"""Stretches of constant network in a run whose network was changed, and the runs at the live page's targets in it."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import scipy
from msgspec import convert
from numpy.typing import NDArray

from tis.common.channels import Arm, Channel, Direction, Hand, hand_channels
from tis.common.device_records import TARGET_RUNS
from tis.common.metrics.percentiles import median
from tis.common.records import CONTACTS, CONTROL, ControlNote
from tis.common.scenario import Scenario
from tis.common.units import MM_PER_M, NS_PER_MS, NS_PER_S, s_to_ns
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.packets import fates_by_key
from tis.deploy.present.numbers import number, significant
from tis.deploy.present.table import Column, Table
from tis.deploy.report.section import DirectionName, Section, means
from tis.deploy.report.subjects.network.requested import Requested
from tis.deploy.report.subjects.ticks import active_duration_s
from tis.deploy.report.subjects.tracking import Array, HandTrack, aligned
from tis.netem.control.replay import changes_from_notes
from tis.netem.expected.synopsis import beside_delay

_SHORTEST_S: Final = 0.5
"""A shorter stretch is left out, as between the reset and the delay that a task of the live page asks for."""
_MOVES_M_S: Final = 1e-3
_SHIFTS_FROM_S: Final = 1.96
"""Told as 2.0 s: where hand or arm moved for less, any of many shifts in time fits about as well."""
_TOUCHES_N: Final = 0.1
"""Less is the noise of a force sensor."""
_WAITS_S: Final = 0.1
_LATEST_S: Final = 1.0
"""How much later than the delays that are set an arm is looked for."""
_NOTE: Final = (
    "Network: what was set, one way: mean delay with its jitter, loss, and what else there is; a wait in a queue "
    "comes on top. Moved: hand or arm faster than 1 mm/s; late and error are of that time alone. Late: the shift in "
    "time by which the arm follows the hand (effective time offset), where each moved for 2 s and the arm touched "
    "nothing. Error: distance of the arm to where the hand has put it at that moment, RMS"
)
_SEEN: Final = {True: "picture and ghost", False: "late picture"}
_TARGETS_NOTE: Final = (
    "From the first of nine targets to the last, in the plane of the picture. A miss: the arm left a target too soon"
)


class Stretch(Section):
    """A stretch of constant network, and how a hand's arm followed in it, over the scored ticks."""

    begin_s: float = means("Run time of its begin.")
    end_s: float = means("Run time of its end.")
    delay_ms: dict[DirectionName, float | None] = means("Mean delay asked for, one way; `null` in a stall.")
    loss_pct: dict[DirectionName, float | None] = means("Loss asked for; 100 in an outage.")
    beside: dict[DirectionName, str] = means(
        "What else was asked for, in words: a queue with its bit rate and the others' traffic in it, duplicates, bit "
        "errors, overtaking; empty for nothing."
    )
    moved_s: float = means("Time in which hand or arm moved, faster than 1 mm/s.")
    late_ms: float | None = means(
        "Effective time offset of the arm (`plant`, else the active estimate) to the hand in that time, median; "
        "`null` where one of them moved for less than 2 s, or the arm touched something."
    )
    rmse_3d_mm: float | None = means("RMSE in that time.")


def stretches(
    logs: RunLogs, scenario: Scenario, requests: Mapping[Direction, Requested], tracks: Mapping[Hand, HandTrack],
    arms: Mapping[Hand, Arm],
) -> dict[str, dict[Hand, list[Stretch]]]:  # fmt: skip
    """Return by hand the stretches under ``stretches``; nothing where nobody changed the network of the run.

    Oracle: a run in virtual time with two changes, test_stretches.
    """
    edges_ns = network_edges_ns(logs, scenario)
    found = {
        hand: [
            _stretch(begin_ns, end_ns, scenario, asked, track, touched_ns)
            for begin_ns, end_ns in pairwise(edges_ns)
            if end_ns - begin_ns >= s_to_ns(_SHORTEST_S)
        ]
        for hand, track in tracks.items()
        if len(edges_ns) > 2
        for asked in [_asked(logs, scenario, requests, hand, arms[hand])]
        for touched_ns in [_touched_ns(logs, hand)]
    }
    return {"stretches": found} if any(len(one) > 1 for one in found.values()) else {}


def network_edges_ns(logs: RunLogs, scenario: Scenario) -> list[int]:
    """Return the run's begin and end, and the instants between at which accepted requests changed the network."""
    end_ns = s_to_ns(active_duration_s(logs, "surgeon", scenario))
    found = {0, end_ns}
    for change in changes_from_notes(convert(row, ControlNote) for row in logs.of("netem", CONTROL)):
        found |= {change.at_ns} if change.cleared else set()
        for entry in change.entries:
            begin_ns = s_to_ns(entry.at_s)
            found |= {begin_ns, begin_ns + s_to_ns(entry.for_s or 0.0)}
    return sorted(ns for ns in found if ns <= end_ns)


class _Asked(NamedTuple):
    """What was asked for N of a hand's messages in one direction, each (N,).

    When each was offered in ns, its delay in ms, its loss in % and what else there was, in words.
    """

    offered_ns: NDArray[np.int64]
    delay_ms: Array
    loss_pct: Array
    beside: NDArray[np.str_]


Asked = dict[Direction, _Asked]


def _asked(logs: RunLogs, scenario: Scenario, requests: Mapping[Direction, Requested], hand: Hand, arm: Arm) -> Asked:
    channels, found = hand_channels(hand, arm), Asked()
    ways: dict[Direction, Channel[Any]] = {"forward": channels.arm, "feedback": channels.estimated}
    for way, channel in ways.items():
        key = channel.key(scenario.session)
        fates = fates_by_key(logs, way).get(key)
        expected = None if fates is None or not len(fates) else requests[way].of_packets(key, fates)
        if fates is not None and expected is not None:
            held = requests[way].in_force(fates.offered_ns)
            delay_ms = np.where(held.column("stall"), np.nan, expected.delay_ns / NS_PER_MS)
            under = [requests[way].under(key, condition.changes) for condition in held.conditions]
            words = np.array(["" if one is None else ", ".join(beside_delay(one.pipeline)) for one in under])
            loss_pct = 100.0 * np.where(expected.outage, 1.0, expected.p_loss)
            found[way] = _Asked(fates.offered_ns, delay_ms, loss_pct, words[held.which])
    return found


def _touched_ns(logs: RunLogs, hand: Hand) -> NDArray[np.int64]:
    """Return the instants at which a hand's arm touched something; none for a run without touch."""
    contacts = logs.of_hand("patient", CONTACTS, hand)
    if not len(contacts):
        return np.empty(0, dtype=np.int64)
    return np.asarray(contacts.t_ns[np.linalg.norm(contacts.force_n, axis=1) > _TOUCHES_N])


def _stretch(
    begin_ns: int, end_ns: int, scenario: Scenario, asked: Asked, track: HandTrack, touched_ns: NDArray[np.int64]
) -> Stretch:
    set_ms: dict[DirectionName, float | None] = {}
    lost_pct: dict[DirectionName, float | None] = {}
    beside: dict[DirectionName, str] = {}
    for way, one in asked.items():
        within = (one.offered_ns >= begin_ns) & (one.offered_ns < end_ns)
        set_ms[way], lost_pct[way] = _mean(one.delay_ms[within]), _mean(one.loss_pct[within])
        beside[way] = " or ".join(str(words) for words in np.unique(one.beside[within]) if words)
    hand_m, rate_hz = track.truth_m, scenario.rate_hz
    nowhere = np.full_like(hand_m, np.nan)
    arm_m = track.estimates.get("plant", track.estimates.get(scenario.active_estimator, nowhere))
    moves = [_moves(one, rate_hz) for one in (hand_m, arm_m)]
    within = track.scored & (track.t_ns >= begin_ns) & (track.t_ns < end_ns)
    moving = within & (moves[0] | moves[1])
    is_free = not ((touched_ns >= begin_ns) & (touched_ns < end_ns)).any()
    late_s = np.empty(0)
    moved = [moving, *(within & _bridged(one, rate_hz) for one in moves)]
    if is_free and min(map(np.count_nonzero, moved)) >= _SHIFTS_FROM_S * rate_hz:
        latest_s = _LATEST_S + sum(ms or 0.0 for ms in set_ms.values()) / 1000.0
        late_s = aligned(replace(track, scored=moving), arm_m, hand_m, rate_hz, latest_s).time_s
    squares = _mean(np.sum((arm_m - hand_m)[moving] ** 2, axis=1))
    return Stretch(
        begin_s=begin_ns / NS_PER_S,
        end_s=end_ns / NS_PER_S,
        delay_ms=set_ms,
        loss_pct=lost_pct,
        beside=beside,
        moved_s=np.count_nonzero(moving) / rate_hz,
        late_ms=1000.0 * median(late_s) if len(late_s) else None,
        rmse_3d_mm=None if squares is None else MM_PER_M * squares**0.5,
    )


def _moves(position_m: Array, rate_hz: int) -> NDArray[np.bool_]:
    steps_m = np.linalg.norm(np.diff(position_m, axis=0, prepend=position_m[:1]), axis=1)
    return np.asarray(steps_m * rate_hz > _MOVES_M_S)


def _bridged(moves: NDArray[np.bool_], rate_hz: int) -> NDArray[np.bool_]:
    """Return the ticks at which one moves or waits between two moves: an arm without a lost sample does not rest."""
    length = 2 * round(_WAITS_S * rate_hz) + 1
    near = scipy.ndimage.maximum_filter1d(moves, length, mode="constant")
    return np.asarray(scipy.ndimage.minimum_filter1d(near, length, mode="nearest"))


def _mean(values: Array) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else None


def stretch_tables(found: Mapping[Hand, list[Stretch]]) -> list[Table]:
    """Return a table for each hand: its arm in each network."""
    columns = (
        "run time", Column("network", words=True), Column("length", "s"), Column("moved", "s"),
        Column("late, median", "ms"), Column("error", "mm"),
    )  # fmt: skip
    tables = []
    for hand, each in found.items():
        rows = [
            (f"{one.begin_s:.1f} to {one.end_s:.1f} s", _network(one), f"{one.end_s - one.begin_s:.1f}",
             f"{one.moved_s:.1f}", one.late_ms, one.rmse_3d_mm)
            for one in each
        ]  # fmt: skip
        tables.append(Table(f"The arm in each network, {hand} hand", columns, rows, _NOTE))
    return tables


def _network(one: Stretch) -> str:
    ways: tuple[Direction, ...] = ("forward", "feedback")
    there, back = (_way(one.delay_ms.get(way), one.loss_pct.get(way), one.beside.get(way, "")) for way in ways)
    return f"{there} each way" if there == back else f"{there} there, {back} back"


def _way(delay_ms: float | None, loss_pct: float | None, beside: str) -> str:
    if loss_pct is None:
        return "not known"
    if loss_pct == 100.0 or delay_ms is None:
        return "stall" if delay_ms is None else "outage"
    lost = f" with {number(loss_pct)} % lost" if loss_pct else ""
    return f"{significant(delay_ms)} ms{lost}" + (f" and {beside}" if beside else "")


def target_table(logs: RunLogs) -> Table:
    """Return the runs at the live page's targets; without rows where none was played to the end."""
    rows = [
        (
            f"{row['at_ns'] / NS_PER_S:.1f} s",
            f"{row['delay_ms']:g} ms",
            _SEEN[row["with_ghost"]],
            f"{row['time_s']:.1f}",
            f"{row['path_mm']:.0f}",
            row["n_misses"],
        )
        for row in logs.of("surgeon", TARGET_RUNS)
    ]
    columns = (
        "ended at", "delay there and back", Column("seen", words=True), Column("time", "s"),
        Column("path of the arm", "mm"), "misses",
    )  # fmt: skip
    return Table("Runs at targets", columns, rows, _TARGETS_NOTE)
