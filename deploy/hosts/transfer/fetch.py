"""Fetching of logs: each grows as ``NAME.part``, and gets its name when its SHA-256 is the source's."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from tis.common.errors import DataError, Fault, PeerError
from tis.deploy.hosts.transfer.offered_logs import MAX_LOG_BYTES, OfferedLog, digest_of

# Decision what to fetch of a log, from what its source offers and what is here.


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
