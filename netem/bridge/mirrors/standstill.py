"""A router of netem's own that routes nothing ever after: noticed, said, and ended in spite of it.

Nothing here reads a router's admin space, but whoever turns it on (``--cfg adminspace/enabled:true``) may have others
read it, and up to Zenoh 1.10 that may lock the routing tables for ever (zenoh's pull request 2619). The process lives
and takes connections, but hands nothing on, and closing its sessions hangs.
"""

import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final, Protocol

import zenoh

from common.errors import Fault, PeerError

_PATIENCE_S: Final = 3.0
_LAST_WORDS_S: Final = 3.0
_NOBODY: Final = "@tis/netem/nobody"


class Failing(Protocol):
    """What ends when it is told what went wrong: the bridge."""

    def failed(self, error: BaseException) -> None:
        """Keep what went wrong, and end."""


def stands_still(session: zenoh.Session, patience_s: float = _PATIENCE_S) -> bool:
    """Tell whether a session cannot even declare something of its own within ``patience_s``."""
    declared = threading.Event()

    def declare() -> None:
        with suppress(zenoh.ZError):  # a refusal is an answer, too
            session.declare_querier(_NOBODY).undeclare()  # type: ignore[no-untyped-call]
        declared.set()

    threading.Thread(target=declare, name="standstill", daemon=True).start()
    return not declared.wait(patience_s)


def end(bridge: Failing, network: str, say: Callable[[str], None]) -> None:
    """Say why, end the bridge, which closes its log, and 3 s later the process: its sessions cannot be closed."""
    rule = "netem's own session stands still and routes nothing: start netem anew, and read no admin space of it"
    error = PeerError(Fault("netem", f"the {network} network", rule))
    say(str(error.faults[0]))
    bridge.failed(error)

    def leave() -> None:
        time.sleep(_LAST_WORDS_S)
        os._exit(error.exit_code)

    threading.Thread(target=leave, name="leave", daemon=True).start()
