"""Detection of a deadlock of netem's own router, and the end of the process despite it.

netem never reads a router's admin space, but with ``--cfg adminspace/enabled:true`` others may read it, and up to
Zenoh 1.10 that may lock the routing tables forever (Zenoh's pull request 2619). The process then accepts connections
but routes nothing, and closing its sessions hangs.
"""

import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Final, Protocol

import zenoh

from tis.common.errors import Fault, PeerError

_TIMEOUT_S: Final = 3.0
_CLOSING_S: Final = 3.0
_UNUSED_KEY: Final = "@tis/netem/nobody"


def is_answered(session: zenoh.Session, timeout_s: float = _TIMEOUT_S) -> bool:
    """Tell whether the routers of a session answer within ``timeout_s``: a session without any answers itself."""
    ended, failed = threading.Event(), threading.Event()

    def take(reply: zenoh.Reply) -> None:
        if reply.ok is None:
            failed.set()

    with suppress(zenoh.ZError):
        handler = zenoh.handlers.Callback(take, ended.set, indirect=False)
        session.liveliness().get(_UNUSED_KEY, handler, timeout=timeout_s)
        return ended.wait(2 * timeout_s) and not failed.is_set()
    return False


class Failing(Protocol):
    """The bridge, as far as needed here."""

    def failed(self, error: BaseException) -> None:
        """Keep the error, and end."""


def is_deadlocked(session: zenoh.Session, timeout_s: float = _TIMEOUT_S) -> bool:
    """Tell whether a session cannot declare anything within ``timeout_s``."""
    declared = threading.Event()

    def declare() -> None:
        with suppress(zenoh.ZError):  # a refusal is an answer too
            session.declare_querier(_UNUSED_KEY).undeclare()  # type: ignore[no-untyped-call]
        declared.set()

    threading.Thread(target=declare, name="deadlock", daemon=True).start()
    return not declared.wait(timeout_s)


def router_deadlock(network: str) -> Fault:
    """Return the fault of a router session that routes nothing any more."""
    rule = "netem's own session is deadlocked and routes nothing: restart netem, and do not read its admin space"
    return Fault("netem", f"the {network} network", rule)


def end_process(bridge: Failing, fault: Fault, report: Callable[[str], None]) -> None:
    """Report the reason, end the bridge, which closes its log, and 3 s later the process, whose sessions hang."""
    error = PeerError(fault)
    report(str(error.faults[0]))
    bridge.failed(error)

    def leave() -> None:
        time.sleep(_CLOSING_S)
        os._exit(error.exit_code)

    threading.Thread(target=leave, name="leave", daemon=True).start()
