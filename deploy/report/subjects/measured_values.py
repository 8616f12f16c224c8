"""Values of a run that requirements are checked against, by metric and direction."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple, Self, get_args

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import VIDEO, Direction
from tis.common.metrics.delay_variation import packet_delay_variation_ns
from tis.common.metrics.latency import Instants, LatencyParts
from tis.common.scenario import Scenario
from tis.common.scenario.limits import Metric
from tis.common.units import MM_PER_M, NS_PER_MS
from tis.deploy.logs.read.columns import Ints, joined
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.subjects.clocks import worst_age_ns
from tis.deploy.report.subjects.latency import UsedSamples
from tis.deploy.report.subjects.logs import LogGaps
from tis.deploy.report.subjects.network.link_ends import ENDS, all_arrivals, both_ends, refused_arrivals
from tis.deploy.report.subjects.requirements import Measured
from tis.deploy.report.subjects.touch import felt_extremes
from tis.deploy.report.subjects.tracking import HandTrack


class OneWay(NamedTuple):
    """The one-way columns of all keys of a direction but that of the picture, which has figures of its own.

    Of the A messages that arrived, key by key in order of sending: ``sent_ns`` (A,) is the instant of sending,
    ``one_way_ns`` (A,) the one-way delay from the call that sends to the stamp of the first arrival (RFC 7679), and
    ``pdv_ns`` (A,) its excess over the smallest delay of the key (RFC 5481). ``lost`` (N,) marks, of the N messages
    sent, in order of sending, those that had not arrived by the end of the drain (RFC 7680).
    """

    sent_ns: Ints
    one_way_ns: Ints
    pdv_ns: Ints
    lost: NDArray[np.bool_]

    @classmethod
    def of(cls, logs: RunLogs, direction: Direction, session: str) -> Self | None:
        """Return one direction's columns; None where a log is missing (oracle: a few messages, test_one_way).

        Messages in the gaps of damaged logs are left out (`LogGaps`). What the receiver's gate refused arrived.
        """
        sender, receiver = ENDS[direction]
        if logs.coverage(sender) is None or logs.coverage(receiver) is None:
            return None
        gaps = LogGaps.of(logs, direction, session, (sender, receiver))
        refused = refused_arrivals(logs, direction, session)
        left_ns, delays_ns, variations_ns, lost, sent_ns = [], [], [], [], []
        for key, (out, back) in both_ends(logs, direction, session).items():
            if key == VIDEO.key(session):
                continue
            logged = out.at(~gaps.affect(out.sent_ns))
            # duplicates: the first arrival counts (RFC 7679)
            arrived = all_arrivals(out, back, refused.get(key)).first_of_each("seq")
            arrived = arrived.at(np.isin(arrived.seq, logged.seq))
            left_ns.append(arrived.sent_ns)
            delays_ns.append(arrived.log_ns - arrived.sent_ns)
            variations_ns.append(packet_delay_variation_ns(delays_ns[-1]))
            lost.append(~np.isin(logged.seq, arrived.seq))
            sent_ns.append(logged.sent_ns)
        # losses of all keys in order of sending, as bursts hit all keys at once
        order = np.argsort(joined(sent_ns), kind="stable")
        return cls(joined(left_ns), joined(delays_ns), joined(variations_ns), joined(lost, np.bool_)[order])


def measured_values(
    logs: RunLogs,
    scenario: Scenario,
    used: UsedSamples,
    parts: LatencyParts,
    durations_ns: Mapping[Metric, Instants],
    tracks: list[HandTrack],
    samples_lost: str | None = None,
) -> dict[tuple[Metric, Direction | None], Measured]:
    """Return the measured values; a metric without any is left out.

    ``durations_ns`` holds the durations without a clock offset, and the age. Loss counts the packets of a link;
    ``samples_lost`` is a remark on the samples that never arrived where packets repeat them. Oracle: a run written by
    hand, test_requirements.
    """
    found: dict[tuple[Metric, Direction | None], Measured] = {}
    for direction in get_args(Direction):
        one_way = OneWay.of(logs, direction, scenario.session)
        if one_way is None:
            continue
        begin, end = ENDS[direction]
        arrived_ns = one_way.sent_ns + one_way.one_way_ns
        error_ns = logs.clocks.uncertainty_ns(begin, one_way.sent_ns, end, arrived_ns)
        found["one_way", direction] = _between(one_way.one_way_ns, error_ns)
        # a difference of two one-way delays, each with its own clock error
        both_ns = None if error_ns is None else error_ns + error_ns.max(initial=0)
        found["pdv", direction] = _between(one_way.pdv_ns, both_ns)
        found["loss", direction] = Measured(one_way.lost)
    if samples_lost is not None and ("loss", "forward") in found:
        aside = f"judged by packets ({samples_lost})"
        found["loss", "forward"] = replace(found["loss", "forward"], aside=aside)
    error_ns = logs.clocks.uncertainty_ns("surgeon", used.sample_ns, "patient", used.published_ns)
    found["end_to_end", None] = _between(parts.end_to_end, error_ns)
    for metric, values_ns in durations_ns.items():
        found[metric, None] = Measured(values_ns / NS_PER_MS)
    worst_ns, ages_ns = worst_age_ns(logs), durations_ns["age"]
    found["age", None] = _between(ages_ns, None if worst_ns is None else np.full_like(ages_ns, worst_ns))
    errors = [_errors_mm(track, scenario.active_estimator) for track in tracks]
    found["rmse_3d", None] = Measured(joined(errors, np.float64))
    if scenario.touch is not None:
        forces_n, energies_mj = felt_extremes(logs, dict.fromkeys(scenario.source.hands))
        found["contact", None], found["energy", None] = Measured(forces_n), Measured(energies_mj)
    return found


def _between(values_ns: Instants, error_ns: Instants | None) -> Measured:
    """Return durations between two clocks; their error is unbounded when one of the clocks is unknown."""
    return Measured(values_ns / NS_PER_MS, np.inf if error_ns is None else error_ns / NS_PER_MS)


def _errors_mm(track: HandTrack, name: str) -> NDArray[np.float64]:
    """Return the distance to the truth at each scored tick; a missing estimate scores as hold's."""
    if name not in track.estimates:
        return np.empty(0)
    estimate_m, hold_m = track.estimates[name], track.estimates["hold"]
    # NaN in any axis makes the sum NaN
    missing = np.isnan(estimate_m.sum(axis=1))
    errors_m = (np.where(missing[:, None], hold_m, estimate_m) - track.truth_m)[track.scored]
    return np.asarray(np.linalg.norm(errors_m, axis=1) * MM_PER_M)
