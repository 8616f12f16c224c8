"""`tis up`: the three sides on their hosts, one run of them, and its logs in one folder."""

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from tis.common.channels import Side
from tis.common.errors import EXIT_INTERRUPTED, EXIT_OK, TisError
from tis.common.runtime.process import Interrupt, command_line
from tis.common.runtime.scenario_files import RUNS, run_folder
from tis.common.scenario import reading
from tis.deploy.hosts.collect import gather_logs, told_on
from tis.deploy.hosts.connections import connect_and_check, hosts_of
from tis.deploy.hosts.host import SideHost
from tis.deploy.hosts.hosts_file import Plan, read_plan
from tis.deploy.hosts.panel import PanelState
from tis.deploy.hosts.panel_view import PanelView
from tis.deploy.hosts.protocol import RunRequest
from tis.deploy.hosts.side_watch import SideWatch
from tis.deploy.run.conclude import Ending, Outputs, conclude
from tis.deploy.shell import run_dir as folder
from tis.deploy.shell.guard import print_faults
from tis.deploy.shell.outcome import Outcome, SideEnd, outcome_of

# The three sides together: all run until all have ended, and an end that ends the others.

_OTHERS_END_S: Final = 2.5


async def watch_all(
    watches: dict[Side, SideWatch], bell: asyncio.Event, tolerates_failures: Callable[[], bool]
) -> dict[Side, SideEnd]:
    """Return the ends of all sides. Ctrl-C ends them; so does a failed one, unless the run tolerates that."""
    sides = {asyncio.create_task(watch.run()): side for side, watch in watches.items()}
    rung = asyncio.create_task(bell.wait())
    ending: list[asyncio.Task[None]] = []
    ends: dict[Side, SideEnd] = {}

    def end_all(delay_s: float) -> None:
        if not ending:
            ending.extend(asyncio.create_task(_interrupt(watch, delay_s)) for watch in watches.values())

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


async def _interrupt(watch: SideWatch, delay_s: float) -> None:
    watch.is_ending = True
    await asyncio.sleep(delay_s)
    await watch.interrupt()


@dataclass(frozen=True)
class UpOptions:
    """Options of the command: the run's folder here, the patience of the sides, and netem's ``--insecure``."""

    run_dir: Path | None = None
    wait_s: float = 120.0
    insecure: bool = False


@dataclass(frozen=True)
class _Finished:
    """What a run left behind: how it ended, whether it began, and the faults of the collection."""

    outcome: Outcome
    has_begun: bool
    not_fetched: TisError | None


def up(file: Path, options: UpOptions, outputs: Outputs, out: Console, err: Console) -> int:
    """Make one run on the hosts of a file; return the exit code. Raises `TisError` before anything starts."""
    plan = read_plan(file)
    hosts = hosts_of(plan)
    name = run_folder(RUNS, plan.scenario.name).name
    path = options.run_dir or RUNS / name
    interrupt = Interrupt()
    with interrupt.installed():
        finished = asyncio.run(_up(_Run(plan, hosts, name, path, options, interrupt, err)))
    if finished is None:
        return EXIT_INTERRUPTED
    outcome = finished.outcome
    print_faults(err, *outcome.reasons)
    if finished.not_fetched is not None:
        print_faults(err, *map(str, finished.not_fetched.faults))
        err.print(f"tis collect {file} --run {name} --run-dir {path} continues the collection", soft_wrap=True)
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
    options: UpOptions
    interrupt: Interrupt
    err: Console


async def _up(run: _Run) -> _Finished | None:
    """Check, run and collect; None when interrupted before anything was started."""
    bell = _bell(run.interrupt)
    async with AsyncExitStack() as stack:
        checked = asyncio.create_task(_checked(stack, run))
        if not await _done_before(checked, bell):
            return None
        await checked
        folder.create(run.path, run.plan.scenario)
        outcome, has_begun = await _run_sides(run, bell)
        not_fetched = None
        if has_begun:
            fetching = asyncio.create_task(gather_logs(run.hosts, run.name, run.path, told_on(run.err)))
            bell.clear()  # a second Ctrl-C ends the collection, which can be continued
            if not await _done_before(fetching, bell):
                return _Finished(_interrupted(outcome), has_begun, None)
            try:
                await fetching
            except TisError as error:
                not_fetched = error
        return _Finished(outcome, has_begun, not_fetched)


async def _checked(stack: AsyncExitStack, run: _Run) -> None:
    run.err.print("connecting and checking the hosts", style="dim")
    await connect_and_check(stack, run.hosts, run.plan)


async def _run_sides(run: _Run, bell: asyncio.Event) -> tuple[Outcome, bool]:
    """Run the sides until all have ended; return the outcome, and whether the run began."""
    scenario = run.plan.scenario
    panel = PanelState({one.side: one.host.place for one in run.hosts}, scenario.duration_s)
    view = PanelView(run.err, panel, scenario.name)
    text = reading.dump_scenario(scenario)
    watches: dict[Side, SideWatch] = {}
    for one in sorted(run.hosts, key=lambda one: one.side != "netem"):  # netem first: the others wait for it
        request = RunRequest(
            folder=one.settings.folder, side=one.side, scenario=text, run=run.name, wait_s=run.options.wait_s,
            insecure=run.options.insecure and one.side == "netem",
        )  # fmt: skip
        watches[one.side] = SideWatch(one, request, view.take, panel.goes_on)
    ends_all = scenario.peer_loss_policy(True) == "end"
    view.start()
    try:
        ends = await watch_all(watches, bell, lambda: panel.has_begun and not ends_all)
    finally:
        view.stop()
    return outcome_of(ends, run.interrupt.requested), panel.has_begun


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


def _interrupted(outcome: Outcome) -> Outcome:
    return Outcome(EXIT_INTERRUPTED, (*outcome.reasons, "the collection was interrupted"), outcome.exit_codes)
