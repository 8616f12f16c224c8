"""Logs of a run folder as a host offers them: regular files of the sides' names, and nothing else of it."""

import hashlib
import os
import re
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, BinaryIO, Final, get_args

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from tis.common.channels import Side
from tis.common.errors import DataError, Fault, file_faults

MAX_LOG_BYTES: Final = 1 << 40
_FORM: Final = rf"^({'|'.join(get_args(Side))})(_camera|_screen)?(_[0-9]{{1,3}})?(_recovered)?\.mcap$"
_BLOCK_BYTES: Final = 1 << 20

LogName = Annotated[str, StringConstraints(pattern=_FORM)]
"""Name of a log: SIDE.mcap, SIDE_2.mcap of a side that was started again, SIDE_recovered.mcap, those of
camera and screen."""
Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class OfferedLog(BaseModel):
    """A log at its source: ``part_sha256`` is that of as many first bytes as were fetched before, if it has them."""

    model_config = ConfigDict(frozen=True, extra="ignore")

    name: LogName
    n_bytes: int = Field(ge=0, le=MAX_LOG_BYTES)
    sha256: Sha256
    part_sha256: Sha256 | None = None


def log_names(folder: Path) -> list[str]:
    """Return the names of the logs in a folder; symbolic links and devices are none."""
    with file_faults(folder, "cannot be read"), os.scandir(folder) as entries:
        return sorted(one.name for one in entries if _is_log(one.name) and one.is_file(follow_symlinks=False))


def offered_logs(folder: Path, parts: Mapping[str, int]) -> list[OfferedLog]:
    """Return the logs of a folder; ``parts`` are the sizes of what the receiver has, by name. Raises `DataError`.

    A log that still grows is offered as far as it reaches now.
    """
    found = []
    for name in log_names(folder):
        with opened_log(folder, name) as file:
            n_bytes = os.fstat(file.fileno()).st_size
            n_part = parts.get(name, 0)
            part, whole = _digests(file, n_bytes, n_part)
        found.append(OfferedLog(name=name, n_bytes=n_bytes, sha256=whole, part_sha256=part))
    return found


@contextmanager
def opened_log(folder: Path, name: str) -> Iterator[BinaryIO]:
    """Open a log of a folder, and no other file, whatever the name; raises `DataError`."""
    if not _is_log(name):
        raise DataError(Fault(str(folder), "", "offers the logs of a run only", name))
    with file_faults(folder / name, "cannot be read"):
        # Not through a link that was put there, and without waiting for the other end of a pipe.
        number = os.open(folder / name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    if not stat.S_ISREG(os.fstat(number).st_mode):
        os.close(number)
        raise DataError(Fault(str(folder / name), "", "must be a regular file"))
    with os.fdopen(number, "rb") as file:
        yield file


def read_range(folder: Path, name: str, begin: int, end: int) -> Iterator[bytes]:
    """Yield a log's bytes from ``begin`` to before ``end``, or to its end, in blocks; raises `DataError`."""
    with opened_log(folder, name) as file:
        file.seek(begin)
        while begin < end and (block := file.read(min(_BLOCK_BYTES, end - begin))):
            begin += len(block)
            yield block


def digest_of(file: Path) -> str:
    """Return a file's SHA-256 in hex digits."""
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def _is_log(name: str) -> bool:
    return re.fullmatch(_FORM.strip("^$"), name) is not None


def _digests(file: BinaryIO, n_bytes: int, n_part: int) -> tuple[str | None, str]:
    """Return the SHA-256 of the first ``n_part`` bytes, None if there are not as many, and that of ``n_bytes``."""
    digest, part, done = hashlib.sha256(), None, 0
    for until in (n_part, n_bytes) if n_part <= n_bytes else (n_bytes,):
        while done < until and (block := file.read(min(_BLOCK_BYTES, until - done))):
            digest.update(block)
            done += len(block)
        if until == n_part:
            part = digest.hexdigest()
    return part, digest.hexdigest()
