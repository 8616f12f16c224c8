"""What decides a result, as short names: the software, a file, a tree of values."""

import hashlib
import importlib.metadata
import json
from functools import cache
from pathlib import Path
from typing import Any, Final

_ROOT: Final = Path(__file__).resolve().parents[2]
_DECIDING: Final = (
    "common/**/*.py",
    "surgeon_side/**/*.py",
    "netem/**/*.py",
    "patient_side/**/*.py",
    "deploy/twin.py",
    "deploy/report/read/load.py",
    "deploy/report/read/memory.py",
    "deploy/report/measures/tracking.py",
    "deploy/compare/cell.py",
    "deploy/compare/histogram.py",
    "deploy/compare/kept_log.py",
    "deploy/compare/score.py",
    "deploy/compare/witness.py",
)
_LIBRARIES: Final = ("numpy", "scipy", "filterpy", "pydantic")


def value_digest(value: Any) -> str:
    """Return 16 hex digits of a JSON value, whatever the order of its keys."""
    return hashlib.blake2b(json.dumps(value, sort_keys=True).encode(), digest_size=8).hexdigest()


def content_digest(content: bytes) -> str:
    """Return 16 hex digits of bytes."""
    return hashlib.blake2b(content, digest_size=8).hexdigest()


@cache
def software_digest() -> str:
    """Return 16 hex digits of all code that a twin and its scores run through, and of the libraries' versions."""
    files = sorted(path for pattern in _DECIDING for path in _ROOT.glob(pattern))
    contents = {str(path.relative_to(_ROOT)): content_digest(path.read_bytes()) for path in files}
    return value_digest([contents, {name: importlib.metadata.version(name) for name in _LIBRARIES}])
