"""Exchange of scenarios between two sides that found their digests different: it tells in which fields."""

import contextlib
import json
import threading
from collections.abc import Mapping
from types import TracebackType
from typing import Any, Final, Self

import zenoh

from tis.common.channels import Network, Side
from tis.common.runtime.control import ControlKeys
from tis.common.scenario import Scenario
from tis.common.scenario.reading import agreed_fields, checked_fields, differences, in_words

MAX_BYTES: Final = 500_000
_ANSWER_S: Final = 3.0
_LINGER_S: Final = 2.0


class ScenarioExchange:
    """Answers the other sides' questions for this side's scenario, and asks for theirs.

    A side that asked stays for a moment, so that the other one, which ends for the same reason, gets its answer.
    """

    def __init__(
        self, sessions: Mapping[Network, zenoh.Session], keys: ControlKeys, side: Side, scenario: Scenario
    ) -> None:
        self._sessions = sessions
        self._keys = keys
        self._fields: Final = agreed_fields(scenario)
        self._has_asked = False
        self._was_asked = threading.Event()
        own, text = keys.scenario(side), json.dumps(self._fields)

        def answer(query: zenoh.Query) -> None:
            with contextlib.suppress(zenoh.ZError), query:  # who asked may be gone
                query.reply(own, text)
            self._was_asked.set()

        self._held: list[Any] = [
            session.declare_queryable(own, answer, complete=True, allowed_origin=zenoh.Locality.REMOTE)
            for session in sessions.values()
        ]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._has_asked:
            self._was_asked.wait(_LINGER_S)
        for queryable in self._held:
            queryable.undeclare()
        self._held.clear()

    def difference(self, network: Network, side: Side) -> str:
        """Return in which fields a side's scenario differs, as text; empty when it does not answer."""
        self._has_asked = True
        key = self._keys.scenario(side)
        for reply in self._sessions[network].get(key, timeout=_ANSWER_S):
            ok = reply.ok
            if ok is None or str(ok.key_expr) != key or len(ok.payload) > MAX_BYTES:
                continue
            there = checked_fields(ok.payload.to_bytes())
            if there is not None:
                return in_words(differences(self._fields, there))
        return ""
