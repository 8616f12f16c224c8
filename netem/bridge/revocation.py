"""Revoked names: netem cuts their connections while a run goes on, each as soon as it opens.

Zenoh tells the name in a client's certificate, and no more of it. So a revoked name stays out, whatever its
certificate, until its line is gone from the file.
"""

import json
import threading
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import zenoh

from tis.common.audit import Happening
from tis.common.channels import Network
from tis.common.refusal import MAX_BYTES, REVOKED_FILE, read_revoked
from tis.common.runtime.connections import address_of, cut
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.netem.bridge.audit import AuditTrail

_EVERY_S: Final = 0.5
_TLS: Final = "transport/link/tls"
_FILES: Final = ("listen_certificate", "root_ca_certificate")


def watch_revoked(
    stack: ExitStack, options: ZenohOptions, audit: AuditTrail | None, sessions: Mapping[Network, zenoh.Session],
    listen: Iterable[str], tell: Callable[[str], None],
) -> None:  # fmt: skip
    """Watch the files beside the certificates of a netem without a scenario, if its clients need any."""
    config = configure("client", options)
    if config.get_json(f"{_TLS}/enable_mtls") != "true":
        return
    folders = _folders(config, options.config)
    if not folders:
        tell(f"{REVOKED_FILE} is not watched, no revoked name is refused: no file says where the certificates are")
        return
    for endpoint in listen:
        if endpoint.startswith("quic/"):  # its connections share a socket, so none can be cut
            tell(f"revoked names are not refused at {endpoint}: only connections over tls/ are cut")
    Revocations(folders, audit, tell).watch(stack, sessions)


def _folders(config: zenoh.Config, file: Path | None) -> list[Path]:
    """Return the folders of the certificates and of the file that may hold them, each with the one above."""
    files = [json.loads(config.get_json(f"{_TLS}/{name}")) for name in _FILES]
    places = [Path(one).absolute().parent for one in (*files, file) if one]
    return list(dict.fromkeys(folder for place in places for folder in (place, place.parent)))


class Revocations:
    """Reads the files of revoked names again and again; ``tell`` gets whom they concern, once, and their faults."""

    def __init__(self, folders: Iterable[Path], audit: AuditTrail | None, tell: Callable[[str], None]) -> None:
        self._files, self._audit, self._tell = [folder / REVOKED_FILE for folder in folders], audit, tell
        self._names: frozenset[str] = frozenset()
        self._in_file: dict[Path, tuple[bytes, frozenset[str]]] = {}
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
                if event.kind == zenoh.SampleKind.PUT and not str(link.dst).startswith("quic/"):
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
        """Read each file, if it has changed."""
        for file in self._files:
            self._read(file)
        self._names = frozenset[str]().union(*(names for _, names in self._in_file.values()))

    def _read(self, file: Path) -> None:
        """Read a file; one that has gone revokes nobody, an unreadable one changes nothing."""
        content = b""
        try:
            with file.open("rb") as opened:
                content = opened.read(MAX_BYTES + 1)
        except FileNotFoundError:
            pass
        except OSError as error:
            if str(file) not in self._told:
                self._told.add(str(file))
                self._tell(f"{file}: cannot be read, what was revoked stays so: {error.strerror}")
            return
        if content != self._in_file.get(file, (b"",))[0]:
            revoked = read_revoked(content)
            self._in_file[file] = content, revoked.names
            for fault in revoked.faults:
                self._tell(f"{file}: {fault}")

    def _cut(self) -> None:
        """Cut what is open of revoked names."""
        names = self._names
        if not names:
            return
        with self._lock:
            found = [one for one in self._open.values() if one[2] in names]
        for network, end, name in found:
            if cut({end}) and self._audit is not None:
                self._audit.refusals.add("revoked")
                self._audit.note(Happening("refused", "revoked", network, end, name))
            if name not in self._told:
                self._told.add(name)
                self._tell(f"netem refused a client whose certificate is revoked from {end}, named {name}")
