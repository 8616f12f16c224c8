"""Logs from several hosts into one folder: resumable, and checked by their SHA-256.

A log that is fetched grows as ``NAME.part``, and gets its name when its SHA-256 is the source's.
"""

import asyncio
import shutil
from collections import Counter
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from tis.common.errors import DataError, Fault, PeerError, file_faults
from tis.deploy.hosts.log_offer import MAX_LOG_BYTES, OfferedLog, digest_of, log_names


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
_MAX_TRIES: Final = 10
"""In a row that bring less than `PROGRESS_BYTES`; a transfer that goes on may break any number of times."""
_MAX_CHANGES: Final = 2
PROGRESS_BYTES: Final = 65_536
"""What a source must bring within `Collection.slow_s`, and in an attempt that counts; less is a stall."""
MAX_COLLECTION_GB: Final = 50.0
BYTES_PER_GB: Final = 10**9
_RESERVE_BYTES: Final = 10**9
"""Left free on the disk that takes the logs."""


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
    max_bytes: int = int(MAX_COLLECTION_GB * BYTES_PER_GB)
    """Of all logs together."""
    slow_s: float = 60.0
    """Within which a source must bring `PROGRESS_BYTES`."""
    origins: dict[str, str] = field(default_factory=dict)
    """The source of each log, by name."""
    _n_received: int = 0
    _n_changes: Counter[str] = field(default_factory=Counter)

    async def fetch_all(self, source: Source) -> None:
        """Fetch the logs of a source, from where an earlier transfer stopped; raises `DataError` and `PeerError`.

        A transfer that breaks is continued, unless several attempts in a row bring next to nothing. A source may be
        hostile: size, rate and number of attempts are bounded. Oracle: sources that lie, trickle and break by turns,
        tests/deploy/hosts/test_transfer.
        """
        n_tries = 0
        while True:
            n_before = self._n_received
            try:
                return await self._fetch_once(source)
            except PeerError:
                n_tries = n_tries + 1 if self._n_received - n_before < PROGRESS_BYTES else 1
                if n_tries >= _MAX_TRIES:
                    raise
                await asyncio.sleep(self.pause_s)

    async def _fetch_once(self, source: Source) -> None:
        changed = True
        while changed:
            changed = False
            logs = await source.offered(self._parts())
            self._check_size(logs, source.place)
            for offered in logs:
                self._check_origin(offered, source.place)
                held = self._held(offered.name)
                fetch = plan_fetch(offered, held)
                if fetch is None:
                    self.told(f"{offered.name} is here already")
                    continue
                if fetch.begin < held.n_part_bytes:
                    self._note_change(fetch.log, source.place)
                if not await self._fetch(source, fetch):
                    self._note_change(fetch.log, source.place)
                    changed = True

    def _note_change(self, log: OfferedLog, place: str) -> None:
        """Count a log that begins anew; raises `DataError` for one that never is what was offered."""
        self._n_changes[log.name] += 1
        if self._n_changes[log.name] > _MAX_CHANGES:
            raise DataError(Fault(place, log.name, "its logs change while they are fetched: try again"))

    async def _fetch(self, source: Source, fetch: Fetch) -> bool:
        """Fetch one log; False if it proved not to be what was offered, so that it has to start anew."""
        log, part = fetch.log, self.folder / f"{fetch.log.name}{PART}"
        begin, done = fetch.begin, fetch.begin
        with file_faults(part, "cannot be written"), part.open("r+b" if begin else "wb") as file:
            file.seek(begin)
            file.truncate()
            blocks = source.read(log.name, begin, log.n_bytes) if begin < log.n_bytes else _nothing()
            async for block in self._in_time(blocks, Fault(source.place, log.name, "")):
                done += len(block)
                self._n_received += len(block)
                if done > log.n_bytes:
                    raise DataError(Fault(source.place, log.name, "sends more than it offered"))
                file.write(block)
                file.flush()  # what is here stays here, however this ends
        if done < log.n_bytes:
            raise PeerError(
                Fault(source.place, log.name, f"the transfer stopped after {done} of {log.n_bytes} bytes")
            )
        with file_faults(part, "cannot be written"):
            if digest_of(part) != log.sha256:
                part.unlink()
                return False
            part.replace(self.folder / log.name)
        went_on = f", continued after {begin} bytes" if begin else ""
        self.told(f"{log.name} from {source.place}: {log.n_bytes} bytes{went_on}")
        return True

    async def _in_time(self, blocks: AsyncIterator[bytes], at: Fault) -> AsyncIterator[bytes]:
        """Yield blocks as long as they bring `PROGRESS_BYTES` within `slow_s`; raises `PeerError`."""
        loop, n_bytes = asyncio.get_running_loop(), 0
        until_s = loop.time() + self.slow_s
        while True:
            try:
                async with asyncio.timeout_at(until_s):
                    block = await anext(blocks)
            except StopAsyncIteration:
                return
            except TimeoutError:
                rule = f"brought less than {PROGRESS_BYTES} bytes in {self.slow_s:g} s"
                raise PeerError(Fault(at.where, at.field, rule)) from None
            yield block
            n_bytes += len(block)
            if n_bytes >= PROGRESS_BYTES:
                n_bytes, until_s = 0, loop.time() + self.slow_s

    def _check_size(self, logs: Sequence[OfferedLog], place: str) -> None:
        """Raise `DataError` where the logs do not fit the collection or its disk, before a byte of them is read."""
        offered = {log.name: log.n_bytes for log in logs}
        with file_faults(self.folder, "cannot be written"):
            here = {name: (self.folder / name).stat().st_size for name in log_names(self.folder)}
            n_free = shutil.disk_usage(self.folder).free - _RESERVE_BYTES
        parts = self._parts()
        n_offered, n_missing = sum(offered.values()), 0
        for name, n_bytes in offered.items():
            n_missing += 0 if here.get(name) == n_bytes else n_bytes - parts.get(name, 0)
        gb = n_offered / BYTES_PER_GB
        if sum((here | offered).values()) > self.max_bytes:
            most = self.max_bytes / BYTES_PER_GB
            rule = f"offers {gb:.2f} GB, and the logs together may have {most:g}: raise it with --max-gb"
            raise DataError(Fault(place, "", rule))
        if n_missing > n_free:
            rule = f"offers {gb:.2f} GB, and {self.folder} has {max(n_free, 0) / BYTES_PER_GB:.2f} GB free"
            raise DataError(Fault(place, "", rule))

    def _parts(self) -> dict[str, int]:
        parts = self.folder.glob(f"*{PART}")
        return {part.name.removesuffix(PART): min(part.stat().st_size, MAX_LOG_BYTES) for part in parts}

    def _held(self, name: str) -> Held:
        whole, part = self.folder / name, self.folder / f"{name}{PART}"
        with file_faults(whole, "cannot be written"):
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
