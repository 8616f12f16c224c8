"""Collection of a run's logs from the hosts of its sides."""

from collections.abc import Callable, Sequence
from pathlib import Path

from tis.common.errors import DataError, Fault
from tis.deploy.hosts.connections import at_all
from tis.deploy.hosts.host import HostLogs, SideHost
from tis.deploy.hosts.protocol import RunsAnswer, RunsRequest
from tis.deploy.hosts.transfer.fetch import Collection


async def gather_logs(hosts: Sequence[SideHost], run: str, folder: Path, told: Callable[[str], None]) -> None:
    """Fetch the logs of a run from all its hosts at once; raises the faults of all."""
    collection = Collection(folder, told)

    async def fetch(one: SideHost) -> None:
        await collection.fetch_all(HostLogs(one, run))

    await at_all(hosts, fetch)


async def newest_run(hosts: Sequence[SideHost]) -> str:
    """Return the newest run of which all hosts have a folder; raises `DataError` when there is none."""
    known: list[tuple[str, ...]] = []

    async def ask(one: SideHost) -> None:
        request = RunsRequest(folder=one.settings.folder, side=one.side)
        known.append((await one.answer(request, RunsAnswer)).runs)

    await at_all(hosts, ask)
    common = set(known[0]).intersection(*known[1:])
    found = [run for run in known[0] if run in common]
    if not found:
        some = sorted({run for runs in known for run in runs})[-3:]
        hint = f"; some hosts have {', '.join(some)}: name one with --run" if some else ""
        raise DataError(Fault("tis collect", "", f"there is no run of which all three hosts have logs{hint}"))
    return found[-1]
