"""Logs over Zenoh: a run folder offered read only, and the offer as a source of a collection."""

import asyncio
import contextlib
import queue
import re
import secrets
import threading
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import zenoh
from pydantic import BaseModel, Field, ValidationError

from tis.common.errors import Fault, PeerError, TisError
from tis.common.scenario.base import Part
from tis.deploy.hosts.protocol import ListAnswer, printable
from tis.deploy.hosts.transfer.offered_logs import LogName, OfferedLog, offered_logs, read_range

# A run folder offered over Zenoh, read only: a list of its logs, and their bytes in chunks.
#
# Each offer has a number of its own in its keys, ``tis/@logs/NUMBER/here``, ``.../list`` and ``.../read``; no
# wildcard of an application matches them. Queries may come from anybody who is let in: sizes and names are checked,
# and a queue of limited length takes them out of Zenoh's callbacks.

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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
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
