"""`tis collect` over the hosts of a hosts file: the logs of a run whose terminal died, or that is still to end."""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Final, Literal, NamedTuple

from rich.console import Console

from tis.common.errors import DataError, Fault, InputError, file_faults
from tis.common.runtime.run_folders import RUNS
from tis.common.zenoh_syntax import endpoint_faults
from tis.deploy.hosts.connections import at_all, hosts_of
from tis.deploy.hosts.host import HostLogs, SideHost
from tis.deploy.hosts.hosts_file import read_plan
from tis.deploy.hosts.protocol import RUN_NAME, RunsAnswer, RunsRequest
from tis.deploy.hosts.transfer import BYTES_PER_GB, MAX_COLLECTION_GB, Collection
from tis.deploy.run.conclude import Outputs, conclude_again

_WHERE: Final = "tis collect"
_PROTOCOLS: Final = ("tcp", "tls", "quic", "ws", "udp", "unixsock-stream", "vsock", "serial")

Kind = Literal["hosts", "zenoh", "offer"]


class Asked(NamedTuple):
    """The options as typed."""

    sources: Sequence[str]
    offer: Path | None
    connect: Sequence[str]
    listen: Sequence[str]
    run: str | None


def check_options(asked: Asked) -> Kind:
    """Return which use is meant; raises `InputError` with all options that contradict each other."""
    sources = [source for source in asked.sources if not _is_endpoint(source)]
    found = endpoint_faults(_WHERE, {"--connect": asked.connect, "--listen": asked.listen, "ENDPOINT": _of(asked)})
    kind: Kind = "offer" if asked.offer is not None else "hosts" if sources else "zenoh"
    if kind == "offer":
        found += _rules({
            "--offer": ("must not stand beside sources", asked.sources),
            "--connect, --listen": ("one of both must be given with --offer", not (asked.connect or asked.listen)),
        })  # fmt: skip
    if kind == "hosts":
        others = len(asked.sources) > 1 or asked.listen
        found += _rules({"HOSTS_FILE": ("must be given alone, once", others)})
    if kind == "zenoh":
        found += _rules({"HOSTS_FILE": ("a hosts file, endpoints or --listen must be given", not _any(asked))})
    if kind != "offer" and asked.connect:
        found.append(Fault(_WHERE, "--connect", "is for --offer; a collector's endpoints stand without option"))
    if asked.run is not None and not RUN_NAME.fullmatch(asked.run):
        found.append(Fault(_WHERE, "--run", "must be the name of a run, such as 20260102_030405_default", asked.run))
    elif asked.run is not None and kind != "hosts":
        found.append(Fault(_WHERE, "--run", "is for a hosts file", asked.run))
    if asked.listen and (asked.connect or _of(asked)):
        found.append(Fault(_WHERE, "--listen", "must not stand beside endpoints to connect to"))
    if found:
        raise InputError(found)
    return kind


def _rules(broken: dict[str, tuple[str, object]]) -> list[Fault]:
    return [Fault(_WHERE, option, rule) for option, (rule, is_broken) in broken.items() if is_broken]


def _any(asked: Asked) -> bool:
    return bool(asked.sources or asked.listen)


def _of(asked: Asked) -> list[str]:
    return [source for source in asked.sources if _is_endpoint(source)]


def _is_endpoint(source: str) -> bool:
    return source.partition("/")[0] in _PROTOCOLS and "/" in source


async def gather_logs(
    hosts: Sequence[SideHost], run: str, folder: Path, told: Callable[[str], None], max_gb: float = MAX_COLLECTION_GB
) -> None:
    """Fetch the logs of a run from all its hosts at once; raises the faults of all."""
    collection = Collection(folder, told, max_bytes=int(max_gb * BYTES_PER_GB))

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


def collect_from_hosts(
    file: Path, run: str | None, run_dir: Path | None, max_gb: float, outputs: Outputs, out: Console, err: Console
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
            await gather_logs(hosts, name, path, told_on(err), max_gb)
            return path

    return conclude_again(asyncio.run(fetch()), out, outputs)


def collection_folder(path: Path) -> Path:
    """Make the folder of a collection, which may hold a part of it already; raises `DataError`."""
    with file_faults(path, "cannot be created"):
        path.mkdir(parents=True, exist_ok=True)
    return path


def told_on(err: Console) -> Callable[[str], None]:
    """Return the function that prints a line for each log."""
    return lambda text: err.print(text, style="dim", markup=False, soft_wrap=True)
