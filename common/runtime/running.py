"""The runs and emulators that are in progress on this machine, so that another command of the same user finds them.

Each is a file of its process below the user's run-time folder; one whose process is gone is stale and removed.
"""

import json
import os
import socket
import stat
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final, NamedTuple

from tis.common.zenoh_syntax import endpoint_fault

WEST: Final = "tcp/127.0.0.1:7447"
EAST: Final = "tcp/127.0.0.1:7448"
"""Endpoints of an emulator that nobody has named."""

ALONE: Final = "tis netem"
"""Title of an emulator that runs by itself."""

UNKNOWN: Final = "an emulator"
"""Title of what listens where an emulator usually does, and has announced nothing."""

_PRIVATE: Final = 0o700
_SUFFIX: Final = ".json"
_MAX_BYTES: Final = 4096
_TIME_OUT_S: Final = 0.2


class Running(NamedTuple):
    """An emulator in progress: its endpoints, the prefix of its control keys, and what runs there."""

    west: str = WEST
    east: str = EAST
    session: str = "tis"
    title: str = UNKNOWN

    def named_by(self, options: Sequence[str]) -> str:
        """Return what runs there, with the words that name it to a command that has these options, west and east."""
        ends = " ".join(f"{option} {end}" for option, end in zip(options, (self.west, self.east), strict=False))
        return f"{self.title} ({ends} --prefix {self.session})"


def _folders() -> Iterator[Path]:
    """Yield the folders in which sessions announce themselves, the usual one first."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime:
        yield Path(runtime) / "tis"
    yield Path(tempfile.gettempdir()) / f"tis-{os.getuid()}"


def _is_own(folder: Path) -> bool:
    """Tell whether a folder is the user's own and nobody else's: others could name endpoints of theirs."""
    found = folder.lstat()
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and stat.S_IMODE(found.st_mode) == _PRIVATE


@contextmanager
def announced(running: Running) -> Iterator[None]:
    """Let other commands of this user find a session during the block; where no folder can be had, they do not."""
    file = None
    for folder in _folders():
        with suppress(OSError):
            folder.mkdir(mode=_PRIVATE, exist_ok=True)
            if _is_own(folder):
                file = folder / f"{os.getpid()}{_SUFFIX}"
                partial = file.with_suffix(".part")
                partial.write_text(json.dumps(running._asdict()), encoding="utf-8")
                partial.replace(file)
                break
    try:
        yield
    finally:
        if file is not None:
            with suppress(OSError):
                file.unlink()


def sessions() -> list[Running]:
    """Return what is in progress on this machine: what this user's processes announce, and an unnamed emulator."""
    found = [running for folder in _folders() for running in _announced_in(folder)]
    places = {place for running in found for place in (running.west, running.east)}
    return found if WEST in places or not _is_open(WEST) else [*found, Running()]


def _announced_in(folder: Path) -> Iterator[Running]:
    try:
        files = sorted(folder.glob(f"*{_SUFFIX}")) if _is_own(folder) else []
    except OSError:
        return
    for file in files:
        with suppress(OSError):
            if not _is_alive(file.stem):
                file.unlink()
            elif (running := _read(file)) is not None:
                yield running


def _is_alive(pid: str) -> bool:
    try:
        os.kill(int(pid), 0)
    except PermissionError:
        return True
    except (ValueError, OverflowError, ProcessLookupError):
        return False
    return True


def _read(file: Path) -> Running | None:
    """Return what a file announces; None if it is none of ours."""
    try:
        found = json.loads(file.read_bytes()[:_MAX_BYTES])
        running = Running(**found)
    except (ValueError, TypeError):
        return None
    sound = all(isinstance(value, str) for value in running)
    return running if sound and not (endpoint_fault(running.west) or endpoint_fault(running.east)) else None


def _is_open(endpoint: str) -> bool:
    """Tell whether something listens on a TCP endpoint of loopback."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    try:
        with socket.create_connection((host, int(port)), _TIME_OUT_S):
            return True
    except OSError:
        return False
