"""Logs that are offered over Zenoh, as a source of a collection."""

import asyncio
import re
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from typing import Final

import zenoh
from pydantic import BaseModel, ValidationError

from tis.common.errors import Fault, PeerError
from tis.deploy.hosts.protocol import ListAnswer, printable
from tis.deploy.hosts.transfer.offered_logs import OfferedLog
from tis.deploy.hosts.transfer.zenoh_offer import CHUNK_BYTES, ListQuery, ReadQuery, key_of

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
