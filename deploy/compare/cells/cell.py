"""Units of work: a training, and a cell, which is one twin with all estimators side by side.

Both are plain values that can be passed to another process; their results are plain JSON.
"""

import contextlib
import gc
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from tis.common.channels import FOLLOWER, ORIGIN, Hand, Side
from tis.common.runtime.recordings import load_recording, load_training, load_trials
from tis.common.runtime.trace_files import load_traces
from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario
from tis.common.sources.trajectory import Recording
from tis.common.units import NS_PER_S
from tis.deploy.compare.cells.forecasts import forecast_sums, record_forecasts
from tis.deploy.compare.cells.measured import MeasuredEstimator, measure_estimators, measure_methods
from tis.deploy.compare.cells.shared_parts import SharedParts
from tis.deploy.compare.cells.sums import hand_sums, logged_ages_ns, traffic, wrist_sums
from tis.deploy.compare.cells.twins import KeptLog, NoLog, is_plain, run_unlogged
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.report.measures.estimation.tracking import track_of_hand
from tis.deploy.report.verdict.invalidity import why_unscored
from tis.deploy.run.twin import build_sides, drive
from tis.netem.build import build_netem
from tis.patient_side.build import build_patient, identify_models
from tis.patient_side.estimators.guarded import Guarded, check_own
from tis.patient_side.identification.model_io import dump_models
from tis.patient_side.models import factories, own_estimators, read_models
from tis.patient_side.node import PatientNode
from tis.patient_side.provenance import warnings_at_start

# CPU time of identification by estimator, measured while the models of all estimators are identified once.
#
# An estimator alone needs the chosen model and the model beside it that is its own; the parts are measured and added,
# so that no model is identified a second time for its time.

_MODEL_OF: Final = {"paper_as_printed": "paper", "adaptive_kf": "innovations_kf"}
"""Estimators that may share the model fitted for another one."""


class FitTimes:
    """CPU time of the process in the fits for single estimators: networks are trained by several threads."""

    def __init__(self) -> None:
        self.fits_s: defaultdict[str, float] = defaultdict(float)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of the context to the estimator's, also where the fit fails."""
        begun_s = time.process_time()
        try:
            yield
        finally:
            self.fits_s[name] += time.process_time() - begun_s

    def alone_s(self, name: str, all_s: float) -> float:
        """Return the time for one estimator alone, of ``all_s`` that the identification took for all of them."""
        own = name if name in self.fits_s else _MODEL_OF.get(name, name)
        return all_s - sum(self.fits_s.values()) + self.fits_s.get(own, 0.0)


@dataclass(frozen=True)
class Training:
    """Identification of models from the scenario's training data; ``digest`` covers everything that decides them.

    ``timed``: also report the time that the identification would take for each estimator alone. ``trials`` replace
    the scenario's training data.
    """

    digest: str
    label: str
    scenario: Scenario
    timed: bool = False
    trials: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Cell:
    """One twin: a trial under one network and seed.

    ``setting`` is the swept value, None without a sweep; ``trial`` names person and recording, or a synthetic seed.
    The models of a ``training``, in a file, replace the scenario's own training. ``n_ahead``: instead of the
    estimates, forecasts of so many samples after the newest are scored. ``is_summarised``: instead of sums, the
    numbers of the summary of a logged twin are kept.
    """

    digest: str
    setting: str | None
    trial: str
    scenario: Scenario
    training: str | None
    n_ahead: int = 0
    is_summarised: bool = False

    @property
    def label(self) -> str:
        """Return the cell's name in messages."""
        at = "" if self.setting is None else f", {self.setting}"
        return f"{self.trial}, seed {self.scenario.seed}{at}"


def train(training: Training) -> tuple[dict[str, Any], bytes]:
    """Identify the models; return CPU time and warnings, and the content of the model file.

    Raises `DataError`, and `UnusableEstimatorError` when a user-defined estimator does not work with these models.
    """
    scenario = training.scenario
    recording = load_recording(scenario)
    named = training.trials
    trainings = load_training(scenario, recording) if named is None else load_trials(scenario, recording, named)
    own = own_estimators(scenario)
    watch = FitTimes()
    begun_s = time.process_time()
    models = identify_models(scenario, recording, trainings, watch.stage)
    all_s = time.process_time() - begun_s
    check_own(factories(own), models)
    # A user-defined estimator gets all models, and which of them it uses is unknown.
    timed = [name for name in scenario.estimators if name not in own] if training.timed else []
    times_s = {name: watch.alone_s(name, all_s) for name in timed}
    about = {
        "train_s": times_s,
        "process_s": all_s,  # all threads of the process, some of which may do other work
        "n_rows": sum(len(rows) for rows in trainings),
        "models": [
            {"hand": model.hand, "method": model.method, "order": model.order, "static": model.static}
            for model in models
        ],
        "warnings": list(warnings_at_start(scenario, recording, models)),
    }
    return about, dump_models(models)


_PARTS: Final = SharedParts()


def run_cell(cell: Cell, model_file: Path | None) -> dict[str, Any]:
    """Run the twin and return its sums by hand, or the reason why no tick was scored. Raises `DataError`.

    Where the scenario allows it, nothing is logged. With ``n_ahead`` they are the sums of forecasts.
    """
    scenario = cell.scenario if model_file is None else with_models(cell.scenario, model_file)
    recording = _PARTS.recording(scenario)
    if cell.is_summarised:
        from tis.deploy.compare.cells.summary import summary_of_twin  # late: it loads the report

        return {"trial": cell.trial, "summary": summary_of_twin(scenario, recording)}
    if cell.n_ahead:
        return {"trial": cell.trial, "forecasts": _forecasts(scenario, recording, cell.n_ahead)}
    scores = unlogged_scores(scenario, recording) if is_plain(scenario) else None
    if scores is None or scores.unscored is not None:  # the logs say why no tick is scored
        scores = logged_scores(scenario, recording)
    return {
        "trial": cell.trial,
        "seed": scenario.seed,
        "duration_s": scenario.duration_s,
        "traffic": scores.traffic,
        "hands": scores.hands,
        "unscored": scores.unscored,
        "warnings": list(scores.warnings),
        "own_faults": own_faults(scores.watched),
    }


class Scores(NamedTuple):
    """Sums of each hand, the surgeon's traffic, why no tick is scored (None: some are), and measured estimators."""

    hands: dict[Hand, dict[str, Any]]
    traffic: dict[str, int]
    unscored: str | None
    warnings: Sequence[str]
    watched: Sequence[Mapping[str, MeasuredEstimator]]


def unlogged_scores(scenario: Scenario, recording: Recording) -> Scores:
    """Return the scores of a twin that keeps no records."""
    own = factories(own_estimators(scenario))
    models = _PARTS.models(scenario, recording)
    link = build_netem(scenario, load_traces(scenario.network)).links[ORIGIN["forward"]]
    patient = build_patient(scenario, models, recording, own=own, build=_PARTS.estimator)
    watched, turning = measure_estimators(patient), measure_methods(patient)
    samples = _PARTS.samples(scenario, recording)
    with _uncollected():
        found = run_unlogged(scenario, recording, samples, link, patient)
    recorded = {hand.hand: hand for hand in recording.hands}
    hands = {}
    for model, measured, methods in zip(models, watched, turning, strict=True):
        track, part = found.tracks[model.hand], recorded[model.hand]
        hands[model.hand] = hand_sums(track, found.ages_ns[model.hand], model, measured)
        hands[model.hand]["orientation"] = wrist_sums(track, recording, part, methods)
    unscored = None if any(sums["n_scored"] for sums in hands.values()) else "no tick is scored"
    return Scores(hands, found.traffic, unscored, warnings_at_start(scenario, recording, models), watched)


def logged_scores(scenario: Scenario, recording: Recording) -> Scores:
    """Return the scores of a twin with logs in memory."""
    nodes, models, warnings = build_sides(scenario, recording=recording)
    patient = nodes["patient"]
    assert isinstance(patient, PatientNode)
    watched, turning = measure_estimators(patient), measure_methods(patient)
    memories: dict[Side, KeptLog] = {side: KeptLog(side) for side in nodes}
    with _uncollected():
        drive(scenario, nodes, memories)
    logs = RunLogs(Path(), {side: memory.log for side, memory in memories.items()})
    hands, recorded = {}, {hand.hand: hand for hand in recording.hands}
    for model, measured, methods in zip(models, watched, turning, strict=True):
        track = track_of_hand(logs, scenario, model.hand)
        hands[model.hand] = hand_sums(track, logged_ages_ns(logs, model.hand, track.t_ns), model, measured)
        hands[model.hand]["orientation"] = wrist_sums(track, recording, recorded[model.hand], methods)
    unscored = None if any(sums["n_scored"] for sums in hands.values()) else why_unscored(logs, scenario)
    return Scores(hands, traffic(logs), unscored, warnings, watched)


def _forecasts(scenario: Scenario, recording: Recording, n_ahead: int) -> dict[str, dict[str, Any]]:
    """Return the sums of the forecasts of so many samples after the newest."""
    nodes, _, _ = build_sides(scenario, recording=recording)
    patient = nodes["patient"]
    assert isinstance(patient, PatientNode)
    measure_estimators(patient)
    recorders = record_forecasts(patient, n_ahead)
    with _uncollected():
        drive(scenario, nodes, {side: NoLog() for side in nodes})
    return forecast_sums(recording, recorders)


@contextlib.contextmanager
def _uncollected() -> Iterator[None]:
    """Collect no garbage, as in a live run: collections must not count as time of a step."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def own_faults(watched: Sequence[Mapping[str, MeasuredEstimator]]) -> dict[str, dict[str, Any]]:
    """Return failed steps, all steps and the first failure of each user-defined estimator that failed."""
    found: dict[str, dict[str, Any]] = {}
    for measured in watched:
        for name, estimator in measured.items():
            guarded = estimator.inner
            if isinstance(guarded, Guarded) and guarded.first is not None:
                t_ns, reason = guarded.first
                entry = found.setdefault(
                    name, {"n_faults": 0, "n_steps": 0, "first": f"{t_ns / NS_PER_S:.3f} s: {reason}"}
                )
                entry["n_faults"] += guarded.n_faults
                entry["n_steps"] += guarded.n_steps
    return found


def with_models(scenario: Scenario, model_file: Path) -> Scenario:
    """Return the scenario with its training replaced by a file of models.

    The other results of the training, first row and pairing, become explicit.
    """
    identification, source = scenario.identification, scenario.source
    changes: dict[str, Any] = {"start": first_row(scenario)}
    if source.kind == "jigsaws":
        crossed = all(model.arm == FOLLOWER[model.hand] for model in read_models(model_file))
        changes["pairing"] = "cross" if crossed else "same_name"
    raw = scenario.model_dump(mode="json", exclude_none=True)
    raw["source"] |= changes
    raw["identification"] = {"train": str(model_file)}  # the other fields describe how the models were found
    assert identification.train in ("own_head", "others")
    return build_scenario(raw, scenario.name)


def first_row(scenario: Scenario) -> int:
    """Return the row that becomes sample 0, by the rule of `load_recording`."""
    start, identification = scenario.source.start, scenario.identification
    if start == "auto":
        return identification.train_samples if identification.train == "own_head" else 0
    return start
