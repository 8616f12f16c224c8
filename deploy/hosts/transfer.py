"""Logs from several hosts into one folder: resumable, and checked by their SHA-256.

A run folder offers regular files of the sides' names, and nothing else of it. A log that is fetched grows as
``NAME.part``, and gets its name when its SHA-256 is the source's.
"""

import asyncio
import hashlib
import os
import re
import stat
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, BinaryIO, Final, NamedTuple, Protocol, get_args

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from tis.common.channels import Side
from tis.common.errors import DataError, Fault, PeerError

MAX_LOG_BYTES: Final = 1 << 40
_FORM: Final = rf"^({'|'.join(get_args(Side))})(_[0-9]{{1,3}})?(_recovered)?\.mcap$"
_BLOCK_BYTES: Final = 1 << 20

LogName = Annotated[str, StringConstraints(pattern=_FORM)]
"""Name of a log: SIDE.mcap, SIDE_2.mcap of a side that was started again, SIDE_recovered.mcap."""
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
    try:
        with os.scandir(folder) as entries:
            return sorted(one.name for one in entries if _is_log(one.name) and one.is_file(follow_symlinks=False))
    except OSError as error:
        raise DataError(Fault(str(folder), "", f"cannot be read: {error.strerror}")) from None


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
    try:
        # Not through a link that was put there, and without waiting for the other end of a pipe.
        number = os.open(folder / name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError as error:
        raise DataError(Fault(str(folder / name), "", f"cannot be read: {error.strerror}")) from None
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


class Held(NamedTuple):
    """What is here of a log: the SHA-256 of the whole file, and size and SHA-256 of a part of it."""

    sha256: str | None = None
    n_part_bytes: int = 0
    part_sha256: str | None = None


class Fetch(NamedTuple):
    """A range of a log to fetch; ``begin`` is 0 for a log that is fetched anew."""

    log: OfferedLog
    begin: int


def plan_fetch(offered: OfferedLog, held: Held) -> Fetch | None:
    """Return what to fetch, None when the log is here already.

    A part is continued only if the source's log begins with the same bytes. A log that changed there starts anew, and
    one that only grew goes on.
    """
    if held.sha256 == offered.sha256:
        return None
    continues = (
        0 < held.n_part_bytes <= offered.n_bytes
        and held.part_sha256 is not None
        and held.part_sha256 == offered.part_sha256
    )
    return Fetch(offered, held.n_part_bytes if continues else 0)


PART: Final = ".part"
_MAX_TRIES: Final = 4
"""Without a byte of progress; a transfer that goes on may break any number of times."""
_MAX_CHANGES: Final = 2


class Source(Protocol):
    """A place with logs of a run. Its methods raise `PeerError` when it cannot be reached or breaks off."""

    @property
    def place(self) -> str:
        """The place in words."""

    async def offered(self, parts: Mapping[str, int]) -> list[OfferedLog]:
        """Return the logs; ``parts`` are the sizes of what is here, by name."""

    def read(self, name: str, begin: int, end: int) -> AsyncIterator[bytes]:
        """Yield the bytes of a log from ``begin`` to before ``end``."""


@dataclass
class Collection:
    """A folder that gathers the logs of one run; ``told`` receives a line for each log."""

    folder: Path
    told: Callable[[str], None]
    pause_s: float = 0.5
    """Before a broken transfer is continued."""
    origins: dict[str, str] = field(default_factory=dict)
    """The source of each log, by name."""

    async def fetch_all(self, source: Source) -> None:
        """Fetch the logs of a source, from where an earlier transfer stopped; raises `DataError` and `PeerError`.

        A transfer that breaks is continued, unless several attempts in a row bring nothing.
        """
        n_tries, n_before = 0, -1
        while True:
            try:
                return await self._fetch_once(source)
            except PeerError:
                n_here = sum(file.stat().st_size for file in self.folder.glob(f"*{PART}"))
                n_tries = n_tries + 1 if n_here <= n_before else 1
                n_before = n_here
                if n_tries >= _MAX_TRIES:
                    raise
                await asyncio.sleep(self.pause_s)

    async def _fetch_once(self, source: Source) -> None:
        for n_changes in range(_MAX_CHANGES + 1):
            changed = False
            for offered in await source.offered(self._parts()):
                self._check_origin(offered, source.place)
                fetch = plan_fetch(offered, self._held(offered.name))
                if fetch is None:
                    self.told(f"{offered.name} is here already")
                    continue
                changed |= not await self._fetch(source, fetch)
            if not changed:
                return
            if n_changes == _MAX_CHANGES:
                raise DataError(Fault(source.place, "", "its logs change while they are fetched: try again"))

    async def _fetch(self, source: Source, fetch: Fetch) -> bool:
        """Fetch one log; False if it proved not to be what was offered, so that it has to start anew."""
        log, part = fetch.log, self.folder / f"{fetch.log.name}{PART}"
        begin, done = fetch.begin, fetch.begin
        with _faults_named(part), part.open("r+b" if begin else "wb") as file:
            file.seek(begin)
            file.truncate()
            blocks = source.read(log.name, begin, log.n_bytes) if begin < log.n_bytes else _nothing()
            async for block in blocks:
                done += len(block)
                if done > log.n_bytes:
                    raise PeerError(Fault(source.place, log.name, "sends more than it offered"))
                file.write(block)
                file.flush()  # what is here stays here, however this ends
        if done < log.n_bytes:
            raise PeerError(
                Fault(source.place, log.name, f"the transfer stopped after {done} of {log.n_bytes} bytes")
            )
        with _faults_named(part):
            if digest_of(part) != log.sha256:
                part.unlink()
                return False
            part.replace(self.folder / log.name)
        went_on = f", continued after {begin} bytes" if begin else ""
        self.told(f"{log.name} from {source.place}: {log.n_bytes} bytes{went_on}")
        return True

    def _parts(self) -> dict[str, int]:
        parts = self.folder.glob(f"*{PART}")
        return {part.name.removesuffix(PART): min(part.stat().st_size, MAX_LOG_BYTES) for part in parts}

    def _held(self, name: str) -> Held:
        whole, part = self.folder / name, self.folder / f"{name}{PART}"
        with _faults_named(whole):
            sha256 = digest_of(whole) if whole.is_file() else None
            if not part.is_file():
                return Held(sha256)
            return Held(sha256, part.stat().st_size, digest_of(part))

    def _check_origin(self, offered: OfferedLog, place: str) -> None:
        """Raise `DataError` if another source has a log of this name, which would overwrite it."""
        first = self.origins.setdefault(offered.name, place)
        if first != place:
            raise DataError(Fault(place, offered.name, f"is a log that {first} has, too: collect one run only"))


async def _nothing() -> AsyncIterator[bytes]:
    for block in (b"",):
        yield block


@contextmanager
def _faults_named(file: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise DataError(Fault(str(file), "", f"cannot be written: {error.strerror}")) from None
