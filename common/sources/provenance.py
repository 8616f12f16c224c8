"""Provenance of rows: the recording and the rows that a model was trained on, or that a run plays."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cache
from typing import Annotated, Any, Final

from pydantic import Field, TypeAdapter

from tis.common.errors import DataError, Fault
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.trajectory import Array, Recording

RECORDING_FILE: Final = "recording.json"
"""Attachment of the surgeon's and the patient's log that describes the recording that each has read."""
MODEL_FILES: Final = ("model.json", "model.safetensors")
"""Names of the models' file in a run folder or log: without and with weights of learned methods."""

SYNTHETIC: Final = " (synthetic)"
"""End of the label of a recording that a program of the testbed made."""

_MAX_NAMED: Final = 6


@dataclass(frozen=True)
class RecordedRows:
    """Rows ``first_row`` .. ``first_row + n_rows - 1`` of a recording, identified by the ``digest`` of its content.

    ``label`` is for display: a task and trial, or the synthetic surgeon and its seed.
    """

    label: str
    digest: str
    first_row: Annotated[int, Field(ge=0)]
    n_rows: Annotated[int, Field(ge=1)]
    rate_hz: Annotated[int, Field(ge=1)]

    def shared(self, other: "RecordedRows") -> "RecordedRows | None":
        """Return the rows that are in both, None if there are none. Oracle: sets of row numbers in the tests."""
        first = max(self.first_row, other.first_row)
        stop = min(self.first_row + self.n_rows, other.first_row + other.n_rows)
        if self.digest != other.digest or stop <= first:
            return None
        return RecordedRows(self.label, self.digest, first, stop - first, self.rate_hz)

    def __str__(self) -> str:
        return f"rows {self.first_row}-{self.first_row + self.n_rows - 1} of {self.label}"


def in_words(rows: Sequence[RecordedRows]) -> str:
    """Return a description of ``rows``: the rows of one recording, or the total number and the recordings."""
    if not rows:
        return "rows that the file does not name"
    if len(rows) == 1:
        return str(rows[0])
    labels = [part.label for part in rows[:_MAX_NAMED]]
    rest = f" and {len(rows) - _MAX_NAMED} more" if len(rows) > _MAX_NAMED else ""
    return f"{sum(part.n_rows for part in rows)} rows of {len(rows)} recordings: {', '.join(labels)}{rest}"


def digest_of_rows(rows: Array) -> str:
    """Return 16 hex digits that identify a recording by its numbers, independently of its file name."""
    return hashlib.blake2b(rows.astype("<f8").tobytes(), digest_size=8).hexdigest()


def digest_of_synthetic(source: SyntheticSource, seed: int, rate_hz: int) -> str:
    """Return 16 hex digits that identify a synthetic movement by its parameters, for any number of rows."""
    deciding = source.model_dump(mode="json", exclude={"hands", "start"})
    text = json.dumps([deciding, seed, rate_hz], sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def played_rows(recording: Recording, n_samples: int) -> RecordedRows:
    """Return the rows that a run of ``n_samples`` plays, and the next one, for the interpolation of truth."""
    n_rows = min(n_samples + 1, len(recording) - recording.start)
    return RecordedRows(recording.label, recording.digest, recording.start, n_rows, recording.rate_hz)


def training_rows(recordings: Sequence[Recording]) -> tuple[RecordedRows, ...]:
    """Return the provenance of training recordings: all rows of each, which begin at row 0."""
    return tuple(RecordedRows(each.label, each.digest, 0, len(each), each.rate_hz) for each in recordings)


def dump_played(recording: Recording, n_samples: int) -> str:
    """Return the JSON description of the rows that a run plays, with their file and all warnings."""
    about = {"file": recording.file, "warnings": [*recording.warnings, *recording.anomalies]}
    return json.dumps(asdict(played_rows(recording, n_samples)) | about, indent=1) + "\n"


def parse_played(text: bytes, where: str) -> tuple[RecordedRows, dict[str, Any]]:
    """Return the rows in a text of `dump_played`, and its complete content; raises `DataError`."""
    try:
        played = _adapter().validate_json(text)
    except ValueError:
        raise DataError(Fault(where, RECORDING_FILE, "cannot be read")) from None
    content = asdict(played)
    return RecordedRows(**{name: content[name] for name in RecordedRows.__dataclass_fields__}), content


@dataclass(frozen=True)
class _Played(RecordedRows):
    """The complete content of the attachment; a device has no rows."""

    n_rows: Annotated[int, Field(ge=0)]
    file: str | None
    warnings: list[str]


@cache
def _adapter() -> TypeAdapter[_Played]:
    return TypeAdapter(_Played)
