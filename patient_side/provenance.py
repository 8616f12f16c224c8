"""Provenance of a run's data and models: the warnings about their origin, before the run and in its summary."""

from collections.abc import Sequence
from typing import Final

from tis.common.estimators import ESTIMATORS, short_name, users_of_fit
from tis.common.scenario import Scenario
from tis.common.scenario.identification import Identification, is_model_file
from tis.common.sources.provenance import RecordedRows, played_rows
from tis.common.sources.trajectory import Recording
from tis.patient_side.statespace import ArmModel

_NO_MODEL: Final = "no model for "
"""Beginning of a model's warning that it serves an estimator not, or an orientation method, which it names."""
IN_SAMPLE: Final = "in sample"
"""Beginning of a warning that a model is scored on its own training rows."""


def warnings_at_start(scenario: Scenario, recording: Recording, models: Sequence[ArmModel]) -> tuple[str, ...]:
    """Return the warnings before a run, each once: about recording, models and settings without effect."""
    played = played_rows(recording, scenario.n_samples)
    of_models = (text for model in models for text in model.warnings if _concerns(text, scenario))
    warnings = (*recording.warnings, *recording.anomalies, *of_models, *in_sample(scenario, models, played))
    warnings += _held_orientations(scenario, models)
    return tuple(dict.fromkeys((*warnings, *without_effect(scenario.identification, models))))


def _concerns(text: str, scenario: Scenario) -> bool:
    """Tell whether a model's warning concerns a run: not where it is of an estimator that nobody asked for."""
    name, colon, _ = text.removeprefix(_NO_MODEL).partition(": ")
    if not text.startswith(_NO_MODEL) or not colon or name not in ESTIMATORS:
        return True
    return not {*map(short_name, scenario.estimators)}.isdisjoint(users_of_fit(ESTIMATORS[name].fitted_with or name))


def models_lacking(models: Sequence[ArmModel]) -> list[str]:
    """Return the estimators, each once, for which the training rows allow no model."""
    texts = (text for model in models for text in model.warnings if text.startswith(_NO_MODEL))
    return list(dict.fromkeys(text.removeprefix(_NO_MODEL).partition(": ")[0] for text in texts))


def _held_orientations(scenario: Scenario, models: Sequence[ArmModel]) -> tuple[str, ...]:
    """Return a warning for each model of a file, as an older one's, without the active orientation method."""
    active = scenario.patient.orientation.active
    return tuple(
        f"the model of the {model.hand} hand has nothing for patient.orientation.active {active}: orientation and "
        "gripper of the answers are those of the newest sample; tis identify writes a model that has it"
        for model in models
        if model_file(scenario) and active != "hold" and (model.wrist is None or not model.wrist.serves(active))
    )


def in_sample(scenario: Scenario, models: Sequence[ArmModel], played: RecordedRows) -> tuple[str, ...]:
    """Return a warning for each recording of which the run plays rows that its models were trained on.

    Training on the run's own recording, ``own_head``, ends before the run's first row. Oracle: runs and model files
    with and without common rows, test_provenance.
    """
    warnings = []
    for model in models:
        for trained in model.trained_on:
            both = trained.shared(played)
            if both is not None:
                whose = f"the model of {model_file(scenario)}" if model_file(scenario) else "the model"
                last = both.first_row + both.n_rows - 1
                warnings.append(
                    f"{IN_SAMPLE}: {whose} was trained on {trained}, and this run plays rows {both.first_row}-{last} "
                    "of them: its errors are no test of the model"
                )
    return tuple(dict.fromkeys(warnings))


def model_file(scenario: Scenario) -> str | None:
    """Return the model file of a scenario, None when the run identifies its models."""
    train = scenario.identification.train
    return train if is_model_file(train) else None


def _own_rows(model: ArmModel) -> int | None:
    return model.trained_on[0].n_rows if model.train == "own_head" and model.trained_on else None


def without_effect(identification: Identification, models: Sequence[ArmModel]) -> tuple[str, ...]:
    """Return a warning for each kind of configured setting that has no effect.

    With a model file, these are all settings of the identification that differ from the defaults and from the
    corresponding values in the file's models.
    """
    warnings = []
    if identification.allow_lookahead and not identification.looks_ahead:
        warnings.append(
            "identification.allow_lookahead has no effect: identification.inputs holds no velocity, and nothing else "
            "looks ahead"
        )
    if is_model_file(identification.train):
        defaults = Identification(train=identification.train)
        in_file = ("method", "block_rows", "order")
        unused = [
            f"identification.{name}"
            for name in Identification.model_fields
            if name != "allow_lookahead"
            and (given := getattr(identification, name)) != getattr(defaults, name)
            and not (name in in_file and all(getattr(model, name) == given for model in models))
            and not (name == "train_samples" and all(_own_rows(model) == given for model in models))
        ]
        if unused:
            verb = "have" if len(unused) > 1 else "has"
            methods = ", ".join(sorted({model.method for model in models}))
            warnings.append(
                f"{', '.join(unused)} {verb} no effect: the model comes from {identification.train}, "
                f"where it was found by {methods}"
            )
    return tuple(warnings)
