"""Detection of applications that bypass netem by Zenoh's multicast scouting.

An application with Zenoh's default settings is a peer. It scouts by multicast and connects to all that answer, in
addition to its configured endpoints. That traffic does not cross netem, and netem's probes do not detect it.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final

import zenoh

from tis.common.channels import Network

_PERIOD_S: Final = 5.0
_LISTEN_S: Final = 1.0
_REMINDER_S: Final = 60.0
_REMEDY: Final = "let them be clients (mode: client), or set scouting/multicast/enabled to false"


class Scouting:
    """A search every 5 s, for 1 s, for members of both networks that answer to multicast scouting.

    ``on_leak`` gets a bypass, once. ``on_danger`` gets it again every minute while it lasts, and also the case that
    the routers of both networks answer, which applications with default settings would join. Call `step` and `close`
    from one thread.
    """

    def __init__(
        self,
        sessions: Mapping[Network, zenoh.Session],
        config: zenoh.Config,
        on_leak: Callable[[str], None],
        on_danger: Callable[[str], None],
    ) -> None:
        self._sessions = sessions
        self._config = config
        self._on_leak = on_leak
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
        kinds = {
            network: {self._found[zid] for zid in _members(session) if zid in self._found}
            for network, session in self._sessions.items()
        }
        if not all(kinds.values()):
            return
        if "peer" in set.union(*kinds.values()):
            text = f"applications of both networks find each other past netem by multicast scouting: {_REMEDY}"
            self._report(text, now_s, self._on_leak)
        else:
            text = (
                "the routers of both networks answer to multicast scouting: applications with Zenoh's default "
                f"settings would join both, past netem; {_REMEDY}"
            )
            self._report(text, now_s, self._on_danger)

    def _report(self, text: str, now_s: float, at_first: Callable[[str], None]) -> None:
        warned_s = self._warned_s.get(text)
        if warned_s is None:
            at_first(text)
        elif now_s - warned_s < _REMINDER_S:
            return
        else:
            self._on_danger(text)
        self._warned_s[text] = now_s


def _members(session: zenoh.Session) -> set[str]:
    """Return the members of a network to which netem is connected."""
    return {str(zid) for zid in (*session.info.peers_zid(), *session.info.routers_zid())}
