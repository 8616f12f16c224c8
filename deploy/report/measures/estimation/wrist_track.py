"""Errors of the orientation methods against the recorded arm, on the ticks of a hand's track."""

from dataclasses import dataclass

import numpy as np
import scipy

from tis.common.channels import Hand
from tis.common.metrics.tracking import error_vectors, orientation_at
from tis.common.records import ORIENTATIONS, TRUTH
from tis.common.scenario import Scenario
from tis.deploy.logs.read.load import Ints, RunLogs
from tis.deploy.logs.read.note_columns import notes
from tis.deploy.report.measures.estimation.tracking import Array, HandTrack, at_ticks


@dataclass(frozen=True)
class WristTrack:
    """Errors of one hand's orientation methods by tick (T,) of its `HandTrack`, in the scenario's order.

    ``turn_rad`` (T, 3) are rotation vectors from estimate to truth in the body frame of the estimate, in rad;
    ``gripper_rad`` (T, 1) are errors of the gripper's angle. ``turn_std_rad`` and ``gripper_std_rad`` are the
    standard deviations that methods state. NaN for none. Empty for runs from before orientations were estimated.
    """

    turn_rad: dict[str, Array]
    gripper_rad: dict[str, Array]
    turn_std_rad: dict[str, Array]
    gripper_std_rad: dict[str, Array]


def wrist_track(logs: RunLogs, scenario: Scenario, track: HandTrack, hand: Hand) -> WristTrack:
    """Return the errors of one hand's orientation methods as far as its logs reach."""
    sample_ns, recorded, recorded_rad = _truth(logs, hand)
    truth = orientation_at(track.t_ns, sample_ns, recorded)
    truth_rad = np.full(len(track.t_ns), np.nan)
    if len(sample_ns):
        truth_rad = np.interp(track.t_ns, sample_ns, recorded_rad, left=np.nan, right=np.nan)
    # where the logs do not know the position's truth, the orientation's is not known either
    unknown = ~np.isfinite(track.truth_m).all(axis=1)
    truth[unknown], truth_rad[unknown] = np.nan, np.nan
    found = WristTrack({}, {}, {}, {})
    for name in methods_of(logs, scenario):
        rows = notes(logs, "patient", topic_of(name))
        ours = rows.where("hand", hand)
        ticks = rows.column("tick")[ours]

        def at(field: str, rows=rows, ours=ours, ticks=ticks) -> Array:  # type: ignore[no-untyped-def]
            return at_ticks(track.tick, ticks, rows.column(field)[ours])

        found.turn_rad[name] = error_vectors(at("orientation"), truth)
        found.gripper_rad[name] = (truth_rad - at("gripper_rad"))[:, None]
        found.turn_std_rad[name] = at("std_rad")
        found.gripper_std_rad[name] = at("gripper_std_rad")[:, None]
    return found


def topic_of(method: str) -> str:
    """Return the topic of a method's estimates in the patient's log."""
    return f"{ORIENTATIONS}/{method}"


def methods_of(logs: RunLogs, scenario: Scenario) -> list[str]:
    """Return the orientation methods in the patient's log, the scenario's first."""
    log, prefix = logs.sides.get("patient"), f"{ORIENTATIONS}/"
    topics = () if log is None else sorted(log.rows)
    logged = [topic.removeprefix(prefix) for topic in topics if topic.startswith(prefix)]
    requested = [name for name in scenario.patient.orientation.methods if name in logged]
    return requested + [name for name in logged if name not in requested]


def _truth(logs: RunLogs, hand: Hand) -> tuple[Ints, Array, Array]:
    """Return sample instants (N,), ascending, unit quaternions (N, 4) and gripper angles (N,) of the recorded arm."""
    rows = notes(logs, "surgeon", TRUTH)
    rotation_rad = rows.column("rotation_rad")
    known = rows.where("hand", hand) & np.isfinite(rotation_rad).all(axis=1)
    # a surgeon that came back logs the samples before its return again
    sample_ns, first = np.unique(rows.column("sample_ns")[known], return_index=True)
    if not len(sample_ns):
        return sample_ns, np.empty((0, 4)), np.empty(0)
    recorded = scipy.spatial.transform.Rotation.from_rotvec(rotation_rad[known][first]).as_quat()
    return sample_ns, recorded, rows.column("gripper_rad")[known][first]
