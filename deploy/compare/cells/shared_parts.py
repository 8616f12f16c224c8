"""Parts that the cells of one process share, as most cells differ in the network alone.

These are recordings with their samples as messages, models, and estimators, whose instances keep only caches that
change no result: the time of a step may be less in a later cell.
The least recently used ones are dropped. A user-defined estimator may keep anything, so each cell builds its own.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any, Final

from tis.common.runtime.recordings import load_recording, own_trial, trial_file
from tis.common.scenario import Scenario
from tis.common.scenario.estimator_names import is_built_in
from tis.common.scenario.identification import is_model_file
from tis.common.scenario.source import RecordedSource
from tis.common.sources.trajectory import Recording
from tis.patient_side.build import choose_models
from tis.patient_side.estimators.guarded import Factories, build_any
from tis.patient_side.estimators.protocol import Estimator
from tis.patient_side.models import models_for, read_models
from tis.patient_side.statespace import ArmModel
from tis.surgeon_side.build import sensor_noise
from tis.surgeon_side.motion import RecordedMotion, SampleMessage, Samples

_N_KEPT: Final = 8
_N_SAMPLES_KEPT: Final = 2
_MAX_MESSAGES: Final = 40_000
"""Messages of a recording up to which they are kept: some 60 MB."""
_MAX_RATE_HZ: Final = 100
"""Rate up to which estimators are kept: their tables grow with it."""


_MOST: Final = {"recording": _N_KEPT, "samples": _N_SAMPLES_KEPT, "models": _N_KEPT, "estimators": 4 * _N_KEPT}


class SharedParts:
    """Recordings, messages, models and estimators by what decides them."""

    def __init__(self) -> None:
        self._kept: dict[str, OrderedDict[Hashable, Any]] = {}

    def recording(self, scenario: Scenario) -> Recording:
        """Return the scenario's recording, as `load_recording` does; raises `DataError`."""
        found: Recording = self._get("recording", _recording_key(scenario), lambda: load_recording(scenario))
        return found

    def samples(self, scenario: Scenario, recording: Recording) -> Callable[[int], list[SampleMessage]]:
        """Return a function that returns the messages of sample 0, 1, ...: each once, in order."""
        history = scenario.surgeon.history

        def taken() -> Callable[[int], list[SampleMessage]]:
            motion = RecordedMotion(recording)
            samples = Samples(scenario.session, motion.channels, scenario.rate_hz, history, sensor_noise(scenario))
            return lambda k: samples.take(k, motion.poses(k))

        def made() -> list[list[SampleMessage]]:
            return list(map(taken(), range(scenario.n_samples)))

        if 2 * len(recording.hands) * scenario.n_samples * (1 + history) > _MAX_MESSAGES:
            return taken()
        noise = (scenario.surgeon.sensor_noise_mm, scenario.seed)
        key = (scenario.session, history, noise, _recording_key(scenario))
        kept: list[list[SampleMessage]] = self._get("samples", key, made)
        return kept.__getitem__

    def models(self, scenario: Scenario, recording: Recording) -> tuple[ArmModel, ...]:
        """Return the models of the scenario's model file, as `models_for` does; raises `DataError`."""
        train = scenario.identification.train
        if not is_model_file(train):
            return models_for(scenario, recording)
        read = self._get("models", _file_key(Path(train)), lambda: read_models(Path(train)))
        return choose_models(scenario, read, train, recording)

    def estimator(self, name: str, model: ArmModel, own: Factories) -> Estimator:
        """Return the estimator for a model, as `build_any` does."""
        if not is_built_in(name) or model.rate_hz > _MAX_RATE_HZ:
            return build_any(name, model, own)
        # The kept model cannot become another one with the same id.
        found: tuple[ArmModel, Estimator] = self._get(
            "estimators", (name, id(model)), lambda: (model, build_any(name, model, own))
        )
        return found[1]

    def _get(self, kind: str, key: Hashable, make: Callable[[], Any]) -> Any:
        kept = self._kept.setdefault(kind, OrderedDict())
        if key in kept:
            kept.move_to_end(key)
            return kept[key]
        made = kept[key] = make()
        if len(kept) > _MOST[kind]:
            kept.popitem(last=False)
        return made


def _recording_key(scenario: Scenario) -> Hashable:
    source = scenario.source
    file = _file_key(trial_file(source, own_trial(source))) if isinstance(source, RecordedSource) else None
    deciding = (source.model_dump_json(), scenario.identification.model_dump_json(exclude={"train"}))
    looks = scenario.identification.train if not is_model_file(scenario.identification.train) else ""
    return (*deciding, looks, scenario.rate_hz, scenario.n_samples, scenario.seed, file)


def _file_key(file: Path) -> Hashable:
    try:
        found = file.stat()
    except OSError:  # reading it will say why
        return str(file), 0, 0
    return str(file), found.st_mtime_ns, found.st_size
