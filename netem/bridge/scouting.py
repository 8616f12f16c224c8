"""Applications that find each other past netem: those of both networks that answer to Zenoh's multicast scouting.

An application with Zenoh's default settings is a peer. It looks for others by multicast and connects to all that
answer, besides what it was told to connect to. Nothing of that crosses netem, and no probe of netem's shows it.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final

import zenoh

from common.channels import Network

_EVERY_S: Final = 5.0
_LISTEN_S: Final = 1.0
_AGAIN_S: Final = 60.0
_REMEDY: Final = "let them be clients (mode: client), or set scouting/multicast/enabled to false"


class Scouting:
    """Looks every 5 s, for a second, who answers to multicast scouting, and whether both networks have one.

    A bypass is told to ``on_leak``, once; to ``on_danger`` again every minute while it lasts, and when the routers
    of both networks can be found, which an application with default settings would join. ``step`` and ``close`` are
    called from one thread.
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
        self._said_s: dict[str, float] = {}

    def step(self, now_s: float) -> None:
        """Begin to look or to judge what was found, when it is time; ``now_s`` is monotonic."""
        if now_s < self._next_s:
            return
        if self._scout is None:
            self._begin()
            self._next_s = now_s + _LISTEN_S
        else:
            self.close()
            self._judge(now_s)
            self._next_s = now_s + _EVERY_S - _LISTEN_S

    def close(self) -> None:
        """Stop looking."""
        if self._scout is not None:
            self._scout.stop()
            self._scout = None

    def _begin(self) -> None:
        self._found = found = {}

        def note(hello: zenoh.Hello) -> None:
            found[str(hello.zid)] = str(hello.whatami)

        with suppress(zenoh.ZError):  # a host without multicast: nobody finds anybody by it
            self._scout = zenoh.scout(note, what="peer|router", config=self._config)  # type: ignore[arg-type]

    def _judge(self, now_s: float) -> None:
        """Say what is wrong, if it is; kinds of answers by the network whose members gave them."""
        kinds = {
            network: {self._found[zid] for zid in _members(session) if zid in self._found}
            for network, session in self._sessions.items()
        }
        if not all(kinds.values()):
            return
        if "peer" in set.union(*kinds.values()):
            text = f"applications of both networks find each other past netem by multicast scouting: {_REMEDY}"
            self._say(text, now_s, self._on_leak)
        else:
            text = (
                "the routers of both networks answer to multicast scouting: applications with Zenoh's default "
                f"settings would join both, past netem; {_REMEDY}"
            )
            self._say(text, now_s, self._on_danger)

    def _say(self, text: str, now_s: float, at_first: Callable[[str], None]) -> None:
        said_s = self._said_s.get(text)
        if said_s is None:
            at_first(text)
        elif now_s - said_s < _AGAIN_S:
            return
        else:
            self._on_danger(text)
        self._said_s[text] = now_s


def _members(session: zenoh.Session) -> set[str]:
    """Return whom a network consists of, as far as netem is connected with them."""
    return {str(zid) for zid in (*session.info.peers_zid(), *session.info.routers_zid())}
