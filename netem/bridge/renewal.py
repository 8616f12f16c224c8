"""netem's renewed certificate, taken into use while a run goes on: open connections go on, new ones meet the new one.

Zenoh reads a listener's certificate once, when it listens, and has no call that replaces a listener. But it tries
again and again to listen where an endpoint was in use; and the sockets are this process's own. So each TLS endpoint
is named more than once: the first one listens, the others are spares, which find it in use. To renew, the listening
socket is given up, and a spare takes its place, with the files as they are then. A session that closes while a spare
waits would take ten seconds.
"""

import os
import socket
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from tis.common.runtime.connections import own_sockets
from tis.common.runtime.credentials import tls_settings
from tis.common.runtime.tls_links import CertificateWatch
from tis.common.zenoh_syntax import port_of

N_SPARES: Final = 2  # each costs 0.14 % of a processor
_TRY_MS: Final = 500
_PATIENCE_S: Final = 5.0
_POLL_S: Final = 0.002
_WAITS: Final = (
    f"exit_on_failure=false;retry_period_init_ms={_TRY_MS};retry_period_max_ms={_TRY_MS};"
    "retry_period_increase_factor=1"
)


def with_spares(endpoint: str) -> list[str]:
    """Return an endpoint to listen on, and its spares, which try again twice a second."""
    if not _port(endpoint):
        return [endpoint]
    return [endpoint, *[f"{endpoint}{';' if '#' in endpoint else '#'}{_WAITS}"] * N_SPARES]


def _port(endpoint: str) -> int:
    """Return the TCP port of a TLS endpoint, 0 without one."""
    return (port_of(endpoint) or 0) if endpoint.startswith("tls/") else 0


class RenewedListeners:
    """Takes a new certificate in ``folder`` into use, until `close`, which must come before a session closes.

    ``listen`` are the endpoints of all sessions. ``tell`` gets what happened, and how long nobody could connect.
    """

    def __init__(self, folder: Path, listen: Iterable[str], tell: Callable[[str], None]) -> None:
        self._folder, self._tell = folder, tell
        self._ports: Final = set(map(_port, listen)) - {0}
        self._spares = N_SPARES if self._ports else 0
        self._watch = CertificateWatch(folder, self._renew, tell)

    def close(self) -> None:
        """Let the spares that are left listen, so that none waits; a second call does nothing."""
        self._watch.close()
        while self._spares and self._replace():
            pass

    def _renew(self, _: bytes) -> None:
        tls_settings(self._folder, listens=True)
        self._tell(self._renewed())

    def _renewed(self) -> str:
        if not self._spares:
            return f"the certificate was renewed more than {N_SPARES} times: netem takes it at its next start"
        begun_s = time.monotonic()
        if not self._replace():
            return f"the certificate was renewed, but netem could not listen again within {_PATIENCE_S:g} s"
        gap_ms = 1e3 * (time.monotonic() - begun_s)
        return f"the certificate was renewed: open connections went on, new ones had to wait for {gap_ms:.0f} ms"

    def _replace(self) -> bool:
        """Give the listening sockets up, and wait until spares listen; tell whether all do."""
        self._spares -= 1
        before = self._listening()
        with socket.socket() as dead:
            for number in before:  # the number stays taken: Zenoh goes on to believe that it listens there
                os.dup2(dead.fileno(), number, inheritable=False)
        until_s = time.monotonic() + _PATIENCE_S
        while len(self._listening()) < len(before):
            if time.monotonic() > until_s:
                self._spares = 0
                return False
            time.sleep(_POLL_S)
        return True

    def _listening(self) -> list[int]:
        """Return the descriptors of the sockets that listen on netem's TLS ports."""
        return [
            number
            for number, found in own_sockets()
            if found.family in (socket.AF_INET, socket.AF_INET6)
            and found.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
            and found.getsockname()[1] in self._ports
        ]
