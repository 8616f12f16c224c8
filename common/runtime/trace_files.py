"""From a scenario's network to the traces that it names: the only place that reads them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from pydantic import BaseModel

from common.errors import DataError, Fault
from common.scenario.base import Part
from common.scenario.network.delay import TraceDelay
from common.scenario.network.loss import TraceLoss
from common.trace import Trace
from common.trace_text import parse_trace

_MOST_BYTES: Final = 256_000_000


def load_traces(part: Part) -> dict[str, Trace]:
    """Return every trace named anywhere in ``part``, a whole network or a piece of one, by its path as written.

    A path counts from the working folder. Raises `DataError` with the faults of all files at once. Oracle: files that
    the tests write.
    """
    traces: dict[str, Trace] = {}
    faults: list[Fault] = []
    for path in sorted(set(_paths(part))):
        try:
            traces[path] = parse_trace(_read(path), path)
        except DataError as error:
            faults += error.faults
    if faults:
        raise DataError(faults)
    return traces


def _paths(value: object) -> Iterator[str]:
    if isinstance(value, TraceDelay | TraceLoss):
        yield value.path
    elif isinstance(value, BaseModel):
        for name in type(value).model_fields:
            yield from _paths(getattr(value, name))
    elif isinstance(value, tuple):
        for item in value:
            yield from _paths(item)


def _read(path: str) -> str:
    file = Path(path)
    try:
        if not file.is_file():
            rule = "must be a file" if file.exists() else "is not there"
            raise DataError(Fault(path, "", rule))
        if (n_bytes := file.stat().st_size) > _MOST_BYTES:
            raise DataError(Fault(path, "", f"must have at most {_MOST_BYTES} bytes", n_bytes))
        return file.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise DataError(Fault(path, "", f"must be UTF-8; byte {error.start} is not")) from None
    except (OSError, ValueError) as error:  # ValueError: a path that no file can have
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise DataError(Fault(path, "", f"cannot be read: {reason}")) from None
