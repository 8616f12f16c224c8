"""`tis up`: one run of the three sides on their hosts, each under watch, and its logs in one folder."""

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from tis.common.channels import Side
from tis.common.errors import EXIT_INTERRUPTED, EXIT_OK, PeerError, TisError
from tis.common.runtime.process import Interrupt, command_line
from tis.common.runtime.run_folders import RUNS, run_folder
from tis.common.scenario import reading
from tis.deploy.hosts.collect import gather_logs, told_on
from tis.deploy.hosts.connections import connect_and_check, hosts_of
from tis.deploy.hosts.host import RemoteProcess, SideHost, cancelled
from tis.deploy.hosts.hosts_file import Plan, read_plan
from tis.deploy.hosts.panel import PanelState, PanelView
from tis.deploy.hosts.protocol import ALIVE, ALIVE_EVERY_S, INTERRUPT, RunRequest, event_in
from tis.deploy.run.conclude import Ending, Outputs, conclude
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import print_faults
from tis.deploy.shell.outcome import Event, Outcome, SideEnd, outcome_of, reasons_of

MAX_RESTARTS: Final = 5
_AFTER_INTERRUPT_S: Final = 10.0
_LAST_WORDS_S: Final = 2.0
_MAX_EVENTS: Final = 1000
_MAX_LAST_LINES: Final = 5


@dataclass
class SideWatch:
    """The life of a side on its host, with new starts where the hosts file allows them.

    ``on_event`` receives its events, and those of the watch: restarted, gone.
    """

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

    async def interrupt(self, after_s: float = 0.0) -> None:
        """Ask the side to end; a host that does not obey loses its connection, which ends the side, too."""
        self.is_ending = True
        await asyncio.sleep(after_s)
        process = self._process
        if process is None:
            return
        self._was_interrupted = True
        self.on_event({"side": self.side, "event": "ending"})
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


_OTHERS_END_S: Final = 2.5


async def watch_all(
    watches: dict[Side, SideWatch], bell: asyncio.Event, tolerates_failures: Callable[[], bool]
) -> dict[Side, SideEnd]:
    """Return the ends of all sides. Ctrl-C ends them; so does a failed one, unless the run tolerates that."""
    sides = {asyncio.create_task(watch.run()): side for side, watch in watches.items()}
    rung = asyncio.create_task(bell.wait())
    ending: list[asyncio.Task[None]] = []
    ends: dict[Side, SideEnd] = {}

    def end_all(after_s: float) -> None:
        if not ending:
            ending.extend(asyncio.create_task(watch.interrupt(after_s)) for watch in watches.values())

    try:
        while len(ends) < len(sides):
            waiting: list[asyncio.Task[Any]] = [task for task, side in sides.items() if side not in ends]
            waiting += [] if rung.done() else [rung]
            done, _ = await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
            ends |= {side: task.result() for task, side in sides.items() if task in done}
            if rung in done:
                for later in ending:
                    later.cancel()
                ending.clear()
                end_all(0)
            elif any(end.exit_code != EXIT_OK for end in ends.values()) and not tolerates_failures():
                end_all(_OTHERS_END_S)  # they see it themselves and say why they end
    finally:
        left: list[asyncio.Task[Any]] = [*sides, rung, *ending]
        for task in left:
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)
    return ends


@dataclass(frozen=True)
class _Finished:
    """What a run left behind: how it ended, whether it began, and the faults of the collection."""

    outcome: Outcome
    has_begun: bool
    not_fetched: TisError | None


def up(
    file: Path, run_dir: Path | None, wait_s: float, insecure: bool, outputs: Outputs, out: Console, err: Console
) -> int:
    """Make one run on the hosts of a file; return the exit code. Raises `TisError` before anything starts.

    ``run_dir`` is the run's folder here, ``wait_s`` the patience of the sides, ``insecure`` netem's.
    """
    plan = read_plan(file)
    hosts = hosts_of(plan)
    name = run_folder(RUNS, plan.scenario.name).name
    path = run_dir or RUNS / name
    interrupt = Interrupt()
    with interrupt.installed():
        finished = asyncio.run(_Run(plan, hosts, name, path, wait_s, insecure, interrupt, err).make())
    if finished is None:
        return EXIT_INTERRUPTED
    outcome = finished.outcome
    print_faults(err, *outcome.reasons)
    if finished.not_fetched is not None:
        print_faults(err, *map(str, finished.not_fetched.faults))
        words = ["collect", str(file), "--run", name, "--run-dir", str(path)]
        err.print(escape(f"{command_line(words)} continues the collection"), soft_wrap=True)
    if outcome.exit_code != EXIT_OK and not finished.has_begun:
        if finished.not_fetched is None:
            folder.remove_unused(path)
        return outcome.exit_code
    ending = Ending("live", command_line(), outcome.exit_code, outcome.exit_codes)
    code = conclude(path, plan.scenario, ending, out, outputs)
    return outcome.exit_code or (0 if finished.not_fetched is None else finished.not_fetched.exit_code) or code


@dataclass(frozen=True)
class _Run:
    """A run to make: its hosts, its name there, and its folder here."""

    plan: Plan
    hosts: list[SideHost]
    name: str
    path: Path
    wait_s: float
    insecure: bool
    interrupt: Interrupt
    err: Console

    async def make(self) -> _Finished | None:
        """Check, run and collect; None when interrupted before anything was started."""
        bell = _bell(self.interrupt)
        async with AsyncExitStack() as stack:
            self.err.print("connecting and checking the hosts", style="dim")
            checked = asyncio.create_task(connect_and_check(stack, self.hosts, self.plan))
            if not await _done_before(checked, bell):
                return None
            await checked
            folder.create(self.path, self.plan.scenario)
            outcome, has_begun = await self._run_sides(bell)
            not_fetched = None
            if has_begun:
                fetching = asyncio.create_task(gather_logs(self.hosts, self.name, self.path, told_on(self.err)))
                bell.clear()  # a second Ctrl-C ends the collection, which can be continued
                if not await _done_before(fetching, bell):
                    reasons = (*outcome.reasons, "the collection was interrupted")
                    return _Finished(Outcome(EXIT_INTERRUPTED, reasons, outcome.exit_codes), has_begun, None)
                try:
                    await fetching
                except TisError as error:
                    not_fetched = error
            return _Finished(outcome, has_begun, not_fetched)

    async def _run_sides(self, bell: asyncio.Event) -> tuple[Outcome, bool]:
        """Run the sides until all have ended; return the outcome, and whether the run began."""
        scenario = self.plan.scenario
        panel = PanelState({one.side: one.host.place for one in self.hosts}, scenario.duration_s)
        view = PanelView(self.err, panel, scenario.name)
        text = reading.dump_scenario(scenario)
        watches: dict[Side, SideWatch] = {}
        for one in sorted(self.hosts, key=lambda one: one.side != "netem"):  # netem first: the others wait for it
            request = RunRequest(
                folder=one.settings.folder, side=one.side, scenario=text, run=self.name, wait_s=self.wait_s,
                insecure=self.insecure and one.side == "netem",
            )  # fmt: skip
            watches[one.side] = SideWatch(one, request, view.take, panel.goes_on)
        ends_all = scenario.peer_loss_policy(True) == "end"
        view.start()
        try:
            ends = await watch_all(watches, bell, lambda: panel.has_begun and not ends_all)
        finally:
            view.stop()
        return outcome_of(ends, self.interrupt.requested), panel.has_begun


def _bell(interrupt: Interrupt) -> asyncio.Event:
    """Return an event that Ctrl-C sets."""
    bell, loop = asyncio.Event(), asyncio.get_running_loop()

    def ring() -> None:
        loop.call_soon_threadsafe(bell.set)

    interrupt.wakers.append(ring)
    if interrupt.requested:
        bell.set()
    return bell


async def _done_before(task: "asyncio.Task[None]", bell: asyncio.Event) -> bool:
    """Wait for a task or the bell; a task that the bell beats is cancelled."""
    rung = asyncio.create_task(bell.wait())
    await asyncio.wait([task, rung], return_when=asyncio.FIRST_COMPLETED)
    rung.cancel()
    if task.done():
        return True
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    return False
