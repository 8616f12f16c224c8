"""`tis collect` without ssh: each host offers its run folder over Zenoh, and one collects.

Either end may listen: the offering host, or the collector, where only its host can be reached or has a server's
certificate, as netem's.
"""

import asyncio
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final, get_args

import zenoh
from rich.console import Console

from tis.common.channels import Side
from tis.common.errors import EXIT_OK, DataError, Fault, PeerError
from tis.common.runtime.process import Interrupt
from tis.common.runtime.scenario_files import run_folder
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_client, open_router, visitor
from tis.deploy.hosts.collect import collection_folder, told_on
from tis.deploy.hosts.transfer.fetch import Collection
from tis.deploy.hosts.transfer.offered_logs import log_names
from tis.deploy.hosts.transfer.zenoh_logs import ZenohOffer, offers
from tis.deploy.run.conclude import Outputs, conclude_again

_WHO: Final = "tis collect"
_LOOK_EVERY_S: Final = 0.5


def offer_logs(folder: Path, options: ZenohOptions, err: Console) -> int:
    """Offer a run folder's logs at the endpoints of ``options`` until Ctrl-C; return the exit code."""
    names = log_names(folder)
    if not names:
        raise DataError(Fault(str(folder), "", "holds no log of a side"))
    interrupt = Interrupt()
    with interrupt.installed(), ExitStack() as stack:
        sessions = _sessions(stack, options, lambda: interrupt.requested, err)
        if sessions is None:
            return EXIT_OK
        for session, _ in sessions:
            stack.enter_context(ZenohOffer(session, folder, told_on(err)))
        places = ", ".join((*options.listen, *options.connect))
        err.print(f"offering {', '.join(names)} at {places}; Ctrl-C ends it", soft_wrap=True, markup=False)
        while not interrupt.requested:
            time.sleep(_LOOK_EVERY_S)
    return EXIT_OK


def collect_over_zenoh(
    options: ZenohOptions, run_dir: Path | None, wait_s: float | None, outputs: Outputs, out: Console, err: Console
) -> int:
    """Fetch the logs that are offered at the endpoints of ``options`` and summarise them; return the exit code.

    Where it listens it waits until a log of each side is there, at most ``wait_s``. Raises `TisError`.
    """
    folder = collection_folder(run_dir or run_folder(Path("runs"), "collected"))
    deadline_s = None if wait_s is None else time.monotonic() + wait_s

    def is_over() -> bool:
        return deadline_s is not None and time.monotonic() > deadline_s

    collection = Collection(folder, told_on(err))
    with ExitStack() as stack:
        sessions = _sessions(stack, options, is_over, err)
        if sessions is None:
            raise PeerError(Fault(_WHO, ", ".join(options.connect), f"nobody answered within {wait_s:g} s"))
        asyncio.run(_collect(collection, sessions, bool(options.listen), is_over, err))
    return conclude_again(folder, out, outputs)


async def _collect(
    collection: Collection, sessions: Sequence[tuple[zenoh.Session, str]], waits: bool, is_over: Callable[[], bool],
    err: Console,
) -> None:  # fmt: skip
    """Fetch what is offered; raises `PeerError` when an endpoint offers nothing or a side's log does not come."""
    done: set[str] = set()
    told = ""
    while True:
        for session, place in sessions:
            found = await asyncio.to_thread(offers, session, place)
            if not found and not waits:
                raise PeerError(Fault(_WHO, place, "offers no logs: start `tis collect --offer RUN_DIR` there"))
            for source in found:
                if source.number not in done:
                    await collection.fetch_all(source)
                    done.add(source.number)
        names = log_names(collection.folder)
        missing = [side for side in get_args(Side) if not any(name.startswith(side) for name in names)]
        if not waits or not missing:
            return
        if is_over():
            raise PeerError(Fault(_WHO, "", f"nobody offered a log of {' and '.join(missing)} in time"))
        text = f"waiting for the logs of {' and '.join(missing)}"
        if text != told:
            err.print(text, style="dim")
            told = text
        await asyncio.sleep(_LOOK_EVERY_S)


def _sessions(
    stack: ExitStack, options: ZenohOptions, stopped: Callable[[], bool], err: Console
) -> list[tuple[zenoh.Session, str]] | None:
    """Open a router that listens, or a client of each endpoint, with its place in words; None when ``stopped``."""
    if options.listen:
        config = configure("router", replace(options, connect=()))
        session = stack.enter_context(open_router(config, ", ".join(options.listen), _WHO))
        return [(session, "a host")]
    found: list[tuple[zenoh.Session, str]] = []
    for endpoint in options.connect:
        with _told_once(err, f"waiting for {endpoint}") as tell:
            client = open_client(visitor(endpoint, options), stopped, tell)
        if client is None:
            return None
        found.append((stack.enter_context(client), endpoint))
    return found


@contextmanager
def _told_once(err: Console, text: str) -> Iterator[Callable[[], None]]:
    """Return a function that prints a text at its first call."""
    left = [text]
    yield lambda: err.print(left.pop(), style="dim", markup=False) if left else None
