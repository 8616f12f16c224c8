"""One side on its host: start, signs of life, end, and a new start where the hosts file allows it."""

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from tis.common.channels import Side
from tis.common.errors import EXIT_OK, PeerError
from tis.deploy.hosts.host import RemoteProcess, SideHost, cancelled
from tis.deploy.hosts.protocol import ALIVE, ALIVE_EVERY_S, INTERRUPT, RunRequest, event_in
from tis.deploy.shell.outcome import Event, SideEnd, reasons_of

MAX_RESTARTS: Final = 5
_AFTER_INTERRUPT_S: Final = 10.0
_LAST_WORDS_S: Final = 2.0
_MAX_EVENTS: Final = 1000
_MAX_LAST_LINES: Final = 5


@dataclass
class SideWatch:
    """The life of a side; ``on_event`` receives its events, and those of the watch: restarted, gone."""

    host: SideHost
    request: RunRequest
    on_event: Callable[[Event], None]
    goes_on: Callable[[Side], bool]
    """Whether the run still goes on for a side: only then it is started again."""
    is_ending: bool = False
    n_restarts: int = 0
    _process: RemoteProcess | None = None
    _events: list[Event] = field(default_factory=list)
    _output: deque[str] = field(default_factory=lambda: deque(maxlen=_MAX_LAST_LINES))
    _progress: Event | None = None
    _exit_code: int | None = None
    _was_interrupted: bool = False

    @property
    def side(self) -> Side:
        """The side."""
        return self.host.side

    async def run(self) -> SideEnd:
        """Run the side to its end, its last if it is started again."""
        while True:
            end = await self._run_once()
            died = self._exit_code not in (None, EXIT_OK) and self.goes_on(self.side) and not self.is_ending
            if not (self.host.settings.restart and died and self.n_restarts < MAX_RESTARTS):
                return end
            self.n_restarts += 1
            self.on_event({"side": self.side, "event": "restarted", "n": self.n_restarts, "code": end.exit_code})

    async def interrupt(self) -> None:
        """Ask the side to end; a host that does not obey loses its connection, which ends the side, too."""
        self.is_ending = True
        process = self._process
        if process is None:
            return
        self._was_interrupted = True
        with contextlib.suppress(PeerError):
            await process.send(f"{INTERRUPT}\n".encode())
        await asyncio.sleep(_AFTER_INTERRUPT_S)
        if self._process is process:
            process.kill()

    async def _run_once(self) -> SideEnd:
        self._events.clear()
        self._output.clear()
        self._progress = self._exit_code = None
        try:
            process = self._process = await self.host.request(self.request)
        except PeerError as error:
            return SideEnd(self.side, PeerError.exit_code, [str(fault) for fault in error.faults])
        beside = [asyncio.create_task(process.keep_errors()), asyncio.create_task(_stay_alive(process))]
        try:
            async for line in process.lines():
                event = event_in(line, self.side)
                if event is not None:
                    self._take(event)
            return await self._end(process, beside[0])
        finally:
            self._process = None
            await cancelled(*beside)
            await process.end()

    def _take(self, event: Event) -> None:
        if event["event"] == "output":
            self._output.append(event["text"])
        elif event["event"] == "exit":
            self._exit_code = event["code"]
        elif event["event"] == "progress":
            self._progress = event
        elif len(self._events) < _MAX_EVENTS:
            self._events.append(event)
        self.on_event(event)

    async def _end(self, process: RemoteProcess, errors: "asyncio.Task[None]") -> SideEnd:
        if self._exit_code is None:  # it is the connection that is lost: the side may still live
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_LAST_WORDS_S):
                    await errors
            said = "; ".join(process.last_lines) or "the connection is lost, so the side ends there"
            self.on_event({"side": self.side, "event": "gone", "text": said})
            return SideEnd(self.side, PeerError.exit_code, (f"{self.host.place}: {said}",))
        if self._exit_code == EXIT_OK:
            return SideEnd(self.side, EXIT_OK)
        events = [*self._events, *filter(None, [self._progress])]
        reasons = tuple(reasons_of(events, self._output))
        return SideEnd(self.side, self._exit_code, reasons, self._was_interrupted)


async def _stay_alive(process: RemoteProcess) -> None:
    """Tell the host that this end lives, until the connection is lost."""
    with contextlib.suppress(PeerError):
        while True:
            await asyncio.sleep(ALIVE_EVERY_S)
            await process.send(f"{ALIVE}\n".encode())
