"""A host on which `tis host` runs: one process for each request, whatever carries it there."""

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, TypeVar

from pydantic import BaseModel, ValidationError

from tis.common.channels import Side
from tis.common.errors import Fault, PeerError
from tis.deploy.hosts.hosts_file import AnyHost
from tis.deploy.hosts.log_offer import OfferedLog
from tis.deploy.hosts.protocol import (
    MAX_LINE_BYTES,
    AnyRequest,
    ListAnswer,
    ListRequest,
    ReadRequest,
    line_of,
    printable,
)

Answer = TypeVar("Answer", bound=BaseModel)

_BLOCK_BYTES: Final = 1 << 16
_MAX_ANSWER_BYTES: Final = 1 << 24
_MAX_ERROR_LINES: Final = 5
_GONE_S: Final = 5.0
ANSWER_S: Final = 60.0
"""Time for an answer; the check of a scenario may read recordings and load own estimators."""


class Reader(Protocol):
    """An output of a process, of asyncio's or asyncssh's."""

    async def read(self, n: int = -1, /) -> bytes:
        """Return up to ``n`` bytes, none at the end."""


class Writer(Protocol):
    """The input of a process, of asyncio's or asyncssh's."""

    def write(self, data: bytes, /) -> None:
        """Send bytes."""

    async def drain(self) -> None:
        """Wait until they are under way."""

    def close(self) -> None:
        """End the input."""


@dataclass
class RemoteProcess:
    """A process on a host: its streams, how to wait for its exit code, and how to kill it."""

    stdin: Writer
    stdout: Reader
    stderr: Reader
    exit_code: Callable[[], Coroutine[Any, Any, int | None]]
    kill: Callable[[], None]
    last_lines: deque[str] = field(default_factory=lambda: deque(maxlen=_MAX_ERROR_LINES))

    async def send(self, data: bytes) -> None:
        """Send bytes; raises `PeerError` when the connection is gone."""
        try:
            self.stdin.write(data)
            await self.stdin.drain()
        except Exception as error:
            raise PeerError(Fault("", "", f"connection lost: {printable(str(error))}")) from None

    async def end(self) -> None:
        """Kill the process, if it still runs, and wait until it is gone."""
        self.kill()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_GONE_S):
                for output in (self.stdout, self.stderr):
                    while await _read(output):
                        pass
                self.stdin.close()
                await self.exit_code()

    async def lines(self) -> AsyncIterator[bytes]:
        """Yield the lines of the output; of a line that is too long nothing. Ends when the connection is gone."""
        rest, is_skipped = b"", False
        while block := await _read(self.stdout):
            *whole, rest = (rest + block).split(b"\n")
            for line in whole:
                if not is_skipped and len(line) <= MAX_LINE_BYTES:
                    yield line
                is_skipped = False
            if len(rest) > MAX_LINE_BYTES:
                rest, is_skipped = b"", True

    async def keep_errors(self) -> None:
        """Read what the process says on its error output, and keep the last lines."""
        text = b""
        while block := await _read(self.stderr):
            *whole, text = (text + block).split(b"\n")
            self.last_lines.extend(filter(None, (printable(line.decode("utf-8", "replace")) for line in whole)))
            text = text[-MAX_LINE_BYTES:]
        if text.strip():
            self.last_lines.append(printable(text.decode("utf-8", "replace")))


class Host(Protocol):
    """A way to start `tis` on a host."""

    @property
    def place(self) -> str:
        """The host in words."""

    async def open(self) -> None:
        """Connect; raises `PeerError` and `InputError`."""

    async def start(self, *words: str) -> RemoteProcess:
        """Start ``tis`` with these words, and connect before if need be; raises `TisError`."""

    async def close(self) -> None:
        """End the connection."""


@dataclass(frozen=True)
class SideHost:
    """The host of a side, as the hosts file describes it, and the way there."""

    side: Side
    settings: AnyHost
    host: Host

    @property
    def place(self) -> str:
        """The side and its host in words."""
        return f"{self.side} on {self.host.place}"

    def fault(self, rule: str) -> PeerError:
        """Return an error of this host."""
        return PeerError(Fault(self.side, self.host.place, rule))

    async def said(self, *words: str) -> str:
        """Return what ``tis`` with these words prints; raises `PeerError`."""
        return (await self._output(words, b"")).decode("utf-8", "replace")

    async def answer(self, request: AnyRequest, model: type[Answer], wait_s: float = ANSWER_S) -> Answer:
        """Return the answer to a request; raises `PeerError`."""
        line = await self._output(("host",), line_of(request), wait_s)
        try:
            return model.model_validate_json(line)
        except ValidationError:
            raise self.fault("its answer is not of this version of tis") from None

    async def request(self, request: AnyRequest) -> RemoteProcess:
        """Start the execution of a request, whose input stays open; raises `PeerError`."""
        process = await self.host.start("host")
        try:
            await process.send(line_of(request))
        except PeerError as error:
            raise self.fault(error.faults[0].rule) from None
        return process

    async def _output(self, words: tuple[str, ...], line: bytes, wait_s: float = ANSWER_S) -> bytes:
        process = await self.host.start(*words)
        errors = asyncio.create_task(process.keep_errors())
        try:
            async with asyncio.timeout(wait_s):
                with contextlib.suppress(PeerError):  # it ended without reading; its error output says why
                    await process.send(line)
                output = bytearray()
                while (block := await _read(process.stdout)) and len(output) <= _MAX_ANSWER_BYTES:
                    output += block
                await errors
                code = await process.exit_code()
        except TimeoutError:
            raise self.fault(f"does not answer within {wait_s:g} s") from None
        finally:
            await cancelled(errors)
            await process.end()
        if code != 0:
            reason = "; ".join(process.last_lines) or "without a reason"
            raise self.fault(f"`{self.settings.tis} {' '.join(words)}` failed: {reason}")
        return bytes(output)


@dataclass(frozen=True)
class HostLogs:
    """The logs of a run on a side's host, as a source of a collection."""

    host: SideHost
    run: str

    @property
    def place(self) -> str:
        """The source in words."""
        return self.host.place

    async def offered(self, parts: Mapping[str, int]) -> list[OfferedLog]:
        """Return the side's own logs; raises `PeerError`."""
        folder, side = self.host.settings.folder, self.host.side
        own = {name: size for name, size in parts.items() if name.startswith(side)}
        request = ListRequest(folder=folder, side=side, run=self.run, parts=own)
        answer = await self.host.answer(request, ListAnswer, 10 * ANSWER_S)  # it reads every byte for the SHA-256
        return [log for log in answer.logs if log.name.startswith(side)]

    async def read(self, name: str, begin: int, end: int) -> AsyncIterator[bytes]:
        """Yield bytes of a log; raises `PeerError`."""
        folder, side = self.host.settings.folder, self.host.side
        request = ReadRequest(folder=folder, side=side, run=self.run, name=name, begin=begin, end=end)
        process = await self.host.request(request)
        errors = asyncio.create_task(process.keep_errors())
        try:
            while block := await _read(process.stdout):
                yield block
        finally:
            await cancelled(errors)
            await process.end()


async def cancelled(*tasks: "asyncio.Task[None]") -> None:
    """Cancel tasks and wait until they have ended."""
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _read(reader: Reader) -> bytes:
    """Return the next bytes, none at the end, also when the connection breaks."""
    try:
        return await reader.read(_BLOCK_BYTES)
    except asyncio.CancelledError:
        raise
    except Exception:  # asyncssh's errors; a break is seen by what is missing
        return b""
