"""The summary's ``orientation_deg``: orientation error of the estimates against the recorded arm."""

from typing import Final

import numpy as np
import scipy

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

_BATCH: Final = 20_000


def orientation_deg(logs: RunLogs, scenario: Scenario, track: HandTrack, model: ArmModel) -> Summary:
    """Return RMS and percentiles of the geodesic distance over one hand's scored ticks, in degrees.

    Estimators do not predict orientation: every estimate carries that of the arm's newest sample. The arrivals tell
    which sample that was, the surgeon's log its orientation. Oracle: an arm that turns at constant speed,
    test_orientation_error.
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
    recorded = scipy.spatial.transform.Rotation.from_rotvec(rotation_rad[known][first]).as_quat()
    del rotation_rad, known
    # the newest sample at each scored tick, by arrival
    fresh = Arrivals.of(arrived.log_ns, arrived.sample_ns)
    t_ns = track.t_ns[track.scored]
    newest = np.searchsorted(fresh.recv_ns, t_ns, side="right") - 1
    t_ns, held_ns = t_ns[newest >= 0], fresh.sample_ns[newest[newest >= 0]]
    found = [np.empty(0)]
    for begin in range(0, len(t_ns), _BATCH):  # rotations take much memory
        some = slice(begin, begin + _BATCH)
        truth, held = (_orientation_at(ns[some], sample_ns, recorded) for ns in (t_ns, held_ns))
        both = np.isfinite(truth).all(axis=1) & np.isfinite(held).all(axis=1)
        found.append(geodesic_deg(held[both], truth[both]))
    return np.concatenate(found)


def _orientation_at(t_ns: Ints, sample_ns: Ints, quaternion: Array) -> Array:
    """Return `orientation_at` of ``t_ns`` (T,), T > 0, from the samples around it only, which is faster."""
    first = max(int(np.searchsorted(sample_ns, t_ns.min(), side="right")) - 2, 0)
    last = int(np.searchsorted(sample_ns, t_ns.max())) + 2
    return orientation_at(t_ns, sample_ns[first:last], quaternion[first:last])
