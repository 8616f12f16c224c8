"""The summary's ``orientation_deg``: how far the orientation of the answers is from the recorded arm's."""

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from common.channels import Hand
from common.metrics.orientation import geodesic_deg, orientation_at
from common.metrics.percentiles import Summary, summarise
from common.metrics.tick_phase import Arrivals
from common.records import TRUTH
from common.scenario import Scenario
from deploy.logs.read.load import Ints, RunLogs
from deploy.logs.read.note_columns import notes
from deploy.report.measures.estimation.tracking import Array, HandTrack
from patient_side.statespace import ArmModel

_AT_ONCE: Final = 20_000


def orientation_deg(logs: RunLogs, scenario: Scenario, track: HandTrack, model: ArmModel) -> Summary:
    """Return the geodesic distances over the scored ticks, ``rms`` and percentiles, of one hand's answers.

    No estimator turns the arm: answers carry the orientation of the arm's newest sample, whichever estimator is
    active. Which one that was at a tick follows from the arrivals, its orientation from the surgeon's record. Oracle:
    an arm that turns at constant speed, test_orientation_error.
    """
    error_deg = _errors_deg(logs, scenario, track, model.hand, f"{scenario.session}/{model.arm}/setpoint_cp")
    rms = float(np.sqrt(np.mean(error_deg**2))) if len(error_deg) else None
    return {"rms": rms, **summarise(error_deg)}


def _errors_deg(logs: RunLogs, scenario: Scenario, track: HandTrack, hand: Hand, key: str) -> np.ndarray:
    arrived = logs.messages("patient", "forward", scenario.session).get(key)
    rows = notes(logs, "surgeon", TRUTH)
    rotation_rad = rows.column("rotation_rad")
    known = rows.where("hand", hand) & np.isfinite(rotation_rad).all(axis=1)
    sample_ns, first = np.unique(rows.column("sample_ns")[known], return_index=True)
    if arrived is None or not len(sample_ns):
        return np.empty(0)
    recorded = Rotation.from_rotvec(rotation_rad[known][first]).as_quat()
    del rotation_rad, known
    fresh = Arrivals.of(arrived.log_ns, arrived.sample_ns)
    t_ns = track.t_ns[track.scored]
    newest = np.searchsorted(fresh.recv_ns, t_ns, side="right") - 1
    t_ns, held_ns = t_ns[newest >= 0], fresh.sample_ns[newest[newest >= 0]]
    found = [np.empty(0)]
    for begin in range(0, len(t_ns), _AT_ONCE):  # rotations take much room
        some = slice(begin, begin + _AT_ONCE)
        truth, held = (_orientation_at(ns[some], sample_ns, recorded) for ns in (t_ns, held_ns))
        both = np.isfinite(truth).all(axis=1) & np.isfinite(held).all(axis=1)
        found.append(geodesic_deg(held[both], truth[both]))
    return np.concatenate(found)


def _orientation_at(t_ns: Ints, sample_ns: Ints, quaternion: Array) -> Array:
    """Return what `orientation_at` does, from the samples around ``t_ns`` (T,), T > 0, only."""
    first = max(int(np.searchsorted(sample_ns, t_ns.min(), side="right")) - 2, 0)
    last = int(np.searchsorted(sample_ns, t_ns.max())) + 2
    return orientation_at(t_ns, sample_ns[first:last], quaternion[first:last])
