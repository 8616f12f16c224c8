"""Connections to the three hosts, and what is checked on all of them before anything starts."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AsyncExitStack
from dataclasses import replace
from typing import get_args

from common.channels import Side
from common.errors import Fault, InputError, PeerError, TisError
from common.extras import GET_HOSTS
from common.scenario import reading
from deploy.hosts.host import Host, SideHost
from deploy.hosts.hosts_file import Plan
from deploy.hosts.process_host import ProcessHost
from deploy.hosts.protocol import CheckAnswer, CheckRequest, printable
from deploy.shell.extras import can_ssh
from deploy.shell.version import version_text


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
    from deploy.hosts.ssh_host import Ssh  # an extra

    key = None if settings.key is None else plan.local_file(settings.key)
    return Ssh(settings, key, plan.local_file(settings.known_hosts))
