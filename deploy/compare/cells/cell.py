"""Units of work: a training, and a cell, which is one twin with all estimators side by side.

Both are plain values that can be passed to another process; their results are plain JSON.
"""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tis.common.channels import FOLLOWER
from tis.common.estimators import ESTIMATORS, short_name
from tis.common.runtime.recordings import load_recording, load_training, load_trials
from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario
from tis.deploy.compare.cells.forecasts import forecasts_of_twin
from tis.deploy.compare.cells.scores import PARTS, own_faults, scores_of_twin, summary_of_twin
from tis.patient_side.build import identify_models
from tis.patient_side.estimators.guarded import check_own
from tis.patient_side.identification.model_file import dump_models
from tis.patient_side.models import factories, own_estimators, read_models
from tis.patient_side.provenance import warnings_at_start


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


class FitTimes:
    """CPU time of the process in the fits for single estimators: networks are trained by several threads.

    The models of all estimators are identified once. An estimator alone needs the chosen model and the one beside it
    that is its own, so the parts are measured and added, and no model is identified a second time for its time.
    """

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
        name = short_name(name)
        row = ESTIMATORS.get(name)
        own = name if name in self.fits_s or row is None else row.fitted_with or name
        return all_s - sum(self.fits_s.values()) + self.fits_s.get(own, 0.0)


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
    about = {
        "train_s": {name: watch.alone_s(name, all_s) for name in timed},
        "process_s": all_s,  # all threads of the process, some of which may do other work
        "n_rows": sum(len(rows) for rows in trainings),
        "models": [
            {"hand": model.hand, "method": model.method, "order": model.order, "static": model.static}
            for model in models
        ],
        "warnings": list(warnings_at_start(scenario, recording, models)),
    }
    return about, dump_models(models)


def run_cell(cell: Cell, model_file: Path | None) -> dict[str, Any]:
    """Run the twin and return its sums by hand, or the reason why no tick was scored. Raises `DataError`.

    Where the scenario allows it, nothing is logged. With ``n_ahead`` they are the sums of forecasts.
    """
    scenario = cell.scenario if model_file is None else with_models(cell.scenario, model_file)
    recording = PARTS.recording(scenario)
    if cell.is_summarised:
        return {"trial": cell.trial, "summary": summary_of_twin(scenario, recording)}
    if cell.n_ahead:
        return {"trial": cell.trial, "forecasts": forecasts_of_twin(scenario, recording, cell.n_ahead)}
    scores = scores_of_twin(scenario, recording)
    return {
        "trial": cell.trial,
        "seed": scenario.seed,
        "duration_s": scenario.duration_s,
        "traffic": scores.traffic,
        "hands": scores.hands,
        "unscored": scores.unscored,
        "warnings": list(scores.warnings),
        "own_faults": own_faults(scores.watched),
        "seen": scores.seen,
        "felt": list(scores.felt),
    }


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
