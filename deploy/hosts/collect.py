"""`tis collect` over the hosts of a hosts file: the logs of a run whose terminal died, or that is still to end."""

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path

from rich.console import Console

from tis.common.errors import DataError, Fault
from tis.common.runtime.scenario_files import RUNS
from tis.deploy.hosts.connections import hosts_of
from tis.deploy.hosts.gather import gather_logs, newest_run
from tis.deploy.hosts.hosts_file import read_plan
from tis.deploy.run.conclude import Outputs, conclude_again


def collect_from_hosts(
    file: Path, run: str | None, run_dir: Path | None, outputs: Outputs, out: Console, err: Console
) -> int:
    """Fetch the logs of a run, by default the newest of all hosts, and summarise them; return the exit code.

    Raises the faults of hosts that cannot be reached. The logs of the others are fetched where ``run`` is given.
    """
    hosts = hosts_of(read_plan(file))

    async def fetch() -> Path:
        async with AsyncExitStack() as stack:
            for one in hosts:
                stack.push_async_callback(one.host.close)
            name = run or await newest_run(hosts)
            path = collection_folder(run_dir or RUNS / name)
            await gather_logs(hosts, name, path, told_on(err))
            return path

    return conclude_again(asyncio.run(fetch()), out, outputs)


def collection_folder(path: Path) -> Path:
    """Make the folder of a collection, which may hold a part of it already; raises `DataError`."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(Fault(str(path), "", f"cannot be created: {error.strerror}")) from None
    return path


def told_on(err: Console) -> Callable[[str], None]:
    """Return the function that prints a line for each log."""
    return lambda text: err.print(text, style="dim", markup=False, soft_wrap=True)
