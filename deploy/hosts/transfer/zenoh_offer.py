"""A run folder offered over Zenoh, read only: a list of its logs, and their bytes in chunks.

Each offer has a number of its own in its keys, ``tis/@logs/NUMBER/here``, ``.../list`` and ``.../read``; no wildcard
of an application matches them. Queries may come from anybody who is let in: sizes and names are checked, and a queue
of limited length takes them out of Zenoh's callbacks.
"""

import contextlib
import queue
import secrets
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import zenoh
from pydantic import Field, ValidationError

from tis.common.errors import TisError
from tis.common.scenario.base import Part
from tis.deploy.hosts.protocol import ListAnswer
from tis.deploy.hosts.transfer.offered_logs import LogName, offered_logs, read_range

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
