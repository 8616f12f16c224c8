"""Store of a comparison: each result is a file named by the digest of everything that decides it.

Files are written atomically, so an interrupted comparison can be resumed.
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import DataError, Fault
from tis.deploy.compare.cells.identity import content_digest
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import unwritable
from tis.patient_side.identification.model_file import is_tensor_file

_MODELS: Final = "models_digest"
_TEXT, _WITH_WEIGHTS = ".json", ".safetensors"
_ANY_FILE: Final = ".new"
_SCORES: Final = ("hands", "forecasts", "summary")
"""The sums, forecasts or summary of a cell: it has one of them."""


@contextmanager
def resumable(store: "Store", err: Console) -> Iterator[None]:
    """Say what Ctrl-C in the block leaves, and how it goes on."""
    try:
        yield
    except KeyboardInterrupt:
        text = f"interrupted: every finished twin is stored in {store.path}; the same command resumes there"
        err.print(escape(text), style="yellow", soft_wrap=True)
        raise


class Store:
    """Store of trainings and cells by digest; raises `DataError` when the folder cannot be written.

    The folder is made with the first result, so that a refusal leaves none.
    """

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()
        above = next(one for one in (self.path, *self.path.parents) if one.exists())
        if unwritable(above / _ANY_FILE):
            raise DataError(Fault(str(path), "", f"folder cannot be created: {above} is not writable"))

    def model_file(self, digest: str) -> Path:
        """Return the file of a training's models."""
        paths = [self._models_file(digest, suffix) for suffix in (_WITH_WEIGHTS, _TEXT)]
        return next((path for path in paths if path.is_file()), paths[-1])

    def training(self, digest: str) -> dict[str, Any] | None:
        """Return a training's result, None if it is missing, or if its models are not those that were stored."""
        found = _read(self._training_file(digest), ("train_s", "warnings", _MODELS))
        try:
            models = self.model_file(digest).read_bytes()
        except OSError:
            return None
        return found if found is not None and found[_MODELS] == content_digest(models) else None

    def cell(self, digest: str) -> dict[str, Any] | None:
        """Return a cell's result, None if it is missing."""
        found = _read(self._cell_file(digest), ("trial",))
        return found if found is not None and any(name in found for name in _SCORES) else None

    def save_training(self, digest: str, result: dict[str, Any], models: bytes) -> None:
        """Write a training's models, the content of a model file, and then its result."""
        suffix = _WITH_WEIGHTS if is_tensor_file(models) else _TEXT
        self._write(self._models_file(digest, suffix), models)
        about = result | {_MODELS: content_digest(models)}
        self._write(self._training_file(digest), json.dumps(about))

    def save_cell(self, digest: str, result: dict[str, Any]) -> None:
        """Write a cell's result."""
        self._write(self._cell_file(digest), json.dumps(result))

    def _write(self, file: Path, content: str | bytes) -> None:
        folder.made(file.parent)
        folder.write(file, content)

    def _models_file(self, digest: str, suffix: str) -> Path:
        return self.path / "models" / f"{digest}{suffix}"

    def _cell_file(self, digest: str) -> Path:
        return self.path / "cells" / f"{digest}.json"

    def _training_file(self, digest: str) -> Path:
        return self.path / "trainings" / f"{digest}.json"


def _read(file: Path, names: Sequence[str]) -> dict[str, Any] | None:
    """Return the content of a file; one that is unreadable, or lacks one of the names, is missing and rewritten."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) and all(name in content for name in names) else None
