"""What has to be said of a run's data and models: where they come from, and where that spoils what the run shows."""

from collections.abc import Sequence
from typing import Final

from common.scenario import Scenario
from common.scenario.patient import Identification
from common.sources.provenance import RecordedRows, played_rows
from common.sources.trajectory import Recording
from patient_side.statespace import ArmModel

IN_SAMPLE: Final = "in sample"
"""How lines begin that say of a model's errors that they are no test."""


def warnings_at_start(scenario: Scenario, recording: Recording, models: Sequence[ArmModel]) -> tuple[str, ...]:
    """Return what is said before a run: of the recording, of the models and of settings without effect, each once."""
    played = played_rows(recording, scenario.n_samples)
    of_models = (text for model in models for text in model.warnings)
    said = (*recording.warnings, *recording.anomalies, *of_models, *in_sample(scenario, models, played))
    return tuple(dict.fromkeys((*said, *without_effect(scenario.identification, models))))


def in_sample(scenario: Scenario, models: Sequence[ArmModel], played: RecordedRows) -> tuple[str, ...]:
    """Return a line for each recording of which a run plays rows that its models were trained on.

    Training that comes with the run, ``own_head``, ends before its first row. Oracle: runs and model files with rows
    in common and without, test_provenance.
    """
    said = []
    for model in models:
        for trained in model.trained_on:
            both = trained.shared(played)
            if both is not None:
                whose = f"the model of {model_file(scenario)}" if model_file(scenario) else "the model"
                last = both.first_row + both.n_rows - 1
                said.append(
                    f"{IN_SAMPLE}: {whose} was trained on {trained}, and this run plays rows {both.first_row}-{last} "
                    "of them: its errors are no test of the model"
                )
    return tuple(dict.fromkeys(said))


def model_file(scenario: Scenario) -> str | None:
    """Return the model file that a scenario names, None when it identifies a model."""
    train = scenario.identification.train
    return train if train.endswith(".json") else None


def _own_rows(model: ArmModel) -> int | None:
    return model.trained_on[0].n_rows if model.train == "own_head" and model.trained_on else None


def without_effect(identification: Identification, models: Sequence[ArmModel]) -> tuple[str, ...]:
    """Return a line for each kind of setting that is given and changes nothing.

    Beside a model file that is all of how models are found, where it differs from the usual and from what the file's
    models say of themselves.
    """
    said = []
    if identification.allow_lookahead and not identification.looks_ahead:
        said.append(
            "identification.allow_lookahead has no effect: identification.inputs holds no velocity, and nothing else "
            "looks ahead"
        )
    if identification.train.endswith(".json"):
        usual = Identification(train=identification.train)
        told = ("method", "block_rows", "order")
        unused = [
            f"identification.{name}"
            for name in Identification.model_fields
            if name != "allow_lookahead"
            and (given := getattr(identification, name)) != getattr(usual, name)
            and not (name in told and all(getattr(model, name) == given for model in models))
            and not (name == "train_samples" and all(_own_rows(model) == given for model in models))
        ]
        if unused:
            verb = "have" if len(unused) > 1 else "has"
            methods = ", ".join(sorted({model.method for model in models}))
            said.append(
                f"{', '.join(unused)} {verb} no effect: the model comes from {identification.train}, "
                f"where it was found by {methods}"
            )
    return tuple(said)
