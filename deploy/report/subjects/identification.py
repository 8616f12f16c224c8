"""The arm's identified models, the rows that they were trained on, and the recording that was played."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import PurePath
from typing import Any

from tis.common.channels import Hand, Side
from tis.common.errors import problem
from tis.common.scenario import Scenario
from tis.common.sources.provenance import RECORDING_FILE, SYNTHETIC, RecordedRows, in_words, parse_played
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.present.table import Column, Table
from tis.deploy.report.section import Section, means
from tis.patient_side.identification.validation import fit_text
from tis.patient_side.provenance import in_sample, model_file
from tis.patient_side.statespace import ArmModel


class Rows(Section):
    """Rows of a recording."""

    label: str = means("Recording.")
    digest: str = means("Fingerprint of its content.")
    first_row: int = means("First row; of the recording played it is sample 0.")
    n_rows: int = means("Number of rows.")
    rate_hz: int = means("Its rows a second.")


class PlayedRecording(Rows):
    """The recording that a run plays."""

    file: str | None = means("File that it was read from; `null` for a synthetic source.")
    warnings: list[str] = means("Warnings on the recording.")

    @property
    def synthetic(self) -> bool:
        """Tell whether a program of the testbed made it, as far as its file says."""
        return self.label.endswith(SYNTHETIC)


class IdentifiedModel(Section):
    """The identified model of an arm."""

    method: str = means("Identification method.")
    order: int = means("Order of the model, or its number of lags.")
    static: bool = means("True when a gain is the whole relation of command and arm.")
    block_rows: int = means("Block rows of the Hankel matrices.")
    train: str = means("Source of the training rows.")
    model_file: str | None = means("Model file that was read; `null` when the model was identified for the run.")
    trained_on: list[Rows] = means("Rows trained on.")
    fit_pct: list[float] = means("Fit of the model's simulation along x, y, z.")
    singular_values: list[float] = means("Singular values from which the order was chosen.")
    spectral_radius: float = means("Spectral radius of A; below 1 for a stable model.")
    pairing: str = means("Master and arm, and how the pair was found.")
    warnings: list[str] = means("Warnings on the model.")

    @property
    def source(self) -> str:
        """Return the training data in words: its name, and the recordings of a model file."""
        if self.model_file is None:
            return self.train
        rows = [RecordedRows(**each.as_json()) for each in self.trained_on]
        return f"{self.model_file} ({self.train}: {in_words(rows)})"

    def __str__(self) -> str:
        """Return the model in a clause for a terminal."""
        kind = "static relation, order 0" if self.static else f"order {self.order}"
        fit = " ".join(fit_text(value, 3) for value in self.fit_pct)
        return f"{self.method}, {kind}, trained on {self.source}, fit {fit} %"


def identified(model: ArmModel, scenario: Scenario) -> IdentifiedModel:
    """Return the figures of a model."""
    return IdentifiedModel(
        method=model.method,
        order=model.order,
        static=model.static,
        block_rows=model.block_rows,
        train=model.train,
        model_file=model_file(scenario),
        trained_on=[Rows(**asdict(rows)) for rows in model.trained_on],
        fit_pct=list(model.fit_pct),
        singular_values=model.singular_values.tolist(),
        spectral_radius=model.spectral_radius,
        pairing=model.pairing,
        warnings=list(model.warnings),
    )


def recording_figures(logs: RunLogs, scenario: Scenario, models: Sequence[ArmModel]) -> dict[str, Any]:
    """Return the recording that the run plays, and the models trained on the rows played; None if unknown."""
    attached = logs.attachments("patient").get(RECORDING_FILE)
    if attached is None:
        return {"recording": None, "in_sample": None}
    rows, recording = parse_played(attached, "patient.mcap")
    return {"recording": PlayedRecording(**recording), "in_sample": list(in_sample(scenario, models, rows))}


def two_recordings(logs: RunLogs) -> list[str]:
    """Return a problem when surgeon and patient read different recordings under one name."""
    sides: tuple[Side, ...] = ("surgeon", "patient")
    attached = {side: logs.attachments(side).get(RECORDING_FILE) for side in sides}
    played = {side: parse_played(data, f"{side}.mcap")[1] for side, data in attached.items() if data is not None}
    if len({one["digest"] for one in played.values()}) < len(sides):
        return []
    files = " and ".join(f"{side}: {one['file'] or one['label']}" for side, one in played.items())
    return [problem(f"recording: surgeon and patient have read different ones ({files})", "copy one to both hosts")]


def source_label(scenario: Scenario, foreign_surgeon: bool = False, recording: PlayedRecording | None = None) -> str:
    """Return the origin of the movement in words."""
    source = scenario.source
    hands = " and ".join(source.hands)
    if foreign_surgeon:
        return f"foreign surgeon, {hands} hand"
    if source.kind == "jigsaws":
        origin = "synthetic" if source.synthetic else "recorded"
        return f"{origin} {source.task} {source.trial}, {hands} hand"
    if source.kind == "table":
        task = "" if source.task is None else f"{source.task} "
        made = "synthetic " if recording is not None and recording.synthetic else ""
        return f"{made}table {task}{PurePath(source.path).stem}, {hands} hand"
    return f"live device, {hands} hand" if source.kind == "live" else f"synthetic surgeon, {hands} hand"


def model_table(models: Mapping[Hand, IdentifiedModel]) -> Table:
    """Return a row for each hand's model."""
    rows = [
        (
            f"{hand} hand",
            model.method,
            model.order,
            *(fit_text(value, 3) for value in model.fit_pct),
            f"{model.spectral_radius:.4f}" if model.order else None,
            model.block_rows,
            model.source,
        )
        for hand, model in models.items()
    ]
    columns = (
        "hand", Column("method", words=True), "order", "fit x, %", "fit y, %", "fit z, %", "spectral radius",
        "block rows", Column("trained on", words=True),
    )  # fmt: skip
    note = "Fit: the share of variance on validation rows that a simulation explains"
    if not all(model.order for model in models.values()):
        note += ". Order 0: the arm follows its command at once"
    note += f". Pairing: {'; '.join(dict.fromkeys(model.pairing for model in models.values()))}"
    return Table("The arm's model", columns, rows, note)
