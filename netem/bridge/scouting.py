"""Detection of ways around the bridge by multicast scouting.

An application with Zenoh's default settings is a peer. It scouts by multicast and connects to all that answer,
in addition to its configured endpoints. That traffic does not cross netem, and probes do not detect it.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final

import zenoh

from tis.common.channels import Network
from tis.netem.bridge.bypass import Bypasses, members

_PERIOD_S: Final = 5.0
_LISTEN_S: Final = 1.0
_REMINDER_S: Final = 60.0
_SCOUTED: Final = "applications of both networks find each other past netem by multicast scouting: "
_DANGER: Final = (
    "the routers of both networks answer to multicast scouting: applications with Zenoh's default settings would "
    "join both, past netem; "
)
_REMEDY: Final = "let them be clients (mode: client), or set scouting/multicast/enabled to false"


class Scouting:
    """A search every 5 s, for 1 s, for members of both networks that answer to multicast scouting.

    ``bypasses`` gets a bypass with its pairs of programs. ``on_danger`` gets it again every minute while it lasts,
    and the case that the routers of both networks answer, which applications with default settings would join. Call
    `step` and `close` from one thread.
    """

    def __init__(
        self,
        sessions: Mapping[Network, zenoh.Session],
        config: zenoh.Config,
        bypasses: Bypasses,
        on_danger: Callable[[str], None],
    ) -> None:
        self._sessions = sessions
        self._config = config
        self._bypasses = bypasses
        self._on_danger = on_danger
        self._found: dict[str, str] = {}
        self._scout: Any = None
        self._next_s = 0.0
        self._warned_s: dict[str, float] = {}

    def step(self, now_s: float) -> None:
        """Begin a search, or judge its result, when it is due; ``now_s`` is monotonic."""
        if now_s < self._next_s:
            return
        if self._scout is None:
            self._begin()
            self._next_s = now_s + _LISTEN_S
        else:
            self.close()
            self._judge(now_s)
            self._next_s = now_s + _PERIOD_S - _LISTEN_S

    def close(self) -> None:
        """Stop the search."""
        if self._scout is not None:
            self._scout.stop()
            self._scout = None

    def _begin(self) -> None:
        self._found = found = {}

        def note(hello: zenoh.Hello) -> None:
            found[str(hello.zid)] = str(hello.whatami)

        with suppress(zenoh.ZError):  # a host without multicast has no bypass by it
            self._scout = zenoh.scout(note, what="peer|router", config=self._config)  # type: ignore[arg-type]

    def _judge(self, now_s: float) -> None:
        """Report a bypass or a danger, by the kinds of members of each network that answered."""
        kinds: dict[Network, dict[str, str]] = {
            network: {zid: self._found[zid] for zid in members(session) if zid in self._found}
            for network, session in self._sessions.items()
        }
        if not all(kinds.values()):
            return
        pairs = {
            (west, east)
            for west, one in kinds["west"].items()
            for east, other in kinds["east"].items()
            if "peer" in (one, other)
        }
        text = f"{_SCOUTED if pairs else _DANGER}{_REMEDY}"
        is_told = text in self._warned_s and self._bypasses.has(pairs)
        if is_told and now_s - self._warned_s[text] < _REMINDER_S:
            return
        if not is_told and pairs:
            self._bypasses.add(text, pairs)
        else:
            self._on_danger(text)
        self._warned_s[text] = now_s
