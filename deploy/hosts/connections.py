"""Connections to the three hosts, and what is checked on all of them before anything starts."""

import asyncio
import contextlib
import os
import shlex
import shutil
import signal
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AsyncExitStack
from dataclasses import replace
from typing import Final, get_args

from tis.common.channels import Side
from tis.common.errors import Fault, InputError, PeerError, TisError
from tis.common.extras import GET_HOSTS
from tis.common.runtime.clock import SKEW_VARIABLE
from tis.common.scenario import reading
from tis.deploy.hosts.host import Host, RemoteProcess, SideHost
from tis.deploy.hosts.hosts_file import LocalHost, NamespaceHost, Plan
from tis.deploy.hosts.protocol import CheckAnswer, CheckRequest, printable
from tis.deploy.shell.guard import can_ssh, version_text

# Hosts on this machine: a network namespace, or the machine itself.

_NO_IP: Final = "/usr/sbin/ip"


class ProcessHost:
    """Starts `tis` as a process of this machine."""

    def __init__(self, settings: NamespaceHost | LocalHost) -> None:
        self.place = settings.place
        self._words = [*_prefix(settings), *(os.path.expanduser(word) for word in shlex.split(settings.tis))]  # noqa: PTH111
        self._skew = {} if settings.clock_skew is None else {SKEW_VARIABLE: settings.clock_skew}

    async def open(self) -> None:
        """Nothing has to be connected."""

    async def start(self, *words: str) -> RemoteProcess:
        """Start ``tis``; raises `PeerError`."""
        pipe = asyncio.subprocess.PIPE
        try:
            # A session of its own: Ctrl-C reaches `tis up` only, which then ends the sides in order.
            process = await asyncio.create_subprocess_exec(
                *self._words, *words, stdin=pipe, stdout=pipe, stderr=pipe, start_new_session=True,
                env={**os.environ, **self._skew},
            )  # fmt: skip
        except OSError as error:
            rule = f"`{self._words[0]}` cannot be started: {error.strerror}"
            raise PeerError(Fault(self.place, "", rule)) from None
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None

        def kill() -> None:
            # not process.kill(): it polls, and so takes the exit code from asyncio, which then warns
            if process.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process.pid, signal.SIGKILL)

        return RemoteProcess(process.stdin, process.stdout, process.stderr, process.wait, kill)

    async def close(self) -> None:
        """Nothing is connected."""


def _prefix(settings: NamespaceHost | LocalHost) -> Sequence[str]:
    if settings.kind == "local":
        return ()
    return (shutil.which("ip") or _NO_IP, "netns", "exec", settings.namespace)


def hosts_of(plan: Plan) -> list[SideHost]:
    """Return the hosts of the three sides, not connected yet; raises `InputError` without asyncssh."""
    by_ssh = [side for side in get_args(Side) if plan.hosts.of(side).kind == "ssh"]
    if by_ssh and not can_ssh():
        rule = f"needs the package asyncssh: {GET_HOSTS}"
        raise InputError([Fault(str(plan.file), f"{side}.kind", rule, "ssh") for side in by_ssh])
    return [SideHost(side, plan.hosts.of(side), _host(plan, side)) for side in get_args(Side)]


async def connect_and_check(stack: AsyncExitStack, hosts: Sequence[SideHost], plan: Plan) -> None:
    """Connect to all hosts at once and check them; raises the faults of all.

    Versions, working folders, and the files that the scenario names are checked.
    """
    scenario = reading.dump_scenario(plan.scenario)

    async def both(one: SideHost) -> None:
        await _open(stack, one)
        await _check(one, scenario)

    await at_all(hosts, both)


async def _open(stack: AsyncExitStack, one: SideHost) -> None:
    await one.host.open()
    stack.push_async_callback(one.host.close)


async def _check(one: SideHost, scenario: str) -> None:
    request = CheckRequest(folder=one.settings.folder, side=one.side, scenario=scenario)
    try:
        answer = await one.answer(request, CheckAnswer)
    except PeerError:
        _check_version(one, await one.said("--version"))  # another version need not know the request
        raise
    _check_version(one, answer.version)
    if answer.faults:
        raise PeerError([Fault(one.side, one.host.place, printable(text)) for text in answer.faults])


async def at_all(hosts: Sequence[SideHost], act: Callable[[SideHost], Awaitable[None]]) -> None:
    """Act on all hosts at once; raises one error with the faults of all, each with its side."""
    ends = await asyncio.gather(*(act(one) for one in hosts), return_exceptions=True)
    found: list[Fault] = []
    kind: type[TisError] = PeerError
    for one, end in zip(hosts, ends, strict=True):
        if isinstance(end, TisError):
            kind = type(end)
            found += [_of_side(fault, one.side) for fault in end.faults]
        elif isinstance(end, BaseException):
            raise end
    if found:
        raise kind(found) if len({*map(type, filter(None, ends))}) == 1 else PeerError(found)


def _check_version(one: SideHost, found: str) -> None:
    """Raise `PeerError` unless a host has this version of `tis` and of Zenoh."""
    own, there = version_text(), printable(found)
    if there != own:
        raise one.fault(f"must run the same versions as this host: {own}; it has {there or 'no tis'}")


def _of_side(fault: Fault, side: Side) -> Fault:
    if fault.where == side:
        return fault
    return replace(fault, where=side, field=": ".join(part for part in (fault.where, fault.field) if part))


def _host(plan: Plan, side: Side) -> Host:
    settings = plan.hosts.of(side)
    if settings.kind != "ssh":
        return ProcessHost(settings)
    from tis.deploy.hosts.ssh_host import Ssh  # an extra

    key = None if settings.key is None else plan.local_file(settings.key)
    return Ssh(settings, key, plan.local_file(settings.known_hosts))
