"""From a scenario's network to the traces that it names: the only place that reads them."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from pydantic import BaseModel

from common.errors import DataError, Fault
from common.scenario.base import Part
from common.scenario.network.delay import TraceDelay
from common.scenario.network.loss import TraceLoss
from common.trace import Trace
from common.trace_text import parse_trace

_FOLDER: Final = "traces"
_MOST_BYTES: Final = 256_000_000


def load_traces(part: Part, kept: Mapping[str, bytes] | None = None) -> dict[str, Trace]:
    """Return every trace named anywhere in ``part``, a whole network or a piece of one, by its path as written.

    ``kept`` are the attachments of a run's log: the trace that the run used comes before the one that lies there now.
    A path counts from the working folder. Raises `DataError` with the faults of all files at once. Oracle: files that
    the tests write.
    """
    traces: dict[str, Trace] = {}
    faults: list[Fault] = []
    for path in sorted(set(_paths(part))):
        try:
            content = (kept or {}).get(f"{_FOLDER}/{path}")
            traces[path] = parse_trace(_decoded(path, _read(path) if content is None else content), path)
        except DataError as error:
            faults += error.faults
    if faults:
        raise DataError(faults)
    return traces


def trace_attachments(part: Part) -> dict[str, bytes]:
    """Return the traces named in ``part`` as files to attach to a log, so that it explains itself anywhere."""
    return {f"{_FOLDER}/{path}": _read(path) for path in sorted(set(_paths(part)))}


def _paths(value: object) -> Iterator[str]:
    if isinstance(value, TraceDelay | TraceLoss):
        yield value.path
    elif isinstance(value, BaseModel):
        for name in type(value).model_fields:
            yield from _paths(getattr(value, name))
    elif isinstance(value, tuple):
        for item in value:
            yield from _paths(item)


def _read(path: str) -> bytes:
    file = Path(path)
    try:
        if not file.is_file():
            rule = "must be a file" if file.exists() else "is not there"
            raise DataError(Fault(path, "", rule))
        if (n_bytes := file.stat().st_size) > _MOST_BYTES:
            raise DataError(Fault(path, "", f"must have at most {_MOST_BYTES} bytes", n_bytes))
        return file.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a path that no file can have
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise DataError(Fault(path, "", f"cannot be read: {reason}")) from None


def _decoded(path: str, content: bytes) -> str:
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise DataError(Fault(path, "", f"must be UTF-8; byte {error.start} is not")) from None
