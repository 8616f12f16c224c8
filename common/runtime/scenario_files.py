"""Files that a scenario stands in or names, read up to a limit of size.

Recordings of movements have a folder of their own: `tis.common.runtime.recordings`.
"""

import errno
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel

from tis.common.errors import DataError, Fault, InputError
from tis.common.runtime.process import command_line
from tis.common.scenario import reading
from tis.common.scenario.base import Part
from tis.common.scenario.network.capacity import RecordedRate
from tis.common.scenario.network.delay import TraceDelay
from tis.common.scenario.network.loss import TraceLoss
from tis.common.scenario.table_source import TABLE_SUFFIXES
from tis.common.trace import Trace, parse_opportunities, parse_trace
from tis.common.yaml_text import MAX_YAML_BYTES, line_of


def read_limited(path: Path, max_bytes: int) -> bytes:
    """Return the content of a file; raises `OSError`, also for one of more than ``max_bytes``.

    The size that the system states would not do: a device states none.
    """
    with path.open("rb") as file:
        content = file.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise OSError(errno.EFBIG, f"it has more than {max_bytes} bytes", str(path))
    return content


_RECORDINGS: Final = (".tsv", ".mcap", ".db3", ".bag")
_HEAD_BYTES: Final = 4096
_N_OF_A_POSE: Final = 8  # an instant, a position and a quaternion


def read_scenario(path: Path) -> dict[str, Any]:
    """Return a scenario file's top-level mapping, not validated yet; raises `InputError`."""
    if (what := _recording(path)) is not None:
        command = command_line(["import", str(path), "--out", f"{path.stem}_table.csv"])
        makes = "" if what == "table" else "makes a table of it, and "
        rule = f"is a {what}, not a scenario: `{command}` {makes}tells how to play it"
        raise InputError(Fault(str(path), "", rule))
    try:
        text = read_limited(path, MAX_YAML_BYTES).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise InputError(Fault(str(path), "", f"cannot be read: {reason}")) from None
    return reading.parse_yaml(text, str(path))


def _recording(path: Path) -> str | None:
    """Return what recording a file is, by its name and its first lines; None for none."""
    lines: list[str] = []
    with suppress(OSError):
        if path.is_file():  # what a pipe gives could not be read again
            with path.open("rb") as file:
                lines = file.read(_HEAD_BYTES).decode("utf-8", "replace").splitlines()
    if lines and lines[0].lower().startswith("#timestamp"):
        return "trajectory (EuRoC)"
    if path.suffix.lower() in TABLE_SUFFIXES:
        return "table"
    first = next((line for line in lines if line.strip() and not line.startswith("#")), "").split()
    has_numbers = len(first) >= _N_OF_A_POSE and all(map(_is_number, first[:_N_OF_A_POSE]))
    return "recording" if has_numbers or path.suffix.lower() in _RECORDINGS else None


def _is_number(word: str) -> bool:
    try:
        return isfinite(float(word))
    except ValueError:
        return False


@contextmanager
def lines_told(path: Path) -> Iterator[None]:
    """Add their lines to the faults of a file that are raised in the block, and name it as `read_scenario` does.

    They come in the order of the lines; faults of what else is read keep their places among them.
    """
    try:
        yield
    except InputError as error:
        try:
            text = read_limited(path, MAX_YAML_BYTES).decode("utf-8")
        except (OSError, UnicodeDecodeError):
            raise error from None
        lines = [_line(fault, str(path), text) for fault in error.faults]
        places = [place for place, line in enumerate(lines) if line]
        told = list(error.faults)
        for place, source in zip(places, sorted(places, key=lines.__getitem__), strict=True):
            told[place] = replace(error.faults[source], where=f"{path}: line {lines[source]}")
        raise InputError(told) from None


def _line(fault: Fault, where: str, text: str) -> int:
    """Return the line of what a fault is about; 0 where it has none, or names it already."""
    if fault.where != where or fault.field.startswith("line ") or not fault.field:
        return 0
    return line_of(text, fault.field) or 0


_FOLDER: Final = "traces"
_MAX_BYTES: Final = 256_000_000


def load_traces(part: Part, kept: Mapping[str, bytes] | None = None) -> dict[str, Trace]:
    """Return every trace named in ``part``, a network or a part of one, by its path as written.

    ``kept`` are the attachments of a run's log; they precede the files, which may have changed since. Paths are
    relative to the working folder. Raises `DataError` with the faults of all files at once. Oracle: files that the
    tests write.
    """
    traces: dict[str, Trace] = {}
    faults: list[Fault] = []
    for path, parse in sorted(set(_files(part)), key=lambda one: one[0]):
        try:
            content = (kept or {}).get(f"{_FOLDER}/{path}")
            traces[path] = parse(_decoded(path, _read(path) if content is None else content), path)
        except DataError as error:
            faults += error.faults
    if faults:
        raise DataError(faults)
    return traces


def trace_attachments(part: Part) -> dict[str, bytes]:
    """Return the traces named in ``part`` as attachments, so that a log is complete without the files."""
    return {f"{_FOLDER}/{path}": _read(path) for path in trace_paths(part)}


def trace_paths(part: Part) -> list[str]:
    """Return the paths of the traces named in ``part`` as written, each once, in order."""
    return sorted({path for path, _ in _files(part)})


def _files(value: object) -> Iterator[tuple[str, Callable[[str, str], Trace]]]:
    """Return the path of each file, and the parser of its format; a file with two formats fails in one of them."""
    if isinstance(value, TraceDelay | TraceLoss):
        yield value.path, parse_trace
    elif isinstance(value, RecordedRate):
        yield value.opportunities, parse_opportunities
    elif isinstance(value, BaseModel):
        for name in type(value).model_fields:
            yield from _files(getattr(value, name))
    elif isinstance(value, tuple):
        for item in value:
            yield from _files(item)


def _read(path: str) -> bytes:
    file = Path(path)
    try:
        if not file.is_file():
            rule = "must be a file" if file.exists() else "does not exist"
            raise DataError(Fault(path, "", rule))
        if (n_bytes := file.stat().st_size) > _MAX_BYTES:
            raise DataError(Fault(path, "", f"must have at most {_MAX_BYTES} bytes", n_bytes))
        return read_limited(file, _MAX_BYTES)
    except (OSError, ValueError) as error:  # ValueError: an impossible path
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise DataError(Fault(path, "", f"cannot be read: {reason}")) from None


def _decoded(path: str, content: bytes) -> str:
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise DataError(Fault(path, "", f"must be UTF-8; byte {error.start} is not")) from None
