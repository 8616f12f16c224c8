"""Store of a comparison: each result is a file named by the digest of everything that decides it.

Files are written atomically, so an interrupted comparison can be resumed.
"""

import json
from pathlib import Path
from typing import Any

from common.errors import DataError, Fault
from deploy.shell import run_dir as folder


class Store:
    """Store of trainings and cells by digest; raises `DataError` when the folder cannot be written."""

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()
        try:
            for name in ("cells", "trainings", "models"):
                (self.path / name).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DataError(Fault(str(path), "", f"folder cannot be created: {error.strerror}")) from None

    def model_file(self, digest: str) -> Path:
        """Return the file of a training's models."""
        return self.path / "models" / f"{digest}.json"

    def training(self, digest: str) -> dict[str, Any] | None:
        """Return a training's result, None if it is missing."""
        return _read(self._training_file(digest)) if self.model_file(digest).is_file() else None

    def cell(self, digest: str) -> dict[str, Any] | None:
        """Return a cell's result, None if it is missing."""
        return _read(self._cell_file(digest))

    def save_training(self, digest: str, result: dict[str, Any], models: str) -> None:
        """Write a training's models, the text of a model file, and then its result."""
        folder.write(self.model_file(digest), models)
        folder.write(self._training_file(digest), json.dumps(result))

    def save_cell(self, digest: str, result: dict[str, Any]) -> None:
        """Write a cell's result."""
        folder.write(self._cell_file(digest), json.dumps(result))

    def _cell_file(self, digest: str) -> Path:
        return self.path / "cells" / f"{digest}.json"

    def _training_file(self, digest: str) -> Path:
        return self.path / "trainings" / f"{digest}.json"


def _read(file: Path) -> dict[str, Any] | None:
    """Return the content of a file; an unreadable one counts as missing and is rewritten."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None
