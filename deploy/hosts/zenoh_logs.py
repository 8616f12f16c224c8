"""`tis collect` without ssh: each host offers its run folder over Zenoh, read only, and one collects.

Either end may listen: the offering host, or the collector, where only its host can be reached or has a server's
certificate, as netem's. Each offer has a number of its own in its keys, ``tis/@logs/NUMBER/here``, ``.../list`` and
``.../read``; no wildcard of an application matches them. Queries may come from anybody who is let in: sizes and names
are checked, and a queue of limited length takes them out of Zenoh's callbacks.
"""

import asyncio
import contextlib
import queue
import re
import secrets
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Self, get_args

import zenoh
from pydantic import BaseModel, Field, ValidationError
from rich.console import Console

from tis.common.channels import Side
from tis.common.errors import EXIT_OK, DataError, Fault, PeerError, TisError
from tis.common.runtime.connections import closing
from tis.common.runtime.process import Interrupt
from tis.common.runtime.run_folders import run_folder
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_client, open_router, visitor
from tis.common.scenario.base import Part
from tis.deploy.hosts.collect import collection_folder, told_on
from tis.deploy.hosts.log_offer import LogName, OfferedLog, log_names, offered_logs, read_range
from tis.deploy.hosts.protocol import ListAnswer, printable
from tis.deploy.hosts.transfer import BYTES_PER_GB, Collection
from tis.deploy.run.conclude import Outputs, conclude_again

CHUNK_BYTES: Final = 256 * 1024
MAX_QUERY_BYTES: Final = 16_384
_MAX_WAITING: Final = 16


class ListQuery(Part):
    """Asks for the logs; ``parts`` are the sizes of what was fetched before, by name."""

    parts: dict[LogName, int] = Field(default={}, max_length=100)


class ReadQuery(Part):
    """Asks for the bytes of a log from ``begin`` to before ``end``, at most `CHUNK_BYTES`."""

    name: LogName
    begin: int = Field(ge=0)
    end: int = Field(ge=0)


def key_of(number: str, operation: str) -> str:
    """Return the key of an offer's operation; ``*`` as the number stands for every offer."""
    return f"tis/@logs/{number}/{operation}"


def answer(folder: Path, operation: str, payload: bytes) -> bytes:
    """Return the answer to a query on a folder, or raise `ValueError` or `TisError` with what is wrong with it."""
    if operation == "here":
        return b""
    if operation == "list":
        asked = ListQuery.model_validate_json(payload or b"{}")
        return ListAnswer(logs=tuple(offered_logs(folder, asked.parts))).model_dump_json().encode()
    if operation != "read":
        raise ValueError("no such operation")
    wanted = ReadQuery.model_validate_json(payload)
    end = min(wanted.end, wanted.begin + CHUNK_BYTES)
    return b"".join(read_range(folder, wanted.name, wanted.begin, end))


class ZenohOffer:
    """Answers the queries of collectors on a session, in a thread of its own, until closed."""

    def __init__(self, session: zenoh.Session, folder: Path, told: Callable[[str], None]) -> None:
        self.number: Final = secrets.token_hex(8)
        self._folder = folder
        self._told = told
        self._was_asked = False
        self._waiting: queue.Queue[zenoh.Query | None] = queue.Queue(_MAX_WAITING)
        self._thread = threading.Thread(target=self._serve, name="offer", daemon=True)
        self._thread.start()
        handler = zenoh.handlers.Callback(self._take, indirect=False)
        self._queryable: Any = session.declare_queryable(key_of(self.number, "*"), handler, complete=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._queryable.undeclare()
        self._waiting.put(None)
        self._thread.join()

    def _take(self, query: zenoh.Query) -> None:
        try:
            self._waiting.put_nowait(query)
        except queue.Full:  # the collector asks again
            query.drop()  # type: ignore[no-untyped-call]

    def _serve(self) -> None:
        while (query := self._waiting.get()) is not None:
            with contextlib.suppress(zenoh.ZError), query:  # the collector may be gone
                self._answer(query)

    def _answer(self, query: zenoh.Query) -> None:
        operation = str(query.key_expr).rpartition("/")[2]
        payload = query.payload
        n_bytes = 0 if payload is None else len(payload)
        try:
            if n_bytes > MAX_QUERY_BYTES:
                raise ValueError("too long")
            found = answer(self._folder, operation, b"" if payload is None else payload.to_bytes())
        except (ValueError, ValidationError):
            query.reply_err("this is no query of a collector")
            return
        except TisError as error:
            query.reply_err(str(error))
            return
        query.reply(key_of(self.number, operation), found)
        if not self._was_asked:
            self._was_asked = True
            self._told("a collector reads the logs")


_LIST_S: Final = 600.0
"""A source reads every byte of its logs for their SHA-256 before it answers."""
_READ_S: Final = 30.0
_HERE_S: Final = 5.0
_MAX_LIST_BYTES: Final = 100_000
_MAX_OFFERS: Final = 32
_NUMBER: Final = re.compile(r"[0-9a-f]{16}")


def offers(session: zenoh.Session, place: str) -> list["ZenohLogs"]:
    """Return the offers that a session reaches, by number."""
    found: set[str] = set()
    for reply in session.get(key_of("*", "here"), timeout=_HERE_S):
        number = str(reply.ok.key_expr).split("/")[2] if reply.ok is not None else ""
        if _NUMBER.fullmatch(number) and len(found) < _MAX_OFFERS:
            found.add(number)
    return [ZenohLogs(session, number, f"{place} ({number[:4]})") for number in sorted(found)]


@dataclass(frozen=True)
class ZenohLogs:
    """The logs of one offer."""

    session: zenoh.Session
    number: str
    place: str

    async def offered(self, parts: Mapping[str, int]) -> list[OfferedLog]:
        """Return the logs; raises `PeerError`."""
        payload = await self._ask("list", ListQuery(parts=dict(parts)), _LIST_S, _MAX_LIST_BYTES)
        try:
            return list(ListAnswer.model_validate_json(payload).logs)
        except ValidationError:
            raise PeerError(Fault(self.place, "", "its answer is not of this version of tis")) from None

    async def read(self, name: str, begin: int, end: int) -> AsyncIterator[bytes]:
        """Yield the bytes of a log; raises `PeerError`."""
        while begin < end:
            until = min(end, begin + CHUNK_BYTES)
            block = await self._ask("read", ReadQuery(name=name, begin=begin, end=until), _READ_S, until - begin)
            if not block:
                return
            begin += len(block)
            yield block

    async def _ask(self, operation: str, query: BaseModel, wait_s: float, max_bytes: int) -> bytes:
        return await asyncio.to_thread(self._ask_now, operation, query, wait_s, max_bytes)

    def _ask_now(self, operation: str, query: BaseModel, wait_s: float, max_bytes: int) -> bytes:
        key, reason = key_of(self.number, operation), "does not answer"
        for reply in self.session.get(key, payload=query.model_dump_json(), timeout=wait_s):
            if reply.ok is None:
                assert reply.err is not None
                reason = printable(reply.err.payload.to_bytes()[:2000].decode("utf-8", "replace"))
            elif str(reply.ok.key_expr) != key or len(reply.ok.payload) > max_bytes:
                reason = "answers what it was not asked"
            else:
                return reply.ok.payload.to_bytes()
        raise PeerError(Fault(self.place, "", reason))


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
    options: ZenohOptions, run_dir: Path | None, wait_s: float | None, max_gb: float, outputs: Outputs, out: Console,
    err: Console,
) -> int:  # fmt: skip
    """Fetch the logs that are offered at the endpoints of ``options`` and summarise them; return the exit code.

    Where it listens it waits until a log of each side is there, at most ``wait_s``. Raises `TisError`.
    """
    folder = collection_folder(run_dir or run_folder(Path("runs"), "collected"))
    deadline_s = None if wait_s is None else time.monotonic() + wait_s

    def is_over() -> bool:
        return deadline_s is not None and time.monotonic() > deadline_s

    collection = Collection(folder, told_on(err), max_bytes=int(max_gb * BYTES_PER_GB))
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
        session = stack.enter_context(closing(open_router(config, ", ".join(options.listen), _WHO), config))
        return [(session, "a host")]
    found: list[tuple[zenoh.Session, str]] = []
    for endpoint in options.connect:
        with _told_once(err, f"waiting for {endpoint}") as tell:
            config = visitor(endpoint, options)
            client = open_client(config, stopped, tell)
        if client is None:
            return None
        found.append((stack.enter_context(closing(client, config)), endpoint))
    return found


@contextmanager
def _told_once(err: Console, text: str) -> Iterator[Callable[[], None]]:
    """Return a function that prints a text at its first call."""
    left = [text]
    yield lambda: err.print(left.pop(), style="dim", markup=False) if left else None
