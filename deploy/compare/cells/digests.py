"""Digests of everything that decides a result: software, file content, tree of values."""

import hashlib
import importlib.metadata
import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

import tis
from tis.common.errors import DataError, Fault

_ROOT: Final = Path(tis.__file__).parent
_DECIDING: Final = (
    "common/**/*.py",
    "surgeon_side/**/*.py",
    "netem/**/*.py",
    "patient_side/**/*.py",
    "deploy/run/twin.py",
    "deploy/logs/read/load.py",
    "deploy/logs/read/memory.py",
    "deploy/report/subjects/tracking.py",
    "deploy/compare/cells/cell.py",
    "deploy/compare/cells/error_sums.py",
    "deploy/compare/cells/forecasts.py",
    "deploy/compare/cells/histogram.py",
    "deploy/compare/cells/kept_log.py",
    "deploy/compare/cells/score.py",
    "deploy/compare/cells/measured_estimator.py",
    "deploy/compare/cells/measured_method.py",
    "deploy/compare/cells/shared_parts.py",
    "deploy/compare/cells/unlogged.py",
    "deploy/compare/cells/wrist_sums.py",
)
_SUMMARISING: Final = ("deploy/report/**/*.py", "deploy/logs/**/*.py", "deploy/compare/cells/summary.py")
_LIBRARIES: Final = ("numpy", "scipy", "filterpy", "pydantic")


def value_digest(value: Any) -> str:
    """Return 16 hex digits of a JSON value, independent of the order of its keys."""
    return hashlib.blake2b(json.dumps(value, sort_keys=True).encode(), digest_size=8).hexdigest()


def content_digest(content: bytes) -> str:
    """Return 16 hex digits of bytes."""
    return hashlib.blake2b(content, digest_size=8).hexdigest()


def file_digest(file: Path) -> str:
    """Return 16 hex digits of a file's content, which is read again only after a change; raises `DataError`."""
    try:
        found = file.stat()
        if not file.is_file():
            raise DataError(Fault(str(file), "", "must be a file"))
        return _digest_of(file, found.st_mtime_ns, found.st_size)
    except (OSError, ValueError) as error:  # ValueError: an impossible path
        reason = error.strerror if isinstance(error, OSError) else error
        raise DataError(Fault(str(file), "", f"cannot be read: {reason}")) from None


@cache
def _digest_of(file: Path, mtime_ns: int, n_bytes: int) -> str:  # noqa: ARG001  cache keys: they change with the file
    return content_digest(file.read_bytes())


@cache
def software_digest() -> str:
    """Return 16 hex digits of all code behind a twin and its scores, and of the libraries' versions."""
    return value_digest([_contents(_DECIDING), {name: importlib.metadata.version(name) for name in _LIBRARIES}])


@cache
def summary_digest() -> str:
    """Return 16 hex digits of the code that turns a twin's logs into a summary."""
    return value_digest(_contents(_SUMMARISING))


def _contents(patterns: Sequence[str]) -> dict[str, str]:
    """Return the digest of each file that matches one of the patterns, by its path."""
    files = sorted(path for pattern in patterns for path in _matching(pattern))
    return {str(path.relative_to(_ROOT)): content_digest(path.read_bytes()) for path in files}


def _matching(pattern: str) -> list[Path]:
    """Return the files that match ``pattern``; raises `FileNotFoundError` without a match."""
    package, _, below = pattern.partition("/")
    files = list((_ROOT / package).glob(below))  # in a checkout the package is a link, which ** does not follow
    if not files:
        raise FileNotFoundError(f"{pattern}: matches no file below {_ROOT}")
    return files
