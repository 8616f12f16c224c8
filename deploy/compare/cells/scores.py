"""Scores of one twin, without logs where nothing that they need depends on it, otherwise with logs in memory."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import ORIGIN, Hand, Side, is_shown_force
from tis.common.node import Record
from tis.common.records import CONTACTS, COUNTERS, ESTIMATES, FRESH, PLANT, SENT_BYTES, SENT_PACKETS, TICKS, TRUTH
from tis.common.runtime.memory import without_collector
from tis.common.runtime.scenario_files import load_traces
from tis.common.scenario import Scenario
from tis.common.sight_records import CAMERA, SCREEN
from tis.common.sources.trajectory import Recording
from tis.common.units import NS_PER_S
from tis.deploy.compare.cells.measured import MeasuredEstimator, measure_estimators, measure_methods
from tis.deploy.compare.cells.shared_parts import SharedParts
from tis.deploy.compare.cells.sums import hand_sums, histogram, wrist_sums
from tis.deploy.compare.cells.unlogged import Scored, is_plain, run_unlogged
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.logs.read.side_log import MemoryLog
from tis.deploy.report.subjects.intrusion import quarantine_texts
from tis.deploy.report.subjects.pictures import Pictures
from tis.deploy.report.subjects.touch import felt_extremes, shown_forces, stability
from tis.deploy.report.subjects.tracking import track_of_hand
from tis.deploy.report.validity import MAX_UNUSED, why_unscored
from tis.deploy.run.twin import build_sides, drive
from tis.netem.build import build_netem
from tis.patient_side.build import build_patient
from tis.patient_side.estimators.guarded import Guarded
from tis.patient_side.models import factories, own_estimators
from tis.patient_side.node import PatientNode
from tis.patient_side.provenance import warnings_at_start
from tis.patient_side.statespace import ArmModel

PARTS: Final = SharedParts()
_KEPT: Final = (CAMERA, CONTACTS, COUNTERS, FRESH, PLANT, SCREEN, TICKS, TRUTH)


class Scores(NamedTuple):
    """Sums of each hand, the surgeon's traffic, why no tick is scored (None: some are), and measured estimators."""

    hands: dict[Hand, dict[str, Any]]
    traffic: dict[str, int]
    unscored: str | None
    warnings: Sequence[str]
    watched: Sequence[Mapping[str, MeasuredEstimator]]
    seen: Mapping[str, Any] | None = None
    """What the surgeon saw, as sums; None without sight."""
    felt: Sequence[Mapping[str, Any]] = ()
    """What each hand felt; empty without touch."""


def scores_of_twin(scenario: Scenario, recording: Recording) -> Scores:
    """Return the scores of a twin. Where nothing is scored it is a logged one, whose logs say why."""
    scores = unlogged_scores(scenario, recording) if is_plain(scenario) else None
    return logged_scores(scenario, recording) if scores is None or scores.unscored is not None else scores


def unlogged_scores(scenario: Scenario, recording: Recording) -> Scores:
    """Return the scores of a twin that keeps no records."""
    own = factories(own_estimators(scenario))
    models = PARTS.models(scenario, recording)
    link = build_netem(scenario, load_traces(scenario.network)).links[ORIGIN["forward"]]
    patient = build_patient(scenario, models, recording, own=own, build=PARTS.estimator)
    watch = _Watch(recording, models, patient)
    samples = PARTS.samples(scenario, recording)
    with without_collector():  # as in a live run: collections must not count as time of a step
        found = run_unlogged(scenario, recording, samples, link, patient)
    hands = watch.sums(found.scored)
    unscored = _unused(patient, found.traffic) or (None if _is_scored(hands) else "no tick is scored")
    warnings = (*warnings_at_start(scenario, recording, models), *_few_unused(patient, recording, found.traffic))
    return Scores(hands, found.traffic, unscored, warnings, watch.estimators)


def logged_scores(scenario: Scenario, recording: Recording) -> Scores:
    """Return the scores of a twin with logs in memory."""
    nodes, models, warnings = build_sides(scenario, recording=recording)
    patient = nodes["patient"]
    assert isinstance(patient, PatientNode)
    watch = _Watch(recording, models, patient)
    memories: dict[Side, KeptLog] = {side: KeptLog(side) for side in nodes}
    drive(scenario, nodes, memories)
    logs = RunLogs(Path(), {side: memory.log for side, memory in memories.items()})
    tracks = {model.hand: track_of_hand(logs, scenario, model.hand) for model in models}
    hands = watch.sums({hand: Scored(track, _ages_ns(logs, hand, track.t_ns)) for hand, track in tracks.items()})
    traffic = _traffic(logs)
    unscored = _unused(patient, traffic) or (None if _is_scored(hands) else why_unscored(logs, scenario))
    warnings = (*warnings, *_few_unused(patient, recording, traffic))
    felt = [_felt(logs, scenario, hand) for hand in hands] if scenario.touch else []
    told = [one for one in felt if one is not None]
    return Scores(hands, traffic, unscored, warnings, watch.estimators, _seen(logs, scenario), told)


def _seen(logs: RunLogs, scenario: Scenario) -> dict[str, Any] | None:
    """Return the sums of what the surgeon saw; None without sight."""
    found = Pictures.of(logs, scenario)
    if found is None:
        return None
    frozen = found.freezes
    return {
        "hand_to_eye_ns": histogram(found.hand_to_eye_ns),
        "n_frames": len(found.camera),
        "n_whole": int(np.count_nonzero(found.states == "complete")),
        "n_freezes": len(frozen.lasted_ns),
        "frozen_ns": int(frozen.lasted_ns.sum()),
        "watched_ns": frozen.watched_ns,
    }


def _felt(logs: RunLogs, scenario: Scenario, hand: Hand) -> dict[str, Any] | None:
    """Return what a hand felt; None where nothing was shown to it."""
    shown, (forces_n, energies_mj) = shown_forces(logs, hand), felt_extremes(logs, {hand: None})
    if shown is None or not len(forces_n):
        return None
    return {
        "stability": stability(shown, scenario.rate_hz),
        "peak_force_n": float(forces_n.max()),
        "energy_mj": float(energies_mj.max(initial=0.0)),
    }


class _Watch:
    """The estimators and orientation methods of a patient, measured, and the sums of what they did."""

    def __init__(self, recording: Recording, models: Sequence[ArmModel], patient: PatientNode) -> None:
        self._recording, self._models = recording, models
        self.estimators, self._methods = measure_estimators(patient), measure_methods(patient)

    def sums(self, scored: Mapping[Hand, Scored]) -> dict[Hand, dict[str, Any]]:
        """Return the sums of each hand; an estimator that failed at every scored tick has none."""
        recorded = {hand.hand: hand for hand in self._recording.hands}
        found = {}
        for model, estimators, methods in zip(self._models, self.estimators, self._methods, strict=True):
            hand = model.hand
            track, ages_ns = scored[hand]
            turned = wrist_sums(track, self._recording, recorded[hand], methods)
            found[hand] = {**hand_sums(track, ages_ns, model, estimators), "orientation": turned}
            for name, estimator in estimators.items():
                n_missing = found[hand]["estimators"][name]["n_missing"]
                failed = isinstance(estimator.inner, Guarded) and estimator.inner.first is not None
                if failed and 0 < n_missing == found[hand]["n_scored"]:
                    del found[hand]["estimators"][name]
        return found


class KeptLog(MemoryLog):
    """Keeps estimates, truth, ticks and counters, and the first message of each key, which begins the scoring.

    Of touch and sight it keeps contacts, the forces shown, and the notes of camera and screen.

    With several copies of each sample the packets' records would be most of a run's memory.
    """

    def __init__(self, side: Side) -> None:
        super().__init__(side)
        self._begun: set[str] = set()

    def record(self, record: Record) -> None:
        """Keep or drop a record."""
        topic = record.topic
        is_message = not topic.startswith("/")
        is_kept = topic in _KEPT or topic.startswith(ESTIMATES) or is_shown_force(topic)
        if is_kept or (is_message and topic not in self._begun):
            super().record(record)
        if is_message:
            self._begun.add(topic)


def _is_scored(hands: Mapping[Hand, Mapping[str, Any]]) -> bool:
    return any(sums["n_scored"] for sums in hands.values())


def _unused(patient: PatientNode, traffic: Mapping[str, int]) -> str | None:
    """Return why a twin is no measurement whose patient did not use more than 1 % of the samples; None if it did."""
    found = patient.gated.n_quarantined
    if found.total() <= MAX_UNUSED * traffic[SENT_PACKETS]:
        return None
    return quarantine_texts({str(kind): n for kind, n in found.items()})[0]


def _few_unused(patient: PatientNode, recording: Recording, traffic: Mapping[str, int]) -> list[str]:
    """Return a warning of the samples that the patient did not use; in other delays it differs in numbers alone."""
    n, n_sent = patient.gated.n_quarantined.total(), traffic[SENT_PACKETS]
    if not n or n > MAX_UNUSED * n_sent:
        return []
    text = f"{recording.label}: the patient did not use {n} of {n_sent} samples, as beyond what its arm can do"
    return [f"{text}: if they are right, raise the limits of patient.gate (tis twin says which)"]


def _traffic(logs: RunLogs) -> dict[str, int]:
    """Return packets and bytes sent by the surgeon's side, all keys together."""
    counts = {row["name"]: row["value"] for row in logs.of("surgeon", COUNTERS)}
    return {
        what: sum(value for name, value in counts.items() if name.startswith(f"{what}."))
        for what in (SENT_PACKETS, SENT_BYTES)
    }


def _ages_ns(logs: RunLogs, hand: Hand, t_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the age at each tick (T,): its instant minus that of the freshest sample; 0 before the first."""
    fresh = [row for row in logs.of("patient", FRESH) if row["hand"] == hand]
    ticks = np.array([row["tick"] for row in fresh], dtype=np.int64)
    sample_ns = np.array([row["sample_ns"] for row in fresh], dtype=np.int64)
    latest = np.searchsorted(ticks, np.arange(len(t_ns)), side="right") - 1
    return np.where(latest >= 0, t_ns - np.append(sample_ns, 0)[latest], 0)


def own_faults(watched: Sequence[Mapping[str, MeasuredEstimator]]) -> dict[str, dict[str, Any]]:
    """Return failed steps, all steps and the first failure of each user-defined estimator that failed."""
    found: dict[str, dict[str, Any]] = {}
    for measured in watched:
        for name, estimator in measured.items():
            guarded = estimator.inner
            if isinstance(guarded, Guarded) and guarded.first is not None:
                t_ns, reason = guarded.first
                first = f"{t_ns / NS_PER_S:.3f} s: {reason}"
                entry = found.setdefault(name, {"n_faults": 0, "n_steps": 0, "first": first})
                entry["n_faults"] += guarded.n_faults
                entry["n_steps"] += guarded.n_steps
    return found


def summary_of_twin(scenario: Scenario, recording: Recording) -> dict[str, float | None]:
    """Run a twin with logs in memory; return the numbers of its summary.

    Oracle: the figures of a cell's sums, tests/deploy/studies/admissible/test_figures.
    """
    from tis.deploy.report.summarise import build_summary  # late: it loads the report

    nodes, models, _ = build_sides(scenario, recording=recording)
    memories: dict[Side, MemoryLog] = {side: MemoryLog(side) for side in nodes}
    drive(scenario, nodes, memories)
    logs = RunLogs(Path(), {side: memory.log for side, memory in memories.items()})
    return flat(build_summary(logs, scenario, models, "twin", None, ""))


def flat(tree: Any, path: str = "") -> dict[str, float | None]:
    """Return the numbers of a summary by their dotted paths, truth values as 0 and 1; None is an unknown one."""
    if tree is None or isinstance(tree, bool | int | float):
        return {path: None if tree is None else float(tree)}
    if isinstance(tree, dict):
        items: Iterable[tuple[str, Any]] = ((str(name), below) for name, below in tree.items())
    elif isinstance(tree, list | tuple):
        items = ((str(i), below) for i, below in enumerate(tree))
    else:
        return {}
    return {
        name: value
        for step, below in items
        for name, value in flat(below, f"{path}.{step}" if path else step).items()
    }
