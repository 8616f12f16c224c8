"""Revoked names: netem cuts their connections while a run goes on, each as soon as it opens.

Zenoh tells the name in a client's certificate, and no more of it. So a revoked name stays out, whatever its
certificate, until its line is gone from the file.
"""

import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import zenoh

from tis.common.audit import Happening
from tis.common.channels import Network
from tis.common.refusal import MAX_BYTES, NONE_REVOKED, REVOKED_FILE, read_revoked
from tis.common.runtime.tls_links import address_of, cut
from tis.netem.bridge.audit import AuditTrail

_EVERY_S: Final = 0.5


class Revocations:
    """Reads the file of revoked names again and again; ``tell`` gets whom it concerns, once, and its faults."""

    def __init__(self, folder: Path, audit: AuditTrail, tell: Callable[[str], None]) -> None:
        self._file, self._audit, self._tell = folder / REVOKED_FILE, audit, tell
        self._revoked = NONE_REVOKED
        self._content = b""
        self._lock = threading.Lock()  # guards what follows
        self._open: dict[str, tuple[Network, str, str]] = {}
        self._told: set[str] = set()
        self._over = threading.Event()

    def watch(self, stack: ExitStack, sessions: Mapping[Network, zenoh.Session]) -> None:
        """Cut the connections of revoked names until ``stack`` closes, before the sessions."""
        self._look()
        held: list[Any] = [
            session.info.declare_link_events_listener(self._taker(network), history=True)
            for network, session in sessions.items()
        ]
        thread = threading.Thread(target=self._serve, name="revocations", daemon=True)
        thread.start()

        def close() -> None:
            self._over.set()
            thread.join(1.0)
            for one in held:
                one.undeclare()

        stack.callback(close)

    def _taker(self, network: Network) -> Callable[[zenoh.LinkEvent], None]:
        def take(event: zenoh.LinkEvent) -> None:
            link = event.link
            key, end = f"{link.zid} {link.dst}", address_of(str(link.dst))
            with self._lock:
                if event.kind == zenoh.SampleKind.PUT:
                    self._open[key] = (network, end, link.auth_identifier or "")
                else:
                    self._open.pop(key, None)
            if event.kind == zenoh.SampleKind.PUT:
                self._cut()

        return take

    def _serve(self) -> None:
        while not self._over.wait(_EVERY_S):
            self._look()
            self._cut()

    def _look(self) -> None:
        """Read the file, if it has changed; one that has gone revokes nobody, an unreadable one changes nothing."""
        content = b""
        try:
            with self._file.open("rb") as file:
                content = file.read(MAX_BYTES + 1)
        except FileNotFoundError:
            pass
        except OSError as error:
            if REVOKED_FILE not in self._told:
                self._told.add(REVOKED_FILE)
                self._tell(f"{self._file}: cannot be read, what was revoked stays so: {error.strerror}")
            return
        if content != self._content:
            self._content = content
            self._revoked = read_revoked(content)
            for fault in self._revoked.faults:
                self._tell(f"{self._file}: {fault}")

    def _cut(self) -> None:
        """Cut what is open of revoked names."""
        names = self._revoked.names
        if not names:
            return
        with self._lock:
            found = [one for one in self._open.values() if one[2] in names]
        for network, end, name in found:
            if cut({end}):
                self._audit.refusals.add("revoked")
                self._audit.note(Happening("refused", "revoked", network, end, name))
            if name not in self._told:
                self._told.add(name)
                self._tell(f"netem refused a client whose certificate is revoked from {end}, named {name}")
